"""The sensed facts `neighbor`, `range` and `silent`: who is near, how far away, and who is heard no more.

They go by what the host offers, or by what frames tell.
"""

from collections.abc import Callable, Sequence

from rmr.base.time import NEVER, Instant
from rmr.base.values import Robot, Value
from rmr.node.motion.hearing import DEAD
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
        self._tells_silence = senses.used("silent")
        self._senses = senses
        self._roster = sorted(other for other in state.config.roster if other != state.robot)
        self._peers = state.peers
        self._radio = state.config.radio
        self._offered = offered
        self._near: Offered | None = None
        self._silent_from: dict[int, Instant] = {}
        """Of robots that the host has offered and offers no more, or would offer if they lived."""
        self.next_wake: Instant = NEVER
        """When the next one of them is silent; NEVER where frames tell: a robot that says hello is called often."""

    def miss(self, now: Instant, others: Sequence[int]) -> None:
        """Note robots that the host would offer if they lived, as this one begins: they are silent unless they come."""
        for other in others:
            self._silent_from[other] = now + DEAD

    def state(self, now: Instant) -> None:
        """State the facts as of now."""
        senses = self._senses
        if self._offered is None:
            if self._used:
                senses.replace(now, "neighbor", [(Robot(other),) for other in self._peers.neighbors(now)])
                senses.replace(now, "range", self._ranges(now))
            if self._tells_silence:
                senses.replace(now, "silent", [(Robot(other),) for other in self._unheard(now)])
            return
        if not self._used and not self._tells_silence:
            return
        near = self._offered()
        if near is not self._near:
            self._note_changes(now, self._near or (), near)
            self._near = near
            senses.replace(now, "neighbor", [(Robot(other),) for other, _ in near])
            senses.replace(now, "range", [(Robot(other), metres) for other, metres in near])
        if self._tells_silence:
            silent = sorted(other for other, at in self._silent_from.items() if at <= now)
            senses.replace(now, "silent", [(Robot(other),) for other in silent])
            self.next_wake = min([at for at in self._silent_from.values() if at > now], default=NEVER)

    def _note_changes(self, now: Instant, before: Offered, near: Offered) -> None:
        offered = {other for other, _ in near}
        for other in [other for other, _ in before if other not in offered]:
            self._silent_from[other] = now + DEAD
        for other in offered:
            self._silent_from.pop(other, None)

    def _unheard(self, now: Instant) -> list[int]:
        """Return the robots that count as dead, and those that have not been heard in the time after which they do."""
        peers = self._peers
        # Where the radio does not reach over the whole floor a robot may be out of range from the beginning.
        began = NEVER if peers.links is None else peers.links.first_at(now)
        silent = []
        for other in self._roster:
            peer = peers.known.get(other)
            if peer is None or peer.hello is None:
                is_silent = now - began > DEAD
            else:
                is_silent = now - peer.hello_at > DEAD and now > peers.dead_from(other, peer)
            if is_silent:
                silent.append(other)
        return silent

    def _ranges(self, now: Instant) -> list[tuple[Value, ...]]:
        """Return (robot, metres) for each neighbor: signal strength by the log-distance path loss law, to 10 cm."""
        at_1_m = self._radio.tx_power_dbm - LOSS_AT_1_M_DB
        slope = 10 * self._radio.exponent
        known = self._peers.known
        return [
            (Robot(robot), round(10 ** ((at_1_m - known[robot].rssi_dbm) / slope), 1))
            for robot in self._peers.neighbors(now)
        ]
