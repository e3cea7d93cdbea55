"""What the compiler says of ranks is what the robot finds out for itself, firing by firing."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from vm_hand import INT, ROBOT, Hand, V, actions, bind, code, guard, machine_of

from rmr.analysis.backward_chaining import Backwards
from rmr.analysis.goal_levels import Levels
from rmr.analysis.regressions import regressions_of
from rmr.base.values import Robot
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    ANY,
    Aggregate,
    Atom,
    Conjunct,
    Derived,
    Effect,
    Head,
    Lead,
    Operator,
    Program,
    Steps,
)
from rmr.lang.lower.goal_paths import GoalPaths, with_leads
from rmr.vm import goals
from rmr.vm.engines import Engine
from rmr.vm.goal_graph import FAR
from rmr.vm.goal_ways import GoalWays
from rmr.vm.ranks import ESTIMATE, Ranks
from rmr.vm.store import Args

pytestmark = pytest.mark.medium

ROBOTS = (1, 2)
FIRINGS_MAX = 30
FACTS_MAX, MATCHES_MAX = 40, 100
"""Of one robot, and of one firing: a program in some hundreds makes ever more, and takes minutes."""


@pytest.fixture(autouse=True, scope="module")
def bounded() -> Iterator[None]:
    """Let no robot hold, and no firing derive, more than programs with an end do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rmr.vm.machine.FACTS_MAX", FACTS_MAX)
        patch.setattr("rmr.vm.derive.MATCHES_MAX", MATCHES_MAX)
        yield


@dataclass
class Scope:
    """The variables that are bound, by what they are."""

    ints: list[int]
    robots: list[int]
    last: list[int]
    """The last slot in use; inner scopes share it."""

    def inner(self) -> "Scope":
        return Scope(list(self.ints), list(self.robots), self.last)

    def new(self, kind: list[int]) -> V:
        self.last[0] += 1
        kind.append(self.last[0])
        return V(self.last[0])


