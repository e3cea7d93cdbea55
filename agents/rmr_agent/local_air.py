"""The radio keys of one robot: the key it publishes on and those it subscribes to.

A robot publishes each announcement on the key of the cell in which the announcement says that it is, and listens to
the ring around its own cell (`rmr.radio.cells`). It listens from its first sample on: before that it does not know
where it is, but neither does it transmit, so no robot can answer it. As all that a session declares and publishes
reaches the router in order, a subscription of a robot is known everywhere before its first frame arrives.

Announcements on the cells' keys are low priority: a robot reads them when it next polls. A frame to be acknowledged is
also announced to its destination, at once, on the key of that robot, so that no other robot is woken for it.

When the cell changes, what is new is declared first and what is left is withdrawn afterwards; keys of both rings are
not touched, so nothing on them is missed or comes twice. Publishers of cells that have been left go with the ring,
so a robot that crosses the whole floor holds nine at most.
"""

from collections.abc import Callable

from rmr.bus import wire
from rmr.bus.checks import MalformedError
from rmr.bus.keys import Keys
from rmr.bus.line import Handler
from rmr.bus.losses import Losses
from rmr.bus.session import Bus
from rmr.radio.air import Announcement
from rmr.radio.cells import Cell, Grid
from rmr.radio.frame import DataFrame
from rmr.radio.receive_filter import decoded


def announced(message: wire.Envelope, losses: Losses) -> Announcement | None:
    """Return what `message` announces; None if nothing, or, which is counted, what another transmitter would send."""
    if not isinstance(message.body, wire.Air | wire.Handshake):
        return None
    announcement = message.body.announcement
    if announcement.source == message.sender:
        return announcement
    losses.drop(MalformedError("a frame of another transmitter than its sender"))
    return None


class LocalAir:
    """One robot's ring of keys."""

    def __init__(self, bus: Bus, keys: Keys, grid: Grid, hear: Handler, robot: int) -> None:
        self._bus = bus
        self._self, self._any = (str(robot), "*") if bus.keyed else ("", "")
        self._keys = keys
        self._grid = grid
        self._hear = hear
        self._cell: Cell | None = None
        self._withdraw: dict[Cell, Callable[[], None]] = {}

    def publish(self, announcement: Announcement) -> None:
        """Tell all robots whom it may concern, and call the one that must answer."""
        cell = self._grid.cell_of(announcement.x, announcement.y)
        self._bus.publish(self._keys.radio(*cell, self._self), wire.Air(announcement))
        frame = decoded(announcement.psdu)
        if isinstance(frame, DataFrame) and frame.wants_ack:
            self._bus.publish(self._keys.call(frame.destination, self._self), wire.Handshake(announcement))

    def move(self, x: float, y: float) -> None:
        """Listen to what can be heard at (x, y), metres."""
        cell = self._grid.follow(self._cell, x, y)
        if cell != self._cell:
            self._cell = cell
            self._listen(cell.ring)

    def leave(self) -> None:
        """Listen to nothing more."""
        self._cell = None
        self._listen(())

    def _listen(self, ring: tuple[Cell, ...]) -> None:
        for cell in ring:
            if cell not in self._withdraw:
                self._withdraw[cell] = self._bus.subscribe(self._keys.radio(*cell, self._any), self._hear)
        for cell in [cell for cell in self._withdraw if cell not in ring]:
            self._withdraw.pop(cell)()
            self._bus.retire(self._keys.radio(*cell, self._self))
