"""`rmr check LAB --explain`: the passages and stations of a lab, who needs them, and what the assertions' turns cover.

An explanation is data (dataclasses that become JSON as they are); `show` renders it as text. Drives are those with
which robots begin (`rmr_world.passage_use`), with times at full speed and without other robots.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from rmr.base.arena import BOTTLENECK
from rmr.base.geometry import Point
from rmr.base.time import in_seconds
from rmr.bytecode.program import Assertion, Program
from rmr_lab.picture import text_map
from rmr_world.lab import Lab
from rmr_world.narrow_places import narrow_places, side_by_side_m
from rmr_world.passage_use import FirstDrive, PassageUse, first_drives, first_events, passage_uses, stretch
from rmr_world.validate.first_instant import first_destinations

SIGNS = "abcdefghijklmnpqrstuvwxyz"
"""Letters of passages on the map; further ones are marked by the last. Robots are `o`."""
PASSAGES_SHOWN_MAX = 50
"""Passages that are shown as text; JSON has them all."""

IN_TURNS = "in turns"
"""How a drive goes through a passage: by a turn of this passage, ..."""
WHOLE_DRIVE = "whole drive"
"""... by a turn that is the whole drive, which excludes all other jobs of the event, ..."""
WITHOUT_TURN = "without a turn"
"""... by none, or by a turn that ends elsewhere."""


@dataclass(frozen=True, slots=True)
class ExplainedDrive:
    """The first drive of a robot, on its way through a passage."""

    robot: int
    goal: str
    event: str | None
    """The event whose turn it waits for."""
    scheduled: str
    """`IN_TURNS`, `WHOLE_DRIVE` or `WITHOUT_TURN`."""
    enters_by: int
    """The end by which it enters, from 1."""
    enters_s: float
    """Seconds from the start of the drive, at full speed."""
    leaves_s: float
    due_s: float | None
    """Deadline of the job, lab time in seconds."""


@dataclass(frozen=True, slots=True)
class ExplainedPassage:
    """A passage of the floor."""

    name: str
    key: str | None
    """The key of the lab file that names it; None: it was found."""
    areas: tuple[str, ...]
    """The areas at its entrances, if it is named."""
    ends: tuple[Point, ...]
    width_m: float | None
    """Free width at the narrowest point; None: two robots pass each other there."""
    length_m: float | None
    in_turns: bool
    """Whether it has turns of its own."""
    drives: tuple[ExplainedDrive, ...]


@dataclass(frozen=True, slots=True)
class ExplainedZone:
    """A place where narrow sections meet."""

    name: str
    centre: Point
    radius_m: float


@dataclass(frozen=True, slots=True)
class ExplainedStation:
    """An area of which robots hold places."""

    name: str
    capacity: int
    """Robots that may be there at a time."""
    robots: tuple[int, ...]
    """Those whose first drive leads there."""


@dataclass(frozen=True, slots=True)
class ExplainedTurn:
    """What the turns of one time assertion cover."""

    assertion: str
    held: tuple[str, ...]
    """The actions that wait for the turn; empty: nothing is exclusive."""
    events: tuple[str, ...]
    """The events of the jobs that begin at the start."""
    over: str
    begins: str
    ends: str


@dataclass(frozen=True, slots=True)
class ExplainedLab:
    """The explanation of one lab."""

    file: str
    lab: str
    side_by_side_m: float
    """Least width in which two robots pass each other."""
    searched: bool
    """Whether the floor was searched for narrow passages; False if it is too large for so small robots."""
    passages: tuple[ExplainedPassage, ...]
    zones: tuple[ExplainedZone, ...]
    stations: tuple[ExplainedStation, ...]
    turns: tuple[ExplainedTurn, ...]
    map: str

    @property
    def names_none(self) -> bool:
        """Whether the lab file names no passage."""
        return all(passage.key is None for passage in self.passages)


def explain(file: str, lab: Lab, program: Program) -> ExplainedLab:
    """Explain a lab without errors."""
    uses = passage_uses(lab, program)
    found = narrow_places(lab.arena)
    return ExplainedLab(
        file=file,
        lab=lab.name,
        side_by_side_m=side_by_side_m(lab.arena.shape.radius),
        searched=found.searched,
        passages=tuple(_passage(lab, use) for use in uses),
        zones=tuple(ExplainedZone(zone.name, zone.centre, zone.radius) for zone in found.zones),
        stations=tuple(_station(lab, program, *station) for station in lab.arena.stations),
        turns=tuple(_turn(lab, program, each) for each in program.assertions),
        map=_map(lab, uses),
    )


def _passage(lab: Lab, use: PassageUse) -> ExplainedPassage:
    named = use.named
    drives = (_drive(lab, use, drive) for drive in use.drives)
    return ExplainedPassage(
        name=use.name,
        key=None if named is None or named.found else ".".join(map(str, named.path)),
        areas=() if named is None or named.found else named.areas,
        in_turns=named is not None,
        ends=use.ends,
        width_m=min((each.width for each in use.narrow), default=None),
        length_m=sum(each.length for each in use.narrow) if use.narrow else None,
        drives=tuple(each for each in drives if each is not None),
    )


def _drive(lab: Lab, use: PassageUse, drive: FirstDrive) -> ExplainedDrive | None:
    within = stretch(lab.arena, drive, use)
    if within is None:
        return None
    entrance = drive.route.point(within[0])
    away = [(entrance.x - end.x) ** 2 + (entrance.y - end.y) ** 2 for end in use.ends]
    speed = lab.arena.shape.speed
    return ExplainedDrive(
        robot=drive.robot,
        goal=drive.goal.name,
        event=drive.event,
        scheduled=_scheduled(use, drive),
        enters_by=away.index(min(away)) + 1,
        enters_s=within[0] / speed,
        leaves_s=within[1] / speed,
        due_s=None if drive.job is None else in_seconds(drive.job.deadline),
    )


def _scheduled(use: PassageUse, drive: FirstDrive) -> str:
    if use.named is not None and drive.needs_turn(use.named) and drive.route.gate_m is not None:
        return IN_TURNS
    if drive.job is None or drive.gated:
        return WITHOUT_TURN
    return WHOLE_DRIVE


def _station(lab: Lab, program: Program, name: str, capacity: int) -> ExplainedStation:
    goals = first_destinations(lab, program)
    return ExplainedStation(name, capacity, tuple(sorted(robot for robot, area in goals.items() if area.name == name)))


def _turn(lab: Lab, program: Program, assertion: Assertion) -> ExplainedTurn:
    held = tuple(dict.fromkeys(program.predicates[each.action].name for each in assertion.serving))
    if not assertion.scheduled or not held:
        why = "no action leads to its finish" if assertion.scheduled else "it is only watched"
        return ExplainedTurn(assertion.name, (), (), f"nothing: {why}", "", "")
    drives = [d for d in first_drives(lab, program) if d.job and program.assertions[d.job.assertion] is assertion]
    events = first_events(lab, program, program.assertions.index(assertion))
    action = f"the first {held[0]} begins" if len(held) == 1 else f"the first of {', '.join(held)} begins"
    whole = f"the last {'of them' if len(held) > 1 else held[0]} has ended, or the job"
    gated = sum(drive.gated for drive in drives)
    if drives and gated == len(drives):
        over = f"{_passages_of(drives)}: one direction at a time, robots of one direction one behind the other"
        return ExplainedTurn(
            assertion.name, held, events, over,
            "the robot is at its entrance (it sets out before, to be there in time)",
            "its hull is out of the narrow section",
        )  # fmt: skip
    if drives and all(drive.to_station for drive in drives):
        stations = " or ".join(sorted({drive.goal.name for drive in drives}))
        return ExplainedTurn(
            assertion.name, held, events, f"a place of station {stations}",
            "a place is free (only then the robot sets out)", "its hull has left the station",
        )  # fmt: skip
    if not gated and (drives or not lab.arena.passages):
        over = "all of the held actions: one robot of the event at a time"
        return ExplainedTurn(assertion.name, held, events, over, action, whole)
    shared = lab.arena.has_shared_passages
    what = "the passages for drives that pass one" if shared else "the bottleneck for drives that pass it"
    over = f"{what}, else all of the held actions, one robot of the event at a time"
    begins = f"the robot is at the entrance, else {action}"
    return ExplainedTurn(
        assertion.name, held, events, over, begins, f"its hull is out of the narrow section, else {whole}"
    )


def _passages_of(drives: Iterable[FirstDrive]) -> str:
    names = sorted({str(drive.route.passage) for drive in drives})
    if names == [BOTTLENECK]:
        return "the bottleneck"
    return f"passage {' and '.join(names)}, with the robots of all events"


def _map(lab: Lab, uses: tuple[PassageUse, ...]) -> str:
    lines = {
        _sign(k): [pair for each in use.narrow for pair in pairwise(each.line)] or list(pairwise(use.ends))
        for k, use in reversed(list(enumerate(uses)))
    }
    areas = [place for area in lab.arena.areas for place in area.places]
    robots = [Point(robot.pose.x, robot.pose.y) for robot in lab.robots]
    return text_map(lab.arena, lines, {".": areas, "o": robots})


def _sign(index: int) -> str:
    return SIGNS[min(index, len(SIGNS) - 1)]


def show(explained: ExplainedLab) -> str:
    """Return an explanation as text."""
    return "".join(f"{line}\n" for line in _lines(explained))


def _lines(explained: ExplainedLab) -> Iterator[str]:
    yield f"{explained.file}: {explained.lab}"
    yield ""
    yield "FLOOR. # obstacle, o robot, . place of an area; letters are passages."
    yield f"Two robots pass each other where it is {explained.side_by_side_m:.2f} m wide or more."
    yield from (
        "",
        explained.map,
        "",
        "PASSAGES. Times at full speed, alone, from the start of the robot's first drive.",
    )
    for index, passage in enumerate(explained.passages[:PASSAGES_SHOWN_MAX]):
        yield ""
        yield from _passage_lines(_sign(index), passage)
    if not explained.searched:
        yield from ("", "  the floor is not searched: it is too large for robots so small")
    elif not explained.passages:
        yield from ("", "  none: two robots can pass each other everywhere")
    found = [passage for passage in explained.passages if passage.key is None and passage.in_turns]
    if found:
        yield from ("", *_paste(found))
    elif explained.names_none and any(passage.drives for passage in explained.passages):
        yield from ("", *_NAMING)
    left_out = len(explained.passages) - PASSAGES_SHOWN_MAX
    if left_out > 0:
        yield from ("", f"  ... and {left_out} more; --json has them all")
    for zone in explained.zones:
        yield from ("", f"  {zone.name}  where narrow sections meet, at {_at(zone.centre)}")
    if explained.stations:
        yield from ("", "STATIONS. A robot holds a place from before it drives in until its hull has left.")
    for station in explained.stations:
        yield from ("", *_station_lines(station))
    yield from ("", "TIME ASSERTIONS. What a turn covers.")
    for turn in explained.turns:
        yield ""
        yield from _turn_lines(turn)
    if not explained.turns:
        yield from ("", "  none")


def _passage_lines(sign: str, passage: ExplainedPassage) -> Iterator[str]:
    meets = len(passage.ends) > 2
    ends = (", " if meets else " to ").join(map(_at, passage.ends))
    size = "not narrow" if passage.width_m is None else f"{passage.width_m:.2f} m wide, {passage.length_m:.2f} m long"
    yield f"  {sign}  {passage.name}  {ends}, {size}"
    if passage.key is None:
        yield "     found      the lab file does not name it"
    else:
        yield f"     named      by the key {passage.key}: {', '.join(passage.areas)}"
    if passage.width_m is not None:
        together = "those that enter or leave by one end" if meets else "one direction at a time"
        yield f"     capacity   one robot abreast: {together}, one robot behind the other"
    kinds = dict.fromkeys(drive.scheduled for drive in passage.drives)
    yield f"     scheduled  {' and '.join(_KINDS[kind] for kind in kinds) or 'no drive at the start needs it'}"
    if passage.drives:
        yield "     robot  by end  enters [s]  leaves [s]  due [s]  event, destination"
    for drive in passage.drives:
        due = "" if drive.due_s is None else f"{drive.due_s:.1f}"
        times = f"{drive.enters_s:10.1f}  {drive.leaves_s:10.1f}  {due:>7}"
        none = "no event" if drive.scheduled == IN_TURNS else "no turn"
        event = none if drive.event is None else drive.event.removesuffix("()")
        yield f"     {drive.robot:5}  {drive.enters_by:6}  {times}  {event}, {drive.goal}"


def _station_lines(station: ExplainedStation) -> Iterator[str]:
    yield f"  {station.name}"
    yield f"     capacity   {station.capacity} at a time"
    if station.robots:
        yield f"     wanted     at the start, by {', '.join(map(str, station.robots))}"


_NAMING = (
    "  Passages in which a robot starts or has its goal have no turns of their own, nor those without room to wait",
    "  before them; with `passages: {}` none has. Areas at the ends, named under passages, give one turns for all that",
    "  drive through; named under bottleneck.mouths, they make it the passage of the turns of events.",
)


def _paste(found: Sequence[ExplainedPassage]) -> Iterator[str]:
    """Yield the passages that were found as lines of a lab file."""
    yield "  Whoever drives through a passage that was found takes turns. In the lab file, to name or to change them"
    yield "  (`passages: {}` for none):"
    yield ""
    names = {passage: [f"{passage.name}_{sign}" for sign in "abcd"[: len(passage.ends)]] for passage in found}
    yield "    areas:"
    for passage, mouths in names.items():
        for mouth, end in zip(mouths, passage.ends, strict=True):
            yield f"      {mouth}: {{at: {_at(end)}}}"
    yield "    passages:"
    for passage, mouths in names.items():
        yield f"      {passage.name}: {{mouths: [{', '.join(mouths)}]}}"


_KINDS = {
    IN_TURNS: "yes, by turns of this passage",
    WHOLE_DRIVE: "yes, by turns that are the whole drive: one robot of an event at a time",
    WITHOUT_TURN: "no, no turn covers it",
}


def _turn_lines(turn: ExplainedTurn) -> Iterator[str]:
    yield f"  {turn.assertion}"
    if turn.held:
        yield f"     held    {', '.join(turn.held)}"
    yield f"     over    {turn.over}"
    if turn.held:
        yield f"     from    {turn.begins}"
        yield f"     to      {turn.ends}"
        events = ", ".join(event.removesuffix("()") for event in turn.events)
        yield f"     events  {events or 'no job begins at the start'}"


def _at(point: Point) -> str:
    return f"[{point.x:.2f}, {point.y:.2f}]"
