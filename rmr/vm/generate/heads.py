"""What a match derives, written as source (paper III.D; the specification is `rmr.vm.derive`)."""

from collections.abc import Sequence

from rmr.base.values import Robot, Value
from rmr.bytecode.arithmetic import NoValue
from rmr.bytecode.conform import fits
from rmr.bytecode.program import (
    SELF,
    Aggregate,
    Atom,
    Base,
    Bind,
    Comprehension,
    DeriveAction,
    DeriveFact,
    DeriveGoal,
    Guard,
    Kind,
    Mode,
    Operator,
    Program,
    Rule,
    Steps,
)
from rmr.bytecode.program import Derived as Item
from rmr.bytecode.scope import UNKNOWN, Scope
from rmr.vm.aggregate import FOLDS, better
from rmr.vm import derive as limits
from rmr.vm.derive import HEAD_PART, Derived, Role
from rmr.vm.doubts import Doubts, doubts, settle
from rmr.vm.generate.body import ME, Body, Slots, begun, loads, positives, serial
from rmr.vm.generate.expressions import narrowed
from rmr.vm.generate.known import NOTHING
from rmr.vm.generate.layout import Table, column, tuple_of
from rmr.vm.generate.lines import Lines
from rmr.vm.generate.source import Pool, Source
from rmr.vm.match import plan_atom

ROLES: dict[type, Role] = {DeriveFact: Role.FACT, DeriveGoal: Role.GOAL, DeriveAction: Role.ACTION}


class WrittenItem:
    """One item of a head as source."""

    def __init__(self, item: Item, slots: Slots, scope: Scope, pool: Pool, tables: Sequence[Table]) -> None:
        predicates = [table.predicate for table in tables]
        self.item = item
        self.mine = item.owner == SELF
        """It is this robot's, whatever the match."""
        self.owner: Source = slots.expression(item.owner, pool)
        self.args = [slots.expression(code, pool) for code in item.args]
        declared = predicates[item.predicate].types
        self.doubts = tuple(
            doubt
            for doubt in doubts(item, predicates, scope)
            if not fits(self.args[doubt.place].known.type or UNKNOWN, declared[doubt.place])
        )
        self.surely_robot = self.owner.known.base is Base.ROBOT

    @property
    def fails(self) -> bool:
        """Whether it may have no value."""
        return bool(self.doubts) or not self.surely_robot or any(each.fails for each in (self.owner, *self.args))

    def write(self, lines: Lines, pool: Pool) -> str:
        """Write what goes before and return the source of the `Derived`; raises NoValue where it has none."""
        owner, args = self.owner.text, tuple_of([each.text for each in self.args])
        if not self.surely_robot:
            robot, no_value = pool.helper("Robot", Robot), pool.helper("NoValue", NoValue)
            lines(f"owner = {owner}")
            lines(f"if type(owner) is not {robot}: raise {no_value}('an owner that is no robot')")
            owner = "owner"
        if self.doubts:
            lines(f"args = {args}", f"{pool.helper('settle', settle)}({pool.object(self.doubts)}, args)")
            args = "args"
        role = pool.helper(f"ROLE_{ROLES[type(self.item)].name}", ROLES[type(self.item)])
        return f"{pool.helper('Derived', Derived)}({role}, {self.item.predicate}, {owner}, {args})"


def written_items(
    rule: Rule, slots: Slots, program: Program, pool: Pool, tables: Sequence[Table]
) -> list[list[WrittenItem]] | None:
    """Return the chains of a head, or None if it has comprehensions or aggregates."""
    scope = Scope()
    scope.grow(rule.body, program.predicates)
    chains: list[list[WrittenItem]] = []
    for head in rule.head:
        if isinstance(head, Comprehension | Aggregate):
            return None
        items = head.steps if isinstance(head, Steps) else (head,)
        chains.append([WrittenItem(item, slots, scope, pool, tables) for item in items])
    return chains


def write_bindings(lines: Lines, pool: Pool, rule: Rule, tables: Sequence[Table], facts: dict[int, str]) -> Slots:
    """Write what gives the rule's variables their values again, given the match's facts by place; return them."""
    slots = Slots()
    predicates = tuple(table.predicate for table in tables)
    for place, conjunct in enumerate(rule.body):
        if isinstance(conjunct, Bind):
            source = slots.expression(conjunct.code, pool)
            lines(f"b{conjunct.slot} = {source.text}")
            slots.names[conjunct.slot] = f"b{conjunct.slot}"
            slots.known[conjunct.slot] = source.known
        elif isinstance(conjunct, Atom) and conjunct.mode is not Mode.ABSENT:
            table, fact = tables[conjunct.predicate], facts[place]
            step = plan_atom(conjunct, predicates, slots.names)
            slots.bind(step, table, lambda position, fact=fact: column(fact, position))  # type: ignore[misc]
        elif isinstance(conjunct, Guard):
            slots.known.update(narrowed(conjunct.code, slots.known))
    return slots


def settled_args(doubts: Doubts, args: tuple[Value, ...]) -> tuple[Value, ...]:
    """Return arguments that have the types that were in doubt. Raises NoValue."""
    settle(doubts, args)
    return args


