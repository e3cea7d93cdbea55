"""A little of what `bytecode.py` does at length: octets are refused with a reason, or run within bounds."""

from collections import Counter
from pathlib import Path
from random import Random

import pytest
from fuzz_cases import KINDS, PROGRAMS_EVERY, Failure, base, batch, judged, made
from fuzz_mutations import resealed
from fuzz_trial import Outcome, Trial, looks_counted, tried

from rmr.bytecode.codec import BytecodeError, decode, encode
from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_file

FIGURE_3 = Path(__file__).parents[1] / "programs" / "figure3.rmr"
SEED = 20
CASES = 10_000
PARTS = 5


@pytest.fixture(scope="module")
def figure_3() -> bytes:
    program = compile_file(FIGURE_3).program
    assert program is not None
    return encode(program, debug=False)


@pytest.mark.parametrize(
    "part", [pytest.param(part, marks=pytest.mark.slow if part else pytest.mark.medium) for part in range(PARTS)]
)
def test_whatever_the_octets_they_are_refused_or_run_within_bounds(part):
    size = CASES // PARTS
    tally, failures = batch(SEED, part * size, (part + 1) * size)
    assert [f"seed {each.seed} case {each.case}\n{each.trace}{each.octets}" for each in failures] == []
    assert tally.total() == size
    by_kind = {kind: sum(tally[kind, outcome] for outcome in Outcome) for kind in KINDS}
    run = {kind: tally[kind, Outcome.ACCEPTED] for kind in KINDS}
    assert run["structure"] > by_kind["structure"] // 10
    assert run["octets"] > 0
    assert run["table"] > 0
    assert tally["random", Outcome.REJECTED] > 0


def test_a_case_is_made_from_its_seed_and_number_alone():
    numbers = [0, 7, PROGRAMS_EVERY + 1]
    first = [(made(5, number)[:2], judged(5, number)) for number in numbers]
    base.cache_clear()
    assert [(made(5, number)[:2], judged(5, number)) for number in reversed(numbers)] == first[::-1]
    assert made(6, 7)[1] != made(5, 7)[1]


def test_what_goes_wrong_is_told_with_its_octets(monkeypatch):
    def fault(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(Trial, "settle", fault)
    outcomes = [judged(5, number)[1] for number in range(40)]
    failures = [each for each in outcomes if isinstance(each, Failure)]
    assert failures
    for each in failures:
        assert "ZeroDivisionError" in each.trace
        assert isinstance(decode(bytes.fromhex(each.octets)), Program)


@pytest.mark.medium
def test_a_trial_that_looks_at_too_many_facts_is_cut_short(monkeypatch):
    monkeypatch.setattr("fuzz_trial.LOOKS_MAX", 0)
    assert any(judged(5, number)[1] is Outcome.CUT_SHORT for number in range(200))
    with looks_counted():
        pass


def test_every_flip_of_a_bit_is_found_by_the_crc(figure_3):
    accepted = []
    for bit in range(8 * len(figure_3)):
        try:
            decode(flipped(figure_3, bit))
        except BytecodeError:
            continue
        accepted.append(bit)
    assert accepted == []


@pytest.mark.medium
def test_every_flip_of_a_bit_with_the_crc_made_right_is_refused_or_runs(figure_3):
    outcomes = Counter(
        tried(resealed(bytearray(flipped(figure_3, bit))), Random(bit)) for bit in range(8 * len(figure_3))
    )
    assert outcomes[Outcome.REJECTED] > outcomes[Outcome.ACCEPTED] > 8 * len(figure_3) // 10
    assert outcomes.total() == 8 * len(figure_3)


def flipped(data: bytes, bit: int) -> bytes:
    octets = bytearray(data)
    octets[bit // 8] ^= 1 << bit % 8
    return bytes(octets)
