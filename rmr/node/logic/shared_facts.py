"""Shared facts: a robot tells its neighbours which it holds, and knows of theirs what it has heard last.

The program's table of ensemble rules says which temporary facts are shared, and which sensed predicate each robot keeps
what it hears of them in (`Duty.HEARD`). This is soft state: a frame lists all facts of a predicate that its sender
holds, so that the newest frame says everything and a lost one is made good by the next. Frames are broadcasts over one
hop, and nobody acknowledges them.

- *Rate.* What changes is told at once, but a robot tells anything at intervals of `CHANGE_MIN` at least, so a fact that
  never stops changing costs a bounded part of the air. What happens in between is never told.
- *Refreshing.* As long as a robot holds a shared fact it tells all of them again after `REFRESH`, or a little less.
- *Age.* A frame says for how long it holds: `LOST_MAX` refreshings. What is not heard again in this time is withdrawn.
- *Crowds.* Both intervals grow with the number of robots in range: all of them together take a bounded part of the air.

Where the host knows who is in range (`Ports.neighbors`) what a robot has heard holds until the other one is out of
range, and is told again when one comes into range.
"""

from collections.abc import Callable, Sequence
from typing import Final, final

from rmr.base.streams import stream
from rmr.base.time import NEVER, Duration, Instant, milliseconds, seconds
from rmr.base.values import Robot, Value
from rmr.bytecode.program import Duty
from rmr.node import payloads
from rmr.node.logic.symbol_numbers import symbols_of
from rmr.node.parts import Radio
from rmr.node.payloads import SHARED_OCTETS, SharedFrame, WireError
from rmr.node.ports import Received
from rmr.node.robot_state import RobotState
from rmr.vm.provenance import HeardCause
from rmr.vm.shared import shared_of

Args = tuple[Value, ...]

REFRESH: Final[Duration] = milliseconds(750)
"""Longest time between two frames about a fact that does not change, with up to 30 robots in range."""
REFRESH_EACH: Final[Duration] = milliseconds(25)
"""The same for each robot in range, where there are more: all together send some 43 such frames a second, a tenth of
the air if a frame has 45 octets of values."""
CHANGE_MIN: Final[Duration] = milliseconds(200)
"""Least time between two times that a robot tells anything, with up to 30 robots in range."""
CHANGE_EACH: Final[Duration] = milliseconds(7)
"""The same for each robot in range, where there are more."""
LOST_MAX: Final = 4
"""Refreshings after which a fact that is not heard again is withdrawn: with three of ten frames lost that happens to a
fact that holds once in a minute and a half. With 30 robots in range these are 3 s, as for `neighbor`."""
SPREAD_EACH: Final[Duration] = milliseconds(5)
"""A change is told after up to so much time for each robot in range, for it is often an answer to a change that all of
them have heard."""
SOURCES_MAX: Final = 1024
"""Robots of whose facts one robot knows; frames of others are ignored."""
NUMBERS: Final = 1 << 16
"""Numbers of frames; a number is newer than another if it is less than half of this ahead (RFC 1982)."""
LIVES: Final = 1 << 8


@final
class _Source:
    """What one other robot has told."""

    def __init__(self, epoch: int, number: int) -> None:
        self.epoch = epoch
        self.number = number
        """Of the newest frame."""
        self.facts: dict[int, list[Args]] = {}
        """By shared predicate."""
        self.until: dict[int, Instant] = {}
        """Until when these hold."""


