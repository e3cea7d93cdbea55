"""Carries the state of a machine over to the machine of another program, at the instant at which a robot changes it.

Carried are, by `ProgramPair`, the facts and open goals of predicates that both programs have, the jobs and watches of
time assertions that both have, and the actions under way that both declare, with the chains of steps behind them.
All else ends and is listed. Facts that are set aside for an offer count as facts; `EarlierMachine` gives them back. An
action under way keeps its serial, by which other robots know it, and is derived anew: the host begins it again. What
both programs state is not stated again, for it was inserted or opened by the old program and may be consumed since;
what only the new one states is inserted and opened last.

Sensed facts that the host provides are not carried: the host states them to the new machine.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from rmr.base.identity import ByIdentity
from rmr.base.streams import Choices
from rmr.base.time import Instant
from rmr.base.values import Robot, format_fact
from rmr.bytecode.heads import items
from rmr.bytecode.octets import identity
from rmr.bytecode.program import Duty, Kind, Program
from rmr.bytecode.program_pair import ProgramPair
from rmr.vm.assertions import goal_text
from rmr.vm.derive import Chain
from rmr.vm.interpreted import Interpreted
from rmr.vm.interpreter import mentioned
from rmr.vm.job import TimedJob
from rmr.vm.machine import Machine
from rmr.vm.shared import shared_of
from rmr.vm.store import Args


@dataclass(slots=True)
class Carried:
    """What became of a machine's state; texts are in program syntax."""

    facts: int = 0
    """Facts carried over."""
    facts_ended: list[str] = field(default_factory=list)
    """Facts of predicates that the new program has not, or with other types."""
    goals: int = 0
    goals_ended: list[str] = field(default_factory=list)
    jobs: list[TimedJob] = field(default_factory=list)
    """Live jobs carried over, with their start and deadline."""
    jobs_ended: list[str] = field(default_factory=list)
    """Undecided jobs of assertions that the new program has not: they are neither met nor missed."""
    actions: int = 0
    """Actions of this robot under way, which begin again."""
    actions_ended: list[str] = field(default_factory=list)

    def ended(self) -> list[str]:
        """Return all that has ended, in words."""
        kinds = (("", self.facts_ended), ("goal ", self.goals_ended), ("job ", self.jobs_ended))
        listed = [f"{kind}{text}" for kind, texts in kinds for text in texts]
        return [*listed, *(f"action {text}" for text in self.actions_ended)]


def carry_over(now: Instant, old: Machine, new: Machine, pair: ProgramPair) -> Carried:
    """Carry the state of `old` over to `new`, which has not been started. `old` is not used any more."""
    carried = Carried()
    new._now = now
    new.firings = old.firings
    number = new._shared.number
    if number is not None:
        new._insert(now, number, (int(new.robot),))
    jobs = new._assertions if new._affairs.mine or old._any_jobs is not None else None
    if jobs is not None:  # the start facts of carried jobs must not start these again
        kept = set(pair.assertions)
        jobs._mine = tuple(each for each in jobs._mine if each[0] not in kept)
        if old._any_jobs is not None:
            jobs.follow(old._any_jobs)
    _facts(now, old, new, pair, carried)
    if jobs is not None:
        jobs._mine = new._affairs.mine
    _goals(now, old, new, pair, carried)
    _jobs(old, new, pair, carried)
    _actions(old, new, pair, carried)
    _stated(now, old, new, pair)
    return carried


def _facts(now: Instant, old: Machine, new: Machine, pair: ProgramPair, carried: Carried) -> None:
    of_goals = old._shared.withdrawals
    # What neighbours have told is stated anew, as all that is sensed, and under the numbers of the new program. What is
    # known of offers is left to `EarlierMachine`.
    hidden = old._shared.hidden
    for index, predicate in enumerate(old.program.predicates):
        if predicate.kind is Kind.ACTION or predicate.provided or index in of_goals or index in hidden:
            continue
        target = pair.predicates[index]
        for args in list(old.each(index)):
            if target is not None:
                new._insert(now, target, args)
                carried.facts += 1
            else:
                mark = "!" if predicate.kind is Kind.PERSISTENT else ""
                carried.facts_ended.append(format_fact(predicate.name, (old.robot, *args), mark))
    kept, ended = _aside(old, pair)
    carried.facts += kept
    carried.facts_ended += ended


