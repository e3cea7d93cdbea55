"""What the later steps of a chain leave of a deadline, and where a crossing is found as it goes from group to group."""

from pathlib import Path

import pytest

from rmr.base.geometry import distance
from rmr.base.time import in_seconds, seconds
from rmr.base.values import Robot, Symbol
from rmr.lang.compiler import compile_file
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.crossing_table import CrossingTable
from rmr.node.crossing.later_steps import time_of
from rmr.node.crossing.phases import Left
from rmr.node.crossing.shared_path import GROUPS_KEPT
from rmr.vm.derive import Derived, DerivedKind
from rmr.vm.job import TimedJob
from rmr_world.lab_file import load_lab

WAREHOUSE = Path(__file__).parents[3] / "deploy" / "labs" / "warehouse"


def test_later_drives_and_waits_take_their_time_and_facts_none():
    arena = load_lab(WAREHOUSE).arena
    program = compile_file(WAREHOUSE / "warehouse.rmr").program
    assert program is not None
    index = {predicate.name: number for number, predicate in enumerate(program.predicates)}
    steps = [
        Derived(DerivedKind.ACTION, index["wait"], Robot(1), (2.0,)),
        Derived(DerivedKind.ACTION, index["moveto"], Robot(1), (Symbol("west_home"),)),
        Derived(DerivedKind.FACT, index["delivered"], Robot(1), ()),
    ]
    start, goal = (arena.area(name).places[0] for name in ("east_store", "west_home"))

    def lasts(*chosen):
        drives = index["moveto"].__eq__
        return in_seconds(time_of(program, arena, drives, start, chosen))

    assert lasts() == lasts(steps[2]) == 0.0
    assert lasts(steps[0]) == 2.0
    straight = distance(*start, *goal) / arena.shape.speed
    assert straight < lasts(steps[1]) < straight + 3.0
    assert lasts(*steps) == pytest.approx(lasts(steps[0]) + lasts(steps[1]))


def job(serial, event="delivery()"):
    return TimedJob(serial, 0, "delivery", event, "delivered(@1)", 0, seconds(90), (), Robot(1))


def test_the_deadline_of_a_crossing_leaves_time_for_what_follows():
    one = Crossing(job(1), b"group.", b"event.", 0, None, later=seconds(25))
    assert one.deadline == seconds(90 - 25)


def test_a_crossing_is_found_by_its_event_in_the_group_of_a_passage_too():
    table = CrossingTable(7)
    own = job(1)
    one = Crossing(own, table.event_id(own), table.event_id(own), 0, None)
    table.add(one)
    table.move(one, table.passage_id("north"), seconds(3))
    assert table.at(table.passage_id("north")) is one
    assert table.at(table.event_id(own)) is None
    assert table.of_event(table.event_id(own)) is one
    assert table.of_job(own) is one
    assert table.of_job(job(2)) is None
    assert one.trigger == seconds(3)


def test_names_of_groups_depend_on_the_program_and_on_what_they_name():
    table, other = CrossingTable(7), CrossingTable(8)
    names = [table.passage_id("a"), table.passage_id("b"), table.station_id("a"), other.passage_id("a")]
    names += [table.drive_id(), table.drive_id(), table.event_id(job(1)), table.event_id(job(1, "delivery(x)"))]
    names += [table.event_id(job(1), step="delivery()"), table.event_id(job(1), step="load()")]
    assert len(set(names)) == len(names)
    assert {len(name) for name in names} == {6}
    assert CrossingTable(7).passage_id("a") == names[0]


def test_the_oldest_crossings_that_are_over_are_forgotten():
    table = CrossingTable(7)
    dropped = []
    for serial in range(GROUPS_KEPT + 5):
        own = job(serial, f"delivery({serial})")
        dropped += table.add(Crossing(own, table.event_id(own), table.event_id(own), 0, None, Left()))
    assert dropped == [table.event_id(job(serial, f"delivery({serial})")) for serial in range(5)]
    assert len(list(table)) == GROUPS_KEPT
