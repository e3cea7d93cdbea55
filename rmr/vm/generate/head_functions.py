"""Generated functions that evaluate a head when its match is found (paper III.D; specified by `rmr.vm.derive`).

``derive{rule}`` takes the facts of a match. It returns the facts that are consumed and the chains that are derived, or
None if the match does not fire. ``value{rule}`` is the variant for the run loop, which consumes the facts of the body
itself. It returns calls, or, where a rule derives only facts of one predicate by one comprehension, their arguments.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial

from rmr.base.values import Value
from rmr.bytecode.arithmetic import NoValue
from rmr.bytecode.heads import codes
from rmr.bytecode.program import (
    SELF,
    Aggregate,
    Atom,
    Comprehension,
    DeriveFact,
    HeadValue,
    Kind,
    Mode,
    Operator,
    Program,
    Steps,
    When,
)
from rmr.bytecode.program import Derived as Item
from rmr.bytecode.scope import UNKNOWN, Scope
from rmr.vm import derive as limits
from rmr.vm.aggregate import FOLDS, better
from rmr.vm.derive import HEAD_PART, draws_in
from rmr.vm.generate.body import ME, ONCE, Body, BoundSlots, begun, loads, places_of, positives
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.fact_tables import FactTable
from rmr.vm.generate.form import (
    Assign,
    AssignAll,
    Continue,
    Evaluate,
    If,
    Local,
    Raise,
    Return,
    Statement,
    Update,
    serial,
    tuple_of,
)
from rmr.vm.generate.head_items import WrittenItem, rows_of, write_bindings
from rmr.vm.generate.known import NOTHING
from rmr.vm.generate.operators import truth
from rmr.vm.generate.source import DRAWS, Pool, Source
from rmr.vm.generate.state_layout import RuleFunctions
from rmr.vm.type_checks import TypeChecks, check_types, type_checks

Inner = Comprehension | Aggregate
"""A part of a head with a body of its own."""


def checked_args(checks: TypeChecks, args: tuple[Value, ...]) -> tuple[Value, ...]:
    """Return `args` if they pass the checks. Raises NoValue."""
    check_types(checks, args)
    return args


class HeadWriter:
    """Writes ``derive`` or ``value`` of one rule."""

    def __init__(
        self, program: Program, rule: int, build: FormBuilder, pool: Pool, tables: Sequence[FactTable], *, calls: bool
    ) -> None:
        """`calls`: ``value``, which is written before the indices are laid out."""
        self.program = program
        self.number = rule
        self.rule = program.rules[rule]
        self.build = build
        self.pool = pool
        self.tables = tables
        self.calls = calls
        atoms = positives(self.rule.body)
        self._facts = {place: f"f{place}" for place in places_of(self.rule.body)}
        consumed = [(atom.predicate, self._facts[place]) for place, atom in atoms if atom.mode is Mode.CONSUME]
        self._consumed = [] if calls else [self.removal(predicate, fact) for predicate, fact in consumed]
        self._gone = [serial(fact) for _, fact in consumed] if calls else []
        """The facts that the run loop itself consumes."""
        pool.helper("NoValue", NoValue)

    def write(self) -> None:
        """Write the function."""
        build = self.build
        rule = self.rule
        scope = Scope()
        scope.grow(rule.body, self.program.predicates)
        functions = RuleFunctions(self.number)
        name = functions.value if self.calls else functions.derive
        with build.function(name, "vm", "now", *self._facts.values()):
            build(Assign(ME, "vm.robot"))
            slots = write_bindings(build, self.pool, rule, self.tables, self._facts)
            build(Assign("consumed", f"[{', '.join(self._consumed)}]"), Assign("out", "[]"))
            build(AssignAll(("part", "matches"), "0"))
            if any(map(draws_in, codes(rule.head))):
                build(Assign(DRAWS, f"vm.draws({self.number})"))
            with build.attempt("NoValue", "reason", self.failed(HEAD_PART, "part", ()), Return("None")):
                for part, head in enumerate(rule.head):
                    build(Assign("part", str(part)))
                    if isinstance(head, HeadValue):
                        self.value(head, slots, scope)
                    elif isinstance(head, When):
                        condition = Source(slots.names[head.slot].text, slots.known[head.slot], fails=False)
                        with build.when(truth(condition, self.pool).text):
                            self.part(part, head.item, slots, scope)
                    else:
                        self.part(part, head, slots, scope)
                build(Return("consumed, out"))

    def value(self, head: HeadValue, slots: BoundSlots, scope: Scope) -> None:
        """Write that a slot gets a value."""
        source = slots.expression(head.code, self.pool)
        name = f"h{head.slot}"
        self.build(Assign(name, source.text))
        slots.names[head.slot] = Local(name)
        slots.known[head.slot] = source.known
        scope.bind(head.slot, UNKNOWN)

    def part(self, part: int, head: Comprehension | Aggregate | Steps | Item, slots: BoundSlots, scope: Scope) -> None:
        """Write that an item of the head is derived."""
        if isinstance(head, Inner):
            InnerWriter(self, part, head, slots, scope).write()
        else:
            self.chain(head.steps if isinstance(head, Steps) else (head,), slots, scope)

    def chain(self, steps: Sequence[Item], slots: BoundSlots, scope: Scope) -> None:
        """Write that what stands outside of comprehensions is derived."""
        items = [self.item(each, slots, scope) for each in steps]
        call = self.call(items[0]) if len(items) == 1 else None
        if call is None:
            names = [f"d{number}" for number in range(len(items))]
            for name, item in zip(names, items, strict=True):
                self.build(Assign(name, item.write(self.build, self.pool)))
            call = self.followed(tuple_of(names))
        self.build(Evaluate(f"out.append({call})"))

    def item(self, item: Item, slots: BoundSlots, scope: Scope) -> WrittenItem:
        """Return an item of the head as source."""
        return WrittenItem(item, slots, scope, self.pool, self.tables)

    def call(self, item: WrittenItem) -> str | None:
        """Return the call that inserts an item, and its arguments; None if it is more than a fact of this robot."""
        if not self.calls or not isinstance(item.item, DeriveFact) or not item.mine:
            return None
        args = [each.text for each in item.args]
        if rows_of(self.rule) is None:
            return None if item.checks else tuple_of([self.tables[item.item.predicate].functions.add, *args])
        if not item.checks:
            return tuple_of(args)
        settled = self.pool.helper("checked_args", checked_args)
        return f"{settled}({self.pool.object(item.checks)}, {tuple_of(args)})"

    def followed(self, chain: str) -> str:
        """Return how a chain is listed."""
        return f"(follow, {chain})" if self.calls else chain

    def removal(self, predicate: int, fact: str) -> str:
        """Return how a fact that is consumed is listed."""
        return f"({self.tables[predicate].functions.remove if self.calls else predicate}, {fact})"

    def gone(self) -> str:
        """Return the set of what has been consumed so far."""
        consumed = f"*[{serial('f')} for _, f in consumed]"
        return f"{{{', '.join([*self._gone, consumed])}}}"

    def found(self, inner: Sequence[str]) -> str:
        """Return the facts found, those of an inner body behind the rule's own."""
        return tuple_of([*self._facts.values(), *inner])

    def failed(self, part: int, step: int | str, inner: Sequence[str]) -> Evaluate:
        """Return the call that reports ``reason``."""
        return Evaluate(f"vm.failed(now, {self.number}, {part}, {step}, {self.found(inner)}, reason)")


