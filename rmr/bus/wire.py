"""Messages on the bus: msgpack arrays, decoded strictly.

Every message is ``[type, sender, run, number, field, ...]``: `sender` is a robot's id or one of the names
below, `run` a random number drawn when the sender's session began, and `number` counts the sender's messages
on that key. A receiver therefore knows how many messages the middleware lost between two that arrived, which
must never be mistaken for radio loss.

A peer's mistake is counted and dropped, never an exception that travels: `decode` raises `MalformedError` and
nothing else, whatever the octets, and a message that it returns has the declared types throughout, within the bounds
of `rmr.bus.checks`: handlers use it as it is.
Each type is one named tuple and one row of `TABLE`; nothing else lists them.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import msgpack  # type: ignore[import-untyped]

from rmr.base.time import Instant
from rmr.base.values import Value
from rmr.bus.checks import (
    ROBOTS_MAX,
    Check,
    MalformedError,
    announcement,
    count,
    disturbance,
    each,
    flag,
    group,
    instant,
    integer,
    lab_name,
    length,
    lives,
    name,
    octets,
    one_of,
    optional,
    pack_value,
    people,
    place,
    quantity,
    robot,
    roster,
    value,
)
from rmr.bus.checks import sender as sender_check
from rmr.bus.record_checks import BEACONS_MAX, floor, radio, report
from rmr.radio.air import Announcement
from rmr.radio.links import DISTURBANCES_MAX, Disturbance

WORLD_ID: Final = -1
"""The world as a sender."""

OPERATOR_ID: Final = -2
"""A person's command as a sender (``rmr up``, ``rmr ps``)."""

MESSAGE_OCTETS_MAX: Final = 1 << 20
"""The largest message that travels as one, far beyond usual maps; larger ones: `rmr.bus.message_parts`."""

PART_OCTETS_MAX: Final = 3 << 14
"""The most of a larger message that one `Part` carries: 48 KiB, which the middleware sends as one batch."""

WHOLE_OCTETS_MAX: Final = 1 << 25
"""The largest message in parts: a robot's part of the report with some 250,000 actions or facts."""

REQUEST_OCTETS_MAX: Final = 4096
"""The longest request of a person to a launcher."""

PARTS_MAX: Final = WHOLE_OCTETS_MAX // PART_OCTETS_MAX + 1

FACTS_MAX: Final = 100_000
"""Facts of a lab, and arguments of one fact."""

STATES: Final = ("waiting", "ready", "running", "finished", "stopped", "failed")
"""What a `Status` says: waiting for the world; ready to start; the lab clock runs; every wanted fact is held;
ended in order; ended by an error."""

CLOCK_STATES: Final = ("waiting", "running", "stopped")
"""Lab time stands at 0 before the start; runs; stands at the end."""

LAUNCHER_STATES: Final = ("waiting", "running", "over", "left")
"""Its robots are not ready yet; they are; the whole run is over; this host has left it."""

ENDS: Final = ("died", "killed", "stopped")
"""How a robot's process ended: by itself, or by a person's order or a fault, or in order."""

WISHES: Final = ("list", "add", "clear")
"""About disturbances: only tell; add one; end all that have been added."""


# --- the messages -----------------------------------------------------------------------------------------


class Air(NamedTuple):
    """A radio frame that begins."""

    announcement: Announcement


class Handshake(NamedTuple):
    """A radio frame that begins and requests an acknowledgement, announced a second time to its receiver alone, which
    must answer within milliseconds."""

    announcement: Announcement


class Sense(NamedTuple):
    """One sample of a robot's sensors; fields as in `rmr.node.ports.Sensed`."""

    stamp: Instant
    left_m: float
    right_m: float
    gyro: float
    compass: float | None
    ranges: tuple[tuple[int, float], ...]
    bodies: tuple[tuple[float, float, float, float], ...]
    bumped: bool
    truth: tuple[float, float, float]
    fix: tuple[float, float, float, float, float] | None = None
    facts: tuple[tuple[str, tuple[Value, ...]], ...] | None = None


class Act(NamedTuple):
    """A wheel command: m/s, rad/s, and the lab instant at which it was given."""

    v: float
    w: float
    stamp: Instant


class Perform(NamedTuple):
    """Carry out an action of this robot outside of it; said again until the answer has come."""

    serial: int
    """Of the action, for the process that sends it."""
    name: str | None
    """None: break it off."""
    args: tuple[Value, ...]
    """Without the robot."""
    begun: Instant
    """When the robot said so first."""


