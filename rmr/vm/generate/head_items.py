"""The items of a head, one fact, goal or action each, written as source (paper III.D; specified by `rmr.vm.derive`).

An item is written where a rule fires (`loop`) if none of its head can fail, else where its match is found (`derive`).
"""

from collections.abc import Sequence

from rmr.base.values import Robot
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
    Fold,
    Guard,
    HeadValue,
    Mode,
    Operator,
    Program,
    Rule,
    Steps,
    Type,
    When,
)
from rmr.bytecode.program import Derived as Item
from rmr.bytecode.scope import UNKNOWN, Scope
from rmr.vm.derive import Derived, DerivedKind
from rmr.vm.generate.body import BoundSlots
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.expression_source import narrowed
from rmr.vm.generate.fact_tables import FactTable
from rmr.vm.generate.form import Assign, Column, Evaluate, If, Local, Raise, tuple_of
from rmr.vm.generate.known import NOTHING, Known
from rmr.vm.generate.source import Pool, Source
from rmr.vm.match import plan_atom
from rmr.vm.type_checks import check_types, type_checks

ROLES: dict[type, DerivedKind] = {
    DeriveFact: DerivedKind.FACT,
    DeriveGoal: DerivedKind.GOAL,
    DeriveAction: DerivedKind.ACTION,
}
"""The machine's kind of each item (`rmr.vm.derive`)."""


class WrittenItem:
    """One item of a head as source."""

    def __init__(self, item: Item, slots: BoundSlots, scope: Scope, pool: Pool, tables: Sequence[FactTable]) -> None:
        predicates = [table.predicate for table in tables]
        self.item = item
        self.mine = item.owner == SELF
        """It is this robot's, whatever the match."""
        self.owner: Source = slots.expression(item.owner, pool)
        self.args = [slots.expression(code, pool) for code in item.args]
        declared = predicates[item.predicate].types
        self.checks = tuple(
            check
            for check in type_checks(item, predicates, scope)
            if not fits(self.args[check.place].known.type or UNKNOWN, declared[check.place])
        )
        self.surely_robot = self.owner.known.base is Base.ROBOT

    @property
    def fails(self) -> bool:
        """Whether it may have no value."""
        return bool(self.checks) or not self.surely_robot or any(each.fails for each in (self.owner, *self.args))

    def write(self, build: FormBuilder, pool: Pool) -> str:
        """Write what goes before and return the source of the `Derived`; raises NoValue where it has none."""
        owner = self.owner.text
        args = tuple_of([each.text for each in self.args])
        if not self.surely_robot:
            robot = pool.helper("Robot", Robot)
            no_value = pool.helper("NoValue", NoValue)
            build(Assign("owner", owner))
            build(If(f"type(owner) is not {robot}", (Raise(f"{no_value}('an owner that is no robot')"),)))
            owner = "owner"
        if self.checks:
            build(
                Assign("args", args),
                Evaluate(f"{pool.helper('check_types', check_types)}({pool.object(self.checks)}, args)"),
            )
            args = "args"
        role = pool.helper(f"ROLE_{ROLES[type(self.item)].name}", ROLES[type(self.item)])
        return f"{pool.helper('Derived', Derived)}({role}, {self.item.predicate}, {owner}, {args})"


def written_items(
    rule: Rule, slots: BoundSlots, program: Program, pool: Pool, tables: Sequence[FactTable]
) -> list[list[WrittenItem]] | None:
    """Return the chains of a head, or None if it has comprehensions, aggregates or conditions."""
    scope = Scope()
    scope.grow(rule.body, program.predicates)
    chains: list[list[WrittenItem]] = []
    for head in rule.head:
        if isinstance(head, Comprehension | Aggregate | HeadValue | When):
            return None
        items = head.steps if isinstance(head, Steps) else (head,)
        chains.append([WrittenItem(item, slots, scope, pool, tables) for item in items])
    return chains


def write_bindings(
    build: FormBuilder, pool: Pool, rule: Rule, tables: Sequence[FactTable], facts: dict[int, str]
) -> BoundSlots:
    """Write what gives the rule's variables their values again, given the match's facts by place; return them."""
    slots = BoundSlots()
    predicates = tuple(table.predicate for table in tables)
    for place, conjunct in enumerate(rule.body):
        if isinstance(conjunct, Bind):
            source = slots.expression(conjunct.code, pool)
            build(Assign(f"b{conjunct.slot}", source.text))
            slots.names[conjunct.slot] = Local(f"b{conjunct.slot}")
            slots.known[conjunct.slot] = source.known
        elif isinstance(conjunct, Fold):
            slots.names[conjunct.result] = Column(facts[place], 0)
            slots.known[conjunct.result] = Known(Type(Base.INT)) if conjunct.operator is Operator.COUNT else NOTHING
        elif isinstance(conjunct, Atom) and conjunct.mode is not Mode.ABSENT:
            table = tables[conjunct.predicate]
            fact = facts[place]
            step = plan_atom(conjunct, predicates, slots.names)
            slots.bind(step, table, lambda position, fact=fact: Column(fact, position))  # type: ignore[misc]
        elif isinstance(conjunct, Guard):
            slots.known.update(narrowed(conjunct.code, slots.known))
    return slots


def rows_of(rule: Rule) -> int | None:
    """Return the predicate whose facts of this robot are all that a rule derives, by one comprehension; else None."""
    if len(rule.head) != 1 or not isinstance(rule.head[0], Comprehension) or len(rule.head[0].head) != 1:
        return None
    item = rule.head[0].head[0]
    return item.predicate if isinstance(item, DeriveFact) and item.owner == SELF else None