def _aside(machine: Machine, pair: ProgramPair) -> tuple[int, list[str]]:
    """Return how many facts that are set aside the new program has, and those that it has not."""
    kept = 0
    ended = []
    for index, hidden in machine._shared.hidden.items():
        if hidden.duty is not Duty.ASIDE or hidden.other is None:
            continue
        facts = list(machine.each(index))
        if pair.predicates[hidden.other] is not None:
            kept += len(facts)
            continue
        name = machine.program.predicates[hidden.other].name
        ended += [format_fact(name, (machine.robot, *args[1:])) for args in facts]
    return kept, ended


def _goals(now: Instant, old: Machine, new: Machine, pair: ProgramPair, carried: Carried) -> None:
    goals = old._any_goals
    if goals is None:
        return
    if goals.open or goals._achieved:
        new._goals._achieved[:0] = goals._achieved
        new._goals._achievements += goals._achievements
    for index, open_goals in list(goals.open.items()):
        target = pair.predicates[index]
        for patterns in list(open_goals.values()):
            if target is None:
                name = old.program.predicates[index].name
                carried.goals_ended.append(goal_text(name, old.robot, patterns))
            else:
                new._want(now, target, patterns)
                carried.goals += 1


def _jobs(old: Machine, new: Machine, pair: ProgramPair, carried: Carried) -> None:
    watches = old._any_watches
    if watches is not None:
        new._watches.take_over(watches, pair.assertions, pair.predicates)
    if old._any_jobs is not None:
        ended = new._assertions.take_over(old._any_jobs, pair.assertions)
        carried.jobs_ended += [job.text for job in ended]
        carried.jobs = list(new._assertions.live)


def _actions(old: Machine, new: Machine, pair: ProgramPair, carried: Carried) -> None:
    under_way = old._any_actions
    if under_way is None:
        return
    target = new._under_way
    target._serial = under_way._serial
    target._forgotten = under_way._forgotten
    for serial, action in under_way._actions.items():
        index = pair.predicates[action.predicate]
        mine = action.executor == old.robot
        if index is None:
            if mine:
                name = old.program.predicates[action.predicate].name
                carried.actions_ended.append(format_fact(name, (old.robot, *action.args)))
            continue
        chain = _renumbered(under_way._chains.get(serial, ()), pair)
        if not mine and not chain:
            continue  # it was awaited for the steps behind it alone
        target._actions[serial] = again = replace(action, predicate=index)
        if chain:
            target._chains[serial] = chain
        if mine:
            carried.actions += 1
            new._events.append(again)


def _renumbered(chain: Chain, pair: ProgramPair) -> Chain:
    """Return a chain up to the first step that the new program does not know."""
    steps = []
    for item in chain:
        target = pair.predicates[item.predicate]
        if target is None:
            break
        steps.append(item._replace(predicate=target))
    return tuple(steps)


def _stated(now: Instant, old: Machine, new: Machine, pair: ProgramPair) -> None:
    """Insert the facts and open the goals that the new program states and the old one did not."""
    known = Counter(
        (target, identity(args))
        for index, args in old._shared.facts(old.robot)
        if (target := pair.predicates[index]) is not None
    )
    for index, args in new._shared.facts(new.robot):
        key = (index, identity(args))
        if known[key] > 0:
            known[key] -= 1
        else:
            new._insert(now, index, args)
    stated = _stated_goals(old.program, old.robot)
    before = {(pair.predicates[index], repr(args)) for index, args in stated}
    for index, args in _stated_goals(new.program, new.robot):
        if (index, repr(args)) not in before:
            new._want(now, index, args)


def _stated_goals(program: Program, robot: int) -> list[tuple[int, Any]]:
    return [(goal.predicate, goal.args) for goal in program.goals if goal.owner in (None, robot)]


def preview(machine: Machine, program: Program) -> tuple[int, list[str]]:
    """Return how many facts a change to `program` would carry over now, and those that it would not."""
    pair = ProgramPair(machine.program, program)
    kept, ended = _aside(machine, pair)
    passed = machine._shared.withdrawals.keys() | machine._shared.hidden.keys()
    for index, predicate in enumerate(machine.program.predicates):
        if predicate.kind is Kind.ACTION or predicate.provided or index in passed:
            continue
        facts = list(machine.each(index))
        if pair.predicates[index] is not None:
            kept += len(facts)
            continue
        mark = "!" if predicate.kind is Kind.PERSISTENT else ""
        ended += [format_fact(predicate.name, (machine.robot, *args), mark) for args in facts]
    return kept, ended