class Performed(NamedTuple):
    """An action that was carried out outside of its robot has ended."""

    serial: int
    failure: str
    """Why it failed; empty if it did not."""


class AskClock(NamedTuple):
    """What is lab time?"""


class Clock(NamedTuple):
    """Lab time, in reply to `AskClock` and whenever it starts, stops or jumps."""

    state: str
    """One of `CLOCK_STATES`."""
    arrived: Instant
    """Lab time when the question reached the world (clock filter of NTP, RFC 5905: T2)."""
    stamp: Instant
    """Lab time when the answer left it (T3)."""


class AskMap(NamedTuple):
    """A robot arrives and asks for its place and for what it must know."""

    robot: int
    token: int
    """Tells two processes with the same id apart."""


class Map(NamedTuple):
    """All that a robot must know of the lab."""

    lab: str
    listed: bool
    """Whether the lab has this robot."""
    taken: bool
    """Whether another process is this robot already."""
    lives: int
    """How many processes have been this robot in this run before."""
    seed: int
    roster: tuple[int, ...]
    arena: dict[str, Any]
    """As `rmr.base.arena.to_data` writes it."""
    radio: dict[str, Any]
    """Settings of the radio, by name."""
    facts: tuple[tuple[str, int | None, tuple[Value, ...]], ...]
    """Predicate, owner (None: every robot), arguments without the owner."""
    finish: tuple[str, tuple[Value | None, ...]] | None
    """Predicate and arguments of the finish fact; an argument None matches anything. None: the lab has none."""
    clock: str
    """One of `CLOCK_STATES`."""
    disturbances: tuple[Disturbance, ...]
    """Of the radio, as in `Disturbances`."""
    predecessor_ended: Instant | None = None
    """An instant at which the robot's process before this one had ended; None: it is not known, or there was none."""
    performs: tuple[str, ...] = ()
    """The actions that the world carries out for its robots."""
    navigates: bool = False
    """Whether this one's body has a driver of its own."""


class Truth(NamedTuple):
    """Where the bodies really are."""

    stamp: Instant
    robots: tuple[tuple[int, float, float, float, float], ...]
    """Id, x, y (metres), heading (radians), distance driven (metres)."""
    collisions: int
    min_gap_m: float | None
    """Smallest gap between two bodies so far; None while there is none to tell."""
    ticks_late: int
    """Ticks of the physics that began more than one tick after their time."""
    final: bool


class Status(NamedTuple):
    """How a robot or the world is doing."""

    state: str
    """One of `STATES`."""
    progress: str
    """For people: one short line."""
    finished: bool
    """The robot holds the lab's finish fact."""
    final: bool
    """The last status: its sender leaves."""
    stamp: Instant
    report: dict[str, Any]
    """Its part of the run's report; empty where it is large and was sent a moment ago."""


class Stop(NamedTuple):
    """Please end in order."""

    reason: str


class AskDisturbances(NamedTuple):
    """What disturbs the radio? And please change it."""

    wish: str
    """One of `WISHES`."""
    added: Disturbance | None
    """What to add; it begins soon, and lasts until its `until`, counted from then."""


class Disturbances(NamedTuple):
    """All that disturbs the radio from now on, in reply to `AskDisturbances` and whenever it changes."""

    lab: str
    stamp: Instant
    held: tuple[Disturbance, ...]
    """What the lab file says, then what has been added."""
    given: int
    """How many of them the lab file says."""
    refused: str
    """Why the wish was not granted; else empty."""


class Part(NamedTuple):
    """A piece of a message that is too large to travel as one."""

    serial: int
    """Which of the sender's messages in parts."""
    place: int
    """Of this piece among them, from 0."""
    parts: int
    """How many there are."""
    octets: bytes


class Load(NamedTuple):
    """A message about a new program (`rmr.load.load_messages`), between an operator and a robot."""

    payload: bytes


class LoadOrder(NamedTuple):
    """Please distribute a program over the radio."""

    program: bytes
    robots: tuple[int, ...]
    """Who gets it."""
    named: bool
    """Whether these robots alone are meant, and not all of the lab."""
    dry: bool
    """Whether they only say what a switch would keep."""


class LoadOutcome(NamedTuple):
    """What became of such an order: the result as JSON, or why there is none."""

    result: bytes
    refused: str


