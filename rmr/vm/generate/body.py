"""The search for the matches of a body, generated as nested loops (paper III.D).

The conjuncts are nested in a given order. A positive atom becomes a loop over candidate facts, oldest first: all facts
of the predicate, or an index bucket for the bound arguments. If all arguments of a set are bound, a look-up takes the
place of the loop. A condition becomes a test that skips the rest of the iteration.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rmr.bytecode.arithmetic import NoValue, same
from rmr.bytecode.octets import identity
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    SELF_SLOT,
    Atom,
    Base,
    Bind,
    Code,
    Conjunct,
    Fold,
    Guard,
    Mode,
    Operator,
    Predicate,
    Slot,
    Type,
)
from rmr.vm import match
from rmr.vm.aggregate import reduced
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.expression_source import condition, expression, narrowed
from rmr.vm.generate.fact_tables import FactTable, Positions, candidates, index_key
from rmr.vm.generate.form import (
    Assign,
    Break,
    Column,
    Continue,
    Evaluate,
    If,
    Local,
    Loop,
    Reference,
    Statement,
    Try,
    column,
    tuple_of,
)
from rmr.vm.generate.known import NOTHING, Known
from rmr.vm.generate.source import Pool, Source
from rmr.vm.match import AtomStep, plan_atom

ME = "me"
"""The local variable that holds the robot itself."""

ONCE = (None,)
"""The sequence of a loop that runs once."""

Placed = tuple[int, Conjunct]
"""A conjunct and its place in the body's text."""


class BoundSlots:
    """The slots of a rule that are bound at a place of a generated function: their names and abstract values."""

    def __init__(self, outer: "BoundSlots | None" = None) -> None:
        """Begin with the robot itself, or with all that is bound in `outer`."""
        self.names: dict[int, Reference] = dict(outer.names) if outer else {SELF_SLOT: Local(ME)}
        self.known: dict[int, Known] = dict(outer.known) if outer else {SELF_SLOT: Known(Type(Base.ROBOT))}
        """Abstract values of the slots at the next conjunct, narrowed by the conditions before it."""
        self.declared: dict[int, Known] = dict(self.known)
        """Abstract values of the slots that atoms bind, by the declarations alone."""

    def expression(self, code: Code, pool: Pool) -> Source:
        """Return the source of an expression."""
        return expression(code, self.names, self.known, pool)

    def type_at(self, slot: int) -> Type | None:
        """Return the type of a slot; None if it is not known."""
        return self.known[slot].type

    def bind(self, step: AtomStep, table: FactTable, argument: Callable[[int], Reference]) -> None:
        """Bind the slots that an atom binds; `argument` returns the expression of the argument at a position."""
        for position, slot in step.binds:
            kind = table.predicate.types[position]
            self.names[slot] = argument(position)
            self.known[slot] = self.declared[slot] = Known(None if kind.base is Base.OPEN else kind)


