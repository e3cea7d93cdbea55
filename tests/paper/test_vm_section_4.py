"""The claims of the paper's sections IV.A and IV.B about byte-code and the runtime's workflow (figure 6)."""

import subprocess
import sys
from collections import Counter

import pytest
from vm_hand import AREA, Hand, V, actions, fired, started

from rmr.base.values import Symbol
from rmr.bytecode.codec import decode, encode
from rmr.bytecode.disassemble import disassemble
from rmr.bytecode.layout import read_layout


def choices(rules: int = 4, wanted: tuple[int, ...] = (), textual: bool = False) -> Hand:
    """One token and rules that all want it; some derive a goal."""
    hand = Hand(textual=textual)
    token = hand.temporary("token")
    results = [hand.temporary(f"result_{index}") for index in range(rules)]
    hand.fact(token)
    for result in results:
        hand.rule([hand.atom(token)], [hand.head(result)])
    for index in wanted:
        hand.goal(results[index])
    return hand


def chosen(hand: Hand, seeds: int = 600) -> Counter[int]:
    program = hand.program()
    return Counter(fired(started(program, seed=seed).drain())[0] for seed in range(seeds))


def test_iv_a_the_byte_code_holds_numbers_and_offsets_of_facts_and_rules() -> None:
    data = encode(choices().program(), debug=False)
    tables = read_layout(data).tables
    assert (tables["facts"].entries, tables["rules"].entries) == (1, 4)
    text = disassemble(data)
    assert f"; facts: 1 at 0x{tables['facts'].start:04x}" in text
    assert f"; rules: 4 at 0x{tables['rules'].start:04x}" in text
    assert decode(data) == choices().program()


def test_iv_b_rules_that_derive_goal_facts_have_the_higher_priority() -> None:
    assert set(chosen(choices(wanted=(2,)))) == {2}


def test_iv_b_among_rules_of_the_same_priority_one_is_chosen_at_random() -> None:
    low = chosen(choices())
    assert sorted(low) == [0, 1, 2, 3]
    assert all(100 < count < 200 for count in low.values())
    high = chosen(choices(wanted=(1, 3)))
    assert sorted(high) == [1, 3]
    assert all(240 < count < 360 for count in high.values())


def test_iv_b_the_order_of_the_text_decides_where_the_program_asks_for_it() -> None:
    assert set(chosen(choices(textual=True))) == {0}
    assert set(chosen(choices(textual=True, wanted=(3, 2)))) == {2}


def test_iv_b_the_machine_goes_on_until_no_rule_is_satisfied() -> None:
    machine = choices().machine()
    assert machine.quiescent
    assert machine.firings == 1


def test_iv_b_a_new_fact_sets_the_workflow_going_again() -> None:
    machine = choices().machine()
    machine.insert(5, 0, ())
    assert not machine.quiescent
    assert machine.next_wake == 5
    machine.run(5)
    assert machine.firings == 2


def test_iv_b_derived_actions_are_passed_to_the_robot() -> None:
    hand = Hand()
    location, moveto = hand.temporary("location", AREA), hand.action("moveto", AREA)
    hand.fact(location, "s")
    hand.rule([hand.atom(location, V(1))], [hand.head(moveto, V(1))])
    (action,) = actions(hand.machine(robot=7).drain())
    assert (action.executor, action.predicate, action.args) == (7, moveto, (Symbol("s"),))


SCRIPT = """
import sys; sys.path[:0] = {path!r}
from test_vm_section_4 import choices, fired, started
program = choices(wanted=(0, 2)).program()
print([fired(started(program, seed=seed).drain()) for seed in range(50)])
"""


@pytest.mark.medium
def test_iv_b_the_choice_depends_on_the_seed_and_not_on_pythonhashseed() -> None:
    outcomes = set()
    for hash_seed in ("0", "1", "4711"):
        script = [sys.executable, "-c", SCRIPT.format(path=sys.path)]
        done = subprocess.run(script, capture_output=True, text=True, check=True, env={"PYTHONHASHSEED": hash_seed})
        outcomes.add(done.stdout)
    assert len(outcomes) == 1
