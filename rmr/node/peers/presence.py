"""Hellos: the robot says where it is and which place it has taken, and takes in what the others say.

A hello settles who stands where. If a robot that goes first has taken this robot's place, or stands on it, the driving
action is sent to another place. All else that a hello changes is what the robot knows of its peers, so most hellos are
taken in as they arrive (`overhear`), without a call of the node: in a crowd nearly all that is heard are hellos.
"""

from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Final, final

from rmr.base.geometry import Point, Pose
from rmr.base.motion_scale import scale_of
from rmr.base.streams import stream
from rmr.base.time import NEVER, Instant, in_seconds
from rmr.node import payloads
from rmr.node.actions.dispatcher import Dispatcher
from rmr.node.crossing.crossings import Crossings
from rmr.node.crossing.phases import Slotted
from rmr.node.driver import Driver
from rmr.node.motion.hearing import OVERDUE
from rmr.node.motion.priority import Heard
from rmr.node.motion.ways import TURNED_M
from rmr.node.parts import Radio
from rmr.node.payloads import Hello, PayloadKind, WireError
from rmr.node.peers.hello import STAYS, STAYS_SPARE, ExpectedStand, HelloClock
from rmr.node.peers.perception import driving_of
from rmr.node.ports import Received
from rmr.node.robot_state import RobotState

decode_hello_cached = lru_cache(maxsize=256)(payloads.decode_hello)
"""`decode_hello` with a cache: in virtual time many robots of one process hear the same octets."""


@final
class _LastOverheard:
    """The hello that any robot of the process has overheard last: in virtual time the others hear it right after."""

    def __init__(self) -> None:
        self._payload = b""
        self._source = 0
        self._at: Instant = -1
        self._hello: Hello | None = None
        self.driving: Heard | None = None
        """The state that the hello reports of a driving robot."""

    def hello(self, payload: bytes, source: int, at: Instant) -> Hello | None:
        """Return the hello in `payload`; None if it is no hello."""
        if at != self._at or source != self._source or payload != self._payload:
            self._payload = payload
            self._source = source
            self._at = at
            self._hello = None
            self.driving = None
            with suppress(WireError):
                self._hello = decode_hello_cached(payload)
                self.driving = driving_of(source, self._hello, at)
        return self._hello


_LAST: Final = _LastOverheard()


def dated(read: Instant, frame: Received) -> Instant:
    """Return the instant from which a hello counts that was `read` then: when it was sent, if it has waited long."""
    return read if read - frame.stamp <= OVERDUE else frame.stamp


