"""Facts between robots: exactly once and in order while both live (a fact travels until the *node* acknowledges it).

Each delivery has (sender, epoch, sequence). The sender repeats it, with back-off, until the receiving node
acknowledges; the receiver acknowledges every copy and hands on only the first. Fragments are acknowledged as
a whole. A delivery that outlives its time comes back as `Outcome.UNDELIVERED`: nothing vanishes.

Acknowledgements are selective (TCP's SACK, RFC 2018): each tells which of the numbers before it have arrived, too. What
has not, although something later has, is repeated at once (RACK-TLP, RFC 8985): once for each copy, so at most once in
a round trip. The oldest ordered delivery under way, which those behind it wait for, is repeated every `RETRY_FIRST`,
without back-off, as long as its receiver has acknowledged anything within `HEARD_WITHIN`. All others back off. When a
robot that has acknowledged nothing for so long is heard again, all that is under way to it is repeated at once.

Deliveries from one robot to another take effect in the order in which they were sent; `unordered` ones take effect as
they arrive and leave earliest deadline first. A receiver acknowledges an ordered delivery that arrives early and holds
it back until those before it have taken effect (`rmr.node.logic.inbound`). The sender alone knows whether something
missing will still come: what it has given up, or what an earlier life of the receiver has acknowledged, will not. So
a receiver for which a delivery has been missing for `ASK_AFTER` asks the sender for the first number that it is not
done with (`FACT_BASE`), again and again; a sender that gives something up says so unasked. If no
answer comes for `HELD_MAX`, or the sender begins another life, what is held back takes effect in its order, without
what is missing.

A delivery takes effect in one life of its receiver at most. Frames are addressed to the life that the sender knows of,
at first to number 0. A receiver drops what is meant for an earlier life of it and answers with its own, and with an
instant at which the earlier one had ended (`FACT_LIFE`). What the sender first sent before that instant it gives up as
`Outcome.OUTLIVED`: the earlier life may have taken it and passed it on. All else it sends to the new life. No receiver
forgets its own number, and a frame is first sent after its delivery was addressed; so the earlier life cannot have
taken what the new one takes. `lasting` deliveries are the exception: they are repeated to each life.

Nothing is handed on twice, however late a copy comes. The receiver keeps windows of sequence numbers for the newest
epoch of each sender. Frames of an older epoch are late ones of a life that has ended: no sender awaits their
acknowledgement, and they are dropped. Epochs and sequence numbers are compared as
serial numbers (RFC 1982): of two the newer is less than half the range ahead. An epoch has 8 bits, so a receiver that
hears nothing through 128 restarts of a sender takes the next lives for old ones; the sender then reports its deliveries
as undelivered.

It does not know what a fact means and it does not know the radio: frames leave through `outbox`.
"""

from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from random import Random
from typing import Final, NamedTuple

from rmr.base.time import NEVER, Duration, Instant, milliseconds, seconds
from rmr.node import payloads
from rmr.node.actions.action_log import ActionEnded
from rmr.node.logic.inbound import UNORDERED, Arrival, Inbound, ahead
from rmr.node.logic.outbound import RETRY_FIRST, ROUTINE_WITHIN, Outgoing, Recipient
from rmr.node.payloads import Delivery, DeliveryRole, WireError
from rmr.vm.machine_events import ActionDerived, FactSent, FinishAwaited, FinishSeen, GoalSent

RETRY_MAX: Final[Duration] = seconds(1)
"""Longest time between two repeats within `PERSISTENT_FOR`: about 25; at 50 % loss both ways 1 delivery in 1000 needs
more."""
PERSISTENT_FOR: Final[Duration] = seconds(30)
"""Time after its first transmission from which on a delivery is repeated rarely, every `RARE_RETRY`. A lasting one then
takes no other one's place any more."""
RARE_RETRY: Final[Duration] = seconds(5)
"""Longest time between two repeats of a delivery that has been under way for `PERSISTENT_FOR`."""
TIME_TO_LIVE: Final[Duration] = seconds(45)
"""Time after its first transmission at which a delivery is given up and reported: a robot that is silent for 30 s gets
it when it is heard again. One that still waits is given up when the receiver has acknowledged nothing for that long."""
HEARD_WITHIN: Final[Duration] = seconds(3)
"""A robot that has acknowledged nothing for this long counts as silent."""
ASK_AFTER: Final[Duration] = seconds(1)
"""Time for which a delivery may be missing before its sender is asked, and between two questions; the sender repeats it
several times in between."""
HELD_MAX: Final[Duration] = TIME_TO_LIVE + seconds(5)
"""Time for which a delivery is held back at most. By then its sender has given up whatever was missing when it came,
for that was sent before it."""
CLOCKS_APART: Final[Duration] = seconds(1)
"""How far the clocks of two robots may differ; a life that ended later than that is a malformed word."""
WAITING_MAX: Final = 10_000
"""Deliveries that may wait for one robot; more are refused, so that a program that talks to a dead robot stays bounded.
They and what is in flight have different sequence numbers. As many may have arrived and wait for the rules of their
robot: more are not acknowledged, so their senders repeat them."""
SENDERS_MAX: Final = 1024
PARTIAL_MAX: Final = 32
"""Deliveries in fragments that may be incomplete at one time."""