class InnerBody(Body):
    """The search for the matches of a comprehension or aggregate: each takes temporary facts, which serve no other."""

    def __init__(self, head: HeadWriter, part: int, inner: Inner, slots: BoundSlots) -> None:
        counted = sum(isinstance(each, Atom) for each in inner.body) > 1
        build = head.build
        pool = head.pool
        tables = head.tables
        super().__init__(build, pool, tables, slots, Continue(), fact="g", may_index=head.calls, counted=counted)
        self._head = head
        self._part = part
        self.taking = [(place, atom.predicate) for place, atom in positives(inner.body) if atom.mode is Mode.CONSUME]
        """Place and predicate of the facts that are consumed."""

    def report(self, place: int) -> Evaluate:
        """Return the call that reports a failure."""
        return self._head.failed(self._part, place, self.found)

    def passed_over(self, atom: Atom, fact: str) -> str | None:
        """Pass over what has been consumed before, and take nothing twice."""
        if self.tables[atom.predicate].predicate.kind is not Kind.TEMPORARY:
            return None
        taken = f" or {serial(fact)} in taken" if atom.mode is Mode.CONSUME else ""
        return f"{serial(fact)} in gone{taken}"

    def spent(self, place: int) -> str | None:
        """Leave the loops behind a fact that has been taken."""
        return next((f"{serial(f'g{each}')} in taken" for each, _ in self.taking if each < place), None)


