"""Deaths and restarts of robots during an evaluation: `--kill` and `--restart`."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from rmr.base.ids import shown
from rmr.base.time import Instant, in_seconds
from rmr.eval.options import OptionError, befalling


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