class Body:
    """Writes one search."""

    def __init__(
        self,
        build: FormBuilder,
        pool: Pool,
        tables: Sequence[FactTable],
        slots: BoundSlots,
        leave: Statement,
        *,
        fact: str = "f",
        may_index: bool = True,
        counted: bool = True,
        reports: tuple[int, int] | None = None,
    ) -> None:
        """Begin a search in the block that `build` has open.

        `leave` is the statement that leaves the function or loop around the search, `fact` the prefix of its fact
        variables. With `may_index` the search may demand new indices. `counted`: facts that are examined count
        against the budget of the search, which is needed unless one atom alone is searched. `reports`
        are the rule and its part for which failures of conjuncts are reported; None: they propagate.
        """
        self.build = build
        self.pool = pool
        self.tables = tables
        self.slots = slots
        self.facts: dict[int, str] = {}
        """By place: the variables that hold the facts found."""
        self.uses: dict[str, None] = {}
        """The indices that are probed: each is to be in a variable of its name."""
        self._fact = fact
        self._skip = leave
        self.may_index = may_index
        self._counted = counted
        self._reports = reports
        self._places: list[tuple[int, int]] = []
        """Of the facts found: place, predicate."""
        self._loops: list[tuple[int, int]] = []
        """Of the loops: how far in their insides stand, the atom's place."""

    def report(self, place: int) -> Evaluate | None:
        """Return the call that reports ``reason``, the NoValue of the conjunct at `place`; None: let it propagate."""
        if self._reports is None:
            return None
        rule, part = self._reports
        return Evaluate(f"vm.failed(now, {rule}, {part}, {place}, {tuple_of(self.found)}, reason)")

    def stop(self, place: int, fact: str) -> str | None:
        """Return the condition on which the atom at `place` takes neither `fact` nor a later one."""
        del place, fact
        return None

    def passed_over(self, atom: Atom, fact: str) -> str | None:
        """Return a condition, beside the match itself, on which an atom does not take a fact."""
        del atom, fact
        return None

    def spent(self, place: int) -> str | None:
        """Return the condition on which the facts found before the atom at `place` cannot lead to another match."""
        del place
        return None

    def take(self, place: int, atom: Atom, fact: str) -> None:
        """Let an atom take `fact`; nothing but its predicate is known."""
        table = self.tables[atom.predicate]
        step = plan_atom(atom, self._predicates, self.slots.names, self.slots.type_at)
        self._test(step, fact)
        self._found(place, step, table, fact)

    def seek(self, order: Sequence[Placed], leaf: Callable[[], None]) -> None:
        """Write the search for `order`; `leaf` writes what is done with each match."""
        with self.build.level():
            for place, conjunct in order:
                if isinstance(conjunct, Guard):
                    self._guard(place, conjunct)
                elif isinstance(conjunct, Bind):
                    self._bind(place, conjunct)
                elif isinstance(conjunct, Fold):
                    self._fold(place, conjunct)
                elif conjunct.mode is Mode.ABSENT:
                    self._absent(conjunct)
                else:
                    self._atom(place, conjunct)
            leaf()
            for depth, place in reversed(self._loops):
                spent = self.spent(place)
                if spent is not None:
                    self.build.close(depth)
                    self.build(If(spent, (Break(),)))

    @property
    def found(self) -> list[str]:
        """The variables of the facts found, in the order of the text."""
        return [self.facts[place] for place in sorted(self.facts)]

    @property
    def skip(self) -> Statement:
        """The statement that leaves out the rest of the turn."""
        return self._skip

    @property
    def _predicates(self) -> tuple[Predicate, ...]:
        return tuple(table.predicate for table in self.tables)

    def _guard(self, place: int, guard: Guard) -> None:
        source = condition(guard.code, self.slots.names, self.slots.known, self.pool)
        self._trying(place, source, If(f"not {source.text}", (self._skip,)))
        self.slots.known.update(narrowed(guard.code, self.slots.known))

    def _bind(self, place: int, bind: Bind) -> None:
        source = self.slots.expression(bind.code, self.pool)
        if bind.slot in self.slots.names:
            equal = f"{self.pool.helper('same', same)}({self.slots.names[bind.slot].text}, {source.text})"
            self._trying(place, source, If(f"not {equal}", (self._skip,)))
            return
        name = f"b{bind.slot}"
        self._trying(place, source, Assign(name, source.text))
        self.slots.names[bind.slot] = Local(name)
        self.slots.known[bind.slot] = source.known

    def _fold(self, place: int, fold: Fold) -> None:
        """Write the search of a fold, and what its matches are reduced to: a pseudo-fact, as the interpreter's."""
        build = self.build
        fact = f"{self._fact}{place}"
        values = f"v{place}"
        inner = FoldBody(self, place, counted=True)
        build(Assign(values, "[]"))
        with build.loop("_", self.pool.helper("ONCE", ONCE)):  # so that `continue` leaves the search
            inner.seek(list(enumerate(fold.body)), lambda: inner.gather(fold, values))
        self.uses.update(inner.uses)
        work = f"{self.pool.helper('reduced', reduced)}({self.pool.object(fold.operator)}, {values})"
        source = Source(work, NOTHING, fails=fold.operator is not Operator.COUNT)
        if fold.operator is Operator.COUNT:
            source = Source(f"len({values})", Known(Type(Base.INT)), fails=False)
        build(If("vm.looks < 0", (self._skip,)))
        self._trying(place, source, Assign("value", source.text))
        if fold.operator in (Operator.MIN, Operator.MAX):
            build(If("value is None", (self._skip,)))
        build(Assign(fact, f"(True, {self.pool.helper('identity', identity)}(value), value)"))
        self.facts[place] = fact
        self.slots.names[fold.result] = Column(fact, 0)
        self.slots.known[fold.result] = source.known

    def _trying(self, place: int, source: Source, statement: Statement) -> None:
        report = self.report(place) if source.fails else None
        if report is None:
            self.build(statement)
            return
        no_value = self.pool.helper("NoValue", NoValue)
        self.build(Try(no_value, "reason", (report, self._skip), (statement,)))

    def _atom(self, place: int, atom: Atom) -> None:
        build = self.build
        table = self.tables[atom.predicate]
        step = plan_atom(atom, self._predicates, self.slots.names, self.slots.type_at)
        fact = f"{self._fact}{place}"
        key = self._member(step, table)
        if key is not None:
            build(Assign(fact, f"{table.name}.get({key})"), If(f"{fact} is None", (self._skip,)))
            stop = self.stop(place, fact)
            if stop is not None:
                build(If(stop, (self._skip,)))
        else:
            facts, sure = self._candidates(step, table)
            build.open(partial(Loop, fact, facts))
            self._loops.append((build.depth, place))
            self._skip = Continue()
            stop = self.stop(place, fact)
            if stop is not None:
                build(If(stop, (Break(),)))
            self._test(step, fact, self._others(atom, fact), sure)
        self._found(place, step, table, fact)

    def _absent(self, atom: Atom) -> None:
        build = self.build
        table = self.tables[atom.predicate]
        step = plan_atom(atom, self._predicates, self.slots.names, self.slots.type_at)
        key = self._member(step, table)
        if key is not None:
            build(If(f"{key} in {table.name}", (self._skip,)))
            return
        facts, sure = self._candidates(step, table)
        tests = self._tests(step, "g", sure)
        passed_over = self.passed_over(atom, "g")
        if passed_over is not None:
            tests.append(passed_over)
        build(Loop("g", facts, (If(f"not ({' or '.join(tests)})", (Break(),)) if tests else Break(),)))
        build.open_otherwise()  # reached if no fact refutes the ``not``: the rest of the search stands there

    def _others(self, atom: Atom, fact: str) -> list[str]:
        """Return the conditions on which a fact is not taken although it matches."""
        others: list[str] = []
        if atom.mode is not Mode.READ:
            # Two conjuncts never take the same temporary fact.
            others += [f"{fact} is {self.facts[place]}" for place, other in self._places if other == atom.predicate]
        passed_over = self.passed_over(atom, fact)
        if passed_over is not None:
            others.append(passed_over)
        return others

    def _test(self, step: AtomStep, fact: str, others: Sequence[str] = (), sure: Positions = ()) -> None:
        tests = [*self._tests(step, fact, sure), *others]
        if tests:
            self.build(If(" or ".join(tests), (self._skip,)))

    def _tests(self, step: AtomStep, fact: str, sure: Positions = ()) -> list[str]:
        """Return the conditions on which a fact does not match; at the positions `sure` it does."""
        bound = [(position, self.pool.constant(value)) for position, value in step.tests]
        bound += [(position, self.slots.names[slot].text) for position, slot in step.joins]
        pairs = [(column(fact, position), text) for position, text in bound if position not in sure]
        pairs += [(column(fact, position), column(fact, other)) for position, other in step.twins]
        if step.strict:
            return [f"not {self.pool.helper('same', same)}({one}, {other})" for one, other in pairs]
        return [f"{one} != {other}" for one, other in pairs]

    def _found(self, place: int, step: AtomStep, table: FactTable, fact: str) -> None:
        self.facts[place] = fact
        self._places.append((place, step.predicate))
        self.slots.bind(step, table, lambda position: Column(fact, position))

    def _values(self, step: AtomStep) -> dict[int, str]:
        """Return the texts of the arguments that are bound, by position."""
        values = {position: self.pool.constant(value) for position, value in step.tests}
        values.update({position: self.slots.names[slot].text for position, slot in step.joins})
        return values

    def _member(self, step: AtomStep, table: FactTable) -> str | None:
        """Return the key of the one fact of a set that can match, if all is bound."""
        values = self._values(step)
        if table.linear or step.strict or len(values) < table.arity:
            return None  # temporary facts are a multiset; equal values of open types may be different ones
        return table.key(self.pool, [values[position] for position in range(table.arity)])

    def _candidates(self, step: AtomStep, table: FactTable) -> tuple[str, Positions]:
        """Return facts, oldest first, among them all that match, and at which positions they surely do."""
        # An index on joined slots is selective and shared by rules; constants alone are indexed only without joins.
        joins = [position for position, _ in step.joins]
        positions = tuple(sorted(joins or [position for position, _ in step.tests]))
        if not positions or table.queued or not (self.may_index or positions in table.indices):
            return (f"counted(vm, {table.facts})" if self._counted else table.facts), ()
        values = self._values(step)
        key = index_key(positions, [values[position] for position in positions])
        text = candidates(table, positions, key, counted=self._counted)
        self.uses.setdefault(table.indices[positions])
        # A bucket holds what Python calls equal: with open types (strict) the columns must be compared all the same.
        return text, () if step.strict else positions


