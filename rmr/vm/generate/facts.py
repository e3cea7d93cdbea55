"""Insertion and removal of facts: tables, indices, and the rules that have to be matched again.

An inserted fact is offered to each rule with an atom for it. What the text alone demands of the fact (constants, a
variable that occurs twice, for a rule of one atom all its conditions) is tested at insertion, as in the alpha network
of a Rete, so that most rules are not affected.
"""

from collections.abc import Sequence

from rmr.base.values import Value
from rmr.bytecode.arithmetic import same
from rmr.bytecode.conform import length
from rmr.bytecode.program import Atom, Bind, Guard
from rmr.vm import machine
from rmr.vm.generate.body import ME, BoundSlots, slots_of
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.expression_source import condition, narrowed
from rmr.vm.generate.fact_tables import FactTable, write_forgetting, write_indexing
from rmr.vm.generate.form import (
    Assign,
    AssignAll,
    Block,
    Continue,
    Delete,
    Equality,
    Evaluate,
    If,
    Local,
    Return,
    Statement,
    Test,
    Update,
    column,
    every,
    held,
    tuple_of,
)
from rmr.vm.generate.operators import DISTINCT
from rmr.vm.generate.plan import RulePlan, Way
from rmr.vm.generate.source import Pool
from rmr.vm.match import plan_atom

NEXT_SERIAL = AssignAll(("s", "vm.newest"), "vm.newest + 1")


