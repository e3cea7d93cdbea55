"""What must hold of any octets whatever: they are refused with a reason, or they are a program that runs.

A program that is accepted is shown, written again and read again, and run by a machine that is handed facts,
goals, the ends of actions and the time as chance has it. Nothing may raise but what is documented, no fact may
be of another type than its predicate declares, and all stays within bounds.
"""

from collections.abc import Iterator, Sized
from contextlib import contextmanager
from enum import Enum
from math import inf
from random import Random

import rmr.vm.generate.body
from rmr.base.streams import Choices
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.codec import BytecodeError, decode, encode
from rmr.bytecode.conform import conforms
from rmr.bytecode.disassemble import disassemble
from rmr.bytecode.program import ANY, Base, Kind, Program, Type
from rmr.vm.engines import new_machine
from rmr.vm.machine import FACTS_MAX
from rmr.vm.machine_events import ActionDerived, FactSent, FinishAwaited, FinishSeen, VmEvent

FIRINGS_MAX = 12
"""Firings of one run."""

DEEDS_MAX = 8
"""What happens from outside in one trial."""

SHOWN = 0.2
"""How often what is refused is shown nevertheless."""

LOOKS_MAX = 30_000
"""Facts looked at in one trial. How long a rule's joins take is its author's affair; a trial is cut short there."""

TIMES = [0, 1, 10**6, 10**9, 10**10, 10**13, 10**17]
"""How much later something happens, in ns."""


class Outcome(Enum):
    """What became of a case."""

    UNWRITABLE = "unwritable"
    """No octets could say what the mutation made."""
    REJECTED = "rejected"
    ACCEPTED = "accepted"
    """Accepted and run."""
    CUT_SHORT = "cut short"
    """Accepted and run, until it had looked at more facts than a trial may."""


class TooLong(BaseException):
    """The trial looks at more facts than it may."""


def tried(data: bytes, rng: Random) -> Outcome:
    """Return what became of `data`. Whatever else is raised is a fault."""
    try:
        program = decode(data)
    except BytecodeError:
        if rng.random() < SHOWN:
            _shown_or_refused(data)
        return Outcome.REJECTED
    assert disassemble(data)
    again = encode(program, debug=True)
    assert repr(decode(again)) == repr(program), "it comes back as another program"
    try:
        with looks_counted():
            Trial(program, rng).run()
    except TooLong:
        return Outcome.CUT_SHORT
    return Outcome.ACCEPTED


def _shown_or_refused(data: bytes) -> None:
    """What does not verify may still be shown."""
    try:
        disassemble(data)
    except BytecodeError:
        return


class Looks:
    """Counts the facts that generated searches look at; code that has been made outlives the trial that it was for."""

    def __init__(self) -> None:
        self.left = inf
        self._counted = rmr.vm.generate.body.counted

    def __call__(self, vm: object, facts: Sized) -> object:
        self.left -= len(facts)
        if self.left < 0:
            raise TooLong
        return self._counted(vm, facts)


LOOKS = Looks()


@contextmanager
def looks_counted() -> Iterator[None]:
    """Raise TooLong when more facts have been looked at than a trial may."""
    original = rmr.vm.generate.body.counted
    rmr.vm.generate.body.counted = LOOKS  # type: ignore[assignment]
    LOOKS.left = LOOKS_MAX
    try:
        yield
    finally:
        LOOKS.left = inf
        rmr.vm.generate.body.counted = original