class Maker:
    """Draws a program of few predicates and constants, so that much of it meets."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)
        self.hand = Hand(textual=self.rng.random() < 0.5)
        hand = self.hand
        self.temporary = [hand.temporary(f"p{arity}", *[INT] * arity) for arity in (0, 1, 2)]
        self.persistent = hand.persistent("known", INT)
        self.of_robot = hand.temporary("with", ROBOT)
        self.sensed = hand.sensed("seen", INT)
        self.facts = [*self.temporary, self.persistent, self.of_robot]
        effects = [self.effect() for _ in range(self.rng.randint(0, 3))]
        self.action = hand.action("act", ROBOT, INT, effects=tuple(effects))

    def value(self, predicate: int) -> object:
        return Robot(self.rng.choice(ROBOTS)) if predicate == self.of_robot else self.rng.randint(0, 2)

    def arity(self, predicate: int) -> int:
        return len(self.hand.predicates[predicate].types)

    def effect(self) -> Effect:
        """An effect of an action on a robot (slot 1) and an int (slot 2)."""
        owner = self.rng.choice([0, 0, 0, 1])
        predicate = self.rng.choice(self.facts if owner else [*self.facts, self.sensed])
        kinds = {True: [V(0), V(1)], False: [V(2), self.rng.randint(0, 2), code(V(2), 1, Op.ADD)]}
        args = [self.rng.choice(kinds[predicate == self.of_robot]) for _ in range(self.arity(predicate))]
        return Effect(predicate, tuple(each if type(each) is tuple else code(each) for each in args), code(V(owner)))

    def atom(self, scope: Scope) -> Atom:
        """A match, whose variables are old or new ones."""
        predicate = self.rng.choice([*self.facts, self.sensed])
        return self.hand.atom(predicate, *[self.pattern(predicate, scope) for _ in range(self.arity(predicate))])

    def pattern(self, predicate: int, scope: Scope) -> object:
        kind = scope.robots if predicate == self.of_robot else scope.ints
        choice = self.rng.random()
        if choice < 0.1:
            return ANY
        if choice < 0.4:
            return self.value(predicate)
        return V(self.rng.choice(kind)) if choice < 0.6 and kind else scope.new(kind)

    def body(self, scope: Scope) -> list[Conjunct]:
        """Matches, conditions and a `not`."""
        rng = self.rng
        body: list[Conjunct] = [self.atom(scope) for _ in range(rng.choice([1, 1, 2]))]
        if scope.ints and rng.random() < 0.5:
            left, right = V(rng.choice(scope.ints)), rng.choice([rng.randint(0, 2), V(rng.choice(scope.ints))])
            body.append(guard(left, right, rng.choice([Op.EQ, Op.EQ, Op.NE, Op.LT])))
        if scope.robots and rng.random() < 0.2:
            body.append(guard(V(0), V(rng.choice(scope.robots)), Op.EQ))
        if rng.random() < 0.15:
            body.append(guard(V(0), Robot(rng.choice(ROBOTS)), Op.EQ))
        if scope.ints and rng.random() < 0.2:
            known = V(rng.choice(scope.ints))
            body.append(bind(scope.new(scope.ints), known))
        if rng.random() < 0.2:
            predicate = rng.choice(self.facts)
            args = [rng.choice([ANY, self.value(predicate)]) for _ in range(self.arity(predicate))]
            body.append(self.hand.absent(predicate, *args))
        return body

    def argument(self, predicate: int, scope: Scope) -> object:
        """A value of the only type that a predicate has: a variable's, a constant, computed."""
        rng = self.rng
        if predicate == self.of_robot:
            return self.robot(scope)
        if not scope.ints or rng.random() < 0.4:
            return rng.randint(0, 2)
        known = V(rng.choice(scope.ints))
        return known if rng.random() < 0.8 else code(known, 1, Op.ADD)

    def robot(self, scope: Scope) -> object:
        return V(self.rng.choice([0, *scope.robots])) if self.rng.random() < 0.7 else Robot(self.rng.choice(ROBOTS))

    def derived(self, scope: Scope) -> Derived:
        """A fact, goal or action of this robot or another one."""
        rng, hand = self.rng, self.hand
        owner = V(0) if rng.random() < 0.75 else self.robot(scope)
        if rng.random() < 0.2:
            return hand.head(self.action, self.robot(scope), self.argument(self.temporary[1], scope), to=owner)
        predicate = rng.choice(self.facts)
        args = [self.argument(predicate, scope) for _ in range(self.arity(predicate))]
        return (hand.want if rng.random() < 0.1 else hand.head)(predicate, *args, to=owner)

    def head(self, scope: Scope) -> Head:
        choice = self.rng.random()
        if choice < 0.75:
            return self.derived(scope)
        if choice < 0.85:
            return Steps((self.derived(scope), self.derived(scope)))
        return self.comprehension(scope) if choice < 0.93 else self.aggregate(scope)

    def comprehension(self, scope: Scope) -> Head:
        inner, first = scope.inner(), scope.last[0] + 1
        body = self.body(inner)
        listed = [V(slot) for slot in range(first, scope.last[0] + 1)]
        return self.hand.each(listed, body, [self.derived(inner)])

    def aggregate(self, scope: Scope) -> Head:
        operator = self.rng.choice([Operator.COUNT, Operator.SUM, Operator.MIN])
        inner, first = scope.inner(), scope.last[0] + 1
        body = self.body(inner)
        own = tuple(range(first, scope.last[0] + 1))
        term = code(V(self.rng.choice(inner.ints)) if inner.ints else 1)
        visible = inner if operator is Operator.MIN else scope.inner()
        result = visible.new(visible.ints).slot
        head = self.derived(visible)
        return Aggregate(operator, None if operator is Operator.COUNT else term, result, own, tuple(body), (head,))

    def goal(self) -> None:
        rng = self.rng
        predicate = rng.choice(self.facts)
        values = [self.value(predicate) for _ in range(self.arity(predicate))]
        args: list[object] = [rng.choice([ANY, value, value]) for value in values]
        if self.arity(predicate) == 2 and rng.random() < 0.3:
            args = [V(1), V(1)]
        if predicate == self.of_robot and rng.random() < 0.4:
            args = [V(0)]
        self.hand.goal(predicate, *args, owner=rng.choice([None, None, *ROBOTS]))

    def outside(self) -> list[tuple[str, int, Args]]:
        """What happens to a robot from outside."""
        rng, out = self.rng, []
        for _ in range(rng.randint(0, 6)):
            what = rng.choice(["insert", "insert", "want", "sense", "withdraw", "complete", "complete"])
            predicate = self.sensed if what in ("sense", "withdraw") else rng.choice(self.facts)
            out.append((what, predicate, tuple(self.value(predicate) for _ in range(self.arity(predicate)))))
        return out

    def program(self) -> Program:
        rng = self.rng
        for _ in range(rng.randint(1, 7)):
            scope = Scope([], [], [0])
            body = self.body(scope)
            heads = [self.head(scope) for _ in range(rng.choice([1, 1, 2]))]
            self.hand.rule(body, heads, scope.last[0] + 1)
        for _ in range(rng.randint(1, 3)):
            self.goal()
        for _ in range(rng.randint(2, 8)):
            predicate = rng.choice(self.facts)
            self.hand.fact(predicate, *[self.value(predicate) for _ in range(self.arity(predicate))])  # type: ignore[arg-type]
        return self.hand.program()


