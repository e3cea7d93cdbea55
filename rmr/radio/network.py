"""The radio of robots that have a network: frames as they are, without losses, airtime or range of an emulated radio.

A station has the interface of `rmr.radio.station.Station`, and its frames are those of 802.15.4. But a frame is taken
when it arrives, by whoever it is for, wherever the robots are; a transmission begins and ends at one instant. There is
no medium access: requests do not wait for each other. A unicast is acknowledged, so its sender knows whether it came;
after `ACK_WAIT` it is sent again, three times at most. Disturbances (`rmr fault`) cut links and lose frames as ever.

`Network` hosts the stations of a lab in virtual time. There a frame arrives `LATENCY` after it was sent.
"""

from collections.abc import Callable
from math import hypot, inf
from random import Random
from typing import Final

from rmr.base.kernel import AIR, RADIO, Alarm, Kernel
from rmr.base.time import NEVER, NS_PER_MS, Duration, Instant
from rmr.radio.air import ACK_ATTEMPT, SEQUENCE_MASK, Announcement, Confirmed, Output, Received
from rmr.radio.frame import BROADCAST, PAYLOAD_MAX, AckFrame, DataFrame, FrameError, encode_ack, encode_data
from rmr.radio.links import Disturbance, Links
from rmr.radio.mac import QUEUE_MAX, RETRIES_MAX
from rmr.radio.phy import RadioConfig, draw, is_dropped, path_loss_db
from rmr.radio.receive_filter import Counters, ReceiveFilter, decoded
from rmr.radio.security import Security

ACK_WAIT: Final[Duration] = 100 * NS_PER_MS
"""How long a station waits for an acknowledgement: a wireless network that is busy takes some tens of milliseconds."""
TAKEN_MAX: Final = 512
"""Frames that wait for the host. Further ones are lost, and not acknowledged."""
REMEMBERED_MAX: Final = 4096
"""Frames by which repeats are known: those of the last second, from a hundred robots that send forty each."""
LATENCY: Final[Duration] = 2 * NS_PER_MS
"""From station to station in virtual time; between processes of one machine it is 1.3 ms."""
BEST_LQI: Final = 255


class _Pending:
    """A request that waits for its acknowledgement."""

    __slots__ = ("attempt", "deadline", "destination", "handle", "psdu")

    def __init__(self, psdu: bytes, destination: int, handle: int, deadline: Instant) -> None:
        self.psdu = psdu
        self.destination = destination
        self.handle = handle
        self.deadline = deadline
        self.attempt = 0


