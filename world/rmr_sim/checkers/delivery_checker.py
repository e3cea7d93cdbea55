"""Rule: no fact, goal or action that one live robot sends another is lost or duplicated.

The receiver's node accepts a message exactly once, or the sender reports it undelivered. In the second case it may have
been accepted as well, if all acknowledgements were lost. No two lives of a receiver accept the same message, unless it
is a lasting one, of an ensemble rule.
"""

import heapq
from collections import OrderedDict
from typing import TypeVar

from rmr.base.time import Duration, Instant
from rmr.node.logic.exchange import TIME_TO_LIVE, DeliveryProgress, Stage
from rmr_sim.checkers.run_view import RunView

CHECK = "delivery"
LOOK_AFTER: Duration = 2 * TIME_TO_LIVE
"""Age at which an undecided delivery is checked: longer than any delivery takes unless it waits for others."""
ACCEPTED_MAX = 100_000
"""Bound of the acceptances and lasting deliveries that are kept, the newest; a duplicate comes within seconds."""

T = TypeVar("T")
Name = tuple[int, int, int, int]
"""Identity of a delivery: sender, the sender's epoch, receiver, sequence number."""


class DeliveryChecker:
    """Checks every delivery."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._open: dict[Name, int] = {}
        """Deliveries under way, with the incarnation of the sender."""
        self._accepted: OrderedDict[tuple[Name, int], None] = OrderedDict()
        """Acceptances, with the incarnation of the receiver."""
        self._lasting: OrderedDict[Name, None] = OrderedDict()
        """Deliveries that are repeated to each life of their receivers."""
        self._look: list[tuple[Instant, Name]] = []
        view.subscribe(DeliveryProgress, self._progressed)

    def _progressed(self, robot: int, now: Instant, progress: DeliveryProgress) -> None:
        peer = progress.peer
        epoch = progress.epoch
        sequence = progress.sequence
        if progress.stage is Stage.ACCEPTED:
            self._accept(now, (peer, epoch, robot, sequence))
            return
        if progress.stage is Stage.RELEASED:
            return  # accepted before
        name = (robot, epoch, peer, sequence)
        if progress.stage is Stage.BEGUN:
            self._open[name] = self._view.life(robot)
            if progress.lasting:
                _remember(self._lasting, name)
            for life in range(self._view.life(peer) + 1 if peer in self._view.robots else 0):
                self._accepted.pop((name, life), None)  # the sequence number has wrapped around
            heapq.heappush(self._look, (now + LOOK_AFTER, name))
            return
        self._open.pop(name, None)
        if progress.stage is Stage.ACKNOWLEDGED and not self._was_accepted(name):
            words = f"what robot {robot} sent robot {peer} was acknowledged but never accepted"
            self._view.violate(now, CHECK, (robot, peer), words)

    def _accept(self, now: Instant, name: Name) -> None:
        sender, _, receiver, _ = name
        key = (name, self._view.life(receiver))
        if key in self._accepted:
            words = f"robot {receiver} accepted the same message of robot {sender} twice"
            self._view.violate(now, CHECK, (sender, receiver), words)
        elif name not in self._lasting and self._was_accepted(name):
            words = f"two lives of robot {receiver} accepted the same message of robot {sender}"
            self._view.violate(now, CHECK, (sender, receiver), words)
        _remember(self._accepted, key)

    def _was_accepted(self, name: Name) -> bool:
        return any((name, life) in self._accepted for life in range(self._view.life(name[2]) + 1))

    def __call__(self, now: Instant) -> None:
        """Check the deliveries that have been under way for long."""
        while self._look and self._look[0][0] < now:
            _, name = heapq.heappop(self._look)
            sender, _, receiver, _ = name
            view = self._view
            life = self._open.get(name)
            if life is None or life != view.life(sender) or not view.alive(sender):
                self._open.pop(name, None)
            elif view.node(sender).messenger.exchange.idle:
                words = f"what robot {sender} sent robot {receiver} is neither delivered nor reported undelivered"
                view.violate(now, CHECK, (sender, receiver), words)
            else:
                heapq.heappush(self._look, (now + LOOK_AFTER, name))


def _remember(known: OrderedDict[T, None], name: T) -> None:
    """Add a name; the oldest ones are forgotten."""
    known[name] = None
    if len(known) > ACCEPTED_MAX:
        known.popitem(last=False)