def lived(program: Program, robot: int, seed: int, engine: Engine = Engine.INTERPRETER) -> list[object]:
    """Return all that happens to a robot and on it."""
    machine = machine_of(program, robot, seed, engine=engine, firing_budget=FIRINGS_MAX, trace=True)
    machine.start(0)
    happened: list[object] = []
    waiting: list[int] = []
    outside = Maker(seed)
    for now, (what, predicate, args) in enumerate([("", 0, ()), *outside.outside()]):
        if what in ("insert", "sense"):
            machine.insert(now, predicate, args)
        elif what == "want":
            machine.want(now, predicate, args)
        elif what == "withdraw":
            machine.withdraw(now, predicate, args)
        elif what == "complete" and waiting:
            machine.complete(now, waiting.pop(0), True)
        machine.run(now)
        events = machine.drain()
        waiting += [action.serial for action in actions(events) if action.executor == robot]
        happened += events
    return [*happened, machine.facts(), machine.goals()]


def without_leads(program: Program) -> Program:
    return replace(program, goals=tuple(replace(goal, leads=None) for goal in program.goals))


SEEDS = st.integers(min_value=0, max_value=1 << 32)
checked = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@checked
@given(SEEDS)
def test_robot_behaves_equally_with_and_without_precomputed_goal_ranks(seed: int) -> None:
    bare = Maker(seed).program()
    program = with_leads(bare)
    for robot in ROBOTS:
        life = lived(bare, robot, seed)
        assert all(lived(program, robot, seed, engine) == life for engine in Engine)


@checked
@given(SEEDS)
def test_a_rank_that_the_compiler_knows_is_the_one_that_a_search_finds(seed: int) -> None:
    program = Maker(seed).program()
    reach = GoalPaths(program)
    led = replace(
        program,
        goals=tuple(
            replace(goal, leads=tuple(Lead(way.rule, way.rank) for way in reach.ways(goal))) for goal in program.goals
        ),
    )
    reading = Backwards(program)

    class Compared(Ranks):
        """Ranks of which each is worked out both ways; every firing is ranked."""

        def nearest(self, rule: int) -> int | None:
            found = super().nearest(rule)
            return None if found is None and self._unstated else 0

        def of(self, rule: int, facts: Iterable[tuple[int, Args]]) -> int | None:
            facts = list(facts)
            found = super().of(rule, facts)
            ways = GoalWays(regressions_of(led), self._robot, self._holdings.each, pytest.fail)
            for predicate, args in self._wanted():
                ways.goal(predicate, args, wanted=True)
            ways.work(1 << 40)
            rank = min((level for fact in facts if (level := ways.level(*fact)) is not None), default=FAR)
            if rank == FAR:
                estimate = Levels(reading, self._wanted(), self._robot).lowest(facts)
                assert found == (None if estimate is None else ESTIMATE + estimate)
            else:
                assert found == rank
            return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(goals, "Ranks", Compared)
        for robot in ROBOTS:
            lived(led, robot, seed)