@final
class SharedFacts:
    """The shared facts of one robot and of those that it hears."""

    def __init__(
        self,
        state: RobotState,
        radio: Radio,
        payload_max: int,
        offered: Callable[[], Sequence[tuple[int, float]]] | None,
    ) -> None:
        """`offered` returns who is in range, as a host knows it; None: what is heard holds for a time."""
        heard = [each for each in state.program.ensemble if each.duty is Duty.HEARD and each.other is not None]
        self._heard: dict[int, int] = {each.other: each.predicate for each in heard if each.other is not None}
        """By shared predicate that some rule reads from afar: the one of what is heard of it."""
        self.used: Final = bool(heard)
        self._state = state
        self._machine = state.machine
        self._radio = radio
        self._room = payload_max - SHARED_OCTETS
        self._offered = offered
        self._near: Sequence[tuple[int, float]] | None = None
        self._present: dict[int, None] = {}
        """The robots of `_near`."""
        self._gate = shared_of(state.program).gate
        self._symbols = symbols_of(state.program)
        self._widths = {index: len(state.program.predicates[index].types) for index in self._heard}
        self._rng = stream(f"{state.config.seed}/robot{state.robot}/shared") if heard else None
        self._told: dict[int, dict[Args, None]] = {index: {} for index in self._heard}
        """What the robot holds, as its frames say or are about to say."""
        self._changed: dict[int, None] = {}
        """Predicates whose change is to be told."""
        self._recent: dict[int, int] = {}
        """By predicate: in how many frames more the facts are told although there are none, or nothing has changed."""
        self._said_at: Instant = -seconds(3600)
        self._refresh_at: Instant = NEVER
        """When everything is told again."""
        self._number = 0
        self.next_said: Instant = NEVER
        """When the robot tells next."""
        self._sources: dict[int, _Source] = {}
        self._expires: Instant = NEVER
        """Nothing that is heard ends before."""
        self.untold: dict[int, int] = {}
        """By predicate: how many of its facts no frame has room for, at the last count."""
        self._over: dict[int, None] = {}

    def follow(self, other: "SharedFacts") -> None:
        """Number frames from the last one of another program's on."""
        self._number = other._number

    @property
    def next_wake(self) -> Instant:
        """When there is something to tell, or what is heard ends."""
        return min(self.next_said, self._expires)

    @property
    def outstanding(self) -> bool:
        """Whether something is to be told that a neighbour may not know."""
        return self.next_said != NEVER

    # -- telling ------------------------------------------------------------------------------------------------

    def look(self, now: Instant) -> None:
        """Notice which shared facts have come and gone; rules and actions have just had their turn."""
        news = False
        for index in self._heard:
            held = dict.fromkeys(self._machine.held(index))
            if held != self._told[index]:
                news = True
                self._told[index] = held
                self._changed[index] = None
                self._recent[index] = self._repeats()
        if news:  # one random wait for each change, however often the robot looks meanwhile
            self._plan_change(now)
        if now >= self.next_said:
            self._say(now)

    def _repeats(self) -> int:
        """Return in how many frames facts are told that have gone, or by a host that knows who is in range any."""
        repeats = self._state.config.shared_repeats
        return LOST_MAX if repeats is None else repeats

    def _plan_change(self, now: Instant) -> None:
        crowd = self._crowd(now)
        wait = 0
        if self._offered is None and self._rng is not None:
            wait = int(self._rng.random() * crowd * SPREAD_EACH)
        at = max(now + wait, self._said_at + max(CHANGE_MIN, crowd * CHANGE_EACH))
        self.next_said = min(self.next_said, at)

    def _crowd(self, now: Instant) -> int:
        """Return how many robots are in range."""
        return len(self._state.peers.neighbors(now)) if self._offered is None else 1

    def _say(self, now: Instant) -> None:
        """Tell what has changed, or everything, and plan the next time."""
        self._said_at = now
        crowd = self._crowd(now)
        # What would be due before the next change may be told is told with this one.
        soon = now + max(CHANGE_MIN, crowd * CHANGE_EACH)
        refreshing = soon >= self._refresh_at or len(self._changed) == len(self._told)
        about = []
        for index, held in self._told.items():
            if index in self._changed:
                about.append(index)
            elif refreshing and (held or self._recent.get(index, 0) > 0):
                about.append(index)
                self._recent[index] = self._recent.get(index, 0) - 1
        self._changed.clear()
        period = max(REFRESH, crowd * REFRESH_EACH)
        for parts in self._packed(now, about):
            self._number = (self._number + 1) % NUMBERS
            frame = SharedFrame(
                self._state.digest, self._state.config.epoch % LIVES, self._number, LOST_MAX * period, parts
            )
            self._radio.transmit(payloads.encode_shared(frame), None)
        if refreshing or self._refresh_at == NEVER:
            assert self._rng is not None
            again = now + int(period * (0.85 + 0.15 * self._rng.random()))
            self._refresh_at = again if self._is_refreshed() else NEVER
        self.next_said = self._refresh_at

    def _is_refreshed(self) -> bool:
        """Return whether all is to be told again."""
        ends = self._state.config.shared_repeats is not None
        return any(self._recent.get(index, 0) > 0 or (held and not ends) for index, held in self._told.items())

    def _packed(self, now: Instant, about: Sequence[int]) -> list[list[bytes]]:
        """Return the parts of as many frames as the facts of these predicates take, those of each in one frame."""
        frames: list[list[bytes]] = []
        left = 0
        for index in about:
            part = self._part(now, index)
            if not frames or len(part) > left:
                frames.append([])
                left = self._room
            frames[-1].append(part)
            left -= len(part)
        return frames

    def _part(self, now: Instant, index: int) -> bytes:
        """Return the facts of a predicate as octets: as many of the newest as a frame has room for."""
        told: list[bytes] = []
        octets = payloads.SHARED_PART_OCTETS
        untold = 0
        for args in reversed(self._told[index]):
            try:
                fact = payloads.encode_values(args, self._symbols.numbers)
            except WireError:  # a text or a list is too long
                untold += 1
                continue
            if octets + len(fact) > self._room or len(told) >= payloads.SHARED_FACTS_MAX:
                untold += 1
                continue
            told.append(fact)
            octets += len(fact)
        if untold:
            self._note_untold(now, index, untold)
        else:
            self.untold.pop(index, None)
        return payloads.encode_shared_part(index, told)

    def _note_untold(self, now: Instant, index: int, untold: int) -> None:
        self.untold[index] = untold
        if index not in self._over:  # once for each predicate
            self._over[index] = None
            name = self._state.program.predicates[index].name
            self._state.trace(now, "bound_reached", kept=f"octets of shared {name} facts", bound=self._room)

    # -- hearing ------------------------------------------------------------------------------------------------

    def wake(self, now: Instant) -> None:
        """Forget what has ended, and tell what is due."""
        if self._offered is not None:
            self._look_around(now, self._offered())
        elif now >= self._expires:
            self._expire(now)
        if now >= self.next_said:
            self._say(now)

    def _look_around(self, now: Instant, near: Sequence[tuple[int, float]]) -> None:
        """Where a host has others in range than before: forget the facts of those that are not, and tell the others."""
        if near is self._near:
            return
        self._near = near
        self._present = dict.fromkeys(robot for robot, _ in near)
        for robot in [each for each in self._sources if each not in self._present]:
            self._forget(now, robot, list(self._heard))
        if any(self._told.values()):
            for index, held in self._told.items():
                if held:
                    self._changed[index] = None
                    self._recent[index] = self._repeats()
            self._plan_change(now)

    def _expire(self, now: Instant) -> None:
        """Forget what has not been heard for too long."""
        self._expires = NEVER
        for robot in list(self._sources):
            source = self._sources[robot]
            self._forget(now, robot, [index for index, until in source.until.items() if until <= now])
            if source.until:
                self._expires = min(self._expires, *source.until.values())

    def _forget(self, now: Instant, robot: int, about: Sequence[int]) -> None:
        source = self._sources[robot]
        for index in about:
            if index in source.until:
                self._replace(now, robot, source, index, [], HeardCause(robot, lost=True))
                del source.until[index], source.facts[index]
        if not source.until:
            del self._sources[robot]

    def received(self, now: Instant, frame: Received) -> None:
        """Take in what another robot tells. Raises WireError for a frame that no robot of this program sends."""
        said = payloads.decode_shared(frame.payload, self._widths, self._symbols.names, self._state.digest)
        if said is None:
            return  # another program's
        if self._offered is not None:  # who has just come into range may already tell
            self._look_around(now, self._offered())
        told = [(index, self._checked(frame.source, index, facts)) for index, facts in said.facts]
        if self._near is not None and frame.source not in self._present:
            return  # it was under way when its sender died
        until = NEVER if self._offered is not None else min(now, frame.stamp) + said.lasts
        source = self._sources.get(frame.source)
        if source is None:
            if len(self._sources) >= SOURCES_MAX:
                return
            source = _Source(said.epoch, said.number)
        elif not _is_newer(said, source):
            return
        elif said.epoch != source.epoch:  # another life, which does not hold what the one before held
            self._forget(now, frame.source, list(source.until))
        if until <= now:
            return
        source.epoch = said.epoch
        source.number = said.number
        self._sources[frame.source] = source
        for index, facts in told:
            self._replace(now, frame.source, source, index, facts, HeardCause(frame.source))
            source.until[index] = until
        self._expires = min(self._expires, until)

    def _checked(self, robot: int, index: int, facts: Sequence[Args]) -> list[Args]:
        """Return facts of `robot` as its predicate declares them. Raises WireError before any of them is taken up."""
        try:
            return [self._gate.fact(self._heard[index], (Robot(robot), *args))[1:] for args in facts]
        except ValueError as error:
            raise WireError(f"shared facts: {error}") from error

    def _replace(
        self, now: Instant, robot: int, source: _Source, index: int, facts: list[Args], cause: HeardCause
    ) -> None:
        """Know from now on that `robot` holds exactly these facts of a predicate."""
        held = source.facts.get(index, [])
        source.facts[index] = facts
        if held == facts:
            return
        self._state.mark_dirty()
        predicate = self._heard[index]
        for args in held:
            if args not in facts:
                self._machine.withdraw(now, predicate, (Robot(robot), *args), cause)
        for args in facts:
            if args not in held:
                self._machine.insert(now, predicate, (Robot(robot), *args), cause)


def _is_newer(said: SharedFrame, source: _Source) -> bool:
    """Return whether a frame was sent after the newest one of its sender."""
    if said.epoch != source.epoch:
        return 0 < (said.epoch - source.epoch) % LIVES < LIVES // 2
    return 0 < (said.number - source.number) % NUMBERS < NUMBERS // 2
