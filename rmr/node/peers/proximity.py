"""The sensed facts `neighbor` and `range`: who is near, and how far away, as the host offers it or as frames tell."""

from collections.abc import Callable, Sequence

from rmr.base.time import Instant
from rmr.base.values import Robot, Value
from rmr.node.robot_state import RobotState
from rmr.radio.phy import LOSS_AT_1_M_DB

Offered = Sequence[tuple[int, float]]
"""(robot, metres) of those in range, as a host knows it."""


class Proximity:
    """States who is near one robot."""

    def __init__(self, state: RobotState, offered: Callable[[], Offered] | None) -> None:
        """`offered` returns the same object while nothing has changed; None: the robot goes by what it hears."""
        senses = state.senses
        self._used = senses.used("neighbor") or senses.used("range")
        self._senses = senses
        self._peers = state.peers
        self._radio = state.config.radio
        self._offered = offered
        self._near: Offered | None = None

    def state(self, now: Instant) -> None:
        """State both facts as of now."""
        if not self._used:
            return
        if self._offered is None:
            self._senses.replace(now, "neighbor", [(Robot(other),) for other in self._peers.neighbors(now)])
            self._senses.replace(now, "range", self._ranges(now))
            return
        near = self._offered()
        if near is not self._near:
            self._near = near
            self._senses.replace(now, "neighbor", [(Robot(other),) for other, _ in near])
            self._senses.replace(now, "range", [(Robot(other), metres) for other, metres in near])

    def _ranges(self, now: Instant) -> list[tuple[Value, ...]]:
        """Return (robot, metres) for each neighbor: signal strength by the log-distance path loss law, to 10 cm."""
        at_1_m = self._radio.tx_power_dbm - LOSS_AT_1_M_DB
        slope = 10 * self._radio.exponent
        known = self._peers.known
        return [
            (Robot(robot), round(10 ** ((at_1_m - known[robot].rssi_dbm) / slope), 1))
            for robot in self._peers.neighbors(now)
        ]
