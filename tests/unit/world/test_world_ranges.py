"""Random numbers in a lab's facts."""

from dataclasses import replace

import pytest
from world_labs import ROOM, complaints, lab_of

from rmr_world.random_facts import Range, StatedFact, drawn


def numbers(stated, seed, roster=(1, 2, 3)):
    return [fact.args[0] for fact in drawn(stated, 0, seed, roster)]


def test_a_range_of_ints_draws_each_of_its_ints_and_nothing_else():
    stated = StatedFact("due", 1, (Range(-1, 2),))
    values = [value for seed in range(100) for value in numbers(stated, seed)]
    assert sorted(set(values)) == [-1, 0, 1, 2]
    assert {type(value) for value in values} == {int}


def test_a_range_with_a_float_draws_floats_of_one_decimal_within_it():
    stated = StatedFact("due", 1, (Range(0.25, 1),))
    values = {value for seed in range(300) for value in numbers(stated, seed)}
    assert sorted(values) == [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    assert {type(value) for value in values} == {float}


def test_a_range_of_one_number_is_that_number():
    assert numbers(StatedFact("due", 1, (Range(7, 7),)), 5) == [7]


def test_every_robot_draws_for_itself():
    facts = list(drawn(StatedFact("due", None, (Range(0, 10**9),)), 3, 1, (1, 2, 3)))
    assert [fact.owner for fact in facts] == [1, 2, 3]
    assert len({fact.args for fact in facts}) == 3


def test_a_fact_of_every_robot_without_a_range_stays_one_fact():
    assert [fact.owner for fact in drawn(StatedFact("start", None, (1,)), 0, 1, (1, 2, 3))] == [None]


def lab_with(tmp_path, *facts):
    return lab_of(tmp_path, ROOM + f"facts: {list(facts)}\n")


def test_ranges_drawn_depend_on_the_seed_only(tmp_path):
    lab = lab_with(tmp_path, "due(@1, 0..1000000)")
    other = replace(lab, seed=lab.seed + 1)
    assert lab.initial_facts == lab.initial_facts
    assert lab.initial_facts != other.initial_facts
    assert replace(other, seed=lab.seed).initial_facts == lab.initial_facts


def test_facts_added_at_the_end_leave_the_others_numbers(tmp_path):
    [alone] = lab_with(tmp_path, "due(@1, 0..1000000)").initial_facts
    first, second = lab_with(tmp_path, "due(@1, 0..1000000)", "due(@1, 0..1000000)").initial_facts
    assert first == alone
    assert second != first


def test_fewer_robots_leave_the_others_numbers(tmp_path):
    more = "  - {ids: 2-3, grid: {from: [1.0, 0.4], step: [0.3, 0], columns: 2}}\n"
    facts = ["due(@3, 0..1000000)", "due(@1, 0..1000000)", "due(R, 0..1000000)"]
    lab = lab_of(tmp_path, ROOM + more + f"facts: {facts}\n")
    fewer = lab.with_robots(2)
    assert [fact for fact in lab.initial_facts if fact.owner != 3] == list(fewer.initial_facts)
    assert len(fewer.initial_facts) == 3


@pytest.mark.parametrize(
    ("fact", "complaint"),
    [
        ("due(@1, 60..20)", "6:9: facts.0: the range 60..20 is the wrong way round: its smaller end comes first"),
        ("due(@1, 0.61..0.68)", "6:9: facts.0: the range 0.61..0.68 holds no number with one decimal"),
    ],
)
def test_range_without_a_number_is_reported_with_its_place(tmp_path, fact, complaint):
    assert complaints(tmp_path, ROOM + f"facts: ['{fact}']\n") == [complaint]