class NetworkStation:
    """One robot's end of the network. `next_wake` is when it wants `advance`, at the latest."""

    payload_max: Final = PAYLOAD_MAX
    """Octets of payload that a frame holds."""
    mute: Final = False
    """Frames of a network have no counter that could be used up."""

    def __init__(
        self,
        address: int,
        pan: int,
        seed: int,
        rng: Random,
        config: RadioConfig,
        patience: Duration = 0,
        links: Links | None = None,
        counters: Counters | None = None,
    ) -> None:
        """`patience`: see `rmr.radio.station.Station`. `links` says what is disturbed; None: nothing yet."""
        self.address = address
        self.config = config
        self.counters = counters or Counters()
        self.links = links or Links(config, seed)
        self.next_wake: Instant = NEVER
        self.soonest: Instant = NEVER
        self._seed = seed
        self._pan = pan
        self._patience = patience
        self._receive_filter = ReceiveFilter(address, pan, self.counters)
        # Of 32 bits: an acknowledgement names no receiver, and is known by its source and this number.
        self._sequence = rng.getrandbits(32)
        self._pending: dict[int, _Pending] = {}
        self._leaving = 0
        self._taken = 0
        """Frames that leave, and that were taken, since the last call of `advance`."""
        self._seen: dict[tuple[int, int], int] = {}
        """The newest attempt of each frame that was taken, by source and number, the oldest first."""
        self._x = self._y = 0.0
        self._out: list[Output] = []

    @property
    def queued(self) -> int:
        """Number of requests that wait for an acknowledgement."""
        return len(self._pending)

    def move(self, x: float, y: float) -> None:
        """Set the station's place, metres; `advance` does so as well."""
        self._x = x
        self._y = y

    def request(
        self,
        now: Instant,
        payload: bytes,
        destination: int | None,
        handle: int,
        due: Instant = NEVER,  # noqa: ARG002 - nothing waits that another could overtake
    ) -> None:
        """Send `payload` (up to `payload_max` octets) to `destination`, None for all.

        A `Confirmed` with `handle` follows. Raises `ValueError` if the payload or the destination does not fit a frame.
        """
        unicast = destination is not None and destination != BROADCAST
        receiver = destination if unicast and destination is not None else BROADCAST
        sequence = self._sequence
        psdu = encode_data(DataFrame(self._pan, receiver, self.address, sequence & 0xFF, unicast, payload))
        self._want(now, now)
        if len(self._pending) + self._leaving >= QUEUE_MAX:
            self.counters.access_failed += 1
            self._out.append(Confirmed(handle, "access_failure"))
            return
        self._sequence = (sequence + 1) & SEQUENCE_MASK
        self._send(now, psdu, sequence, 0)
        if unicast:
            self._pending[sequence] = _Pending(psdu, receiver, handle, now + ACK_WAIT)
        else:
            self._leaving += 1
            self._out.append(Confirmed(handle, "ok"))

    def _send(self, now: Instant, psdu: bytes, sequence: int, attempt: int) -> None:
        if attempt & ACK_ATTEMPT:
            self.counters.acknowledgements += 1
        else:
            self.counters.sent += 1
        own = (self.address, sequence, attempt, now, now, self.config.tx_power_dbm, self._x, self._y)
        self._out.append(Announcement(*own, psdu))

    def hear(self, announcement: Announcement, now: Instant) -> None:
        """Take in a frame that has arrived `now`, perhaps for the second time; its own are ignored."""
        if announcement.source == self.address:
            return
        try:
            frame = decoded(announcement.psdu)
        except FrameError:
            self.counters.malformed += 1
            return
        if isinstance(frame, AckFrame):
            self._answered(announcement, now)
        elif frame.source == announcement.source and self._receive_filter.concerns(frame):
            self._take(announcement, frame, now)

    def _answered(self, announcement: Announcement, now: Instant) -> None:
        pending = self._pending.get(announcement.sequence)
        if pending is None or pending.destination != announcement.source or self._is_lost(announcement):
            return
        del self._pending[announcement.sequence]
        self._out.append(Confirmed(pending.handle, "ok"))
        self._want(now, now)

    def _take(self, announcement: Announcement, frame: DataFrame, now: Instant) -> None:
        frame_id = announcement.source, announcement.sequence
        seen = self._seen.get(frame_id)
        if seen is not None and announcement.attempt <= seen:
            return  # the same transmission by another key of the bus
        if self._taken >= TAKEN_MAX or self._is_lost(announcement):
            self.counters.dropped += 1
            return
        if seen is None and len(self._seen) >= REMEMBERED_MAX:
            del self._seen[next(iter(self._seen))]
        self._seen[frame_id] = announcement.attempt
        self._taken += 1
        self._want(now, now if frame.wants_ack else now + self._patience)
        if frame.wants_ack:
            number = announcement.sequence
            self._send(now, encode_ack(frame.sequence), number, ACK_ATTEMPT | announcement.attempt)
        if seen is not None:
            self.counters.duplicates += 1
            return
        received = self._receive_filter.take(frame, self._rssi_dbm(announcement), BEST_LQI, now)
        if received is not None:
            self._out.append(received)

    def _is_lost(self, announcement: Announcement) -> bool:
        """Whether a disturbance of the link takes the frame."""
        source, sequence, attempt, start, *_ = announcement
        links = self.links
        if links.fades and links.gain_db(source, self.address, start) == -inf:
            return True
        bits = draw(self._seed, source, sequence, attempt, self.address)
        return links.loses and is_dropped(bits, links.loss(source, self.address, start))

    def _rssi_dbm(self, announcement: Announcement) -> float:
        """Return the power that a radio would have received: by it a program knows how far its neighbors are."""
        away = hypot(announcement.x - self._x, announcement.y - self._y)
        return self.config.tx_power_dbm - path_loss_db(away, self.config.exponent)

    def advance(self, now: Instant, x: float, y: float) -> list[Output]:
        """Return what has come of requests and arrivals up to `now`, with the station at `x`, `y` (metres)."""
        self._x = x
        self._y = y
        if now < self.soonest:
            return []
        for sequence, pending in [each for each in self._pending.items() if each[1].deadline <= now]:
            if pending.attempt < RETRIES_MAX:
                pending.attempt += 1
                pending.deadline = now + ACK_WAIT
                self._send(now, pending.psdu, sequence, pending.attempt)
            else:
                del self._pending[sequence]
                self.counters.no_ack += 1
                self._out.append(Confirmed(pending.handle, "no_ack"))
        out = self._out
        self._out = []
        self._leaving = self._taken = 0
        self.soonest = self.next_wake = min((each.deadline for each in self._pending.values()), default=NEVER)
        return out

    def _want(self, possible: Instant, wanted: Instant) -> None:
        self.soonest = min(self.soonest, possible)
        self.next_wake = min(self.next_wake, wanted)


