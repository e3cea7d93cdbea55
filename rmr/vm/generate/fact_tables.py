"""Storage of facts in a generated machine (the paper's tiny database, V.B.3): tables and hash indices.

A fact is a list: whether it holds, its serial number, its arguments and, for predicates whose facts have a date, the
instant of its insertion. A table is a dict in the order of insertion; its key is the serial number of a temporary fact,
or the arguments of a fact of a set. An index maps the values at some positions to the facts with these values, in the
order of insertion; it is made when it is first probed. Temporary facts that only rules of one atom consume, each fact
at most one rule, are stored in these rules' queues instead of a table.
"""

from collections.abc import Sequence

from rmr.bytecode.octets import identity
from rmr.bytecode.program import Duty, Kind, Predicate, Program
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.form import Assign, AssignAll, Block, Delete, Evaluate, If, Return, column, serial, tuple_of
from rmr.vm.generate.source import Pool
from rmr.vm.generate.state_layout import VM, PredicateFunctions, PredicateSlots
from rmr.vm.store import LONG, is_open

FEW = 8
"""Facts of a table up to which examining each is quicker than probing an index."""

Positions = tuple[int, ...]


class FactTable:
    """How the facts of one predicate are kept."""

    def __init__(self, index: int, predicate: Predicate, dated: bool, concerned: bool) -> None:
        self.index = index
        self.predicate = predicate
        self.arity = len(predicate.types)
        self.linear = predicate.kind is Kind.TEMPORARY
        self.lasting = predicate.kind is Kind.PERSISTENT and predicate.best is None
        """Its facts never go."""
        self.open = any(map(is_open, predicate.types))
        self.dated = dated
        """A fact keeps the instant of its insertion."""
        self.concerned = concerned
        """Whether time assertions must be notified of each new fact."""
        self.long = [place for place, kind in enumerate(predicate.types) if kind.base in LONG]
        self._slots = PredicateSlots(index)
        self.slot = self._slots.table
        """The attribute of a machine that holds the table."""
        self.functions = PredicateFunctions(index)
        """Names of the generated functions of the predicate."""
        self.name = f"{VM}{self.slot}"
        """The same, as an expression."""
        self.queued = False
        """Whether the table is a list of the facts that match no rule; each other fact is in the queue of one rule."""
        self.indices: dict[Positions, str] = {}
        self.returns: int | None = None
        """The predicate of which an insertion of this one is, without the consequences of an insertion."""

    def key(self, pool: Pool, args: Sequence[str]) -> str:
        """Return what tells a fact of a set apart, given the texts of its arguments."""
        key = args[0] if self.arity == 1 else tuple_of(args)
        return f"{pool.helper('identity', identity)}({key})" if self.open else key

    def fact_key(self, pool: Pool, fact: str) -> str:
        """Return where `fact` stands in the table."""
        return serial(fact) if self.linear else self.key(pool, [column(fact, i) for i in range(self.arity)])

    def args(self, fact: str) -> str:
        """Return the arguments of `fact` as a tuple."""
        return tuple_of([column(fact, place) for place in range(self.arity)])

    @property
    def facts(self) -> str:
        """All facts, oldest first."""
        return f"vm.queued({self.index})" if self.queued else f"{self.name}.values()"

    def index_on(self, positions: Positions) -> str:
        """Return the name of the index on `positions`; from now on there is one."""
        return self.indices.setdefault(positions, self._slots.index(len(self.indices)))

    def fact(self, serial_number: str, args: Sequence[str]) -> str:
        """Return a new fact."""
        return f"[True, {', '.join([serial_number, *args, *(['now'] if self.dated else [])])}]"


def tables_of(program: Program) -> list[FactTable]:
    """Return the tables of a program."""
    asked = {assertion.finish.predicate for assertion in program.assertions}
    starting = {assertion.start.predicate for assertion in program.assertions}
    tables = [FactTable(i, each, i in asked, i in asked | starting) for i, each in enumerate(program.predicates)]
    for hidden in program.ensemble:
        if hidden.duty is Duty.RETURN:
            tables[hidden.predicate].returns = hidden.other
    return tables