class Silence(NamedTuple):
    """Please let a robot hear no beacon before the lab time `until`."""

    robot: int
    until: Instant


class Launcher(NamedTuple):
    """What the launcher of one host of a lab tells those of the other hosts."""

    host: str
    state: str
    """One of `LAUNCHER_STATES`."""
    shares: tuple[tuple[str, tuple[int, ...]], ...]
    """Each host of the lab and its robots, as this launcher has read them."""
    made_of: tuple[tuple[str, str], ...]
    """What has to be the same on all hosts: a name for people, and its version or digest."""
    gone: tuple[tuple[int, str], ...]
    """Robots of this host that are not there and will not be, and what became of them: one of `ENDS`."""
    folder: str
    """For people: its run folder."""
    finished: bool
    """The run is over and has finished."""
    reason: str
    """For people: why it is over, or this launcher has left."""
    befell: bytes
    """As JSON: what befell its robots, for the report (`rmr_deploy.run_outcome.Befell`)."""


class HostOrder(NamedTuple):
    """Please carry out what a person asks of a robot of your host, or answer it."""

    request: bytes
    """As a file with a request has it (`rmr_deploy.run_requests`)."""


class HostAnswer(NamedTuple):
    """What became of such an order."""

    host: str
    answer: bytes
    """As a file with an answer has it."""


# --- the table ------------------------------------------------------------------------------------------


def _pack_map(message: tuple[Any, ...]) -> list[Any]:
    fields = Map(*message)
    facts = [[name, owner, [pack_value(arg) for arg in args]] for name, owner, args in fields.facts]
    finish = None
    if fields.finish is not None:
        name, patterns = fields.finish
        finish = [name, [None if pattern is None else pack_value(pattern) for pattern in patterns]]
    disturbances = [held.to_wire() for held in fields.disturbances]
    return list(fields._replace(facts=facts, finish=finish, disturbances=disturbances))  # type: ignore[arg-type]


def _pack_sense(message: tuple[Any, ...]) -> list[Any]:
    *felt, facts = message
    told = None if facts is None else [[name, [pack_value(arg) for arg in args]] for name, args in facts]
    return [*felt, told]


def _pack_perform(message: tuple[Any, ...]) -> list[Any]:
    serial, action, args, begun = message
    return [serial, action, [pack_value(arg) for arg in args], begun]


def _pack_wish(message: tuple[Any, ...]) -> list[Any]:
    wish, added = message
    return [wish, None if added is None else added.to_wire()]


def _pack_disturbances(message: tuple[Any, ...]) -> list[Any]:
    fields = Disturbances(*message)
    return list(fields._replace(held=[held.to_wire() for held in fields.held]))  # type: ignore[arg-type]


Message = (
    Air
    | Handshake
    | Sense
    | Act
    | Perform
    | Performed
    | AskClock
    | Clock
    | AskMap
    | Map
    | Truth
    | Status
    | Stop
    | AskDisturbances
    | Disturbances
    | Part
    | Load
    | LoadOrder
    | LoadOutcome
    | Silence
    | Launcher
    | HostOrder
    | HostAnswer
)


class Row(NamedTuple):
    """One type of message."""

    code: int
    kind: type[Any]
    checks: tuple[Check, ...]
    """One for each field, in order."""
    pack: Callable[[tuple[Any, ...]], Any] = list
    patient: bool = False
    """Whether its receiver may leave it for a moment (`rmr.bus.bridge.PATIENCE`): nothing is decided by it before."""


_POSE: Final = group(place, place, quantity)
_SEEN: Final = group(quantity, quantity, quantity, quantity)
_SAMPLE: Final = (
    instant,
    quantity,
    quantity,
    quantity,
    optional(quantity),
    each(group(count, length), BEACONS_MAX),
    each(_SEEN, ROBOTS_MAX),
    flag,
    _POSE,
    optional(group(place, place, quantity, length, length)),
    optional(each(group(name, each(value, FACTS_MAX)), FACTS_MAX)),
)
_FACT: Final = group(name, optional(robot), each(value, FACTS_MAX))
_PATTERN: Final = group(name, each(optional(value), FACTS_MAX))
_HELD: Final = each(disturbance, DISTURBANCES_MAX)
_LAB: Final = (
    lab_name,
    flag,
    flag,
    lives,
    integer,
    roster,
    floor,
    radio,
    each(_FACT, FACTS_MAX),
    optional(_PATTERN),
    one_of(CLOCK_STATES),
    _HELD,
    optional(instant),
    each(name, FACTS_MAX),
    flag,
)
_LAUNCHER: Final = (
    lab_name,
    one_of(LAUNCHER_STATES),
    each(group(lab_name, each(robot, ROBOTS_MAX)), ROBOTS_MAX),
    each(group(people, people), ROBOTS_MAX),
    each(group(robot, one_of(ENDS)), ROBOTS_MAX),
    people,
    flag,
    people,
    octets(PART_OCTETS_MAX),
)
_BODY: Final = group(robot, place, place, quantity, length)

