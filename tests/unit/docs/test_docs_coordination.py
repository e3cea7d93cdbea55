"""docs/coordination.md says what the code of coordination says."""

import ast
import re
import struct
from itertools import pairwise
from pathlib import Path

import pytest
from doc_pages import codes, page, section, table

from rmr.base.arena import RobotShape
from rmr.base.direction import EXCLUSIVE
from rmr.base.motion_scale import scale_of
from rmr.base.time import NS_PER_MS, in_seconds
from rmr.coord import insertion, messages, schedule, states, timing
from rmr.coord.messages import Beacon, Entry, FrameKind, Job, Phase, Sched
from rmr.node.config import UNKNOWN_INSIDE
from rmr.node.crossing import approach, crossing, lateness, phases
from rmr.node.motion import gate, route
from rmr.node.motion.standoff import detector

PAGE = page("coordination")
SOURCE = ast.parse(Path(timing.__file__).with_suffix(".py").read_text())
FIELDS_OF = {part.name for part in SOURCE.body if isinstance(part, ast.ClassDef) and part.name.endswith("Timing")}
FRAMES = {
    "header": messages._HEADER,
    "JOB": messages._JOB,
    "SCHED": messages._SCHED,
    "entry": messages._ENTRY,
    "BEACON": messages._BEACON,
    "PATH": messages._PATH,
}
NAMES = {
    "header": ("kind", "group_id", "time", "counter", "leader"),
    "JOB": Job._fields[3:],
    "SCHED": (*Sched._fields[3:-1], "count"),
    "entry": Entry._fields,
    "BEACON": Beacon._fields[3:],
    "PATH": ("direction", "part", "first", "total", "offset"),
}


def documented(frame):
    """Return (fields, octets) of each line of the list under the frame's name."""
    listed = re.search(rf"^\*\*{frame}\*\*.*:\n\n((?:(?:- |  ).*\n)+)", section(PAGE, "Messages"), re.MULTILINE)
    assert listed, f"no fields of {frame}"
    lines = re.findall(r"^- (.+)$", listed[1], re.MULTILINE)
    rows = [re.match(r"(`.+`) (\d+)(?::|$)", line) for line in lines]
    assert all(rows), lines
    return [(codes(row[1]), int(row[2])) for row in rows]


def sizes(layout: struct.Struct) -> list[int]:
    form = layout.format.lstrip(">")
    return [struct.calcsize(f">{unit}") for unit in (["B", "6s", *form[3:]] if "6s" in form else form)]


def documented_times():
    """Yield each time of `rmr/coord/timing.py` with its docstring, None if it has none."""
    for part in SOURCE.body:
        if isinstance(part, ast.ClassDef) and part.name in FIELDS_OF:
            for field, after in pairwise([*part.body, ast.Pass()]):
                if isinstance(field, ast.AnnAssign) and ast.unparse(field.annotation) not in FIELDS_OF:
                    documented = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                    yield f"{part.name}.{field.target.id}", after.value.value if documented else None


def test_every_time_has_its_reason_in_the_source() -> None:
    """The page names `rmr/coord/timing.py` for the defaults and their reasons."""
    assert "`rmr/coord/timing.py`, each with its default and its reason" in " ".join(PAGE.split())
    times = list(documented_times())
    assert len(times) > 60
    assert [name for name, words in times if not words or len(words.split()) < 3] == []


def test_the_bounds_are_those_of_the_code():
    bounds = (
        f"Bounds: {timing.RECORDS_MAX} robots remembered per event, {timing.JOBS_MAX} jobs per leader, "
        f"{timing.GROUPS_MAX} events per robot, {timing.BANS_MAX} avoided leaders, {timing.OUTPUT_MAX} frames "
        f"and events waiting for the host, {timing.IN_FLIGHT_MAX} unicasts whose outcome is awaited."
    )
    assert bounds in PAGE.replace("\n", " ")


@pytest.mark.parametrize("frame", FRAMES)
def test_the_fields_of_a_frame_are_documented_in_order_with_their_sizes(frame):
    octets = [size for _, size in documented(frame)]
    assert sum(octets) == FRAMES[frame].size
    if frame == "PATH":  # column and row of the first cell stand in one line
        assert octets == [1, 1, 4, 2, 2]
    else:
        assert octets == sizes(FRAMES[frame])


@pytest.mark.parametrize("frame", FRAMES)
def test_the_fields_of_a_frame_bear_the_names_of_the_code(frame):
    named = [name for names, _ in documented(frame) for name in names]
    assert sorted(named) == sorted(NAMES[frame])


def test_the_frames_are_documented_with_code_and_length():
    lengths = {
        FrameKind.JOB: f"{messages.JOB_OCTETS} octets",
        FrameKind.SCHED: f"{messages.SCHED_OCTETS} + {messages.ENTRY_OCTETS} k octets",
        FrameKind.BEACON: f"{messages.BEACON_OCTETS} octets",
        FrameKind.PATH: f"{messages.PATH_OCTETS} octets + 3 bits a step",
    }
    heads = re.findall(r"^\*\*([A-Z]+)\*\* (0x\w+), (.+?), by broadcast", PAGE, re.MULTILINE)
    assert heads == [(kind.name, f"0x{kind:02X}", length) for kind, length in lengths.items()]
    assert f"k up to {messages.ENTRIES_MAX} jobs" in PAGE
    assert f"up to {messages.STEPS_MAX} steps" in PAGE
    assert f"several frames, {messages.PARTS_MAX} at most" in PAGE
    assert f"never exceeds {messages.PAYLOAD_MAX} octets" in PAGE