class Network:
    """The stations of one lab in virtual time, with the interface of `rmr.radio.ether.Ether`."""

    def __init__(self, kernel: Kernel, config: RadioConfig, seed: int, pan: int) -> None:
        self.kernel = kernel
        self.config = config
        self.seed = seed
        self.pan = pan
        self.links = Links(config, seed)
        self.stations: list[HostedStation] = []
        self.on_air: Callable[[Announcement], None] | None = None
        """Called with each announcement, acknowledgements too."""

    def add(
        self,
        address: int,
        rng: Random,
        take: Callable[[Received | Confirmed], None] | None,
        x: float = 0.0,
        y: float = 0.0,
        *,
        security: Security | None = None,
    ) -> "HostedStation":
        """Return a new station at (x, y), metres. Raises `ValueError` for a radio that secures its frames."""
        if security is not None:
            raise ValueError("frames of a network are secured by the bus")
        station = HostedStation(self, len(self.stations), address, rng, take)
        station.move(x, y)
        self.stations.append(station)
        return station

    def announce(self, announcement: Announcement) -> None:
        """Let all other stations have a frame in `LATENCY`."""
        if self.on_air is not None:
            self.on_air(announcement)
        self.kernel.at(self.kernel.now + LATENCY, AIR, lambda now: self._arrive(announcement, now))

    def _arrive(self, announcement: Announcement, now: Instant) -> None:
        for station in self.stations:
            station.arrived(announcement, now)


class HostedStation:
    """A station in virtual time, with the interface of `rmr.radio.ether_station.EtherStation`."""

    payload_max: Final = PAYLOAD_MAX

    def __init__(
        self,
        network: Network,
        index: int,
        address: int,
        rng: Random,
        take: Callable[[Received | Confirmed], None] | None,
    ) -> None:
        self.index = index
        self.take = take
        self.held = False
        """Whether its process is stopped or ended: nothing is sent."""
        self._on = True
        self._network = network
        self._address = address
        self._place = (0.0, 0.0)
        self._waiting: list[Announcement] = []
        """What has arrived while the process was stopped."""
        self._alarm = Alarm(network.kernel, RADIO, self._advance)
        self._station = self._made(rng, Counters())

    def _made(self, rng: Random, counters: Counters) -> NetworkStation:
        net = self._network
        return NetworkStation(self._address, net.pan, net.seed, rng, net.config, links=net.links, counters=counters)

    @property
    def counters(self) -> Counters:
        """Its counters."""
        return self._station.counters

    @property
    def queued(self) -> int:
        """Number of requests that wait for an acknowledgement."""
        return self._station.queued

    def request(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Send `payload`; see `NetworkStation.request`."""
        self._station.request(self._network.kernel.now, payload, destination, handle, due)
        self._set_alarm()

    def move(self, x: float, y: float) -> None:
        """Set the station's place, metres."""
        self._place = x, y
        self._station.move(x, y)

    def hold(self) -> None:
        """Stop the process: frames that arrive wait, as many as a process that lags keeps."""
        self.held = True
        self._alarm.set(NEVER)

    def resume(self, now: Instant) -> None:
        """Continue after `hold`."""
        self.held = False
        for announcement in self._waiting:
            self._station.hear(announcement, now)
        self._waiting.clear()
        self._set_alarm()

    def switch_off(self) -> None:
        """Neither send nor receive any more, as when the process ends."""
        self.hold()
        self._on = False
        self._waiting.clear()

    def switch_on(self, rng: Random, security: Security | None) -> None:
        """Start the next incarnation in the same place, which keeps nothing of the earlier one but the counters."""
        assert security is None, "frames of a network are secured by the bus"
        self._station = self._made(rng, self._station.counters)
        self._station.move(*self._place)
        self.held = False
        self._on = True

    def arrived(self, announcement: Announcement, now: Instant) -> None:
        """Take in a frame of the network."""
        if not self._on:
            return
        if not self.held:
            self._station.hear(announcement, now)
            self._set_alarm()
        elif len(self._waiting) < TAKEN_MAX:
            self._waiting.append(announcement)
        else:
            self.counters.dropped += 1

    def _set_alarm(self) -> None:
        if not self.held:
            self._alarm.set(self._station.next_wake)

    def _advance(self, now: Instant) -> None:
        for out in self._station.advance(now, *self._place):
            if isinstance(out, Announcement):
                self._network.announce(out)
            elif self.take is not None:
                self.take(out)
        self._set_alarm()


def network_disturbance_problem(disturbance: Disturbance) -> str:
    """Return why a network cannot be disturbed in this way, with what to do; empty if it can."""
    if disturbance.attenuation_db in (0.0, inf):
        return ""
    return "a radio of mode network has no power that could be attenuated; cut the link, or lose a share of its frames"