TABLE: Final = (
    Row(1, Air, (announcement,), patient=True),
    Row(2, Sense, _SAMPLE, _pack_sense, patient=True),
    Row(3, Act, (quantity, quantity, instant), patient=True),
    Row(4, AskClock, ()),
    Row(5, Clock, (one_of(CLOCK_STATES), instant, instant)),
    Row(6, AskMap, (robot, count)),
    Row(7, Map, _LAB, _pack_map),
    Row(8, Truth, (instant, each(_BODY, ROBOTS_MAX), count, optional(length), count, flag)),
    Row(9, Status, (one_of(STATES), people, flag, flag, instant, report)),
    Row(10, Stop, (people,)),
    Row(11, AskDisturbances, (one_of(WISHES), optional(disturbance)), _pack_wish),
    Row(12, Disturbances, (lab_name, instant, _HELD, count, people), _pack_disturbances),
    Row(13, Handshake, (announcement,)),
    Row(14, Part, (count, count, count, octets(PART_OCTETS_MAX))),
    Row(15, Load, (octets(PART_OCTETS_MAX),)),
    Row(16, LoadOrder, (octets(PART_OCTETS_MAX), each(robot, ROBOTS_MAX), flag, flag)),
    Row(17, LoadOutcome, (octets(MESSAGE_OCTETS_MAX), people)),
    Row(18, Silence, (robot, instant)),
    Row(19, Launcher, _LAUNCHER),
    Row(20, HostOrder, (octets(REQUEST_OCTETS_MAX),)),
    Row(21, HostAnswer, (lab_name, octets(MESSAGE_OCTETS_MAX))),
    Row(22, Perform, (count, optional(name), each(value, FACTS_MAX), instant), _pack_perform),
    Row(23, Performed, (count, people)),
)
"""Every type of message: its code on the wire, its form, the check of each field."""

_BY_CODE: Final = {row.code: row for row in TABLE}
_BY_KIND: Final = {row.kind: row for row in TABLE}
_PATIENT: Final = frozenset(row.code for row in TABLE if row.patient)


class Envelope(NamedTuple):
    """A message and where it comes from."""

    sender: int
    run: int
    number: int
    body: Message


def encode(sender: int, run: int, number: int, body: Message) -> bytes:
    """Return the octets of a message. Raises TypeError or ValueError when a field holds what msgpack cannot carry."""
    row = _BY_KIND[type(body)]
    return bytes(msgpack.packb([row.code, sender, run, number, *row.pack(body)]))


def decode(data: bytes, octets_max: int = MESSAGE_OCTETS_MAX) -> Envelope:
    """Return the message in `data`. Raises MalformedError."""
    if len(data) > octets_max:
        raise MalformedError("too long")
    try:
        items = msgpack.unpackb(data)
    except (ValueError, TypeError, RecursionError, OverflowError) as error:
        raise MalformedError(f"not msgpack: {error}") from None
    if type(items) is not list or len(items) < 4:
        raise MalformedError("expected an array of type, sender, run, number")
    code, sender, run, number, *fields = items
    row = _BY_CODE.get(code) if type(code) is int else None
    if row is None:
        raise MalformedError("an unknown type of message")
    if len(fields) != len(row.checks):
        raise MalformedError(f"{row.kind.__name__} has {len(row.checks)} fields")
    try:
        values = [check(field) for check, field in zip(row.checks, fields, strict=True)]
    except MalformedError as error:
        raise MalformedError(f"{row.kind.__name__}: {error}") from None
    return Envelope(sender_check(sender), count(run), count(number), row.kind(*values))


def is_patient(data: bytes) -> bool:
    """Whether the message in `data` may wait, as far as its first octets tell: those of a short array and its code."""
    return len(data) > 1 and data[1] in _PATIENT
