"""The radio of one robot: medium access and reception over announced transmissions.

`hear` is called with each transmission of another station. The station keeps those that matter (all within
`RELEVANCE_DB` of its sensitivity). At the end of a frame for it, `phy.reception` and `phy.draw` decide whether it has
received it. A received unicast is acknowledged 192 us after its end without channel assessment (802.15.4-2006,
7.5.6.4).

It is the radio of a robot process. Between processes announcements come some milliseconds late and out of order, so a
reception is decided `grace` after the frame's end and acknowledged then, still stamped end + 192 us, and the sender
waits for its acknowledgement twice the grace longer. Everything else is decided by time stamps, so a late announcement
leads to the same reception as an early one. With grace 0, announcements delivered as they are made, and all stations
advanced in order of time, nothing is late. Run in this way, stations are the reference for `rmr.radio.ether`.
"""

from bisect import bisect_left, insort
from collections import deque
from math import log10
from random import Random
from typing import Final

from rmr.base.time import NEVER, NS_PER_MS, Duration, Instant
from rmr.radio.air import ACK_ATTEMPT, Announcement, Confirmed, Output, Received
from rmr.radio.frame import ACK_OCTETS, PSDU_MAX, AckFrame, DataFrame, FrameError, encode_ack
from rmr.radio.links import Links
from rmr.radio.mac import Mac, State, Transmission
from rmr.radio.phy import (
    CCA,
    LOCK_HISTORY,
    LOSS_AT_1_M_DB,
    RELEVANCE_DB,
    TURNAROUND,
    Interval,
    RadioConfig,
    ReceptionVerdict,
    Signal,
    airtime,
    channel_busy,
    channel_of,
    draw,
    is_dropped,
    is_right,
    link_quality,
    milliwatts,
    reception,
)
from rmr.radio.receive_filter import Counters, ReceiveFilter, decoded
from rmr.radio.security import Security, payload_max

__all__ = ["Announcement", "Confirmed", "Counters", "RadioConfig", "Received", "Station"]

GRACE_MARGIN: Final[Duration] = NS_PER_MS
"""Margin on twice the grace for which a process waits for a late acknowledgement."""
AIR_MAX: Final = 256
"""Transmissions kept at most; `LOCK_HISTORY` of a full channel holds a few dozen. The oldest are dropped first."""
_ACK_AIRTIME: Final = airtime(ACK_OCTETS)


class _Heard(Signal):
    """An announcement with the power that this station receives."""

    __slots__ = ("announcement", "frame", "power_dbm")

    def __init__(self, announcement: Announcement, power_dbm: float) -> None:
        super().__init__(announcement.start, announcement.end, announcement.source, milliwatts(power_dbm))
        self.announcement = announcement
        self.power_dbm = power_dbm
        self.frame: DataFrame | AckFrame | None = None


def _by_start(heard: Signal) -> tuple[Instant, int]:
    return heard.start, heard.source


def _by_end(heard: Signal) -> tuple[Instant, int]:
    return heard.end, heard.source