class InnerWriter:
    """Writes one comprehension or aggregate."""

    def __init__(self, head: HeadWriter, part: int, inner: Inner, outer: BoundSlots, scope: Scope) -> None:
        self._head = head
        self._build = head.build
        self._pool = head.pool
        self._part = part
        self._inner = inner
        self._outer = outer
        self._slots = BoundSlots(outer)
        self._scope = Scope(scope)
        self._scope.grow(inner.body, head.program.predicates)
        self._body = InnerBody(head, part, inner, self._slots)
        single = isinstance(inner, Comprehension) and len(inner.head) == 1
        self._at_end = single and all(isinstance(each, Atom) for each in inner.body) and not self._can_fail()
        """The matches are counted when all are there: nothing fails, so it makes no difference."""

    def write(self) -> None:
        """Write the search and what becomes of its matches."""
        build = self._build
        inner = self._inner
        head = self._head
        atoms = [each for each in inner.body if isinstance(each, Atom)]
        if any(head.program.predicates[each.predicate].kind is Kind.TEMPORARY for each in atoms):
            build(Assign("gone", head.gone()), Assign("taken", "set()"))
        if isinstance(inner, Aggregate):
            build(Assign("values", "[]"), Assign("best", "None"))
        if len(atoms) > 1:
            build(*begun(self._pool, (head.number, self._part, len(inner.body)), head.found(())))
        if self._at_end:
            build(Assign("before", "len(out)"))
        mark = build.mark()
        with build.loop("_", self._pool.helper("ONCE", ONCE)):  # so that `continue` leaves the search
            self._body.seek(list(enumerate(inner.body)), self._leaf)
        build.insert(mark, loads(self._body))
        if self._at_end:
            build(Update("matches", "+", "len(out) - before"), _limit())
        if isinstance(inner, Aggregate):
            self._fold(inner)

    def _can_fail(self) -> bool:
        assert isinstance(self._inner, Comprehension)
        predicates = self._head.program.predicates
        return any(
            item.owner != SELF
            or any(len(code) != 1 for code in item.args)
            or type_checks(item, predicates, self._scope)
            for item in self._inner.head
        )

    def _leaf(self) -> None:
        """Write what is done with one match."""
        build = self._build
        inner = self._inner
        if not self._at_end:
            made = len(inner.head) if isinstance(inner, Comprehension) else 1
            build(Update("matches", "+", str(made or 1)), _limit())
        if isinstance(inner, Comprehension):
            items = [self._head.item(each, self._slots, self._scope) for each in inner.head]
            with self._trying(any(each.fails for each in items)):
                names = [self._written(f"d{number}", item) for number, item in enumerate(items)]
            self._take()
            build(*[Evaluate(f"out.append({name})") for name in names])
        else:
            term = self._slots.expression(inner.term, self._pool) if inner.term is not None else None
            with self._trying(term is not None and term.fails):
                build(Assign("value", "1" if term is None else term.text))
            self._take()
            self._keep(inner)

    def _trying(self, fails: bool) -> AbstractContextManager[None]:
        """Report and skip a match for which the statements that are added meanwhile fail."""
        if not fails:
            return nullcontext()
        return self._build.attempt("NoValue", "reason", self._body.report(HEAD_PART), self._body.skip)

    def _written(self, name: str, item: WrittenItem) -> str:
        """Write that `name` is an item, and return how it is listed."""
        call = self._head.call(item)
        self._build(Assign(name, call or item.write(self._build, self._pool)))
        return name if call is not None else self._head.followed(f"({name},)")

    def _take(self) -> None:
        """Write that the match's temporary facts are taken."""
        for place, predicate in self._body.taking:
            fact = f"g{place}"
            self._build(Evaluate(f"taken.add({serial(fact)})"))
            self._build(Evaluate(f"consumed.append({self._head.removal(predicate, fact)})"))

    def _keep(self, aggregate: Aggregate) -> None:
        """Write what an aggregate keeps of a match."""
        build = self._build
        if aggregate.operator not in (Operator.MIN, Operator.MAX):
            build(Evaluate("values.append(value)"))
            return
        operator = self._pool.helper(f"OPERATOR_{aggregate.operator.name}", aggregate.operator)
        with build.when(f"{self._pool.helper('better', better)}({operator}, value, best)"):
            build(Assign("best", "value"))
            build(*[Assign(f"w{slot}", self._slots.names[slot].text) for slot in self._new_slots()])

    def _fold(self, aggregate: Aggregate) -> None:
        """Write what an aggregate derives of all its matches."""
        slots = BoundSlots(self._outer)
        with self._build.level():
            if aggregate.operator in (Operator.MIN, Operator.MAX):
                for slot in self._new_slots():
                    slots.names[slot] = Local(f"w{slot}")
                    slots.known[slot] = self._slots.known[slot]
                slots.names[aggregate.result] = Local("best")
                self._build.open(partial(If, "best is not None"))
            else:
                fold = self._pool.helper(f"FOLD_{aggregate.operator.name}", FOLDS[aggregate.operator])
                self._build(Assign("total", f"{fold}(values)"))
                slots.names[aggregate.result] = Local("total")
            slots.known[aggregate.result] = NOTHING
            for item in aggregate.head:
                self._head.chain((item,), slots, self._scope)

    def _new_slots(self) -> list[int]:
        """Return the slots that the inner body binds."""
        return sorted(self._slots.names.keys() - self._outer.names.keys())


def _limit() -> Statement:
    """Return the statement that gives up a firing with too many matches."""
    text = f"more than {limits.MATCHES_MAX} matches in one firing"
    return If(f"matches > {limits.MATCHES_MAX}", (Raise(f"NoValue({text!r})"),))
