"""The distribution of a program: offers, fragments, one decision (two-phase commit with an instant).

The coordinator is an operator at the bus, or a robot that distributes over the radio. It is a core without I/O.

    OFFERING    offers the program to each robot, and sends the fragments that any of them misses, until each is ready.
                One that refuses, or is silent for `patience`, makes the load fail.
    COMMITTING  tells all the instant of the switch, again and again until each has confirmed it. If one has not after
                three quarters of the lead, the load fails.
    ABORTING    tells all that the old program goes on, until each has confirmed it or the instant has long passed.
    OVER        `result` says what became of it.

No protocol over links that lose frames makes two robots do the same with certainty. A robot that has confirmed the
instant and hears no ABORT until then switches; the others then learn of its program as robots that were away do. That
takes a robot that is cut off for the last quarter of the lead, and not before.
"""

from collections.abc import Collection
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from rmr.base.printable import counted
from rmr.base.time import NEVER, Instant, in_seconds
from rmr.load.load_messages import Fragments, LoadError, LoadKind, LoadMessage, decode, numbers_of
from rmr.load.load_pace import LoadPace
from rmr.load.program_loader import Out


class LoadPhase(Enum):
    """How far a load has come."""

    OFFERING = "offering"
    COMMITTING = "committing"
    ABORTING = "aborting"
    OVER = "over"


@dataclass(slots=True)
class Target:
    """A robot that is to get the program."""

    heard: Instant
    """When it answered last; the begin, if it never has."""
    answered: bool = False
    ready: bool = False
    confirmed: bool = False
    aborted: bool = False
    problem: str = ""
    carried: int = 0
    ended: int = 0
    text: str = ""
    """What ends, as far as it fits a message."""

    @property
    def decided(self) -> bool:
        """Whether nothing more is awaited of it while programs are offered."""
        return self.ready or bool(self.problem)