def rows_of(rule: Rule) -> int | None:
    """Return the predicate whose facts of this robot are all that a rule derives, by one comprehension; else None."""
    if len(rule.head) != 1 or not isinstance(rule.head[0], Comprehension) or len(rule.head[0].head) != 1:
        return None
    item = rule.head[0].head[0]
    return item.predicate if isinstance(item, DeriveFact) and item.owner == SELF else None


class HeadWriter:
    """Writes ``derive{rule}``: given a match's facts, what it consumes and the chains that it derives, or None.

    ``value{rule}`` is the same for nobody but the run loop: what it consumes and derives are calls.
    """

    def __init__(
        self,
        program: Program,
        rule: int,
        lines: Lines,
        pool: Pool,
        tables: Sequence[Table],
        *,
        index: bool,
        calls: bool = False,
    ) -> None:
        self._program = program
        self._number = rule
        self._rule = program.rules[rule]
        self._lines = lines
        self._pool = pool
        self._tables = tables
        self._may_index = index
        atoms = positives(self._rule.body)
        self._facts = {place: f"f{place}" for place, _ in atoms}
        consumed = [(atom.predicate, self._facts[place]) for place, atom in atoms if atom.mode is Mode.CONSUME]
        self._calls = calls
        self._consumed = [] if calls else [self._removal(predicate, fact) for predicate, fact in consumed]
        self._gone = [serial(fact) for _, fact in consumed] if calls else []
        """The facts that the run loop itself consumes."""

    def write(self) -> None:
        """Write the function."""
        lines, pool, rule = self._lines, self._pool, self._rule
        parameters = ", ".join(["vm", "now", *self._facts.values()])
        scope = Scope()
        scope.grow(rule.body, self._program.predicates)
        with lines.block(f"def {'value' if self._calls else 'derive'}{self._number}({parameters}):"):
            lines(f"{ME} = vm.robot")
            slots = write_bindings(lines, pool, rule, self._tables, self._facts)
            lines(f"consumed = [{', '.join(self._consumed)}]", "out = []", "part = matches = 0")
            with lines.block("try:"):
                lines("pass")
                for part, head in enumerate(rule.head):
                    lines(f"part = {part}")
                    if isinstance(head, Comprehension | Aggregate):
                        self._inner(part, head, slots, scope)
                    else:
                        steps = head.steps if isinstance(head, Steps) else (head,)
                        self._chain([WrittenItem(each, slots, scope, pool, self._tables) for each in steps])
            with lines.block(f"except {pool.helper('NoValue', NoValue)} as reason:"):
                lines(f"vm.failed(now, {self._number}, {HEAD_PART}, part, {self._found([])}, reason)", "return None")
            lines("return consumed, out")

    def _removal(self, predicate: int, fact: str) -> str:
        """Return how a fact that is consumed is listed."""
        return f"({f'remove{predicate}' if self._calls else predicate}, {fact})"

    def _as_call(self, item: WrittenItem) -> str | None:
        """Return the call that inserts an item, and its arguments: a fact of this robot that cannot fail."""
        if not self._calls or not isinstance(item.item, DeriveFact) or not item.mine:
            return None
        if item.doubts:
            if rows_of(self._rule) is None:
                return None
            args = tuple_of([each.text for each in item.args])
            settled = self._pool.helper("settled", settled_args)
            return f"{settled}({self._pool.object(item.doubts)}, {args})"
        adding = [] if rows_of(self._rule) is not None else [f"add{item.item.predicate}"]
        return tuple_of([*adding, *[each.text for each in item.args]])

    def _chain(self, items: list[WrittenItem]) -> None:
        call = self._as_call(items[0]) if len(items) == 1 else None
        if call is not None:
            self._lines(f"out.append({call})")
            return
        names: list[str] = []
        for number, item in enumerate(items):
            source = item.write(self._lines, self._pool)
            names.append(f"d{number}")
            self._lines(f"d{number} = {source}")
        self._lines(f"out.append({'(follow, ' if self._calls else ''}{tuple_of(names)}{')' if self._calls else ''})")

    def _found(self, inner: Sequence[str]) -> str:
        return tuple_of([*self._facts.values(), *inner])

    def _inner(self, part: int, head: Comprehension | Aggregate, outer: Slots, outer_scope: Scope) -> None:
        lines, pool = self._lines, self._pool
        slots, scope = Slots(outer), Scope(outer_scope)
        scope.grow(head.body, self._program.predicates)
        atoms = [each for each in head.body if isinstance(each, Atom)]
        if any(self._program.predicates[each.predicate].kind is Kind.TEMPORARY for each in atoms):
            lines(f"gone = {{{', '.join([*self._gone, '*[f[1] for _, f in consumed]'])}}}", "taken = set()")
        if isinstance(head, Aggregate):
            lines("values = []", "best = None")
        taking = [(place, atom.predicate) for place, atom in positives(head.body) if atom.mode is Mode.CONSUME]
        body = Body(
            lines,
            pool,
            self._tables,
            slots,
            "continue",
            fact="g",
            told=lambda step: self._tell(part, step, body.found),
            passed_over=self._passed_over,
            spent=lambda place: next((f"{serial(f'g{each}')} in taken" for each, _ in taking if each < place), None),
            may_index=self._may_index,
            counted=len(atoms) > 1,
        )
        if len(atoms) > 1:
            lines(begun(pool, (self._number, part, len(head.body)), self._found([])))
        if self._counts_at_end(head):
            lines("before = len(out)")
        mark = lines.mark()
        with lines.block(f"for _ in {pool.helper('ONCE', (None,))}:"):
            body.seek(list(enumerate(head.body)), lambda: self._leaf(part, head, body, outer, scope, taking))
        lines.insert(mark, loads(body))
        if self._counts_at_end(head):
            lines("matches += len(out) - before", self._limit())
        if isinstance(head, Aggregate):
            self._aggregated(head, outer, slots, scope)

    def _counts_at_end(self, head: Comprehension | Aggregate) -> bool:
        """Tell whether the matches of an inner body can be counted when all are there: nothing in it can fail."""
        guards = [each for each in head.body if not isinstance(each, Atom)]
        simple = isinstance(head, Comprehension) and len(head.head) == 1 and not guards
        return simple and all(len(code) == 1 for code in head.head[0].args)  # type: ignore[union-attr]

    def _limit(self) -> str:
        """Return the statement that gives up a firing with too many matches."""
        text = f"more than {limits.MATCHES_MAX} matches in one firing"
        return f"if matches > {limits.MATCHES_MAX}: raise {self._pool.helper('NoValue', NoValue)}({text!r})"

    def _passed_over(self, atom: Atom, fact: str) -> str | None:
        if self._program.predicates[atom.predicate].kind is not Kind.TEMPORARY:
            return None
        if atom.mode is Mode.CONSUME:
            return f"{serial(fact)} in gone or {serial(fact)} in taken"
        return f"{serial(fact)} in gone"

    def _tell(self, part: int, step: int, found: Sequence[str]) -> str:
        return f"vm.failed(now, {self._number}, {part}, {step}, {self._found(found)}, reason)"

    def _leaf(
        self,
        part: int,
        head: Comprehension | Aggregate,
        body: Body,
        outer: Slots,
        scope: Scope,
        taking: Sequence[tuple[int, int]],
    ) -> None:
        lines, pool = self._lines, self._pool
        items = head.head if isinstance(head, Comprehension) else (head.head,)
        no_value = pool.helper("NoValue", NoValue)
        if not self._counts_at_end(head):
            lines(f"matches += {len(items) or 1}", self._limit())
        if isinstance(head, Comprehension):
            written = [WrittenItem(item, body.slots, scope, pool, self._tables) for item in items]
            fails = any(item.fails for item in written)
        else:
            term = body.slots.expression(head.term, pool) if head.term is not None else None
            fails = term is not None and term.fails
        names = []
        with lines.level():
            if fails:
                lines("try:")
                lines.enter()
            if isinstance(head, Comprehension):
                for number, item in enumerate(written):
                    source = self._as_call(item)
                    if source is None:
                        lines(f"d{number} = {item.write(lines, pool)}")
                        names.append(f"(follow, (d{number},))" if self._calls else f"(d{number},)")
                    else:
                        lines(f"d{number} = {source}")
                        names.append(f"d{number}")
            else:
                lines(f"value = {term.text if term is not None else 1}")
        if fails:
            lines(f"except {no_value} as reason:", f" {self._tell(part, HEAD_PART, body.found)}", f" {body.skip}")
        for place, predicate in taking:
            lines(f"taken.add({serial(f'g{place}')})", f"consumed.append({self._removal(predicate, f'g{place}')})")
        if isinstance(head, Comprehension):
            lines(*[f"out.append({name})" for name in names])
        elif head.operator in (Operator.MIN, Operator.MAX):
            operator = pool.helper(f"OPERATOR_{head.operator.name}", head.operator)
            with lines.block(f"if {pool.helper('better', better)}({operator}, value, best):"):
                lines("best = value")
                lines(*[f"w{slot} = {body.slots.names[slot]}" for slot in sorted(body.slots.names.keys() - outer.names.keys())])
        else:
            lines("values.append(value)")

    def _aggregated(self, head: Aggregate, outer: Slots, inner: Slots, scope: Scope) -> None:
        lines, pool = self._lines, self._pool
        slots = Slots(outer)
        if head.operator in (Operator.MIN, Operator.MAX):
            for slot in sorted(inner.names.keys() - outer.names.keys()):
                slots.names[slot], slots.known[slot] = f"w{slot}", inner.known[slot]
            slots.names[head.result], slots.known[head.result] = "best", NOTHING
            with lines.block("if best is not None:"):
                self._chain([WrittenItem(head.head, slots, scope, pool, self._tables)])
            return
        fold = pool.helper(f"FOLD_{head.operator.name}", FOLDS[head.operator])
        lines(f"total = {fold}(values)")
        slots.names[head.result], slots.known[head.result] = "total", NOTHING
        self._chain([WrittenItem(head.head, slots, scope, pool, self._tables)])