class FactWriter:
    """Writes ``add{predicate}`` and ``remove{predicate}``, and the same in line."""

    def __init__(
        self, build: FormBuilder, pool: Pool, tables: Sequence[FactTable], readers: Sequence[Sequence[RulePlan]]
    ) -> None:
        """`readers` are, by predicate, the rules that name it in a body (`rmr.vm.generate.plan.readers_of`)."""
        self.firing_all: RulePlan | None = None
        """The rule that fires as matches are found (`LoopWriter.write_fire_all`): there is room, ``s`` is the serial
        number given last, and ``q`` the rule's queue, the rest of which is tried next."""
        self.readers = [readers[table.index if table.returns is None else table.returns] for table in tables]
        self._build = build
        self._pool = pool
        self._tables = tables
        self._predicates = tuple(table.predicate for table in tables)
        pool.helper("length", length)

    def functions(self, predicate: int) -> None:
        """Write the functions for the facts of a predicate."""
        build = self._build
        table = self._tables[predicate]
        args = [f"a{place}" for place in range(table.arity)]
        with build.function(table.functions.add, "vm", "now", *args):
            self.insertion(predicate, args)
        with build.function(table.functions.remove, "vm", "now", "f"):
            build(Update("vm.count", "-", "1"))
            if self.readers[predicate]:
                build(Assign("vm.busy", "True"))
            self.remove(predicate, "f")
            readers = mask(self.readers[predicate])
            build(If("vm.observed", (Evaluate(f"vm.on_remove(now, {predicate}, {table.args('f')}, {readers})"),)))

    def several(self, predicate: int) -> None:
        """Write the function that inserts facts of a predicate, given all their arguments."""
        build = self._build
        table = self._tables[predicate]
        args = [f"a{place}" for place in range(table.arity)]
        row = tuple_of(args) if args else "_"
        with build.function(table.functions.several, "vm", "now", "rows"):
            build(Assign(ME, "vm.robot"))
            if self.readers[predicate]:
                build(Assign("vm.busy", "True"))
            if not table.long and not table.concerned and (table.linear or (table.lasting and table.returns is None)):
                # Fast path: there is room for all of them, and no insertion has to be reported by itself.
                with build.when(f"not vm.observed and vm.count + len(rows) <= {machine.FACTS_MAX}"):
                    build(Assign("s", "vm.newest"))
                    with build.loop(row, "rows"):
                        if not table.linear:
                            build(If(f"(key := {table.key(self._pool, args)}) in {table.name}", (Continue(),)))
                        self.add(predicate, args, "key", next_serial=Update("s", "+", "1"))
                    build(Update("vm.count", "+", "s - vm.newest"), Assign("vm.newest", "s"), Return())
            with build.loop(row, "rows"):
                build(If(self._unwanted(predicate, args), (Continue(),)), Update("vm.count", "+", "1"))
                self.add(predicate, args, "key")
                build(self._report(predicate, args))

    def insertion(self, predicate: int, args: Sequence[str]) -> None:
        """Write the rest of a function, which inserts a fact."""
        build = self._build
        build(Assign(ME, "vm.robot"))
        build(If(self._unwanted(predicate, args), (Return(),)), Update("vm.count", "+", "1"))
        if self.readers[predicate]:
            build(Assign("vm.busy", "True"))
        self.add(predicate, args, "key")
        build(self._report(predicate, args))

    def _report(self, predicate: int, args: Sequence[str]) -> Statement:
        """Return the statement that reports an insertion while each change is traced or goals are open."""
        readers = mask(self.readers[predicate])
        return If("vm.observed", (Evaluate(f"vm.on_insert(now, {predicate}, {tuple_of(args)}, {readers})"),))

    def add_if_new(self, predicate: int, args: Sequence[str]) -> None:
        """Write the insertion of a fact, if there is room and it is not in a set already."""
        with self._build.when(f"not ({self._unwanted(predicate, args)})"):
            if self.firing_all is not None:
                self.add(predicate, args, "key", Update("s", "+", "1"))
                return
            self._build(Update("vm.count", "+", "1"))
            self.add(predicate, args, "key")

    def is_full(self, many: str) -> str:
        """Return the condition on which there is no room for a fact; `many` is that on which there are too many."""
        too_long = f"vm.length >= {machine.FACTS_LENGTH_MAX}"
        return f"({many} or {too_long})" if any(each.long for each in self._tables) else many

    def _unwanted(self, predicate: int, args: Sequence[str]) -> str:
        """Return the condition on which a fact is not inserted."""
        table = self._tables[predicate]
        full = f"{self.is_full(f'vm.count >= {machine.FACTS_MAX}')} and vm.is_full(now)"
        if table.linear:
            return full if self.firing_all is None else "False"
        known = f"(key := {table.key(self._pool, args)}) in {table.name}"
        if self.firing_all is not None:
            return known
        if table.predicate.best is not None:
            # It removes the fact whose place a better one takes, so that there is room.
            known = f"vm.is_worse(now, {predicate}, {tuple_of(args)}) or {known}"
        return f"{known} or {full}"

    def add(self, predicate: int, args: Sequence[str], key: str, next_serial: Statement = NEXT_SERIAL) -> None:
        """Write the insertion of a fact that has room, is new and is counted already.

        `next_serial` is the statement that assigns the next serial number to ``s``.
        """
        build = self._build
        back = self._tables[predicate].returns
        predicate = predicate if back is None else back
        table = self._tables[predicate]
        build(*[Update("vm.length", "+", f"length({args[place]})") for place in table.long])
        build(next_serial, Assign("f", table.fact("s", args)))
        if not table.queued:
            build(Assign(f"{table.name}[{'s' if table.linear else key}]", "f"))
        write_indexing(build, table, "f")
        self._show(predicate, args)
        if table.concerned and back is None:
            build(Evaluate(f"vm.concern(now, {predicate}, {tuple_of(args)})"))

    def remove(self, predicate: int, fact: str, but: int = 0) -> None:
        """Write the removal of a fact that holds, except for the count; the rules in the mask `but` need no mark."""
        build = self._build
        table = self._tables[predicate]
        build(Assign(held(fact), "False"))
        if not table.queued:
            build(Delete(f"{table.name}[{table.fact_key(self._pool, fact)}]"))
        build(*[Update("vm.length", "-", f"length({column(fact, place)})") for place in table.long])
        write_forgetting(build, table, fact)
        self.removed(predicate, but)
        if table.dated:
            build(Evaluate(f"vm._removed(now, {predicate}, {table.args(fact)}, {fact}[-1])"))

    def removed(self, predicate: int, but: int = 0) -> None:
        """Write which rules become stale by a removal, except those in the mask `but`."""
        build = self._build
        readers = self.readers[predicate]
        again = [plan for plan in readers if plan.way is Way.REMATCH]
        # A rule that is rematched may gain a match by a removal (``not``, inner bodies): it is stale in any case. A
        # rule that keeps its matches can only lose the one it has, so it is stale only if it is satisfied.
        free = mask([plan for plan in again if plan.once or predicate in (*plan.absent, *plan.inner)])
        if free:
            build(mark_stale(free), Update("vm.changed", "|", str(free)))
        if_ready = mask(readers) & ~free & ~but
        if if_ready:
            build(mark_stale(f"vm.ready & {if_ready}"))
        inner = mask([plan for plan in readers if predicate in plan.inner]) & ~free
        if inner:
            build(If("vm.broken", (mark_stale(f"vm.broken & {inner}"),)))

    def is_queued(self, predicate: int) -> bool:
        """Return whether the facts of a predicate need no table: each is in at most one queue, and no search reads it.

        This holds if only rules of one atom consume them and no two of these rules can want the same fact.
        """
        table = self._tables[predicate]
        readers = self.readers[predicate]
        gates = Gates(self._build)
        if table.returns is not None:
            return False
        for plan in readers:
            if plan.way is not Way.SINGLE or plan.once or plan.may_break or predicate in plan.inner:
                return False
            self._gate(plan, *plan.atoms[0], [f"a{place}" for place in range(table.arity)], gates)
        return bool(readers) and table.linear and not table.dated and gates.is_exclusive

    def _show(self, predicate: int, args: Sequence[str]) -> None:
        """Write the reaction of each rule to a new fact."""
        build = self._build
        inner = 0  # rules whose comprehensions or aggregates read the predicate: what they derive may change
        gates = Gates(build)
        for plan in self.readers[predicate]:
            if plan.way is Way.REMATCH:
                build(mark_stale(plan.bit), *([Update("vm.changed", "|", str(plan.bit))] if plan.once else []))
                continue
            if predicate in plan.inner:
                inner |= plan.bit
            for place, atom in plan.atoms:
                if atom.predicate == predicate:
                    self._gate(plan, place, atom, args, gates)
            if plan.once and plan.may_break:
                again = mark_stale(plan.bit), Update("vm.changed", "|", str(plan.bit))
                build(If(f"vm.broken & {plan.bit}", again))
        if inner:
            build(mark_stale(f"(vm.ready | vm.broken) & {inner}"))
        # A fact without a table is in the queue of the rule that takes it, or, if no rule does, in a list of its own.
        table = self._tables[predicate]
        gates.write((Evaluate(f"{table.name}.append(f)"),) if table.queued else ())

    def _gate(self, plan: RulePlan, place: int, atom: Atom, args: Sequence[str], gates: "Gates") -> None:
        """Add the reaction of a rule to a fact for one of its atoms."""
        state = plan.state
        if plan.way is Way.SINGLE:
            satisfied = Update("vm.stale" if plan.valued else "vm.ready", "|", str(plan.bit))
            next_match: Block = (Assign(state.match, "f"), satisfied)
            taken = If(f"{state.match} is None", next_match, (_queued(state.queue, "[0, f]"),))
            gates.add(self._conditions(plan, atom, args), (taken,))
            return
        if plan is self.firing_all:
            gates.add(self._top_tests(plan, atom, args), (Evaluate("q.append(f)"),))
        elif place == plan.atoms[0][0]:
            stale: Statement = mark_stale(plan.bit)
            if not plan.is_eager and not plan.valued:
                stale = If(f"not vm.ready & {plan.bit}", (stale,))  # a later top cannot replace the match found
            gates.add(self._top_tests(plan, atom, args), (_queued(state.queue, "[0, f]"), stale))
        else:
            # Before the first top is tried there is nothing to join a new fact with: the search below it finds both.
            tests = [*self.tests(atom, args), Test(state.last_top)]
            gates.add(tests, (_queued(state.new(place), "[f]"), mark_stale(plan.bit)))

    def _top_tests(self, plan: RulePlan, atom: Atom, args: Sequence[str]) -> list[Test]:
        """Return the conditions of a rule on the fact of its first atom alone."""
        slots = BoundSlots()
        tests = self.tests(atom, args, slots)
        self._bind(atom, args, slots)
        for conjunct in () if plan.failing else plan.rule.body:
            if isinstance(conjunct, Guard) and slots_of(conjunct) <= slots.names.keys():
                tests.append(self._guard(conjunct, slots))
        return tests

    def _conditions(self, plan: RulePlan, atom: Atom, args: Sequence[str]) -> list[Test]:
        """Return all the conditions of a rule of one atom, none of which can fail."""
        slots = BoundSlots()
        tests: list[Test] = []
        for conjunct in plan.rule.body:
            if isinstance(conjunct, Atom):
                tests += self.tests(atom, args, slots)
                self._bind(atom, args, slots)
            elif isinstance(conjunct, Guard):
                tests.append(self._guard(conjunct, slots))
            else:
                assert isinstance(conjunct, Bind)
                source = slots.expression(conjunct.code, self._pool)
                name = f"c{plan.index}_{conjunct.slot}"  # the rule that derives the fact has variables of its own
                tests.append(Test(f"(({name} := {source.text}), True)", binds=True))
                slots.names[conjunct.slot] = Local(name)
                slots.known[conjunct.slot] = source.known
        return tests

    def _bind(self, atom: Atom, args: Sequence[str], slots: BoundSlots) -> None:
        step = plan_atom(atom, self._predicates, slots.names)
        slots.bind(step, self._tables[atom.predicate], lambda position: Local(args[position]))

    def _guard(self, guard: Guard, slots: BoundSlots) -> Test:
        """Return the test of a condition; behind it more is known of the slots.

        An expression that was written without checks because of an earlier condition may only be evaluated behind
        that condition (``Y > 0, X % Y = 1``): then the test is no equality that may be evaluated first.
        """
        source = condition(guard.code, slots.names, slots.known, self._pool)
        equality = source.equality
        if equality is not None and condition(guard.code, slots.names, slots.declared, Pool()).fails:
            equality = None
        slots.known.update(narrowed(guard.code, slots.known))
        return Test(source.text, equality)

    def tests(self, atom: Atom, args: Sequence[str], slots: BoundSlots | None = None) -> list[Test]:
        """Return the conditions of an atom on a fact: constants and repeated variables."""
        bound = slots or BoundSlots()
        step = plan_atom(atom, self._predicates, bound.names, bound.type_at)
        pairs = [(args[position], bound.names[slot].text) for position, slot in step.joins]
        pairs += [(args[position], args[other]) for position, other in step.twins]
        if step.strict:
            pairs = [(args[position], self._pool.constant(value)) for position, value in step.tests] + pairs
            return [Test(f"{self._pool.helper('same', same)}({one}, {other})") for one, other in pairs]
        tests = [self._equals(args[position], value) for position, value in step.tests]
        return tests + [Test(f"{one} == {other}") for one, other in pairs]

    def _equals(self, arg: str, value: Value) -> Test:
        constant = self._pool.constant(value)
        return Test(f"{arg} == {constant}", Equality(arg, constant) if type(value) in DISTINCT else None)