def index_key(positions: Positions, texts: Sequence[str]) -> str:
    """Return where an index on `positions` has the facts with these values there."""
    return texts[0] if len(positions) == 1 else tuple_of(texts)


def candidates(table: FactTable, positions: Positions, key: str, *, counted: bool) -> str:
    """Return the facts, oldest first, that have the values of `key` at `positions`; the index is in a variable.

    If they are to be `counted`, a single fact is not: it costs no more than what led to it.
    """
    name = table.index_on(positions)
    probed = f"probe_{name}(vm, {key})"
    if not counted:
        return f"({_bucket(table, name, key)} if {name} is not None else {probed})"
    if table.lasting:
        bucket = f"(b if len(b := {name}.get({key}, NONE)) < 2 else counted(vm, b))"
        return f"({bucket} if {name} is not None else counted(vm, {probed}))"
    # A tuple is the bucket of a single fact (see `_entry`).
    bucket = f"(b if type(b := {name}.get({key}, NONE)) is tuple else counted(vm, b.values()))"
    return f"({bucket} if {name} is not None else counted(vm, {probed}))"


def _bucket(table: FactTable, index: str, key: str) -> str:
    """Return what an index has for a key."""
    if table.lasting:
        return f"{index}.get({key}, NONE)"
    return f"(b if type(b := {index}.get({key}, NONE)) is tuple else b.values())"


def write_probes(build: FormBuilder, tables: Sequence[FactTable]) -> None:
    """Write for each index how it is probed before it is there: a small table needs none."""
    for table in tables:
        for positions, name in table.indices.items():
            key = index_key(positions, [column("f", position) for position in positions])
            with build.function(f"probe_{name}", "vm", "key"):
                build(Assign("x", f"vm.{name}"))
                with build.when("x is None"):
                    matching = f"[f for f in {table.name}.values() if {key} == key]"
                    build(If(f"len({table.name}) < {FEW}", (Return(matching),)))
                    build(AssignAll((f"vm.{name}", "x"), "defaultdict(list)" if table.lasting else "{}"))
                    with build.loop("f", f"{table.name}.values()"):
                        build(*_entry(table, positions, "f"))
                build(Return(_bucket(table, "x", "key")))


def write_indexing(build: FormBuilder, table: FactTable, fact: str) -> None:
    """Write that a new fact gets into the indices that there are."""
    for positions, name in table.indices.items():
        build(If(f"(x := vm.{name}) is not None", _entry(table, positions, fact)))


def _entry(table: FactTable, positions: Positions, fact: str) -> Block:
    """Return the statements that enter a fact into the index ``x``.

    A bucket begins as the tuple of one fact, for most keys have one; the second fact turns it into a dict by serial
    number, from which a fact can be removed at once. Facts that are never removed are kept in a list.
    """
    key = index_key(positions, [column(fact, position) for position in positions])
    if table.lasting:
        return (Evaluate(f"x[{key}].append({fact})"),)
    bucket = Assign("b", f"x.get(k := {key})")
    two = f"{{{serial('b[0]')}: b[0], {serial(fact)}: {fact}}}"
    second = If("type(b) is tuple", (Assign("x[k]", two),), (Assign(f"b[{serial(fact)}]", fact),))
    return bucket, If("b is None", (Assign("x[k]", f"({fact},)"),), (second,))


def write_forgetting(build: FormBuilder, table: FactTable, fact: str) -> None:
    """Write that a fact gets out of the indices that there are."""
    for positions, name in table.indices.items():
        key = index_key(positions, [column(fact, position) for position in positions])
        drop: Block = (Delete("x[k]"),)
        several: Block = (Delete(f"b[{serial(fact)}]"), If("not b", drop))
        inside: Block = (Assign("b", f"x[k := {key}]"), If("type(b) is tuple", drop, several))
        build(If(f"(x := vm.{name}) is not None", inside))