class Station:
    """One robot's radio. `next_wake` is when it wants `advance`, at the latest."""

    def __init__(
        self,
        address: int,
        pan: int,
        seed: int,
        rng: Random,
        config: RadioConfig | None = None,
        grace: Duration = 0,
        links: Links | None = None,
        security: Security | None = None,
        patience: Duration = 0,
    ) -> None:
        """`seed` decides receptions, alike in all stations of a lab; `rng` is this station's own, for backoffs.

        `links` is what besides distance happens to them; None: what `config` says, and no disturbances.
        `security` is what secures its frames; None: neither does it send secured frames, nor take them.
        `patience` is how much later than it could the station asks to be advanced for a frame that nobody waits for
        its answer to: several are decided at once then.
        """
        self.address = address
        self.payload_max = payload_max(security)
        """Octets of payload that a frame holds."""
        self.config = config or RadioConfig()
        self.counters = Counters()
        self.links = links or Links(self.config, seed)
        self.next_wake: Instant = NEVER
        self.soonest: Instant = NEVER
        """The earliest instant at which something can be decided; `next_wake` may be later by the patience."""
        self._seed = seed
        self._security = security
        self._grace = grace
        self._patience = patience
        self._channel = channel_of(self.config)
        self._relevant_dbm = self.config.sensitivity_dbm - RELEVANCE_DB
        self._slope_db = 5.0 * self.config.exponent
        self._mac = Mac(address, pan, rng, 2 * grace + GRACE_MARGIN if grace else 0, security)
        self._x = self._y = 0.0
        self._now: Instant = 0
        self._air: list[_Heard] = []
        self._due: list[_Heard] = []
        self._deaf: list[Interval] = []
        self._receive_filter = ReceiveFilter(address, pan, self.counters, security)
        # Assessments with a clear channel, to detect late announcements that contradict them.
        self._assessed: deque[Instant] = deque(maxlen=16)
        self._out: list[Output] = []

    @property
    def mute(self) -> bool:
        """Whether it sends nothing any more because its frame counter is used up."""
        return self._security is not None and self._security.used_up

    @property
    def queued(self) -> int:
        """Number of requests that wait for the channel."""
        return self._mac.queued

    def move(self, x: float, y: float) -> None:
        """Set the station's true position, metres; `advance` does so as well."""
        self._x = x
        self._y = y

    def request(self, now: Instant, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Send `payload` (up to `payload_max` octets) to `destination`, None for all.

        A `Confirmed` with `handle` follows. Frames with a deadline `due` are sent earliest deadline first. Raises
        `ValueError` if the payload or the destination does not fit a frame.
        """
        if not self._mac.request(now, payload, destination, handle, due):
            self.counters.access_failed += 1
            self._out.append(Confirmed(handle, "access_failure"))
            self._want(now, now)
        else:
            self._want(self._mac.next_wake, self._mac.next_wake)

    def hear(self, announcement: Announcement, now: Instant | None = None) -> None:
        """Take in the announcement of another station, early, late or repeated; its own are ignored.

        It is heard where the station was last said to be (`move`, `advance`). `now` is when it came in, for the
        counters alone; None: when the station was last advanced.
        """
        if announcement.source == self.address:
            return
        power_dbm = self._power_dbm(announcement)
        if power_dbm < self._relevant_dbm:
            return
        heard = _Heard(announcement, power_dbm)
        if not self._add(heard):
            return
        arrived = self._now if now is None else now
        if self._grace and arrived > heard.start:
            self.counters.late += 1
            self._contradict(heard)
        if self._concerns(heard):
            if arrived > heard.end + self._allowance(announcement.attempt):
                self.counters.overdue += 1
            if self._due and _by_end(heard) < _by_end(self._due[-1]):
                insort(self._due, heard, key=_by_end)
            else:
                self._due.append(heard)
            del self._due[AIR_MAX:]  # the farthest ahead: what is stamped with times to come displaces nothing
            self._want(heard.end + self._grace, self._wanted(heard))

    def advance(self, now: Instant, x: float, y: float) -> list[Output]:
        """Handle all that is due up to `now`, each thing at its own instant, with the station at `x`, `y` (metres).

        Returns what came of it, in order: announcements to hand to all other stations, receptions and outcomes.
        A host that calls late loses nothing, but its announcements may be late for others.
        """
        self._x = x
        self._y = y
        self._now = now
        if now < self.soonest:
            return []
        while True:
            mac_at = self._mac.next_wake
            heard_at = self._due[0].end + self._grace if self._due else NEVER
            if min(mac_at, heard_at) > now:
                break
            # What has arrived comes first: an acknowledgement at the very deadline still counts.
            if heard_at <= mac_at:
                self._resolve(self._due.pop(0), heard_at)
            else:
                self._step_mac(mac_at)
        self.soonest = self.next_wake = mac_at
        if self._due:
            self._want(heard_at, min(map(self._wanted, self._due)))
        out = self._out
        self._out = []
        return out

    def _want(self, possible: Instant, wanted: Instant) -> None:
        """Schedule something that can be decided from `possible` on and is wanted at `wanted`."""
        self.soonest = min(self.soonest, possible)
        self.next_wake = min(self.next_wake, wanted)

    def _wanted(self, heard: _Heard) -> Instant:
        """Return when the reception of `heard` must be decided."""
        return heard.end + self._grace + (0 if heard.announcement.pressing else self._patience)

    def _power_dbm(self, announcement: Announcement) -> float:
        """Return the power with which a transmission arrives here."""
        dx = announcement.x - self._x
        dy = announcement.y - self._y
        square = dx * dx + dy * dy
        power_dbm = announcement.power_dbm - LOSS_AT_1_M_DB
        if square > 1.0:
            power_dbm -= self._slope_db * log10(square)
        if self.links.fades:
            power_dbm += self.links.gain_db(announcement.source, self.address, announcement.start)
        return power_dbm

    def _contradict(self, late: _Heard) -> None:
        """Count the assessments that found the channel clear although `late`, unknown then, was on the air."""
        if not self._assessed or self._assessed[-1] <= late.start:
            return
        channel = self._channel
        if late.power_mw >= min(channel.busy_mw, channel.carrier_mw):
            self.counters.blind += sum(1 for end in self._assessed if late.start < end < late.end + CCA)

    def _add(self, heard: _Heard) -> bool:
        """Insert `heard` into the air, in order of start; False if it is a repeat."""
        air = self._air
        horizon = min(self._now, heard.start) - LOCK_HISTORY - 4 * self._grace - airtime(PSDU_MAX)
        while air and (air[0].end < horizon or len(air) >= AIR_MAX):
            del air[0]
        key = _by_start(heard)
        if not air or _by_start(air[-1]) < key:  # the usual case: announcements come in order
            air.append(heard)
            return True
        at = bisect_left(air, key, key=_by_start)
        if at < len(air) and _by_start(air[at]) == key:
            return False
        air.insert(at, heard)
        return True

    def _concerns(self, heard: _Heard) -> bool:
        """Whether `heard` is meant for this station, so that its reception must be decided."""
        try:
            frame = decoded(heard.announcement.psdu)
        except FrameError:
            self.counters.malformed += 1
            return False
        heard.frame = frame
        if isinstance(frame, AckFrame):
            return self._mac.awaits_ack(frame.sequence, heard.start)
        return self._receive_filter.concerns(frame)

    def _resolve(self, heard: _Heard, at: Instant) -> None:
        verdict = reception(heard, self._air, self._deaf, self._channel)
        if not self._survives(heard, verdict):
            return
        frame = heard.frame
        if isinstance(frame, AckFrame):
            if self._mac.awaits_ack(frame.sequence, heard.start):
                self._out.append(self._mac.acknowledged(at, heard.end))
            return
        assert frame is not None
        if frame.wants_ack:
            self._acknowledge(heard, frame)
        quality = link_quality(heard.power_dbm, verdict.success, self.config)
        received = self._receive_filter.take(frame, heard.power_dbm, quality, heard.end)
        if received is not None:
            self._out.append(received)

    def _survives(self, heard: _Heard, verdict: ReceptionVerdict) -> bool:
        """Whether the frame is received; if not, count why."""
        counters = self.counters
        if verdict.success == 0.0:
            if verdict.cause == "deaf":
                counters.deaf += 1
            elif verdict.cause == "collision":
                counters.collided += 1
            else:
                counters.dropped += 1
            return False
        if verdict.success == 1.0 and not self.links.loses:
            return True
        _, sequence, attempt, start, *_ = announcement = heard.announcement
        bits = draw(self._seed, announcement.source, sequence, attempt, self.address)
        if not is_right(bits, verdict.success):
            if verdict.cause == "collision":
                counters.collided += 1
            else:
                counters.dropped += 1
            return False
        if is_dropped(bits, self.links.loss(announcement.source, self.address, start)):
            counters.dropped += 1
            return False
        return True

    def _acknowledge(self, heard: _Heard, frame: DataFrame) -> None:
        """Announce the acknowledgement of `heard`, unless this station already transmits at that time."""
        start = heard.end + TURNAROUND
        end = start + _ACK_AIRTIME
        if any(since < end and until > start for since, until in self._deaf):
            self.counters.withheld += 1
            return
        original = heard.announcement
        self.counters.acknowledgements += 1
        self._announce(
            encode_ack(frame.sequence),
            original.sequence,
            ACK_ATTEMPT | original.attempt,
            start,
            end,
        )

    def _step_mac(self, at: Instant) -> None:
        mac = self._mac
        out = mac.fire(mac.state is State.BACKOFF and self._busy(at))
        if isinstance(out, Transmission):
            self.counters.sent += 1
            self._assessed.append(at)
            self._announce(out.psdu, out.sequence, out.attempt, out.start, out.end)
        elif out is not None:
            if out.status == "no_ack":
                self.counters.no_ack += 1
            elif out.status == "access_failure":
                self.counters.access_failed += 1
            self._out.append(out)

    def _busy(self, at: Instant) -> bool:
        """Assess the channel in the window that ends at `at`."""
        deaf = self._deaf
        # With a grace, receptions are decided late: the acknowledgement of a frame that has ended may be due, unknown
        # as yet. Its time counts as busy.
        if self._grace:
            owed = [h.end for h in self._due if isinstance(h.frame, DataFrame) and h.frame.wants_ack]
            deaf = deaf + [(end, end + 2 * TURNAROUND + _ACK_AIRTIME) for end in owed]
        return channel_busy(at, self._air, deaf, self._channel)

    def _allowance(self, attempt: int) -> Duration:
        """How long after its end an announcement may arrive in time: acknowledgements leave a grace later."""
        return 2 * self._grace if attempt & ACK_ATTEMPT else self._grace

    def _announce(self, psdu: bytes, sequence: int, attempt: int, start: Instant, end: Instant) -> None:
        if self._now > start + self._grace:
            self.counters.overdue += 1
        deaf = self._deaf
        while deaf and deaf[0][1] < start - LOCK_HISTORY - 4 * self._grace:
            del deaf[0]
        insort(deaf, (start - TURNAROUND, end + TURNAROUND))
        self._out.append(
            Announcement(self.address, sequence, attempt, start, end, self.config.tx_power_dbm, self._x, self._y, psdu)
        )