class FoldBody(Body):
    """The search for the matches of a fold, inside of the search of a body."""

    def __init__(self, outer: Body, place: int, *, counted: bool) -> None:
        slots = BoundSlots(outer.slots)
        fact = f"i{place}_"
        super().__init__(
            outer.build,
            outer.pool,
            outer.tables,
            slots,
            Continue(),
            fact=fact,
            may_index=outer.may_index,
            counted=counted,
        )
        self._outer = outer
        self._place = place

    def report(self, place: int) -> Evaluate | None:
        """Return the call that reports a failure: it is one of the fold."""
        del place
        return self._outer.report(self._place)

    def gather(self, fold: Fold, values: str) -> None:
        """Write that the value of a match is kept."""
        if fold.term is None:
            self.build(Evaluate(f"{values}.append(1)"))
            return
        term = self.slots.expression(fold.term, self.pool)
        self._trying(self._place, term, Evaluate(f"{values}.append({term.text})"))


def places_of(body: Sequence[Conjunct]) -> list[int]:
    """Return the places of the conjuncts that a fact or the pseudo-fact of a fold stands for in a match."""
    atoms = [place for place, _ in positives(body)]
    return atoms + [place for place, each in enumerate(body) if isinstance(each, Fold)]


def positives(body: Sequence[Conjunct]) -> list[tuple[int, Atom]]:
    """Return the atoms of a body that take a fact, with their places."""
    return [(i, each) for i, each in enumerate(body) if isinstance(each, Atom) and each.mode is not Mode.ABSENT]


