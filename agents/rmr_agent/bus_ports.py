"""The node's ports in a robot process: the radio and the body, both over the bus, and what the world does for it.

The radio is a `rmr.radio.station.Station`, or a `rmr.radio.network.NetworkStation` where nothing is emulated: what it
announces goes out on the bus, what others announce comes in, and everything else about a frame's fate is decided here.
The emulated radio decides by time stamps. Announcements are some milliseconds late when they arrive, hence the grace.
"""

from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from typing import Final

from rmr.base.geometry import STILL, Pose, Twist
from rmr.base.time import NEVER, Duration, Instant, milliseconds
from rmr.base.values import Value
from rmr.bus import wire
from rmr.node.actions.dispatcher import Handler
from rmr.node.actions.handle import ActionFailed, Pause, RobotHandle
from rmr.node.frame_log import FrameLog
from rmr.node.payloads import LOAD_OCTET
from rmr.node.ports import FRAMES_MAX, SAMPLES_MAX, Confirmed, PoseFix, Received, SeenBody, Sensed
from rmr.radio.air import Announcement
from rmr.radio.network import NetworkStation
from rmr.radio.station import Station

RADIO_GRACE: Final[Duration] = milliseconds(4)
"""How long after a frame's end its reception is decided: announcements cross the bus in 0.3 to 2 ms."""

AHEAD_MAX: Final[Duration] = milliseconds(1000)
"""Announcements from farther ahead in lab time are dropped: twice what a robot may go ahead of its world. They are of
another run, as when a world begins anew and some robots have not noticed yet, and would be received in an hour."""


class RadioLink:
    """`rmr.node.ports.RadioPort` over a station."""

    def __init__(
        self, station: Station | NetworkStation, now: Callable[[], Instant], publish: Callable[[Announcement], None]
    ) -> None:
        self.station = station
        self._instant = isinstance(station, NetworkStation)
        """Whether frames have no airtime."""
        self._now = now
        self._publish = publish
        self._received: deque[Received] = deque(maxlen=FRAMES_MAX)
        self._confirmed: deque[Confirmed] = deque(maxlen=FRAMES_MAX)
        self.overhear: Callable[[Instant, Received], bool] = lambda _now, _frame: False
        """Takes in a frame for which the node need not be called; what it refuses waits for the node's call."""
        self.programs: Callable[[Instant, Received], None] | None = None
        """Takes the frames about new programs, which are none of the node's."""
        self.frames: FrameLog | None = None
        """Takes note of each transmission, where the robot is recorded."""
        self.dropped = 0
        """Frames and outcomes that a full queue has dropped."""
        self.malformed = 0
        """Announcements that cannot be: of a time that is far from come, or of another mode of the radio."""

    @property
    def waiting(self) -> bool:
        """Whether the node has something to fetch."""
        return bool(self._received or self._confirmed)

    @property
    def payload_max(self) -> int:
        """Octets of payload that a frame holds."""
        return self.station.payload_max

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Queue `payload`; see `rmr.node.ports.RadioPort`."""
        now = self._now()
        if self.frames is not None:
            self.frames.requested(now, payload, handle)
        self.station.request(now, payload, destination, handle, due)

    def receive(self) -> list[Received]:
        """Return what has arrived since the last call."""
        received = list(self._received)
        self._received.clear()
        return received

    def confirmations(self) -> list[Confirmed]:
        """Return the outcomes since the last call."""
        confirmed = list(self._confirmed)
        self._confirmed.clear()
        return confirmed

    def hear(self, announcement: Announcement) -> Instant:
        """Take in an announcement from the bus; return lab time."""
        now = self._now()
        instant = announcement.end == announcement.start
        if instant != self._instant or announcement.start > now + AHEAD_MAX:
            self.malformed += 1
        else:
            self.station.hear(announcement, now)
        return now

    def advance(self, now: Instant, x: float, y: float) -> None:
        """Let the station do what is due; (x, y) is the robot's true place in metres."""
        for out in self.station.advance(now, x, y):
            if isinstance(out, Announcement):
                self._publish(out)
                if self.frames is not None:
                    self.frames.announced(out)
            elif isinstance(out, Confirmed):
                self.dropped += len(self._confirmed) == FRAMES_MAX
                self._confirmed.append(out)
                if self.frames is not None:
                    self.frames.confirmed(now, out)
            elif self.programs is not None and out.payload[:1] == LOAD_OCTET:
                self.programs(now, out)
            elif self._received or not self.overhear(now, out):
                self.dropped += len(self._received) == FRAMES_MAX
                self._received.append(out)


class BusBody:
    """`rmr.node.ports.BodyPort` over the bus."""

    def __init__(self, publish: Callable[[wire.Message], None]) -> None:
        self._publish = publish
        self._samples: deque[Sensed] = deque(maxlen=SAMPLES_MAX)
        self.place: tuple[float, float] | None = None
        """The robot's true place, for the radio alone; None before the first sample."""
        self.dropped = 0
        """Samples that a full queue has dropped."""
        self.twist = STILL
        """The last command."""

    def feed(self, sample: wire.Sense) -> None:
        """Take in a sample from the bus."""
        bodies = tuple([SeenBody(*body) for body in sample.bodies])
        self.dropped += len(self._samples) == SAMPLES_MAX
        fix = None if sample.fix is None else PoseFix(*sample.fix)
        self._samples.append(Sensed(*sample._replace(bodies=bodies, fix=fix)))  # type: ignore[arg-type]
        self.place = sample.truth[:2]

    @property
    def waiting(self) -> bool:
        """Whether the node has something to fetch."""
        return bool(self._samples)

    def keep_newest(self) -> None:
        """Drop all samples but the newest: before lab time runs, they all say the same."""
        while len(self._samples) > 1:
            self._samples.popleft()

    def sense(self) -> list[Sensed]:
        """Return the samples since the last call."""
        samples = list(self._samples)
        self._samples.clear()
        return samples

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Command the wheels."""
        self.twist = twist
        self._publish(wire.Act(twist.v, twist.w, stamp))

    def head(self, serial: int, target: Pose | None, stamp: Instant) -> None:
        """Let the body's own driver drive."""
        self._publish(wire.Perform(serial, "navigate", () if target is None else tuple(target), stamp))


class WorldActions:
    """The actions that the world carries out for the robot.

    A wish is said again, twice a second, until its end is told, for messages get lost; one that is broken off is taken
    back.
    """

    def __init__(self, publish: Callable[[wire.Message], None], now: Callable[[], Instant]) -> None:
        self._publish = publish
        self._now = now
        self._asked = 0
        self._ends: dict[int, str | None] = {}
        """Of the actions under way: why they failed, an empty text for those that did not, None before the end."""

    def heard(self, end: wire.Performed) -> None:
        """Take in the end of an action."""
        if end.serial in self._ends:
            self._ends[end.serial] = end.failure

    def handlers(self, names: Iterable[str]) -> dict[str, Handler]:
        """Return the handlers of actions."""
        return {name: Handler(name, self._handler(name)) for name in names}

    def _handler(self, name: str) -> Callable[..., Awaitable[None]]:
        async def run(_robot: RobotHandle, *args: Value) -> None:
            self._asked += 1
            serial, begun = self._asked, self._now()
            self._ends[serial] = None
            try:
                while (failure := self._ends[serial]) is None:
                    self._publish(wire.Perform(serial, name, args, begun))
                    await Pause(self._now() + milliseconds(500), lambda: self._ends[serial] is not None)
            finally:
                if self._ends.pop(serial) is None:
                    self._publish(wire.Perform(serial, None, (), begun))
            if failure:
                raise ActionFailed(failure)

        return run
