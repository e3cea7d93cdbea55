"""docs/coordination.md says what the code of coordination says."""

import struct
from dataclasses import fields

import pytest
from doc_pages import codes, page, section, table

from rmr.base.time import NS_PER_MS, in_seconds
from rmr.coord import insertion, messages, schedule, states, values
from rmr.coord.messages import Beacon, Entry, Job, Kind, Phase, Sched
from rmr.coord.values import Values
from rmr.node.crossing import approach, turn, turns
from rmr.node.motion import gate, route
from rmr.node.motion.standoff import detector

PAGE = page("coordination")
FRAMES = {
    "header": messages._HEADER,
    "JOB": messages._JOB,
    "SCHED": messages._SCHED,
    "entry": messages._ENTRY,
    "BEACON": messages._BEACON,
    "PATH": messages._PATH,
}
NAMES = {
    "header": ("kind", "event", "time", "counter", "leader"),
    "JOB": Job._fields[3:],
    "SCHED": (*Sched._fields[3:-1], "count"),
    "entry": Entry._fields,
    "BEACON": Beacon._fields[3:],
    "PATH": ("way", "part", "first", "total", "offset"),
}


def documented(frame):
    return [row for row in table(PAGE, "frame", "field", "octets", "unit and meaning") if row[0] == frame]


def sizes(layout: struct.Struct) -> list[int]:
    form = layout.format.lstrip(">")
    return [struct.calcsize(f">{unit}") for unit in (["B", "6s", *form[3:]] if "6s" in form else form)]


def text_of(value: int | values.Order | None) -> str:
    if not isinstance(value, int):
        return "none" if value is None else value.value
    return f"{value // NS_PER_MS} ms" if value >= NS_PER_MS else str(value)


def test_every_value_is_documented_with_its_default():
    rows = {codes(name)[0]: default for name, default, _ in table(PAGE, "value", "default", "what it is")}
    assert rows == {field.name: text_of(getattr(Values(), field.name)) for field in fields(Values)}


def test_the_bounds_are_those_of_the_code():
    bounds = (
        f"Bounds: {values.RECORDS_MAX} robots remembered per event, {values.JOBS_MAX} jobs per leader, "
        f"{values.EVENTS_MAX} events per robot, {values.BANS_MAX} avoided leaders, {values.OUTPUT_MAX} frames "
        f"and events waiting for the host, {values.IN_FLIGHT_MAX} unicasts whose outcome is awaited."
    )
    assert bounds in PAGE.replace("\n", " ")


@pytest.mark.parametrize("frame", FRAMES)
def test_the_fields_of_a_frame_are_documented_in_order_with_their_sizes(frame):
    rows = documented(frame)
    octets = [int(row[2]) for row in rows]
    assert sum(octets) == FRAMES[frame].size
    if frame == "PATH":  # column and row of the first cell stand in one line
        assert octets == [1, 1, 4, 2, 2]
    else:
        assert octets == sizes(FRAMES[frame])


@pytest.mark.parametrize("frame", FRAMES)
def test_the_fields_of_a_frame_bear_the_names_of_the_code(frame):
    named = [name for row in documented(frame) for name in row[1].split(", ")]
    assert sorted(named) == sorted(NAMES[frame])


def test_the_frames_are_documented_with_code_and_length():
    lengths = {
        Kind.JOB: f"{messages.JOB_OCTETS}",
        Kind.SCHED: f"{messages.SCHED_OCTETS} + {messages.ENTRY_OCTETS} k",
        Kind.BEACON: f"{messages.BEACON_OCTETS}",
        Kind.PATH: f"{messages.PATH_OCTETS} + 3 bits a step",
    }
    rows = [row[:3] for row in table(PAGE, "frame", "kind", "octets", "sent")]
    assert rows == [(kind.name, f"0x{kind:02X}", length) for kind, length in lengths.items()]
    assert f"k up to {messages.ENTRIES_MAX} jobs" in PAGE
    assert f"up to {messages.STEPS_MAX} steps" in PAGE
    assert f"several frames, {messages.PARTS_MAX} at most" in PAGE
    assert f"never exceeds {messages.PAYLOAD_MAX} octets" in PAGE


def test_the_phases_are_documented_with_where_they_may_stand():
    places = {(True, True): "both", (True, False): "beacon", (False, True): "entry"}
    expected = [(p.name, str(int(p)), places[p in messages._BEACON_PHASES, p in messages._ENTRY_PHASES]) for p in Phase]
    assert [row[:3] for row in table(PAGE, "phase", "code", "in", "meaning")] == expected


@pytest.mark.parametrize(
    ("title", "steps"), [("Roles", states.ROLES), ("The passage of the robot's own job", states.PASSAGES)]
)
def test_the_transitions_are_those_of_the_code(title, steps):
    rows = table(section(PAGE, title), "from", "to", "on")
    assert rows == [(step.source.name.lower(), step.target.name.lower(), step.on) for step in steps]


def test_the_methods_of_ordering_bear_the_limits_of_the_code():
    beam = next(count for count in range(values.JOBS_MAX, 0, -1) if schedule.BEAM_WORK // count**3)
    assert f"the optimum for up to {schedule.EXACT_MAX} jobs" in PAGE.replace("\n", " ")
    rows = table(page("scheduling"), "jobs on time at best", "method", "result")
    assert [row[0] for row in rows] == [f"up to {schedule.EXACT_MAX}", f"up to {beam}", "more"]
    assert f"{schedule.BEAM_WORK:,} / n^3" in rows[1][1]
    assert f"beyond {insertion.KEYS_MAX} by deadline alone" in rows[2][1]


def test_a_turn_goes_through_the_phases_named():
    assert f"A turn goes\n{', '.join(phase.value for phase in turn.Phase)};" in PAGE


def test_the_figures_of_motion_are_those_of_the_code():
    text = section(PAGE, "How motion uses turns")
    for figure in (
        f"within {route.GATE_REACH_M * 100:.0f} cm of the gate's point",
        f"(2 radius + {approach.HEADWAY_MARGIN_M * 100:.0f} cm) / speed",
        f"+ {in_seconds(approach.ORDER_MARGIN):g} s, if that is more",
        f"slot - approach - {in_seconds(turn.LEAVE_EARLY):g} s",
        f"at the line within {in_seconds(turns.READY):g} s",
        f"{in_seconds(turn.UNKNOWN_INSIDE):g} s if nothing is known",
        f"| {values.EXCLUSIVE_WAY}: such turns exclude every other one |",
        f"its front {gate.HOLD_MARGIN_M * 100:.0f} cm before",
        f"a margin of {gate.EARLY_S:g} s and a tenth of the time left",
    ):
        assert figure in text.replace("\n", " ")
    assert gate.EARLY_SHARE == 0.1  # "a tenth"
    assert turns.REVISE_EVERY == 500 * NS_PER_MS  # "every half second"
    longest = detector.PATIENCE_S + 3 * detector.PATIENCE_STEP_S
    assert f"after {detector.PATIENCE_S:g} to {longest:g} s of standing" in PAGE