def loads(body: Body) -> list[Statement]:
    """Return the statements that load the indices that a search probes into variables."""
    return [Assign(name, f"vm.{name}") for name in body.uses]


def begun(pool: Pool, part: tuple[int, int, int], facts: str | None = None) -> list[Statement]:
    """Return the statements before a search, which begin to count the facts that it looks at.

    `part` is the rule, the part of it and the step that the end of a body stands for, `facts` those found before.
    """
    pool.globals["counted"] = counted
    looking = pool.object((part, ())) if facts is None else f"({pool.object(part)}, {facts})"
    return [Assign("vm.looks", str(match.LOOKS_MAX)), Assign("vm.looking", looking)]


def counted(vm: Any, facts: Any) -> Any:
    """Return `facts`; none once a search has looked at too many."""
    if vm.looks < 0:
        return ()
    vm.looks -= len(facts)
    if vm.looks < 0:
        vm.give_up()
        return ()
    return facts


def slots_of(conjunct: Conjunct) -> set[int]:
    """Return the slots that a conjunct names."""
    if isinstance(conjunct, Atom):
        return {pattern.index for pattern in conjunct.args if isinstance(pattern, Slot)}
    assert not isinstance(conjunct, Fold)  # only rules that are joined or gated ask, and those have none
    return {each.operand for each in conjunct.code if each.op is Op.LOAD and isinstance(each.operand, int)}