Gate = tuple[Sequence[Test], Block]
"""The conditions of a rule on a fact, and its reaction to a fact that meets them."""


class Gates:
    """The conditions on which rules take notice of a fact.

    Where several rules compare one expression with different constants, the expression is evaluated once and chooses
    among them; the other conditions of a rule are tested in its branch.
    """

    def __init__(self, build: FormBuilder) -> None:
        self._build = build
        self._gates: list[Gate] = []

    def add(self, tests: Sequence[Test], taken: Block) -> None:
        """Add what is done with a fact that meets all `tests`."""
        self._gates.append((tests, taken))

    @property
    def is_exclusive(self) -> bool:
        """Whether a fact meets the conditions of one rule at most."""
        if len(self._gates) == 1:
            return True
        cases = list(self._cases().values())
        return len(cases) == 1 and len({equality.constant for equality, _ in cases[0]}) == len(self._gates)

    def write(self, left: Block = ()) -> None:
        """Write all that has been added, and `left` for a fact that meets no conditions, if they are exclusive."""
        done: set[int] = set()
        for subject, cases in self._cases().items():
            self._build(Assign("c", subject), self._choice(cases, left))
            done |= {number for _, number in cases}
        for number, gate in enumerate(self._gates):
            if number not in done:
                self._build(*_gated(*gate, left))
        if not self._gates:
            self._build(*left)

    def _cases(self) -> dict[str, list[tuple[Equality, int]]]:
        """Return the expressions that are compared with several constants: the comparisons, and numbers of gates."""
        chosen: dict[str, list[tuple[Equality, int]]] = {}
        if len(self._gates) < CASES_FROM:
            return chosen
        for number, (tests, _) in enumerate(self._gates):
            equality = next((test.equality for test in tests if test.equality is not None), None)
            if equality is not None and not any(test.binds for test in tests):
                chosen.setdefault(equality.subject, []).append((equality, number))
        return {
            subject: cases
            for subject, cases in chosen.items()
            if len({equality.constant for equality, _ in cases}) >= CASES_FROM
        }

    def _choice(self, cases: Sequence[tuple[Equality, int]], left: Block) -> If:
        """Return the choice among the constants that ``c`` may equal."""
        by_constant: dict[Equality, list[Statement]] = {}
        for equality, number in cases:
            tests, taken = self._gates[number]
            rest = [test for test in tests if test.equality != equality]
            by_constant.setdefault(equality, []).extend(_gated(rest, taken, left))
        choice: Block = left
        for equality, inside in reversed(by_constant.items()):
            choice = (If(f"c == {equality.constant}", tuple(inside), choice),)
        assert isinstance(choice[0], If)
        return choice[0]


def _gated(tests: Sequence[Test], taken: Block, left: Block) -> Block:
    """Return `taken` behind its tests."""
    return (If(every(tests), taken, left),) if tests else taken


def _queued(queue: str, first: str) -> If:
    """Return the statement that appends a fact to a queue; `first` is the queue with this fact alone."""
    return If(f"{queue} is None", (Assign(queue, first),), (Evaluate(f"{queue}.append(f)"),))


def mark_stale(rules: int | str) -> Update:
    """Return the statement that has rules matched again before the next firing."""
    return Update("vm.stale", "|", str(rules))


CASES_FROM = 3
"""Different constants from which on the comparisons with one expression become a choice."""


def mask(plans: Sequence[RulePlan]) -> int:
    """Return the bits of rules."""
    bits = 0
    for plan in plans:
        bits |= plan.bit
    return bits
