"""The part of a robot by which it gets a new program, gives it to others, and learns of one that it has missed.

It is a core without I/O and clock, beside the node and not in it: it outlives the node's program. Messages leave by
`out`; the host calls `wake` at `next_wake`, and performs the switch when `due` says so.

    state       offered a program   all fragments    COMMIT            ABORT    at the instant
    idle        collecting          -                asks its sender   -        -
    collecting  -                   ready, refused   -                 idle     -
    ready       -                   -                committed         idle     -
    committed   refused             -                -                 idle     switched, idle

A robot that was away is behind: its version is older than that of the others. It asks when it starts, and every robot
with a loaded program says now and then which one that is. The robot that is behind fetches the fragments from the first
that tells it, verifies them as in a load, and switches at once. The later version holds, so all agree in the end.
"""

from collections.abc import Callable
from random import Random
from typing import Final, NamedTuple

from rmr.base.time import NEVER, Instant
from rmr.bytecode.program import Program
from rmr.load.load_messages import (
    FRAGMENT_HEAD,
    Fragments,
    LoadError,
    LoadKind,
    LoadMessage,
    decode,
    missing_bits,
    numbers_of,
)
from rmr.load.load_pace import ASK_EVERY, ASKS, FORGET, GIVE_UP, TELL_EVERY, TELL_WITHIN, WANT_EVERY
from rmr.load.robot_fit import UnfitError

Fit = Callable[[bytes, int], Program]
"""Returns the program with this digest if the robot can run it; raises UnfitError."""


class Preview(NamedTuple):
    """What a switch would keep and end here."""

    carried: int
    ended: tuple[str, ...]


class RunningProgram(NamedTuple):
    """A robot's program."""

    octets: bytes
    digest: int
    version: Instant = 0
    """The instant of lab time at which the robots switched to it; 0: it was started with it."""
    targets: tuple[int, ...] = ()
    """The robots that run it; empty: all."""


class Switch(NamedTuple):
    """A switch that is due."""

    program: Program
    running: RunningProgram


class Out(NamedTuple):
    """A message that leaves."""

    message: LoadMessage
    destination: int | None
    """None: all robots."""


class _Pending:
    """A program that is being fetched."""

    def __init__(self, fragments: Fragments, source: int, now: Instant) -> None:
        self.fragments = fragments
        self.source = source
        """Who has it."""
        self.heard = now
        """When something new of it came."""
        self.program: Program | None = None
        """Once it is verified."""
        self.problem = ""
        """Why the robot cannot run it."""
        self.version: Instant = NEVER
        """The instant of the switch; NEVER: not known yet."""
        self.targets: tuple[int, ...] = ()
        self.missed = False
        """It was loaded while this robot was away: it asks for the fragments by itself."""
        self.want_at: Instant = NEVER


