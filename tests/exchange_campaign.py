"""Random histories of the exchange of facts: two robots over a network that loses, doubles, delays and reorders frames.

The sender and the receiver are killed and restarted after a while. At the end the network is healed; then nothing may
be missing, doubled or out of order beyond what the documentation allows (`problems`). A delivery that takes effect in
two lives of the receiver is doubled: a relay may have handed it on before it died.

Run as a program for a long campaign: ``python exchange_campaign.py FIRST LAST``; each failing seed is printed.
"""

import sys
from dataclasses import dataclass, field
from random import Random

from rmr.base.time import NEVER, Instant, milliseconds, seconds
from rmr.node import payloads
from rmr.node.logic.exchange import Exchange, Outcome
from rmr.node.payloads import Delivery, DeliveryRole, PayloadKind

SENDER, RECEIVER = 0, 1
LATE_MAX = milliseconds(400)
"""Longest delay of a frame, but for the copies that come after any time."""


@dataclass
class Sent:
    """A delivery, by the life of its sender and its place among those of its kind there."""

    life: int
    place: int
    ordered: bool
    acknowledged_in: int | None = None
    """The receiver's life that acknowledged it."""
    given_up: Instant = 0
    """When; 0: it was not."""
    outlived: bool = False
    """It was given up because the receiver was restarted."""
    first_sent: Instant = NEVER
    """When its first frame left."""
    needless: bool = False
    """It was given up though it left after the end of the life that the receiver had told of."""


