"""No fact, goal or action on its way between two robots that live is lost or doubled.

What a robot sends is accepted once by the other's mind, or the sender reports that it could not be delivered; then it
may have been accepted all the same, if all acknowledgements were lost. A robot that is started anew has forgotten what
it accepted.
"""

import heapq
from collections import OrderedDict

from rmr.base.time import Duration, Instant
from rmr.node.logic.exchange import TIME_TO_LIVE, DeliveryProgress, Stage
from rmr_sim.checkers.scene import Scene

CHECK = "delivery"
LOOK_AFTER: Duration = 2 * TIME_TO_LIVE
"""What is not decided by then is looked at: longer than any delivery that does not wait for others is under way."""
ACCEPTED_MAX = 100_000
"""Acceptances remembered, the newest; a repeat comes within seconds."""

Name = tuple[int, int, int, int]
"""A delivery: its sender, the sender's epoch, the receiver, the sequence number."""


class Deliveries:
    """Keeps account of every delivery."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._open: dict[Name, int] = {}
        """What is under way, with the life of its sender."""
        self._accepted: OrderedDict[tuple[Name, int], None] = OrderedDict()
        """With the life of the receiver."""
        self._look: list[tuple[Instant, Name]] = []
        scene.hear(DeliveryProgress, self._progressed)

    def _progressed(self, robot: int, now: Instant, progress: DeliveryProgress) -> None:
        peer, epoch, sequence = progress.peer, progress.epoch, progress.sequence
        if progress.stage is Stage.ACCEPTED:
            self._accept(now, (peer, epoch, robot, sequence))
            return
        name = (robot, epoch, peer, sequence)
        if progress.stage is Stage.BEGUN:
            self._open[name] = self._scene.life(robot)
            for life in range(self._scene.life(peer) + 1 if peer in self._scene.robots else 0):
                self._accepted.pop((name, life), None)  # the number has gone round
            heapq.heappush(self._look, (now + LOOK_AFTER, name))
            return
        self._open.pop(name, None)
        if progress.stage is Stage.ACKNOWLEDGED and not self._was_accepted(name):
            words = f"what robot {robot} sent robot {peer} was acknowledged but never accepted"
            self._scene.violate(now, CHECK, (robot, peer), words)

    def _accept(self, now: Instant, name: Name) -> None:
        sender, _, receiver, _ = name
        key = (name, self._scene.life(receiver))
        if key in self._accepted:
            words = f"robot {receiver} accepted the same message of robot {sender} twice"
            self._scene.violate(now, CHECK, (sender, receiver), words)
        self._accepted[key] = None
        if len(self._accepted) > ACCEPTED_MAX:
            self._accepted.popitem(last=False)

    def _was_accepted(self, name: Name) -> bool:
        return any((name, life) in self._accepted for life in range(self._scene.life(name[2]) + 1))

    def __call__(self, now: Instant) -> None:
        """Look at what has been under way for long."""
        while self._look and self._look[0][0] < now:
            _, name = heapq.heappop(self._look)
            sender, _, receiver, _ = name
            scene = self._scene
            life = self._open.get(name)
            if life is None or life != scene.life(sender) or not scene.alive(sender):
                self._open.pop(name, None)
            elif scene.node(sender).messenger.exchange.idle:
                words = f"what robot {sender} sent robot {receiver} is neither delivered nor reported undelivered"
                scene.violate(now, CHECK, (sender, receiver), words)
            else:
                heapq.heappush(self._look, (now + LOOK_AFTER, name))