class ProgramLoader:
    """One robot's program, and the next one."""

    def __init__(
        self,
        robot: int,
        running: RunningProgram | None,
        fit: Fit,
        preview: Callable[[Program], Preview],
        rng: Random,
        octets_max: int,
    ) -> None:
        """`running` is None for a robot that waits for its first program; `octets_max` is that of a message."""
        self.robot: Final = robot
        self.running = running
        self.out: list[Out] = []
        """What is to be sent; the host clears it."""
        self.malformed = 0
        self.octets_max = octets_max
        self._fit = fit
        self._preview = preview
        self._rng = rng
        self._pending: _Pending | None = None
        self._asks = 0
        self._ask_at: Instant = NEVER
        self._tell_at: Instant = NEVER
        self._own: Fragments | None = None
        """The program that runs, in the fragments in which it was asked for last."""

    @property
    def version(self) -> Instant:
        """The version that runs; -1: none does."""
        return -1 if self.running is None else self.running.version

    @property
    def digest(self) -> int:
        """The digest of what runs; 0: nothing does."""
        return 0 if self.running is None else self.running.digest

    # -- time -------------------------------------------------------------------------------------------------

    def begin(self, now: Instant, *, away: bool) -> None:
        """Begin; a robot that was `away` asks the others first, and does not take part before `settled`."""
        if away:
            self._asks = ASKS
            self._ask_at = now

    @property
    def settled(self) -> bool:
        """Whether the robot knows of no newer program, as far as it has asked."""
        pending = self._pending
        behind = pending is not None and pending.missed and not pending.problem
        return self.running is not None and not self._asks and not behind

    @property
    def next_wake(self) -> Instant:
        """When `wake` has something to do."""
        pending = self._pending
        wake = min(self._ask_at, self._tell_at)
        if pending is None:
            return wake
        return min(wake, pending.want_at, pending.heard + self._limit(pending), self.due)

    @property
    def due(self) -> Instant:
        """When the robot is to switch (`take`); NEVER if it is not."""
        pending = self._pending
        return NEVER if pending is None or pending.program is None else pending.version

    def _limit(self, pending: _Pending) -> int:
        if pending.program is not None and pending.version < NEVER:
            return NEVER - pending.heard
        return GIVE_UP if pending.missed else FORGET

    def wake(self, now: Instant) -> None:
        """Ask, tell and fetch what is due."""
        if now >= self._ask_at:
            self._asks -= 1
            self._ask_at = now + ASK_EVERY if self._asks > 0 else NEVER
            if self._asks > 0:
                self._say(LoadMessage(LoadKind.ASK, self.digest, max(0, self.version)))
        if now >= self._tell_at:
            self._tell(now)
        pending = self._pending
        if pending is None:
            return
        if now >= pending.heard + self._limit(pending):
            self._pending = None
        elif now >= pending.want_at:
            self._want(now, pending)

    def take(self, now: Instant) -> Switch:
        """Return the switch that is due; the robot runs that program from now on."""
        pending = self._pending
        assert pending is not None
        assert pending.program is not None
        octets = pending.fragments.whole
        assert octets is not None
        self.running = RunningProgram(octets, pending.fragments.digest, pending.version, pending.targets)
        self._own = pending.fragments
        self._pending = None
        self._asks = 0
        self._ask_at = NEVER
        self._tell_at = now + round(TELL_EVERY * self._rng.uniform(0.2, 1.0))
        return Switch(pending.program, self.running)

    # -- messages ---------------------------------------------------------------------------------------------

    def received(self, now: Instant, payload: bytes, source: int) -> None:
        """Handle a message of robot `source`, or of an operator; one that is malformed is counted."""
        try:
            message = decode(payload)
            self._handle(now, message, source)
        except LoadError:
            self.malformed += 1

    def _handle(self, now: Instant, message: LoadMessage, source: int) -> None:
        match message.kind:
            case LoadKind.ASK:
                self._asked(now, message)
            case LoadKind.TELL:
                self._told(now, message, source)
            case LoadKind.OFFER:
                self._offered(now, message, source)
            case LoadKind.FRAGMENT:
                self._piece(now, message, source)
            case LoadKind.WANT:
                self._wanted(message, source)
            case LoadKind.COMMIT:
                self._committed(now, message, source)
            case LoadKind.ABORT:
                pending = self._pending
                if pending is not None and pending.fragments.digest == message.digest and not pending.missed:
                    self._pending = None
                self._say(LoadMessage(LoadKind.ABORTED, message.digest), source)
            case LoadKind.READY | LoadKind.REFUSED | LoadKind.COMMITTED | LoadKind.ABORTED:
                pass  # what robots answer is for a coordinator

    def _say(self, message: LoadMessage, destination: int | None = None) -> None:
        self.out.append(Out(message, destination))

    # -- a load -----------------------------------------------------------------------------------------------

    def _offered(self, now: Instant, message: LoadMessage, source: int) -> None:
        pending = self._pending
        same = pending is not None and pending.fragments.is_same(message.digest, message.octets, message.piece_octets)
        if pending is not None and not same:
            if pending.version < NEVER:
                text = f"another program is to be switched to ({pending.fragments.digest:08x}): load again after it"
                self._say(LoadMessage(LoadKind.REFUSED, message.digest, text=text), source)
                return
            pending = None
        if pending is None:
            pending = self._pending = _Pending(
                Fragments(message.digest, message.octets, message.piece_octets), source, now
            )
            if self.running is not None and self.running.digest == message.digest:
                self._keep(pending, self.running.octets)
        pending.heard = now
        self._answer(pending, source)
        if message.dry and pending.program is not None:
            self._pending = None

    @staticmethod
    def _keep(pending: _Pending, octets: bytes) -> None:
        """Take the fragments of the program that runs: it is the same, so that nothing need be sent."""
        if len(octets) == pending.fragments.octets:
            size = pending.fragments.piece_octets
            for number in range(pending.fragments.count):
                pending.fragments.add(number, octets[number * size : (number + 1) * size])

    def _answer(self, pending: _Pending, source: int) -> None:
        fragments = pending.fragments
        if fragments.whole is None:
            first, bits = missing_bits(fragments.missing, self.octets_max - FRAGMENT_HEAD)
            self._say(LoadMessage(LoadKind.WANT, fragments.digest, number=first, data=bits), source)
            return
        self._verify(pending)
        if pending.problem:
            self._say(LoadMessage(LoadKind.REFUSED, fragments.digest, text=pending.problem), source)
            return
        assert pending.program is not None
        preview = self._preview(pending.program)
        text = "; ".join(preview.ended)
        ended = len(preview.ended)
        self._say(
            LoadMessage(LoadKind.READY, fragments.digest, text=text, carried=preview.carried, ended=ended), source
        )

    def _verify(self, pending: _Pending) -> None:
        octets = pending.fragments.whole
        if octets is None or pending.program is not None or pending.problem:
            return
        try:
            pending.program = self._fit(octets, pending.fragments.digest)
        except UnfitError as error:
            pending.problem = str(error)

    def _piece(self, now: Instant, message: LoadMessage, source: int) -> None:
        pending = self._pending
        if pending is None or pending.fragments.digest != message.digest:
            return
        if not pending.fragments.add(message.number, message.data):
            return
        pending.heard = now
        if pending.fragments.whole is None:
            return
        if pending.missed:
            self._verify(pending)
        else:
            self._answer(pending, pending.source if source != pending.source else source)

    def _committed(self, now: Instant, message: LoadMessage, source: int) -> None:
        running = self.running
        answer = LoadMessage(LoadKind.COMMITTED, message.digest, message.version)
        if running is not None and (running.digest, running.version) == (message.digest, message.version):
            self._say(answer, source)
            return
        pending = self._pending
        if pending is None or pending.fragments.digest != message.digest or pending.program is None:
            return  # it has started anew since it was ready: the load fails, or it learns of it from the others
        if message.version <= now:
            return  # too late to be in time with the others: it learns of it from them
        pending.version = message.version
        pending.targets = message.targets
        pending.heard = now
        self._say(answer, source)

    # -- those that were away ---------------------------------------------------------------------------------

    def _asked(self, now: Instant, message: LoadMessage) -> None:
        if self.running is not None and self.version > message.version:
            within = round(TELL_WITHIN * self._rng.random())
            self._tell_at = min(self._tell_at, now + within)

    def _tell(self, now: Instant) -> None:
        running = self.running
        self._tell_at = NEVER
        if running is None or running.version <= 0:
            return
        self._tell_at = now + round(TELL_EVERY * self._rng.uniform(0.8, 1.2))
        own = self._fragments(running)
        self._say(
            LoadMessage(
                LoadKind.TELL, running.digest, running.version, own.octets, own.piece_octets, targets=running.targets
            )
        )

    def _fragments(self, running: RunningProgram) -> Fragments:
        """Return the fragments in which other robots are given the program: those of a load over the bus are larger."""
        own = self._own
        octets_max = self.octets_max - FRAGMENT_HEAD
        if own is None or own.digest != running.digest or own.piece_octets > octets_max:
            own = self._own = Fragments.of(running.digest, running.octets, octets_max)
        return own

    def _told(self, now: Instant, message: LoadMessage, source: int) -> None:
        if message.version == self.version and self._tell_at < NEVER:
            # Another one has said it: one of a group is enough.
            self._tell_at = now + round(TELL_EVERY * self._rng.uniform(0.8, 1.2))
        if message.version <= self.version or (message.targets and self.robot not in message.targets):
            return
        pending = self._pending
        if pending is not None and pending.version < NEVER and pending.version >= message.version:
            return
        same = pending is not None and pending.fragments.is_same(message.digest, message.octets, message.piece_octets)
        if pending is None or not same:
            fragments = Fragments(message.digest, message.octets, message.piece_octets)
            pending = self._pending = _Pending(fragments, source, now)
        pending.missed = True
        pending.source = source
        pending.version = message.version
        pending.targets = message.targets
        pending.want_at = now
        self._verify(pending)

    def _want(self, now: Instant, pending: _Pending) -> None:
        pending.want_at = NEVER
        if pending.missed and pending.fragments.whole is None:
            pending.want_at = now + WANT_EVERY
            first, bits = missing_bits(pending.fragments.missing[:WANTED_AT_ONCE], self.octets_max - FRAGMENT_HEAD)
            self._say(LoadMessage(LoadKind.WANT, pending.fragments.digest, number=first, data=bits), pending.source)

    def _wanted(self, message: LoadMessage, source: int) -> None:
        running = self.running
        if running is None or running.digest != message.digest:
            return
        own = self._fragments(running)
        for number in numbers_of(message.number, message.data)[:WANTED_AT_ONCE]:
            piece = own.piece(number)
            if piece is not None:
                self._say(LoadMessage(LoadKind.FRAGMENT, message.digest, number=number, data=piece), source)


WANTED_AT_ONCE: Final = 16
"""Fragments that a robot asks another one for at once: the others need the air, too."""