class Presence:
    """One robot's hellos, said and heard."""

    def __init__(self, state: RobotState, radio: Radio, crossings: Crossings, actions: Dispatcher) -> None:
        self._state = state
        self._peers = state.peers
        self._driver = state.driver
        self._radio = radio
        self._crossings = crossings
        self._actions = actions
        self._profile = state.config.profile
        self._parked: Sequence[Point] | None = None
        """Where others stand, as the navigator was last given it."""
        self._hellos: HelloClock | None = None
        """None: a robot without a body has no place to tell."""
        self._expected: ExpectedStand | None = None
        """What the last hello lets others expect."""
        self._said_at: Instant = 0
        self._strays_m: Final = TURNED_M * scale_of(state.config.arena.shape).pace
        if state.driver is not None:
            rng = stream(f"{state.config.seed}/robot{state.robot}/hello")
            self._hellos = HelloClock(rng, self._profile)

    # -- saying -----------------------------------------------------------------------------------------------

    @property
    def next_wake(self) -> Instant:
        """When the next hello is due."""
        return NEVER if self._hellos is None else self._hellos.due

    def start(self, now: Instant) -> None:
        """Plan the first hello."""
        if self._hellos is not None:
            self._hellos.start(now)

    def hello_soon(self, now: Instant) -> None:
        """Say hello at once: something that matters to the others has changed."""
        if self._hellos is not None:
            self._hellos.soon(now)

    def telemetry(self, now: Instant) -> None:
        """Notice a change that matters to others, as between parked and moving."""
        if self._hellos is not None and self._driver is not None:
            if self._peers.changes(now):  # a robot has died: no hello tells that
                self._update_parked(now)
            if self._hellos.due == NEVER and self._driver.localiser.pose is not None:
                self._hellos.begin(now)
            self._hellos.poll(now, parked=self._actions.driving is None, back=self._driver.speed < 0.0)
            if self._strays(now, self._driver):
                self._hellos.at_once(now)

    def _strays(self, now: Instant, driver: Driver) -> bool:
        """Return whether the robot drives elsewhere than its last hello lets others expect: they keep clear of that."""
        expected = self._expected
        pose = driver.localiser.pose
        if expected is None or pose is None or self._actions.driving is None:
            return False
        return expected.astray_m(in_seconds(now - self._said_at), pose, driver.driven(now)) > self._strays_m

    def wake(self, now: Instant) -> None:
        """Say hello if that is due; a robot that does not know where it is says it as soon as it does."""
        if self._hellos is None or self._driver is None or now < self._hellos.due:
            return
        pose = self._driver.localiser.pose
        if pose is None:
            self._hellos.due = NEVER
            return
        self._plan_next(now, self._hellos)
        self._say_hello(now, self._driver, pose, parked=self._hellos.parked)

    def _plan_next(self, now: Instant, hellos: HelloClock) -> None:
        crossing = self._crossings.current
        if not self._profile.promises_to_stay:
            hellos.rewind(now, waits=crossing is not None)
            return
        leaves = crossing is not None and isinstance(crossing.phase, Slotted) and not self._stays(now)
        hellos.rewind(now, waits=crossing is not None, leaves=leaves, driving=len(self._peers.driving(now)))

    def _stays(self, now: Instant) -> bool:
        """Return whether the robot, parked in a crowd, will stand for a while: it has finished, or its slot is far."""
        if not self._profile.promises_to_stay or self._driver is None or self._actions.driving is not None:
            return False
        crossing = self._crossings.current
        return self._state.finish.holds if crossing is None else crossing.leaves_after(now + STAYS + STAYS_SPARE)

    def _say_hello(self, now: Instant, driver: Driver, pose: Pose, *, parked: bool) -> None:
        stays = parked and self._stays(now)
        if stays:
            # A promise: those who heard it count on it for STAYS, so the wheels are held a little longer than that.
            driver.stays_until = now + STAYS + STAYS_SPARE
        goal = self._crossings.destinations.current()
        rank = self._crossings.rank
        links = self._peers.links
        listed = b"" if links is None else links.list_of(self._peers.heard_at(now), now)
        v = driver.driven(now)
        hello = Hello(pose.x, pose.y, pose.theta, v, parked, rank, goal, self._state.digest, stays, listed)
        self._radio.transmit(payloads.encode_hello(hello), None)
        self._expected = ExpectedStand(hello)
        self._said_at = now

    # -- hearing ----------------------------------------------------------------------------------------------

    def overhear(self, now: Instant, frame: Received) -> bool:
        """Take in `frame` if it is a hello that says only where a robot is that is known; else return False."""
        payload = frame.payload
        source = frame.source
        if not payload or payload[0] != PayloadKind.HELLO:
            return False
        peer = self._peers.known.get(source)
        if peer is None or peer.hello is None:
            return False
        at = dated(now, frame)
        hello = _LAST.hello(payload, source, at)
        if hello is None or hello.digest != self._state.digest or self._disputes(source, hello):
            return False
        peer.heard = now
        peer.rssi_dbm = frame.rssi_dbm
        self._peers.hello(at, source, hello, _LAST.driving, said=frame.stamp)
        self._update_parked(now)
        return True

    def met(self, now: Instant, frame: Received, hello: Hello) -> None:
        """Take in a hello in a call of the node."""
        source = frame.source
        known = self._peers.known[source].hello
        # Once per change, not once per hello: a robot of another program says its digest several times a second.
        if hello.digest != self._state.digest and (known is None or known.digest != hello.digest):
            self._state.trace(now, "other_program", source=source)
        self._peers.hello(dated(self._state.heard_at, frame), source, hello, said=frame.stamp)
        if self._disputes(source, hello):
            self._change_place(now)
        self._update_parked(now)

    def _disputes(self, source: int, hello: Hello) -> bool:
        """Return whether `hello` is a reason to look for another place than the one that the robot goes to."""
        driver = self._driver
        running = self._actions.driving
        if driver is None or driver.place is None or running is None:
            return False
        crossing = self._crossings.crossing(running)
        sent = None if crossing is None else crossing.course.destination
        if (
            sent or driver.navigator.goal
        ) != driver.place:  # another action has the wheels, such as `face`: it keeps them
            return False
        return driver.disputes(source, hello, outside=crossing is not None and crossing.waits)

    def _change_place(self, now: Instant) -> None:
        """Go to another place: a robot that goes first has taken this one's."""
        assert self._driver is not None
        place = self._driver.choose_again(now, self._peers)
        if place is not None:
            self._crossings.destinations.change_place(now, place)

    def _update_parked(self, now: Instant) -> None:
        """Let the navigator know where others stand, if that has changed; one without a goal need not."""
        if self._driver is None or self._driver.navigator.goal is None:
            return
        # The same object until a robot sets out or parks (`Peers.parked`): the comparison costs nothing per hello.
        parked = self._peers.parked(now)
        if parked is not self._parked:
            self._parked = parked
            self._driver.navigator.update_parked(parked, self._peers.lost_places(now))
