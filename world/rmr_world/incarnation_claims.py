"""Which process is which robot: one at a time, and each knows how many have been it before, and until when.

A process asks for its robot with a token of its own. The claim stands while the robot is alive on the bus, and for
`CLAIM_S` before it has appeared there. Each new token is a life of the robot. It is told an instant at which the life
before had ended, so that others know what that one cannot have received.
"""

from collections.abc import Sequence
from typing import Any, Final

from rmr.base.time import Duration, Instant, milliseconds

CLAIM_S: Final = 1.0
"""How long a claim is valid without a liveliness token, which a robot declares within milliseconds."""
CLOCKS_APART: Final[Duration] = milliseconds(500)
"""How far a robot's lab time may be ahead of the world's (`rmr_agent.clock.AHEAD_MAX`): a frame that leaves so much
later than a death, by its sender's clock, has left after it."""


class IncarnationClaims:
    """The claims of all robots."""

    def __init__(self) -> None:
        self._claims: dict[int, tuple[int, float]] = {}
        """Token, and when it was claimed last, seconds of a monotonic clock."""
        self._lives: dict[int, dict[int, Instant | None]] = {}
        """By robot and token, in the order of lives: when the life before had ended, if that is known."""
        self._gone: dict[int, Instant] = {}
        """When a robot vanished from the bus last."""

    def claim(self, robot: int, token: int, at: float, *, alive: bool) -> bool:
        """Let the process with `token` be `robot`, unless another one is; return whether it may.

        `at` is now by a monotonic clock, seconds; `alive` says whether the robot is on the bus.
        """
        claim = self._claims.get(robot)
        if claim is not None and claim[0] != token and (alive or at - claim[1] < CLAIM_S):
            return False
        self._claims[robot] = token, at
        lives = self._lives.setdefault(robot, {})
        if token not in lives:
            gone = self._gone.get(robot)
            lives[token] = None if gone is None or not lives else gone + CLOCKS_APART
        return True

    def life(self, robot: int, token: int) -> tuple[int, Instant | None]:
        """Return the number of earlier lives of `robot`, and when the last of them had ended, if that is known."""
        lives = self._lives.get(robot, {})
        return (list(lives).index(token), lives[token]) if token in lives else (len(lives), None)

    def vanished(self, robot: int, now: Instant) -> None:
        """Take note that a robot is not on the bus any more, at this lab time."""
        self._gone[robot] = now

    def kept(self) -> list[Any]:
        """Return the lives of all robots as plain data."""
        return [[robot, [list(life) for life in lives.items()]] for robot, lives in self._lives.items()]

    def bring_back(self, kept: Sequence[Any], now: Instant) -> None:
        """Take over lives that were `kept`; who does not return had ended before this lab time."""
        self._lives = {robot: dict(lives) for robot, lives in kept}
        self._gone = dict.fromkeys(self._lives, now)

    def release(self, robot: int) -> None:
        """Let any process be `robot`: the one that was has left."""
        self._claims.pop(robot, None)
