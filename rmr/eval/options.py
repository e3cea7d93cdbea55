"""The values of the command's options: numbers of robots, durations, shares, outside events, deaths and restarts.

An invalid value is the caller's mistake: `OptionError` says what was found and what to write instead.
"""

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from rmr.base.errors import UsageError
from rmr.base.ids import in_order, listed, shown
from rmr.base.time import Duration, Instant, in_seconds, seconds
from rmr.base.values import ROBOT_ID_MAX

COLUMNAR = "columnar"
"""The engine that runs all robots at once as columns, if the program is suited."""

DURATION_S_MAX = 1e8
"""Three years: more is a slip of the finger, and nanoseconds of it are far from `NEVER`."""
_SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0}
_DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?)(ms|s|min|)", re.ASCII)


class OptionError(UsageError):
    """An option's value cannot be used; the message says what is wrong and what to write."""


def robots(text: str) -> tuple[int, ...]:
    """Return the robots' ids, ascending: of ``4`` they are 1 to 4, of ``0-5,9`` those listed. Raises OptionError."""
    text = text.strip()
    if text.isdecimal() and text.isascii():
        return _counted(text)
    try:
        return listed(text)
    except ValueError as error:
        raise OptionError(str(error)) from None


def _counted(text: str) -> tuple[int, ...]:
    number = int(text[:6])
    if len(text) > 6 or not 1 <= number <= ROBOT_ID_MAX:
        raise OptionError(f"1 to {ROBOT_ID_MAX} robots, not {shown(text)}; write 0-0 for robot 0 alone")
    return tuple(range(1, number + 1))


def duration(text: str) -> Duration:
    """Return a duration: ``500ms``, ``2s``, ``1.5min``, or a plain number of seconds. Raises OptionError."""
    match = _DURATION.fullmatch(text.strip())
    if match is None:
        raise OptionError(f"{shown(text)} is no duration; write 500ms, 2s, 1.5min, or a number of seconds")
    value = float(match[1]) * _SECONDS[match[2]]
    if value > DURATION_S_MAX:
        raise OptionError(f"{shown(text)} is too long: at most {DURATION_S_MAX:.0f} seconds")
    return seconds(value)


def action_times(texts: Iterable[str]) -> tuple[Duration, dict[str, Duration]]:
    """Return the time of all actions (``2s``; 0 without) and those of some (``moveto=3s``). Raises OptionError."""
    usual: Duration | None = None
    named: dict[str, Duration] = {}
    for text in texts:
        name, equals, time = text.partition("=")
        name = name.strip()
        if not equals and usual is not None:
            raise OptionError(f"{shown(text)} is the second time for all actions; write NAME={text.strip()} for one")
        if name in named:
            raise OptionError(f"the time of {name} is given twice")
        if equals:
            named[name] = duration(time)
        else:
            usual = duration(text)
    return usual or 0, named


def befalling(text: str) -> tuple[Instant, list[int]]:
    """Return when, and which robots: ``5s: @2``, ``5s: @2,@4``. Raises OptionError."""
    when, colon, robots_text = text.partition(":")
    if not colon or not robots_text.strip():
        raise OptionError(f"{shown(text)} is no time and robot; write '5s: @2'")
    try:
        return duration(when), in_order(robots_text.replace("@", ""))
    except ValueError as error:
        raise OptionError(str(error)) from None


def share(text: str) -> float:
    """Return a share from 0 to 1, both included. Raises OptionError."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise OptionError(f"a share from 0 to 1, not {shown(text)}; 0.1 loses one frame in ten")
    return value


def outside_event(text: str) -> tuple[Instant, str]:
    """Return when, and the fact's text: ``2.5s: online(@3, l1)``. Raises OptionError."""
    when, colon, fact = text.partition(":")
    if not colon or not fact.strip():
        raise OptionError(f"{shown(text)} is no time and fact; write '2.5s: online(@3, l1)'")
    if not fact.isascii() and any("\ud800" <= character <= "\udfff" for character in fact):
        raise OptionError(f"{shown(text)} is not UTF-8")
    return duration(when), fact.strip()


@dataclass(frozen=True, slots=True)
class Death:
    """The end of a robot's process, or the beginning of a new one."""

    at: Instant
    robot: int
    restart: bool
    text: str
    """As the option says it."""

    @property
    def option(self) -> str:
        """The option that asks for it."""
        return "--restart" if self.restart else "--kill"


def deaths(kills: Sequence[str], restarts: Sequence[str], robots: Collection[int]) -> tuple[Death, ...]:
    """Return the deaths and restarts of the two options, in order of time. Raises OptionError.

    At one instant robots are killed before others are started again, in the order of the options.
    """
    found = [
        each
        for texts, restart in ((kills, False), (restarts, True))
        for text in texts
        for each in _read(text, restart, robots)
    ]
    found.sort(key=lambda each: each.at)
    dead: set[int] = set()
    for each in found:
        lives = each.robot not in dead
        if lives is each.restart:
            state, advice = (
                ("lives", "kill it before it is started again") if lives else ("is dead", "start it again first")
            )
            at = f"at {in_seconds(each.at):g} s"
            raise OptionError(f"{each.option} {shown(each.text)}: robot {each.robot} {state} {at}: {advice}")
        dead ^= {each.robot}
    return tuple(found)


def _read(text: str, restart: bool, robots: Collection[int]) -> list[Death]:
    option = "--restart" if restart else "--kill"
    try:
        at, ids = befalling(text)
    except OptionError as error:
        raise OptionError(f"{option} {shown(text)}: {error}") from None
    for robot in ids:
        if robot not in robots:
            raise OptionError(f"{option} {shown(text)}: robot {robot} is not among the robots")
    return [Death(at, robot, restart, text.strip()) for robot in ids]