class Trial:
    """One machine and what happens to it."""

    def __init__(self, program: Program, rng: Random) -> None:
        self.program = program
        self.rng = rng
        self.now = 0
        self.serials = [0, 1]
        robot = rng.choice([0, 1, 7, 65533])
        self.machine = new_machine(program, robot, Choices(str(rng.random())), firing_budget=FIRINGS_MAX, trace=True)

    def run(self) -> None:
        """Start the machine and let things happen."""
        self.machine.start(0)
        self.settle()
        deeds = [self.insert, self.insert, self.withdraw, self.want, self.command, self.complete, self.wait]
        deeds += [self.await_finish, self.see_finish, self.ask, self.mistake]
        for _ in range(self.rng.randint(1, DEEDS_MAX)):
            self.now += self.rng.choice(TIMES)
            self.rng.choice(deeds)()
            self.settle()

    def settle(self) -> None:
        """Run, and look at everything that can be seen."""
        machine = self.machine
        machine.run(self.now)
        events = machine.drain()
        self.serials += [event.serial for event in events if isinstance(event, ActionDerived)]
        assert all(repr(event) for event in events)
        self.check_types(events)
        assert sum(len(machine.held(index)) for index in range(len(self.program.predicates))) <= FACTS_MAX
        assert all(machine.facts())
        assert machine.goals().keys() == {"achieved", "open"}
        assert all(repr(job) for job in machine.jobs)
        assert machine.next_wake >= self.now or machine.next_wake == machine.due
        assert machine.quiescent or machine.next_wake <= self.now
        assert min([machine.expression_failures, *machine.dropped.values()]) >= 0

    def check_types(self, events: list[VmEvent]) -> None:
        """Check that whatever is held, done or sent is what its predicate declares."""
        for index in range(len(self.program.predicates)):
            for args in self.machine.held(index):
                self.check_args(index, args)
        for event in events:
            if isinstance(event, ActionDerived | FactSent):
                self.check_args(event.predicate, event.args)
            elif isinstance(event, FinishAwaited | FinishSeen):
                assertion = self.program.assertions[event.assertion]
                seen = isinstance(event, FinishSeen)
                self.check_args((assertion.finish if seen else assertion.start).predicate, _args_of(event))

    def check_args(self, predicate: int, args: tuple[Value, ...]) -> None:
        """Check one fact or action."""
        declared = self.program.predicates[predicate]
        fitting = [conforms(value, kind) for value, kind in zip(args, declared.types, strict=True)]
        assert all(fitting), f"{declared.name}{args} is not of the declared types"

    # ---- what happens from outside

    def chosen(self, *kinds: Kind) -> int | None:
        """A predicate of one of `kinds`."""
        fitting = [index for index, each in enumerate(self.program.predicates) if each.kind in kinds]
        return self.rng.choice(fitting) if fitting else None

    def args(self, predicate: int) -> tuple[Value, ...]:
        """Arguments as declared, mostly such as hold already."""
        held = self.machine.held(predicate)
        if held and self.rng.random() < 0.4:
            return self.rng.choice(held)
        return tuple(self.value(kind) for kind in self.program.predicates[predicate].types)

    def value(self, kind: Type) -> Value:
        values: dict[Base, list[Value]] = {
            Base.ROBOT: [Robot(0), Robot(1), Robot(7)],
            Base.INT: [0, 1, 2, -1, 2**63 - 1, -(2**63)],
            Base.FLOAT: [0.0, 1.0, -2.5, 1e308, 5e-324],
            Base.BOOL: [True, False],
            Base.STRING: ["", "a", "ß" * 9],
            Base.SYMBOL: [Symbol("a"), Symbol("b"), Symbol("s")],
        }
        if kind.base is Base.LIST:
            return tuple(self.value(kind.element or Type(Base.INT)) for _ in range(self.rng.randint(0, 3)))
        return self.rng.choice(values.get(kind.base) or [value for group in values.values() for value in group])

    def insert(self) -> None:
        predicate = self.chosen(Kind.TEMPORARY, Kind.PERSISTENT, Kind.SENSED)
        if predicate is not None:
            self.machine.insert(self.now, predicate, self.args(predicate))

    def withdraw(self) -> None:
        predicate = self.chosen(Kind.SENSED)
        if predicate is not None:
            self.machine.withdraw(self.now, predicate, self.args(predicate))

    def want(self) -> None:
        predicate = self.chosen(Kind.TEMPORARY, Kind.PERSISTENT, Kind.SENSED)
        if predicate is not None:
            args = tuple(self.rng.choice([ANY, value]) for value in self.args(predicate))
            self.machine.want(self.now, predicate, args)

    def command(self) -> None:
        """An action that another robot derived for this one."""
        predicate = self.chosen(Kind.ACTION)
        if predicate is not None:
            self.machine.derive_action(self.now, predicate, self.args(predicate), self.rng.choice([None, (3, 5)]))

    def complete(self) -> None:
        executor = self.rng.choice([None, None, 0, 1, 7])
        self.machine.complete(self.now, self.rng.choice(self.serials), self.rng.random() < 0.7, executor)

    def wait(self) -> None:
        """Let pass what is due."""
        self.now = max(self.now, min(self.machine.next_wake, self.now + 10**12))

    def await_finish(self) -> None:
        """Another robot's job waits for a fact of this one; it may be one that no robot can have."""
        for index, assertion in enumerate(self.program.assertions):
            try:
                args = self.args(assertion.start.predicate)
                self.machine.await_finish(self.now, self.rng.choice([0, 1, 7]), index, args, self.now - 10**9)
            except ValueError:
                continue

    def see_finish(self) -> None:
        for index, assertion in enumerate(self.program.assertions):
            args = self.args(assertion.finish.predicate)
            self.machine.finish_seen(
                self.now, self.rng.choice([0, 1, 7]), index, args, self.now - self.rng.choice(TIMES)
            )

    def ask(self) -> None:
        """What holds, and which jobs an action serves."""
        fact, action = self.chosen(Kind.TEMPORARY, Kind.PERSISTENT, Kind.SENSED), self.chosen(Kind.ACTION)
        if fact is not None:
            held = self.machine.held(fact)
            assert self.machine.holds(fact, (ANY,) * len(self.program.predicates[fact].types)) is bool(held)
        if action is not None:
            assert all(job.finish is None for job in self.machine.serves(action, self.args(action)))

    def mistake(self) -> None:
        """What is no fact of the program is refused, and nothing else happens."""
        if self.machine.due < self.now:
            return  # deadlines before the input come first, and their violations may be facts
        before = self.machine.facts()
        try:
            self.machine.insert(self.now, self.rng.choice([-1, 0, 1, 10**6]), (object(), 2**70))  # type: ignore[arg-type]
        except ValueError:
            assert self.machine.facts() == before
        else:
            raise AssertionError("what is no value was taken")


def _args_of(event: FinishAwaited | FinishSeen) -> tuple[Value, ...]:
    return event.args if isinstance(event, FinishSeen) else event.start_args