@dataclass
class History:
    """One run."""

    seed: int
    restarts: bool = True
    now: Instant = 0
    lives: list[int] = field(default_factory=lambda: [0, 0])
    sent: list[Sent] = field(default_factory=list)
    arrived: list[list[int]] = field(default_factory=lambda: [[]])
    """Indices of deliveries in the order in which they took effect, by life of the receiver."""

    def __post_init__(self) -> None:
        self.rng = Random(self.seed)
        self.robots = [Exchange(9, 0, Random(1)), Exchange(9, 0, Random(2))]
        self.air: list[tuple[Instant, int, int, bytes]] = []
        """(arrival, number, destination, frame)."""
        self.kept: list[tuple[int, bytes]] = []
        self.count = 0
        self.dead: list[Instant | None] = [None, None]
        """Since when a robot is dead; None: it lives."""
        self.ended: Instant = 0
        """When the receiver's last life but the present one ended."""
        self.tells_end = self.rng.random() < 0.5
        """Whether the host knows when the receiver died; otherwise its start is what it tells."""
        self.loss = self.rng.choice((0.0, 0.2, 0.5, 0.8))
        self.double = self.rng.choice((0.0, 0.3))
        self.late = self.rng.choice((0, LATE_MAX))

    def run(self) -> list[str]:
        """Run the history; return what is wrong."""
        rng = self.rng
        for _ in range(rng.randint(1, 120)):
            match rng.choices(("send", "wait", "old", "long", "restart", "kill"), (60, 60, 8, 1, 2, 2))[0]:
                case "send":
                    self._send(rng.choice((1, 1, 1, 4, 20)))
                case "wait":
                    self._until(self.now + rng.randint(0, milliseconds(500)))
                case "old" if self.kept:
                    self._take(*rng.choice(self.kept))
                case "long":
                    self._until(self.now + seconds(rng.choice((2, 10, 40, 70))))
                case "restart" if self.restarts:
                    self._restart(rng.choice((SENDER, RECEIVER)))
                case "kill" if self.restarts:
                    self._kill(rng.choice((SENDER, RECEIVER)))
            self._settle()
        for robot in (SENDER, RECEIVER):
            if self.dead[robot] is not None:
                self._restart(robot)
        self.loss = self.double = self.late = 0
        self.healed = self.now
        self._until(NEVER)
        return list(self.problems())

    def problems(self):
        """Yield what is wrong once all is quiet."""
        everything = [index for indices in self.arrived for index in indices]
        if len(set(everything)) != len(everything):
            yield "two lives of the receiver got the same delivery"
        for life, indices in enumerate(self.arrived):
            if len(set(indices)) != len(indices):
                yield f"life {life} of the receiver got something twice"
            ordered = [(self.sent[i].life, self.sent[i].place) for i in indices if self.sent[i].ordered]
            if ordered != sorted(ordered):
                yield f"life {life} of the receiver got ordered deliveries out of order"
        if not all(robot.idle for robot in self.robots):
            yield "something is under way or held back for ever"
        taken = {index for indices in self.arrived for index in indices}
        for index, sent in enumerate(self.sent):
            if sent.needless:
                yield f"delivery {index} was given up though no earlier life of the receiver can have got it"
            if sent.given_up > self.healed + seconds(2) and not sent.outlived:
                yield f"delivery {index} was given up over a perfect network"
            if index in taken or sent.given_up:
                continue
            # A life that ends takes with it what it has not sent, or has acknowledged and holds back.
            ended = sent.acknowledged_in is None and sent.life < self.lives[SENDER]
            if not ended and (sent.acknowledged_in is None or sent.acknowledged_in == self.lives[RECEIVER]):
                yield f"delivery {index} was lost, or acknowledged and never took effect"

    def _send(self, count: int) -> None:
        if self.dead[SENDER] is not None:
            return
        for _ in range(count):
            ordered = self.rng.random() < 0.8
            life = self.lives[SENDER]
            place = sum(each.life == life and each.ordered == ordered for each in self.sent)
            index = len(self.sent)
            self.sent.append(Sent(life, place, ordered))
            body = index.to_bytes(4, "big") * self.rng.choice((1, 1, 1, 60))
            due = self.now + self.rng.randint(0, seconds(3)) if self.rng.random() < 0.3 else NEVER
            delivery = Delivery(DeliveryRole.FACT, index, ())
            self.robots[SENDER].send(self.now, RECEIVER, delivery, body, due=due, ordered=ordered)

    def _kill(self, robot: int) -> None:
        if self.dead[robot] is None:
            self.dead[robot] = self.now
            self.robots[robot] = Exchange(9, 0, Random(0))  # says nothing, and is told nothing

    def _restart(self, robot: int) -> None:
        self._kill(robot)
        self.lives[robot] += 1
        self.robots[robot] = Exchange(9, self.lives[robot], Random(self.lives[robot]))
        ended, self.dead[robot] = self.dead[robot], None
        assert ended is not None
        self.robots[robot].predecessor_ended = ended + 1 if self.tells_end else self.now
        if robot == RECEIVER:
            self.ended = ended
            self.arrived.append([])

    def _until(self, end: Instant) -> None:
        while True:
            wake = min((robot.next_wake for robot in self.robots), default=NEVER)
            event = min(wake, min(self.air)[0] if self.air else NEVER)
            if event == NEVER or event > end:
                break
            self.now = max(self.now, event)
            for robot in self.robots:
                robot.wake(self.now)
            due = sorted(frame for frame in self.air if frame[0] <= self.now)
            self.air = [frame for frame in self.air if frame[0] > self.now]
            for _, _, destination, frame in due:
                self._take(destination, frame)
            self._settle()
        if end != NEVER:
            self.now = max(self.now, end)

    def _take(self, destination: int, frame: bytes) -> None:
        robot = self.robots[destination]
        source = 1 - destination
        if self.dead[destination] is not None:
            return
        match frame[0]:
            case PayloadKind.FACT_ACK:
                robot.acknowledged(self.now, frame, source)
            case PayloadKind.FACT_BASE:
                robot.base_told(self.now, frame, source)
            case PayloadKind.FACT_BASE_WANTED:
                robot.asked(frame, source)
            case PayloadKind.FACT_LIFE:
                robot.life_told(self.now, frame, source)
            case _:
                before = robot.delivered
                robot.received(self.now, frame, source)
                if robot.delivered > before:
                    self._acknowledged_in(payloads.decode_fact_frame(frame))
        self._settle()

    def _acknowledged_in(self, frame: payloads.FactFrame) -> None:
        index = int.from_bytes((frame.piece if frame.part == 0 else self._first(frame))[:4], "big")
        self.sent[index].acknowledged_in = self.lives[RECEIVER]

    def _first(self, frame: payloads.FactFrame) -> bytes:
        """Return the piece with which the body of a fragment begins."""
        for destination, data in self.kept:
            if destination == RECEIVER and data[0] == PayloadKind.FRAGMENT:
                other = payloads.decode_fact_frame(data)
                if (other.epoch, other.sequence, other.part) == (frame.epoch, frame.sequence, 0):
                    return other.piece
        raise AssertionError("a fragment without a first one")

    def _settle(self) -> None:
        for index, robot in enumerate(self.robots):
            arrivals, robot.arrivals = robot.arrivals, []
            for arrival in arrivals:
                self.arrived[-1].append(int.from_bytes(arrival.body[:4], "big"))
            for news in robot.news:
                if news.outcome in (Outcome.UNDELIVERED, Outcome.OUTLIVED):
                    sent = self.sent[news.delivery.index]
                    sent.given_up = self.now
                    sent.outlived = news.outcome is Outcome.OUTLIVED
                    sent.needless = sent.outlived and self.tells_end and sent.first_sent > self.ended
            robot.news.clear()
            for frame, destination, _ in robot.outbox:
                assert destination == 1 - index
                self._carry(destination, frame)
            robot.outbox.clear()

    def _carry(self, destination: int, frame: bytes) -> None:
        self.kept.append((destination, frame))
        if frame[0] in (PayloadKind.FACT, PayloadKind.FRAGMENT):
            fact = payloads.decode_fact_frame(frame)
            if fact.part == 0:
                sent = self.sent[int.from_bytes(fact.piece[:4], "big")]
                sent.first_sent = min(sent.first_sent, self.now)
        for _ in range(1 + (self.rng.random() < self.double)):
            if self.rng.random() >= self.loss:
                self.count += 1
                delay = milliseconds(5) + round(self.rng.random() * self.late)
                self.air.append((self.now + delay, self.count, destination, frame))


def main(first: int, last: int) -> int:
    """Run the histories of these seeds; return how many fail."""
    failed = 0
    for seed in range(first, last + 1):
        wrong = History(seed, restarts=seed % 2 == 0).run()
        if wrong:
            failed += 1
            print(f"seed {seed}: {'; '.join(wrong[:3])}", flush=True)
    print(f"{last - first + 1} histories, {failed} fail")
    return failed


if __name__ == "__main__":
    sys.exit(bool(main(int(sys.argv[1]), int(sys.argv[2]))))
