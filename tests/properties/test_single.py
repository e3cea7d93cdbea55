"""Where it is shown that a robot holds at most one fact of a predicate, it never holds two, whatever is drawn."""

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vm_hand import Hand

from rmr.analysis.at_most_one import several
from rmr.base.streams import Choices
from rmr.bytecode.program import Conjunct, Head, Kind, Program
from rmr.vm.engines import Engine, new_machine

FIRINGS = 40


def drawn(seed: int) -> Program:
    """Rules that pass tokens on, double, drop and keep them, and look whether there are none."""
    random = Random(seed)
    hand = Hand()
    tokens = [hand.temporary(name) for name in "abcde"]
    lasting = [hand.persistent(name) for name in "pq"]
    for token in tokens + lasting:
        if random.random() < 0.3:
            hand.fact(token, owner=random.choice([None, None, 1, 2]))
    for _each in range(random.randint(2, 6)):
        taken = random.sample(tokens, random.choice([0, 1, 1, 2]))
        body: list[Conjunct] = [hand.atom(each) if random.random() < 0.8 else hand.keep(each) for each in taken]
        body += [hand.atom(each) for each in lasting if random.random() < 0.15 or not body]
        body += [hand.absent(each) for each in tokens if random.random() < 0.15]
        head: list[Head] = [hand.head(token) for token in random.choices(tokens, k=random.choice([0, 1, 1, 1, 2]))]
        head += [hand.head(each) for each in lasting if random.random() < 0.1]
        hand.rule(body, head)
    return hand.program()


def most(program: Program, seed: int) -> list[int]:
    """How many facts of each predicate robots have held at most."""
    counts = [0] * len(program.predicates)
    for robot in (1, 2):
        machine = new_machine(program, robot, Choices(str(seed)), engine=Engine.INTERPRETER, firing_budget=1)
        machine.start(0)
        for _each in range(FIRINGS):
            counts = [max(count, len(machine.held(i))) for i, count in enumerate(counts)]
            machine.run(0)
    return counts


def check(seed: int) -> tuple[int, int]:
    """Return how many predicates are shown to hold one fact, and how many of the others hold several."""
    program = drawn(seed)
    doubted = {each.predicate for each in several(program, program.facts)}
    counts = most(program, seed)
    shown = [i for i in range(len(counts)) if i not in doubted and program.predicates[i].kind is Kind.TEMPORARY]
    assert all(counts[i] <= 1 for i in shown)
    return sum(counts[i] == 1 for i in shown), sum(counts[i] > 1 for i in doubted)


@pytest.mark.medium
@settings(deadline=None, max_examples=300)
@given(st.integers(0, 2**32))
def test_predicate_proved_single_never_holds_two_facts(seed: int) -> None:
    check(seed)


@pytest.mark.medium
def test_drawn_programs_include_proved_and_unproved_predicates() -> None:
    found = [check(seed) for seed in range(300)]
    assert sum(shown > 1 for shown, _ in found) > 60
    assert sum(doubted > 0 for _, doubted in found) > 30