class Outcome(Enum):
    """What became of a delivery."""

    DELIVERED = "delivered"
    """The other node has acknowledged it."""
    REPEATED = "repeated"
    """It was sent again."""
    UNDELIVERED = "undelivered"
    """It was given up; the other robot may have got it all the same, if all its acknowledgements were lost."""
    OUTLIVED = "outlived"
    """It was given up, as the life of the other robot that may have got it has ended."""


class News(NamedTuple):
    """An outcome."""

    outcome: Outcome
    destination: int
    epoch: int
    sequence: int
    delivery: Delivery
    earlier: int | None = None
    """Digest of the earlier program that it belongs to; None: the one that runs."""


class ProgramUnknown(NamedTuple):
    """Another robot has said that it has not run an earlier program in its life."""

    robot: int
    life: int
    digest: int
    """Of the earlier program."""
    deliveries: list[Delivery]
    """What was under way to it."""


class Stage(Enum):
    """How far a delivery has come."""

    BEGUN = "begun"
    REPEATED = "repeated"
    """Sent again, for want of an acknowledgement."""
    ACCEPTED = "accepted"
    """By the other node, the first copy."""
    RELEASED = "released"
    """Held back for an earlier one until now."""
    ACKNOWLEDGED = "acknowledged"
    GIVEN_UP = "given up"
    OUTLIVED = "outlived"
    """Given up because its receiver was restarted."""


STAGES: Final = {
    Outcome.DELIVERED: Stage.ACKNOWLEDGED,
    Outcome.REPEATED: Stage.REPEATED,
    Outcome.UNDELIVERED: Stage.GIVEN_UP,
    Outcome.OUTLIVED: Stage.OUTLIVED,
}
"""The stage that an outcome is."""
WHY_GIVEN_UP: Final = {
    Stage.GIVEN_UP: "no acknowledgement",
    Stage.OUTLIVED: "its receiver was restarted before it had acknowledged",
}


Sent = FactSent | GoalSent | ActionDerived | FinishAwaited | FinishSeen | ActionEnded
"""What a delivery is sent for: an event of the machine, or the end of an action that another robot waits for."""


class DeliveryProgress(NamedTuple):
    """A delivery has reached another stage; an event for checkers."""

    stage: Stage
    peer: int
    """The other robot: of an accepted or released delivery its sender, else its destination."""
    epoch: int
    """The sender's."""
    sequence: int
    lasting: bool = False
    """Of one that begins: whether it is never given up, and is repeated to each life of its receiver."""
    delivery: Delivery | None = None
    """One that begins."""
    of: Sent | None = None
    """Of one that begins: what it is sent for; None: the refusal of an action."""


Renewal = Callable[[Delivery], tuple[Delivery, bytes] | None]
"""Returns a delivery and its body in terms of another program; None if that program cannot take it."""