def test_the_phases_are_documented_with_where_they_may_stand():
    places = {(True, True): "both", (True, False): "beacon", (False, True): "entry"}
    expected = [(p.name, str(int(p)), places[p in messages._BEACON_PHASES, p in messages._ENTRY_PHASES]) for p in Phase]
    assert re.findall(r"^- `([A-Z]+)` (\d+), (\w+): ", PAGE, re.MULTILINE) == expected


@pytest.mark.parametrize(
    ("title", "steps"), [("Roles", states.ROLES), ("The passage of the robot's own job", states.PASSAGES)]
)
def test_the_transitions_are_those_of_the_code(title, steps):
    found: dict[str, list[str]] = {}
    for step in steps:
        found.setdefault(step.source.name.lower(), []).append(f"{step.on} -> {step.target.name.lower()}")
    lines = re.findall(r"^- (.+)$", re.sub(r"\n  +", " ", section(PAGE, title)), re.MULTILINE)
    assert sorted(lines) == sorted(f"{source}: {'; '.join(ways)}" for source, ways in found.items())


def test_the_methods_of_ordering_bear_the_limits_of_the_code():
    beam = next(count for count in range(timing.JOBS_MAX, 0, -1) if schedule.BEAM_WORK // count**3)
    rows = table(page("scheduling"), "jobs on time at best", "method", "result")
    assert [row[0] for row in rows] == [f"up to {schedule.EXACT_MAX}", f"up to {beam}", "more"]
    assert f"{schedule.BEAM_WORK:,} / n^3" in rows[1][1]
    assert f"beyond {insertion.KEYS_MAX} by deadline alone" in rows[2][1]


def words(event: type | phases.OwnEvent) -> str:
    """Return the name of an event or a phase in words."""
    if isinstance(event, phases.OwnEvent):
        return event.value
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", event.__name__).lower()


def test_a_crossing_goes_through_the_phases_named():
    phases_named = ", ".join(words(phase) for phase in phases.Phase.__args__)
    assert f"A crossing goes through the phases {phases_named}." in " ".join(PAGE.split())


def test_the_late_policies_are_those_of_the_code():
    def after(policy: lateness.LatePolicy) -> str:
        if policy.in_a_row > 1:
            return f"{policy.in_a_row} in a row"
        return f"{in_seconds(policy.after):g} s" if policy.after else "at once"

    text = re.sub(r"\n  +", " ", section(PAGE, "How motion uses turns"))
    assert re.findall(r"^- (.+ -> .+)$", text, re.MULTILINE) == [
        f"{symptom.value}, {after(policy)}: {policy.evidence} -> {policy.remedy.value}"
        for symptom, policy in lateness.POLICIES.items()
    ]
    back_off, most = in_seconds(lateness.BACK_OFF), in_seconds(lateness.BACK_OFF_MAX)
    assert f"a release that is {back_off:g} s later, and {most:g} s the further times" in PAGE


def test_the_evidence_of_the_late_policies_bears_the_figures_of_the_code():
    figures = {
        lateness.Symptom.RETRY_NEXT: f"within {in_seconds(lateness.NEAR_ENTRANCE):g} s of the line",
        lateness.Symptom.DEFERRED: f"slot is {gate.PUT_OFF_S:g} s later",
        lateness.Symptom.BLOCKING_ENTRANCE: f"not begin within {in_seconds(lateness.SLOT_IS_NEAR):g} s",
        lateness.Symptom.POSTPONING: f"is {in_seconds(lateness.REVISE_FROM):g} s later",
        lateness.Symptom.STUCK: f"within {lateness.PROGRESS_M * 100:g} cm",
    }
    assert all(figure in lateness.POLICIES[symptom].evidence for symptom, figure in figures.items())
    changed = f"when {in_seconds(lateness.APPROACH_CHANGE):g} s nearer or farther"
    assert changed in lateness.POLICIES[lateness.Symptom.DEFERRED].evidence


def test_the_figures_of_motion_are_those_of_the_code():
    text = section(PAGE, "How motion uses turns")
    for figure in (
        f"within {route.GATE_REACH_M * 100:.0f} cm of the gate's point",
        f"(2 radius + {scale_of(RobotShape()).headway_m * 100:.0f} cm) / speed",
        f"+ {in_seconds(approach.ORDER_MARGIN):g} s, if that is more",
        f"slot - approach - {in_seconds(crossing.LEAVE_EARLY):g} s",
        f"at the line within {in_seconds(lateness.READY):g} s",
        f"{in_seconds(UNKNOWN_INSIDE):g} s if nothing is known",
        f"| {EXCLUSIVE}: such turns exclude every other one |",
        f"its front {gate.HOLD_MARGIN_M * 100:.0f} cm before",
        f"a margin of {gate.EARLY_S:g} s and a tenth of the time left",
    ):
        assert figure in text.replace("\n", " ")
    assert gate.EARLY_SHARE == 0.1  # "a tenth"
    assert crossing.POLL_EVERY == 500 * NS_PER_MS  # "every half second"
    longest = detector.PATIENCE_S + 3 * detector.PATIENCE_STEP_S
    assert f"after {detector.PATIENCE_S:g} to {longest:g} s of standing" in " ".join(PAGE.split())