# ---- offers in doubt at the change
#
# What robots have offered each other is settled by the rules that the compiler has made for that, and these belong to
# one program. So they go on beside the new program: with what was set aside, reserved, noted or decided, and without
# any other fact. Without the fact that a draw takes its number from nothing new is offered, and without facts of the
# program every question of another robot is refused. What comes back, and what a firing derives, is the new program's.


class EarlierMachine(Interpreted):
    """The rules by which the offers of an earlier program are settled."""

    __slots__ = ("_now_runs", "_pair", "count")

    def __init__(self, now: Instant, old: Machine, choices: Choices) -> None:
        """Take over what `old` knows of offers."""
        program = old.program
        super().__init__(settling(program), old.robot, choices)
        self._now_runs = old
        self._pair = ProgramPair(program, program)
        self.count: list[Args] = []
        """The facts that the next offer would take its number from."""
        for hidden in program.ensemble:
            name = program.predicates[hidden.predicate].name
            if hidden.predicate == self._shared.count:
                self.count = list(old.each(hidden.predicate))
            elif hidden.duty not in _RETOLD and not name.startswith("wished__"):
                for args in list(old.each(hidden.predicate)):
                    self._insert(now, hidden.predicate, args)

    def serve(self, machine: Machine, program: Program) -> None:
        """Give what comes of offers to `machine`; `program` is the earlier one, of which this has only some rules."""
        self._now_runs = machine
        self._pair = ProgramPair(program, machine.program)

    def hand_over(self, now: Instant, machine: Machine) -> None:
        """Give what is known of offers to a `machine` that runs the same program again."""
        for hidden in self.program.ensemble:
            if hidden.predicate == self._shared.count:
                machine.take_out(now, hidden.predicate)
                for args in self.count:
                    machine._insert(now, hidden.predicate, args)
            else:
                for args in self.each(hidden.predicate):
                    machine._insert(now, hidden.predicate, args)

    @property
    def open(self) -> bool:
        """Whether an offer is not settled: something is set aside, reserved, or held back."""
        return any(self._noted(("aside__", "out__", *_BY_NAME[:-1])))

    @property
    def concerned(self) -> list[Robot]:
        """The robots that the robot has noted in offers."""
        found = (each for args in self._noted(_BY_NAME) for each in args if isinstance(each, Robot))
        return [each for each in dict.fromkeys(found) if each != self.robot]

    def _noted(self, beginnings: tuple[str, ...]) -> Iterator[Args]:
        for hidden in self.program.ensemble:
            if self.program.predicates[hidden.predicate].name.startswith(beginnings):
                yield from self.each(hidden.predicate)

    def _insert(self, now: Instant, predicate: int, args: Args) -> None:
        back = self._shared.returns.get(predicate)
        if back is None:
            super()._insert(now, predicate, args)
        elif (target := self._pair.predicates[back]) is not None:
            self._now_runs.give_back(now, target, args)

    def _follow(self, now: Instant, chain: Chain) -> None:
        if chain[0].predicate in self._shared.hidden:
            super()._follow(now, chain)
        elif steps := _renumbered(chain, self._pair):
            self._now_runs.derive(now, steps)


_RETOLD = (Duty.VIEW, Duty.HEARD)
"""Duties of what other robots have told, and tell anew."""
_BY_NAME = ("note_", "booked__", "held__", "closing__", "telling__", "ask__", "query__", "did__")
"""Beginnings of the names of what a robot notes of an offer and of the robots that take part in it; the last one is of
what it remembers afterwards."""


def _settling(program: Program) -> Program:
    told = frozenset([each.predicate for each in program.ensemble if each.duty in _RETOLD])
    hidden = frozenset([each.predicate for each in program.ensemble]) - told
    rules = []
    for rule in program.rules:
        read = frozenset(mentioned(rule))
        named = told & (read | {item.predicate for item in items(rule.head)})
        if read & hidden and not named and shared_of(program).count not in read:
            rules.append(rule)
    return Program(
        program.predicates,
        rules=tuple(rules),
        strategy=program.strategy,
        functions=program.functions,
        ensemble=program.ensemble,
    )


settling = ByIdentity(_settling)
"""Returns a program with the rules that settle offers, and no others."""