class Exchange:
    """Reliable delivery of facts to other robots over a lossy link, in order unless they are marked `unordered`."""

    def __init__(self, digest: int, epoch: int, rng: Random, payload_max: int = payloads.PAYLOAD_OCTETS_MAX) -> None:
        self._payload_max = payload_max
        self._digest = digest & 0xFFFF
        self._life = epoch
        self._epoch = epoch & 0xFF
        self.predecessor_ended: Instant = 0
        """An instant at which this robot's life before this one had ended, told to those that mean that one."""
        self._greeted: tuple[int, Instant] = (-1, 0)
        """The robot that was told this life last, and when."""
        self._rng = rng
        self._copies = 0
        """Copies of deliveries that were handed to the radio."""
        self._peers: dict[int, Recipient] = {}
        self._senders: OrderedDict[int, Inbound] = OrderedDict()
        self._partial: OrderedDict[tuple[int, int, int, int], dict[int, bytes]] = OrderedDict()
        self.outbox: list[tuple[bytes, int, Instant]] = []
        """(payload, destination, deadline), to be handed to the link; NEVER: the frame is none of a delivery. The owner
        clears it."""
        self.news: list[News] = []
        """What became of deliveries since the last look; the owner clears it."""
        self.earlier: dict[int, frozenset[int]] = {}
        """By digest of 16 bits, programs that this robot has run before in this life, whose offers it still settles:
        the predicates of their messages."""
        self.loaded = False
        """Whether the robot has changed its program in this life: then it answers what is for robots of others."""
        self.unknown: list[ProgramUnknown] = []
        """What others have said of earlier programs since the last look; the owner clears it."""
        self.arrivals: list[Arrival] = []
        """What may take effect, in order; the owner removes each as it does."""
        self.silent: dict[int, None] = {}
        """Robots to which something is under way and that count as silent; the owner tells when it hears one
        (`heard_again`)."""
        self.next_wake: Instant = NEVER
        self._repeat_at: Instant = NEVER
        self._ask_at: Instant = NEVER
        self.delivered = 0
        """Deliveries of others that have arrived here, repeats not counted."""
        self.repeated = 0
        """Deliveries sent again."""
        self.tell: Callable[[DeliveryProgress], None] = lambda _: None
        self.duplicates = 0
        self.held = 0
        """Deliveries that were held back until an earlier one came."""
        self.skipped = 0
        """Times at which held deliveries took effect without an earlier one: after `HELD_MAX`, or in another life of
        their sender."""
        self.late = 0
        """Frames of a sender's earlier life, or meant for one of this robot, dropped."""
        self.foreign = 0
        """Frames of another program, dropped."""

    @property
    def idle(self) -> bool:
        """Whether nothing is under way or held back."""
        return self.next_wake == NEVER

    @property
    def unsettled(self) -> int:
        """Number of deliveries that end with this life: not acknowledged yet, or arrived and without effect yet."""
        sent = sum(len(peer.under_way()) + len(peer.unordered.parked) for peer in self._peers.values())
        return sent + sum(len(sender.held) for sender in self._senders.values()) + len(self.arrivals)

    # -- sender -----------------------------------------------------------------------------------------------

    def send(
        self,
        now: Instant,
        destination: int,
        delivery: Delivery,
        body: bytes,
        *,
        due: Instant = NEVER,
        ordered: bool = True,
        lasting: bool = False,
        of: Sent | None = None,
        earlier: int | None = None,
    ) -> Outgoing:
        """Begin to deliver; `due` is the deadline of what the delivery serves. Return what shows how long it waits.

        A `lasting` delivery, which is not ordered, is never given up: it is repeated until it is acknowledged. `of` is
        passed on to `tell` alone. `earlier` is the digest of the earlier program that it belongs to, if it is not the
        one that runs.

        Raises WireError when `body` is too large to travel, or too much waits already.
        """
        peer = self._peers.get(destination)
        if peer is None:
            peer = self._peers[destination] = Recipient(heard=-TIME_TO_LIVE)
        if peer.waiting >= WAITING_MAX:
            raise WireError(f"{WAITING_MAX} facts wait for robot {destination} already")
        queue = peer.ordered if ordered else peer.unordered
        sequence = queue.next_number if ordered else queue.next_number | UNORDERED
        digest = self._digest if earlier is None else earlier
        to = payloads.address(digest, peer.life)
        frames = payloads.encode_fact_frames(to, self._epoch, sequence, body, self._payload_max)
        expires = now + TIME_TO_LIVE
        outgoing = Outgoing(delivery, destination, sequence, frames, expires, due, now, lasting=lasting, digest=digest)
        queue.push(outgoing)
        self.tell(DeliveryProgress(Stage.BEGUN, destination, self._epoch, sequence, lasting, delivery, of))
        self._fill(now, destination, peer)
        return outgoing

    def _fill(self, now: Instant, destination: int, peer: Recipient, gave_up: bool = False) -> None:
        """Send what may leave; if an ordered delivery was given up, here or before, say what comes first now."""
        for queue in (peer.ordered, peer.unordered):
            while (outgoing := queue.ready()) is not None:
                queue.pop(outgoing)
                if not outgoing.lasting and max(outgoing.expires, peer.heard + TIME_TO_LIVE) <= now:
                    self._tell(Outcome.UNDELIVERED, outgoing)
                    gave_up |= queue is peer.ordered
                    continue
                outgoing.expires = now + TIME_TO_LIVE
                outgoing.sent = now
                queue.in_flight[outgoing.sequence] = outgoing
                self._transmit(now, peer, outgoing)
        if gave_up:
            self._say_base(destination)

    def _tell(self, outcome: Outcome, outgoing: Outgoing) -> None:
        earlier = None if outgoing.digest == self._digest else outgoing.digest
        destination, sequence = outgoing.destination, outgoing.sequence
        self.news.append(News(outcome, destination, self._epoch, sequence, outgoing.delivery, earlier))
        self.tell(DeliveryProgress(STAGES[outcome], outgoing.destination, self._epoch, outgoing.sequence))

    def _transmit(self, now: Instant, peer: Recipient, outgoing: Outgoing) -> None:
        due = min(peer.queue(outgoing.sequence).due(outgoing), now + ROUTINE_WITHIN)
        for frame in outgoing.frames:
            self.outbox.append((frame, outgoing.destination, due))
        self._copies += 1
        outgoing.first_copy = outgoing.first_copy or self._copies
        outgoing.last_copy = self._copies
        self._wait(now, outgoing)
        if outgoing is not peer.ordered.oldest or peer.heard + HEARD_WITHIN <= now:
            longest = RARE_RETRY if outgoing.sent + PERSISTENT_FOR <= now else RETRY_MAX
            outgoing.wait = min(outgoing.wait * 2, longest)

    def _wait(self, now: Instant, outgoing: Outgoing) -> None:
        """Set the time of the next repeat, or of the end of all repeats."""
        # Random, so that two senders whose frames have collided do not repeat at the same instant.
        again = now + round(outgoing.wait * self._rng.uniform(1.0, 1.5))
        outgoing.next_send = again if outgoing.lasting else min(again, outgoing.expires)
        self._repeat_at = min(self._repeat_at, outgoing.next_send)
        self.next_wake = min(self.next_wake, outgoing.next_send)

    def _send_again(self, now: Instant, peer: Recipient, outgoing: Outgoing) -> None:
        self.repeated += 1
        self._tell(Outcome.REPEATED, outgoing)
        self._transmit(now, peer, outgoing)

    def wake(self, now: Instant) -> None:
        """Repeat what is overdue, give up what has outlived its time, and ask for what is missing."""
        if now < self.next_wake:
            return
        if now >= self._repeat_at:
            self._repeat(now)
        if now >= self._ask_at:
            self._ask(now)
        self.next_wake = min(self._repeat_at, self._ask_at)

    def _repeat(self, now: Instant) -> None:
        self._repeat_at = NEVER
        for destination, peer in self._peers.items():
            gave_up = False
            parked = peer.unordered.parked
            for queue in (peer.ordered, peer.unordered):
                for outgoing in [*queue.in_flight.values(), *(parked.values() if queue is peer.unordered else ())]:
                    if outgoing.lasting and outgoing.sequence not in parked and outgoing.sent + PERSISTENT_FOR <= now:
                        parked[outgoing.sequence] = queue.in_flight.pop(outgoing.sequence)
                    if outgoing.expires <= now and not outgoing.lasting:
                        del queue.in_flight[outgoing.sequence]
                        self._tell(Outcome.UNDELIVERED, outgoing)
                        gave_up |= queue is peer.ordered
                    elif outgoing.next_send <= now:
                        self._send_again(now, peer, outgoing)
                    else:
                        self._repeat_at = min(self._repeat_at, outgoing.next_send)
            self._fill(now, destination, peer, gave_up)
            if not peer.idle and max(peer.heard, peer.retried) + HEARD_WITHIN <= now:
                self.silent[destination] = None

    def heard_again(self, now: Instant, robot: int) -> None:
        """Repeat all that is under way to a robot that was `silent` and has been heard."""
        del self.silent[robot]
        peer = self._peers[robot]
        peer.retried = now
        for outgoing in peer.repeated():
            outgoing.wait = RETRY_FIRST
            outgoing.next_send = now
        self._repeat_at = self.next_wake = now

    def acknowledged(self, now: Instant, payload: bytes, source: int) -> None:
        """Handle an acknowledgement from `source`. Raises WireError."""
        epoch, sequence, before = payloads.decode_ack(payload)
        peer = self._peers.get(source)
        if peer is None or epoch != self._epoch:
            return
        arrived = peer.settle(sequence, before)
        if not arrived:
            return
        peer.heard = now
        self.silent.pop(source, None)
        for outgoing in arrived:
            self._tell(Outcome.DELIVERED, outgoing)
        for outgoing in peer.queue(sequence).in_flight.values():
            if any(outgoing.overtaken_by(other) for other in arrived):
                outgoing.wait = RETRY_FIRST
                self._send_again(now, peer, outgoing)
        oldest = peer.ordered.oldest
        if oldest is not None and oldest.wait > RETRY_FIRST:  # what comes after it waits for it from now on
            oldest.wait = RETRY_FIRST
            self._wait(now, oldest)
        self._fill(now, source, peer)
        if all(other.idle for other in self._peers.values()):
            self._repeat_at = NEVER
            self.next_wake = self._ask_at

    def asked(self, payload: bytes, source: int) -> None:
        """Answer a receiver that misses a delivery: say which is the first that will come. Raises WireError."""
        payloads.decode_base_wanted(payload)
        self._say_base(source)

    def _say_base(self, destination: int) -> None:
        peer = self._peers.get(destination)
        base = 0 if peer is None else peer.ordered.base
        to = payloads.address(self._digest, 0 if peer is None else peer.life)
        self.outbox.append((payloads.encode_base(to, self._epoch, base), destination, NEVER))

    def life_told(self, now: Instant, payload: bytes, source: int) -> None:
        """Handle a receiver's word that it is in another life than deliveries were meant for. Raises WireError.

        The last word counts, whatever its number: a late or forged one is contradicted by the receiver's next answer.
        """
        life, ended = payloads.decode_life(payload)
        if ended > now + CLOCKS_APART:
            raise WireError("life: the one before has not ended yet")
        peer = self._peers.get(source)
        if peer is None or life == peer.life:
            return
        peer.heard = now
        for outgoing in peer.begin_life(life, ended):
            self._tell(Outcome.OUTLIVED, outgoing)
        if peer.ordered.base != peer.ordered.next_number:
            self._say_base(source)  # before the deliveries: what comes first
        for outgoing in (*peer.ordered.in_flight.values(), *peer.unordered.in_flight.values()):
            outgoing.wait = RETRY_FIRST
            self._transmit(now, peer, outgoing)
        for outgoing in peer.unordered.parked.values():
            outgoing.next_send = now
        self._repeat_at = self.next_wake = now
        self._fill(now, source, peer)

    def change_program(
        self,
        now: Instant,
        digest: int,
        renewed: Renewal,
        body_of: Callable[[bytes], bytes],
        settled: frozenset[int],
    ) -> None:
        """Go on with another program: what is under way, waits or is held back keeps its number, encoded anew.

        `renewed` returns a delivery and its body for the new program; None: it ends. `body_of` does so for a body that
        has come from another robot; an empty one takes no effect. The facts of the predicates `settled` stay as they
        are: offers of the program that has run until now, to be settled by its rules.
        """
        before = self._digest
        self._digest = digest & 0xFFFF
        self.loaded = True
        if settled:
            self.earlier[before] = settled
        self.earlier.pop(self._digest, None)
        self._partial.clear()  # their other parts come with the new program's digest
        for sender in self._senders.values():
            sender.held = {number: (since, body_of(body)) for number, (since, body) in sender.held.items()}
        self.arrivals = [self._taken_over(each, before, settled, body_of) for each in self.arrivals]
        for destination, peer in self._peers.items():
            gave_up = False
            for outgoing in (*peer.under_way(), *peer.unordered.parked.values()):
                stays = outgoing.digest != before or (
                    outgoing.delivery.role is DeliveryRole.FACT and outgoing.delivery.index in settled
                )
                if stays:
                    if outgoing.sent != NEVER:
                        outgoing.next_send = now
                elif not self._renew(outgoing, renewed(outgoing.delivery), peer.life):
                    peer.remove(outgoing)
                    gave_up = True
                    self.tell(DeliveryProgress(Stage.GIVEN_UP, destination, self._epoch, outgoing.sequence))
                elif outgoing.sent != NEVER:
                    outgoing.next_send = now
            self._fill(now, destination, peer, gave_up)
        self._repeat_at = self.next_wake = now

    def _taken_over(
        self, arrival: Arrival, before: int, settled: frozenset[int], body_of: Callable[[bytes], bytes]
    ) -> Arrival:
        """Return what has arrived and waits as it is to take effect under the new program."""
        whose = before if arrival.earlier is None else arrival.earlier
        if arrival.earlier is not None or payloads.fact_of(arrival.body) in settled:
            return arrival._replace(earlier=None if whose == self._digest else whose)
        return arrival._replace(body=body_of(arrival.body))

    def _renew(self, outgoing: Outgoing, found: tuple[Delivery, bytes] | None, life: int) -> bool:
        if found is None:
            return False
        with suppress(WireError):  # too large, as the new program has no numbers for its symbols
            sequence = outgoing.sequence
            to = payloads.address(self._digest, life)
            frames = payloads.encode_fact_frames(to, self._epoch, sequence, found[1], self._payload_max)
            outgoing.delivery = found[0]
            outgoing.frames = frames
            outgoing.digest = self._digest
            return True
        return False

    # -- receiver ---------------------------------------------------------------------------------------------

    def received(self, now: Instant, payload: bytes, source: int) -> None:
        """Handle a fact frame; what takes effect is appended to `arrivals`. Raises WireError."""
        frame = payloads.decode_fact_frame(payload)
        earlier = self._earlier(frame)
        if earlier is None and not self._is_meant(now, frame.address, source):
            return
        sender = self._sender(source, frame.epoch)
        if sender is None:
            return
        sequence = frame.sequence
        if sender.has(sequence):
            # The first acknowledgement was lost, or crossed the repeat: say it again, or the sender never stops.
            self.duplicates += 1
            self._acknowledge(sender, sequence)
            return
        if sender.passed(sequence) or sender.full(sequence) or len(self.arrivals) >= WAITING_MAX:
            self.duplicates += 1
            self._expect(now, sender)
            return
        body = frame.piece if frame.parts == 1 else self._join(source, frame)
        if body is None:
            return
        arrivals = sender.accept(now, sequence, body)
        self.delivered += 1
        self.tell(DeliveryProgress(Stage.ACCEPTED, source, frame.epoch, sequence))
        self._acknowledge(sender, sequence)
        self._hand_on([each._replace(earlier=earlier) for each in arrivals] if earlier is not None else arrivals)
        self.held += not arrivals
        self._expect(now, sender)

    def base_told(self, now: Instant, payload: bytes, source: int) -> None:
        """Handle a sender's word which ordered delivery is the first that will come. Raises WireError."""
        to, epoch, base = payloads.decode_base(payload)
        if not self._is_meant(now, to, source):
            return
        sender = self._sender(source, epoch)
        if sender is not None:
            self._hand_on(sender.begin_at(base))
            self._expect(now, sender)

    def _earlier(self, frame: payloads.FactFrame) -> int | None:
        """Return the digest of the earlier program whose offers a frame is about; None: it is about no such offer."""
        for digest, settled in self.earlier.items():
            if frame.address == payloads.address(digest, self._epoch):
                return digest if frame.parts == 1 and payloads.fact_of(frame.piece) in settled else None
        return None

    def tells(self, robot: int, digest: int) -> bool:
        """Return whether something of an earlier program is under way to a robot."""
        peer = self._peers.get(robot)
        return peer is not None and bool(peer.of_program(digest))

    def unknown_told(self, now: Instant, payload: bytes, source: int) -> None:
        """Handle the word of a robot of this program that it has not run an earlier one. Raises WireError.

        For the earlier program that is as good as an acknowledgement: `unknown` says what the robot would answer to.
        """
        to, running, life = payloads.decode_unknown(payload)
        peer = self._peers.get(source)
        if peer is None or running != self._digest:
            return
        for digest in self.earlier:
            if payloads.address(digest, peer.life) != to:
                continue
            gone = peer.of_program(digest)
            for outgoing in gone:
                peer.remove(outgoing)
                delivery, sequence = outgoing.delivery, outgoing.sequence
                self.news.append(News(Outcome.DELIVERED, source, self._epoch, sequence, delivery, digest))
                self.tell(DeliveryProgress(Stage.GIVEN_UP, source, self._epoch, sequence))
            if gone:
                deliveries = [each.delivery for each in gone]
                self.unknown.append(ProgramUnknown(source, life, digest, deliveries))
                self._fill(now, source, peer)

    def _is_meant(self, now: Instant, to: int, source: int) -> bool:
        """Return whether a frame with the address `to` is for this life of this robot; answer what is for another."""
        if to == payloads.address(self._digest, self._epoch):
            return True
        if not any(not (to ^ digest) & 0xFF for digest in (self._digest, *self.earlier)):
            self.foreign += 1
            if self.loaded:
                self._greet(now, source, payloads.encode_unknown(to, self._digest, self._life))
            return False
        if any(to == payloads.address(digest, self._epoch) for digest in self.earlier):
            self.foreign += 1  # no message of an offer: its sender repeats it when it has the same program
            return False
        self.late += 1
        self._greet(now, source, payloads.encode_life(self._epoch, self.predecessor_ended))
        return False

    def _greet(self, now: Instant, source: int, answer: bytes) -> None:
        """Answer a robot that means another life or program."""
        # Shortest time between two answers: the frames of one burst get one answer.
        if self._greeted[0] != source or now >= self._greeted[1] + milliseconds(50):
            self._greeted = source, now
            self.outbox.append((answer, source, NEVER))

    def _hand_on(self, arrivals: list[Arrival]) -> None:
        """Take note that nothing earlier is missing before `arrivals`."""
        for arrival in arrivals:
            if arrival.held:
                self.tell(DeliveryProgress(Stage.RELEASED, arrival.source, arrival.epoch, arrival.sequence))
        self.arrivals += arrivals

    def _sender(self, source: int, epoch: int) -> Inbound | None:
        """Return what is known of a life of a sender; None if it has ended."""
        sender = self._senders.get(source)
        if sender is not None and sender.epoch != epoch:
            if ahead(sender.epoch, epoch, 8) < 0:
                self.late += 1
                return None
            self._release(sender)
            sender = None
        if sender is None:
            sender = self._senders[source] = Inbound(source, epoch)
            if len(self._senders) > SENDERS_MAX:
                self._release(self._senders.popitem(last=False)[1])
        return sender

    def _acknowledge(self, sender: Inbound, sequence: int) -> None:
        payload = payloads.encode_ack(sender.epoch, sequence, sender.before(sequence))
        self.outbox.append((payload, sender.source, NEVER))

    def _expect(self, now: Instant, sender: Inbound) -> None:
        """Set the time at which the sender is asked for what is missing."""
        if not sender.held:
            sender.ask_at = NEVER
            return
        if sender.ask_at == NEVER:
            # A life that began before this receiver did: only the sender knows what comes first.
            sender.ask_at = now if sender.next is None else now + ASK_AFTER
        self._ask_at = min(self._ask_at, sender.ask_at)
        self.next_wake = min(self.next_wake, self._ask_at)

    def _ask(self, now: Instant) -> None:
        self._ask_at = NEVER
        for sender in self._senders.values():
            if sender.ask_at > now:
                self._ask_at = min(self._ask_at, sender.ask_at)
                continue
            if sender.held_since + HELD_MAX <= now:
                self.skipped += 1
                self._hand_on(sender.release_oldest())
            if not sender.held:
                sender.ask_at = NEVER
                continue
            self.outbox.append((payloads.encode_base_wanted(sender.epoch), sender.source, NEVER))
            sender.ask_at = now + ASK_AFTER
            self._ask_at = min(self._ask_at, sender.ask_at)

    def _release(self, sender: Inbound) -> None:
        self.skipped += bool(sender.held)
        self._hand_on(sender.release_all())

    def _join(self, source: int, frame: payloads.FactFrame) -> bytes | None:
        key = (source, frame.epoch, frame.sequence, frame.parts)
        parts = self._partial.setdefault(key, {})
        parts[frame.part] = frame.piece
        if len(parts) == frame.parts:
            del self._partial[key]
            return b"".join(parts[i] for i in range(frame.parts))
        if len(self._partial) > PARTIAL_MAX:
            self._partial.popitem(last=False)
        return None
