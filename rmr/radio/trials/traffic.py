"""Senders, and the life of their frames.

A sender has an unbounded queue, and hands its radio the next frame when the last one is confirmed. So a radio never has
more than one, and a frame's service begins when it is handed over. `Frame` records the instants of a frame: offered to
the sender, taken by the radio, on the air (each attempt), delivered (the first time), confirmed.

`Scene` is the world of one replication: the kernel, the ether, and the senders by address.
"""

from collections import deque
from collections.abc import Callable
from random import Random

from rmr.base.kernel import ROBOT, Kernel
from rmr.base.streams import stream
from rmr.base.time import NEVER, NS_PER_MS, NS_PER_S, Duration, Instant
from rmr.radio.air import ACK_ATTEMPT, Announcement, Confirmed, Received
from rmr.radio.ether import Ether
from rmr.radio.ether_station import EtherStation
from rmr.radio.frame import FCS_OCTETS, HEADER_OCTETS, PAYLOAD_MAX, PSDU_MAX
from rmr.radio.phy import RadioConfig
from rmr.radio.trials.places import Place

PAN = 1

PHASES: Duration = 10 * NS_PER_MS
"""Interval in which saturated senders start, each at a random instant."""
COUNT_MAX = 100_000
"""Frames of one run that are sent one by one: more than any interval has use for."""


class Frame:
    """The history of one frame; `NEVER` is the instant of an event that has not happened."""

    __slots__ = ("aired", "attempts", "confirmed", "delivered", "offered", "status", "taken")

    def __init__(self, offered: Instant) -> None:
        self.offered = offered
        self.taken = self.aired = self.delivered = self.confirmed = NEVER
        """Handed to the radio; first symbol on the air; last symbol at the receiver; outcome known."""
        self.attempts = 0
        self.status = ""

    @property
    def has_arrived(self) -> bool:
        """Whether the destination has received it."""
        return self.delivered < NEVER


class Sender:
    """One station's traffic to one destination, None for all."""

    def __init__(self, kernel: Kernel, destination: int | None, payload: int) -> None:
        self.frames: list[Frame] = []
        """All frames ever offered, in order."""
        self.on_confirmed: Callable[[Instant], None] | None = None
        """Called after each confirmation; the frame before it is out of the way."""
        self.on_received: Callable[[Received], None] | None = None
        """Called with what the station receives of others."""
        self.last = Frame(0)
        """The frame that is or was last on the air."""
        self.station: EtherStation
        self._kernel = kernel
        self._destination = destination
        self._payload = bytes(payload)
        self._waiting: deque[Frame] = deque()
        self._current: Frame | None = None

    def offer(self, now: Instant) -> None:
        """Have one more frame to send."""
        frame = Frame(now)
        self.frames.append(frame)
        self._waiting.append(frame)
        if self._current is None:
            self._hand_over(now)

    def announced(self, announcement: Announcement) -> None:
        """Take note that the current frame goes on the air."""
        assert self._current is not None
        self.last = self._current
        self.last.attempts += 1
        if self.last.attempts == 1:
            self.last.aired = announcement.start

    def delivered(self, stamp: Instant) -> None:
        """Take note that the frame last on the air has arrived."""
        self.last.delivered = min(self.last.delivered, stamp)

    def take(self, output: Received | Confirmed) -> None:
        """Handle what the radio says."""
        if isinstance(output, Received):
            if self.on_received is not None:
                self.on_received(output)
            return
        frame = self._current
        assert frame is not None
        now = self._kernel.now
        frame.confirmed = now
        frame.status = output.status
        self._current = None
        if self._waiting:
            self._hand_over(now)
        if self.on_confirmed is not None:
            self.on_confirmed(now)

    def _hand_over(self, now: Instant) -> None:
        self._current = self._waiting.popleft()
        self._current.taken = now
        self.station.request(self._payload, self._destination, 0)


class Scene:
    """The world of one replication; all that is random in it is named from the seed."""

    def __init__(self, config: RadioConfig, seed: int) -> None:
        self.kernel = Kernel()
        self.ether = Ether(self.kernel, config, seed, PAN)
        self.ether.on_air = self._on_air
        self.senders: dict[int, Sender] = {}
        self._seed = seed

    def chance(self, name: str) -> Random:
        """Return the stream called `name` of this replication."""
        return stream(f"{self._seed}/{name}")

    def listener(self, address: int, place: Place, hear: Callable[[Received], None] | None) -> EtherStation:
        """Add a station that has nothing to send of itself; without `hear` what it receives is only counted."""

        def take(output: Received | Confirmed) -> None:
            assert hear is not None
            if isinstance(output, Received):
                hear(output)

        return self._add(address, place, take if hear is not None else None)

    def sender(self, address: int, place: Place, destination: int | None, payload: int) -> Sender:
        """Add a station that sends."""
        made = self.senders[address] = Sender(self.kernel, destination, payload)
        made.station = self._add(address, place, made.take)
        return made

    def note_delivery(self, received: Received) -> None:
        """Take note that a sender's frame has arrived where it should."""
        self.senders[received.source].delivered(received.stamp)

    def _add(self, address: int, place: Place, take: Callable[[Received | Confirmed], None] | None) -> EtherStation:
        return self.ether.add(address, self.chance(f"station{address}/csma"), take, *place)

    def _on_air(self, announcement: Announcement) -> None:
        if not announcement.attempt & ACK_ATTEMPT and announcement.source in self.senders:
            self.senders[announcement.source].announced(announcement)


def send_poisson(scene: Scene, sender: Sender, rate_fps: float, rng: Random, until: Instant) -> None:
    """Have `sender` offered frames at independent times, `rate_fps` in a second, before `until`."""

    def arrive(now: Instant, first: bool = False) -> None:
        if not first:
            sender.offer(now)
        following = now + round(rng.expovariate(rate_fps) * NS_PER_S)
        if following < until:
            scene.kernel.at(following, ROBOT, arrive)

    arrive(0, first=True)


def send_always(scene: Scene, sender: Sender, rng: Random) -> None:
    """Have `sender` offered the next frame whenever the last one is confirmed.

    Senders begin at random, to the nanosecond: all times of the standard are multiples of 32 us, and those who began
    together would for ever meet just at the edges of each other's assessments.
    """
    sender.on_confirmed = sender.offer
    scene.kernel.at(rng.randrange(PHASES), ROBOT, sender.offer)


def in_ms(duration: Duration) -> float:
    """Return a duration in milliseconds."""
    return duration / NS_PER_MS


def octets_of(payload: int) -> int:
    """Return the octets of a PSDU with `payload` octets of payload."""
    return payload + HEADER_OCTETS + FCS_OCTETS


def check_payload(payload: int) -> None:
    """Raise `ValueError` if `payload` octets do not fit one frame."""
    if not 0 <= payload <= PAYLOAD_MAX:
        raise ValueError(f"a payload of {payload} octets: a frame carries 0 to {PAYLOAD_MAX}")


def check_psdu(psdu: int) -> None:
    """Raise `ValueError` if `psdu` is not the size of a data frame, in octets."""
    if not octets_of(0) <= psdu <= PSDU_MAX:
        raise ValueError(f"a PSDU of {psdu} octets: a data frame has {octets_of(0)} to {PSDU_MAX}")


def check_count(count: int) -> None:
    """Raise `ValueError` if `count` is not in 1 to `COUNT_MAX`."""
    if not 1 <= count <= COUNT_MAX:
        raise ValueError(f"{count} frames: write 1 to {COUNT_MAX}")