@dataclass(slots=True)
class LoadResult:
    """What became of a load."""

    digest: int
    switched: bool
    """Whether all robots switch, or have switched; of a dry run, whether they could."""
    at: Instant | None
    """The instant of the switch."""
    dry: bool
    robots: dict[int, Target] = field(default_factory=dict)

    def words(self, robot: int) -> str:
        """Return what became of it at one robot."""
        target = self.robots[robot]
        if target.problem:
            return target.problem
        if not self.switched:
            return "was ready" if target.ready else "was not ready yet"
        facts = f"keeps {counted(target.carried, 'fact')}"
        return f"{facts}, drops {target.ended}" + (f": {target.text}" if target.text else "")

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON."""
        return {
            "program": f"{self.digest:08x}",
            "dry_run": self.dry,
            "switched": self.switched and not self.dry,
            "at_s": None if self.at is None or not self.switched else round(in_seconds(self.at), 3),
            "robots": {
                str(robot): {
                    "ready": target.ready,
                    "problem": target.problem or None,
                    "carried": target.carried,
                    "dropped": target.ended,
                    "drops": target.text,
                }
                for robot, target in sorted(self.robots.items())
            },
        }


class LoadCoordinator:
    """Distributes one program."""

    def __init__(
        self,
        program: bytes,
        digest: int,
        robots: Collection[int],
        pace: LoadPace,
        *,
        dry: bool = False,
        named: bool = False,
    ) -> None:
        """`robots` get it; `named`: these alone, not all of the lab, so that messages name them. Raises LoadError."""
        self.out: list[Out] = []
        """What is to be sent; the host clears it."""
        self.phase = LoadPhase.OFFERING
        self.result: LoadResult | None = None
        self.next_wake: Instant = NEVER
        self._digest = digest
        self._pace = pace
        self._dry = dry
        self._named = tuple(sorted(robots)) if named else ()
        self._fragments = Fragments.of(digest, program, pace.piece_octets)
        self._targets: dict[int, Target] = {robot: Target(0) for robot in sorted(robots)}
        self._queue: dict[int, None] = {}
        """Numbers of fragments to be sent, in order."""
        self._poll_at: Instant = NEVER
        self._send_at: Instant = NEVER
        self._at: Instant | None = None
        self._aborts = 0
        # What does not fit a message is refused before anything is sent.
        LoadMessage(LoadKind.COMMIT, digest, 0, targets=self._named).encode(pace.octets_max)

    @property
    def robots(self) -> tuple[int, ...]:
        """Who gets the program."""
        return tuple(self._targets)

    def start(self, now: Instant) -> None:
        """Begin."""
        for target in self._targets.values():
            target.heard = now
        self._poll_at = self.next_wake = now

    def cancel(self, now: Instant, why: str) -> None:
        """Let the load fail, unless it is decided."""
        if self.phase is LoadPhase.OFFERING:
            for target in self._targets.values():
                target.problem = target.problem or ("" if target.ready else why)
            self._abort(now)

    def received(self, now: Instant, payload: bytes, source: int) -> None:
        """Handle an answer; what is malformed, or of a robot that gets no program, is dropped."""
        target = self._targets.get(source)
        try:
            message = decode(payload)
        except LoadError:
            return
        if target is None or message.digest != self._digest:
            return
        target.heard = now
        target.answered = True
        match message.kind:
            case LoadKind.WANT if self.phase is LoadPhase.OFFERING:
                self._queue |= dict.fromkeys(numbers_of(message.number, message.data))
                self._send_at = min(self._send_at, now)
            case LoadKind.READY if self.phase is LoadPhase.OFFERING:
                target.ready = True
                target.carried, target.ended, target.text = message.carried, message.ended, message.text
            case LoadKind.REFUSED if self.phase is LoadPhase.OFFERING:
                target.problem = message.text or "it refuses the program"
            case LoadKind.COMMITTED if message.version == self._at:
                target.confirmed = True
            case LoadKind.ABORTED:
                target.aborted = True
            case LoadKind.WANT | LoadKind.READY | LoadKind.REFUSED | LoadKind.COMMITTED:
                pass  # in another phase, of an earlier instant, or from another coordinator
            case LoadKind.ASK | LoadKind.TELL | LoadKind.OFFER | LoadKind.FRAGMENT | LoadKind.COMMIT | LoadKind.ABORT:
                pass  # no answers
        self.next_wake = now

    def wake(self, now: Instant) -> None:
        """Send what is due, and decide."""
        match self.phase:
            case LoadPhase.OFFERING:
                self._offer(now)
            case LoadPhase.COMMITTING:
                self._commit(now)
            case LoadPhase.ABORTING:
                self._tell_abort(now)
            case LoadPhase.OVER:
                self.next_wake = NEVER

    def _say(self, message: LoadMessage, destination: int | None) -> None:
        self.out.append(Out(message, destination))

    def _offer(self, now: Instant) -> None:
        open_ = {robot: target for robot, target in self._targets.items() if not target.decided}
        for target in open_.values():
            if now - target.heard >= self._pace.patience:
                silent = f"no answer for {in_seconds(self._pace.patience):g} s"
                target.problem = silent if target.answered else "it has not been heard: it is off, or out of reach"
        if all(target.decided for target in self._targets.values()):
            self._decide(now)
            return
        if now >= self._poll_at:
            self._poll_at = now + self._pace.poll
            fragments = self._fragments
            offer = LoadMessage(
                LoadKind.OFFER,
                self._digest,
                octets=fragments.octets,
                piece_octets=fragments.piece_octets,
                dry=self._dry,
            )
            # While fragments are on their way the robots are not asked which are missing: they would all come twice.
            for robot in open_ if not self._queue else ():
                self._say(offer, robot)
        if self._queue and now >= self._send_at:
            for number in list(self._queue)[: self._pace.at_once]:
                del self._queue[number]
                piece = self._fragments.piece(number)
                if piece is not None:
                    self._say(LoadMessage(LoadKind.FRAGMENT, self._digest, number=number, data=piece), None)
            self._send_at = now + self._pace.gap if self._queue else NEVER
            if not self._queue:
                self._poll_at = now + self._pace.gap
        self.next_wake = min(self._poll_at, self._send_at)

    def _decide(self, now: Instant) -> None:
        if any(target.problem for target in self._targets.values()):
            self._abort(now)
        elif self._dry:
            self._end(switched=True)
        else:
            self.phase = LoadPhase.COMMITTING
            self._at = now + self._pace.lead
            self._poll_at = now
            self._commit(now)

    def _commit(self, now: Instant) -> None:
        assert self._at is not None
        open_ = [robot for robot, target in self._targets.items() if not target.confirmed]
        if not open_:
            self._end(switched=True)
            return
        if now >= self._at - self._pace.lead // 4:
            for robot in open_:
                self._targets[robot].problem = "it was ready, and has not confirmed the instant of the switch"
            self._abort(now)
            return
        if now >= self._poll_at:
            self._poll_at = now + self._pace.poll // 2
            for robot in open_:
                self._say(LoadMessage(LoadKind.COMMIT, self._digest, self._at, targets=self._named), robot)
        self.next_wake = min(self._poll_at, self._at - self._pace.lead // 4)

    def _abort(self, now: Instant) -> None:
        self.phase = LoadPhase.ABORTING
        self._poll_at = now
        self._tell_abort(now)

    def _tell_abort(self, now: Instant) -> None:
        open_ = [robot for robot, target in self._targets.items() if target.answered and not target.aborted]
        if not open_ or self._aborts >= 10:  # how often a robot that does not confirm is told that the load has failed
            self._end(switched=False)
            return
        if now >= self._poll_at:
            self._aborts += 1
            self._poll_at = now + self._pace.poll // 2
            for robot in open_:
                self._say(LoadMessage(LoadKind.ABORT, self._digest), robot)
        self.next_wake = self._poll_at

    def _end(self, *, switched: bool) -> None:
        self.phase = LoadPhase.OVER
        self.next_wake = NEVER
        self.result = LoadResult(self._digest, switched, self._at, self._dry, dict(self._targets))
