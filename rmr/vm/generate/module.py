"""The generated module of a program: its source and its compiled functions.

Source is generated from verified programs only, in the process that runs it, and never read from a file or a peer.
Python's compiler takes longer than everything else in loading a program. So the functions of a single rule or predicate
are generated on their first call.

`Machine.insert` and `Machine.run` are generated without the parts that the program does not need. A fact from outside
is checked and inserted by one function for each predicate. Its in-line checks accept the usual values of the declared
types. All other arguments go to `rmr.vm.outside.Gate`, which converts or rejects them.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

from rmr.base.time import Instant
from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol
from rmr.bytecode.conform import LENGTH_MAX
from rmr.bytecode.program import GOALS_OF, Base, Kind, Program
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.expression_source import write_function
from rmr.vm.generate.fact_tables import FactTable, tables_of, write_probes
from rmr.vm.generate.facts import FactWriter, mask
from rmr.vm.generate.form import (
    Assign,
    AssignAll,
    Block,
    Define,
    Evaluate,
    If,
    Statement,
    Update,
    column,
    text_of,
    tuple_of,
)
from rmr.vm.generate.head_functions import HeadWriter
from rmr.vm.generate.head_items import write_bindings, written_items
from rmr.vm.generate.loop import LoopWriter
from rmr.vm.generate.match_search import SearchWriter
from rmr.vm.generate.plan import RulePlan, Way, readers_of
from rmr.vm.generate.source import Pool
from rmr.vm.generate.state_layout import VM
from rmr.vm.outside import Gate
from rmr.vm.shared import shared_of
from rmr.vm.store import Args

CHECKS = {
    Base.ROBOT: f"type({{0}}) is Robot and 0 <= {{0}} <= {ROBOT_ID_MAX}",
    Base.INT: f"type({{0}}) is int and {INT_MIN} <= {{0}} <= {INT_MAX}",
    Base.FLOAT: "type({0}) is float and {0} - {0} == 0.0",
    Base.BOOL: "type({0}) is bool",
    Base.STRING: f"type({{0}}) is str and len({{0}}) <= {LENGTH_MAX} and {{0}}.isascii()",
    Base.SYMBOL: f"type({{0}}) is Symbol and len({{0}}) <= {LENGTH_MAX} and {{0}}.isascii()",
}
"""Source of the in-line check that a value conforms (`rmr.bytecode.conform`); lists have none, for it would be long."""


def write_methods(build: FormBuilder, jobs: bool, timed: int) -> None:
    """Write the machines' methods: `jobs` says that there are time assertions, `timed` which heads ask for the time."""
    due = "vm._any_jobs is not None and vm._any_jobs.due"
    begin: list[Statement] = [Assign("vm._now", "now")]
    end: list[Statement] = []
    if jobs:
        begin.append(If(f"{due} < now", (Evaluate("vm._miss(now - 1)"),)))
        again = If("vm.busy", (Evaluate("vm._fire(now)"),))  # by a fact of a violation
        end.append(If(f"last and {due} <= now", (Evaluate("vm._miss(now)"), again)))
    # The cause of an input is for `rmr.vm.observed_machine` alone.
    with build.function("insert", "vm", "now", "predicate", "args", "cause=None"):
        build(*begin, Evaluate("ARRIVE[predicate](vm, now, args)"))
    with build.function("run", "vm", "now", "last=True"):
        build(*begin)
        with build.when("vm.busy"):
            if timed:
                build(Update("vm.touched", "|", str(timed)))
            build(Evaluate("vm._fire(now)"))
        build(*end)


def write_arrival(build: FormBuilder, table: FactTable, pool: Pool, gate: Gate, facts: FactWriter) -> str:
    """Write the function for the facts of a predicate that is no action and return its name."""
    index = table.index
    name = table.functions.arrive
    names = [f"a{place}" for place in range(table.arity)]
    checked = f"{pool.helper('gate', gate)}.fact({index}, args)"
    for helper, thing in (("Robot", Robot), ("Symbol", Symbol)):
        pool.helper(helper, thing)
    checks = [CHECKS.get(kind.base, "").format(name) for kind, name in zip(table.predicate.types, names, strict=True)]
    each = tuple_of(names)
    with build.function(name, "vm", "now", "args"):
        if not names:
            build(If("args", (Evaluate(checked),)))
        elif all(checks):
            build(If(f"len(args) != {len(names)}", (Evaluate(checked),)), Assign(each, "args"))
            build(If(f"not ({' and '.join(checks)})", (Assign(each, checked),)))
        else:
            build(Assign(each, checked))
        facts.insertion(index, names)
    return name


def follow(vm: Any, now: int, chain: Any) -> None:
    """Derive the items of a chain."""
    vm._follow(now, chain)


class Module:
    """The generated code of one program, shared by all its machines."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.pool = Pool()
        self.pool.globals.update(NONE=(), follow=follow, defaultdict=defaultdict)
        self.tables = tables_of(program)
        self.plans = [RulePlan(program, index, self.tables) for index in range(len(program.rules))]
        for plan in self.plans:
            plan.valued = self._is_valued(plan)
        self.readers = readers_of(self.plans, len(program.predicates))
        """By predicate: the rules that name it in a body."""
        facts = self._facts(FormBuilder())
        for table in self.tables:
            table.queued = facts.is_queued(table.index)
        loop = self._loop(FormBuilder())
        for plan in self.plans:
            plan.fires_all = loop.may_fire_all(plan)
        self.names: dict[str, Any] = self.pool.globals
        self.sources: list[str] = []
        """Generated sources compiled so far, for inspection."""
        self._waiting: dict[int, Block] = {}
        """By rule, its own functions, until they are needed."""
        self.names["FIND"] = {
            plan.bit: self._first(self.search, plan.index, plan.functions.find) for plan in self.plans
        }
        self.names["FIRE"] = {
            plan.bit: self._first(self.search, plan.index, plan.functions.fire) for plan in self.plans
        }
        self.add = [self._first(self.change, table.index, table.functions.add) for table in self.tables]
        self.remove = [self._first(self.change, table.index, table.functions.remove) for table in self.tables]
        self._changing: set[int] = set()
        self.names["ARRIVE"] = Arrivals(self, shared_of(program).gate)
        self._compile(self._write())
        self.methods = {"insert": self.names["insert"], "run": self.names["run"], "_fire": self.names["fire"]}
        """Further attributes of a machine's class."""
        self.reset = self.names["reset"]
        self.at_first = mask([plan for plan in self.plans if plan.way is Way.REMATCH])
        """The rules that may be satisfied without any fact."""
        self.all_rules = mask(self.plans)
        self.slots: list[str] = self._slots
        self._slow: set[int] = set()
        self._rows: tuple[Iterable[tuple[int, Args]], list[tuple[int, list[Args]]]] = (), []
        """The facts that were to be inserted at once last, and what `rows` has made of them."""

    def search(self, rule: int) -> None:
        """Make the functions that look for a rule's matches, and the one in which it fires, unless they are there."""
        waiting = self._waiting.pop(rule, None)
        if waiting is not None:
            plan = self.plans[rule]
            build = FormBuilder()
            loop = self._loop(build)
            if not loop.is_in_loop:
                loop.write_rule(plan)
            if plan.fires_all:
                loop.write_fire_all(plan)
            self._compile((*waiting, *build.statements))
            self.names["FIND"][plan.bit] = self.names[plan.functions.find]
            self.names["FIRE"][plan.bit] = self.names[plan.functions.fire]

    def change(self, predicate: int) -> None:
        """Make the functions that insert and remove facts of a predicate, unless they are there."""
        if predicate in self._changing:
            return
        self._changing.add(predicate)
        build = FormBuilder()
        self._facts(build).functions(predicate)
        self._compile(build.statements)
        functions = self.tables[predicate].functions
        self.add[predicate] = self.names[functions.add]
        self.remove[predicate] = self.names[functions.remove]

    def rows(self, facts: Iterable[tuple[int, Args]]) -> list[tuple[int, list[Args]]]:
        """Return `facts` in their order, those of one predicate that stand together in one list."""
        if facts is self._rows[0]:
            return self._rows[1]
        runs: list[tuple[int, list[Args]]] = []
        last = -1
        for predicate, args in facts:
            if predicate != last:
                runs.append((predicate, []))
                last = predicate
            runs[-1][1].append(args)
        self._rows = facts, runs
        return runs

    def several(self, predicate: int) -> Callable[..., None]:
        """Return the function that inserts many facts of a predicate."""
        name = self.tables[predicate].functions.several
        if name not in self.names:
            self.change(predicate)
            build = FormBuilder()
            self._facts(build).several(predicate)
            self._compile(build.statements)
        function: Callable[..., None] = self.names[name]
        return function

    def slow(self, rule: int) -> None:
        """Make the functions that enumerate a rule's matches as the specification does, unless they are there."""
        if rule in self._slow:
            return
        self._slow.add(rule)
        self.search(rule)
        build = FormBuilder()
        if self.plans[rule].way is not Way.REMATCH:
            SearchWriter(self.plans[rule], build, self.pool, self.tables).write_each(may_index=False)
        HeadWriter(self.program, rule, build, self.pool, self.tables, calls=False).write()
        self._compile(build.statements)

    def arrival(self, table: FactTable, gate: Gate) -> Callable[[Any, Instant, Args], None]:
        """Return the function that checks and inserts facts from outside."""
        build = FormBuilder()
        name = write_arrival(build, table, self.pool, gate, self._facts(build))
        self._compile(build.statements)
        arrive: Callable[[Any, Instant, Args], None] = self.names[name]
        return arrive

    def _compile(self, functions: Block) -> None:
        """Compile functions of the intermediate form."""
        source = text_of(functions)
        self.sources.append(source)
        exec(compile(source, "<rules>", "exec"), self.names)

    def _first(self, make: Callable[[int], None], index: int, name: str) -> Callable[..., None]:
        """Return a placeholder of the function `name`, which `make` replaces at the first call."""

        def first(*args: Any) -> None:
            make(index)
            self.names[name](*args)

        self.names[name] = first
        return first

    def _facts(self, build: FormBuilder) -> FactWriter:
        return FactWriter(build, self.pool, self.tables, self.readers)

    def _loop(self, build: FormBuilder) -> LoopWriter:
        return LoopWriter(self.program, build, self.pool, self.tables, self.plans, self._facts(build))

    def _is_valued(self, plan: RulePlan) -> bool:
        if plan.way is Way.REMATCH or plan.drawn:
            return True
        build = FormBuilder()
        pool = Pool()
        slots = write_bindings(build, pool, plan.rule, self.tables, plan.facts)
        chains = written_items(plan.rule, slots, self.program, pool, self.tables)
        return chains is None or any(item.fails for chain in chains for item in chain)

    def _write(self) -> Block:
        build = FormBuilder()
        facts = self._facts(build)
        for plan in self.plans:
            self._waiting[plan.index] = self._search(plan, facts)
        for index, function in enumerate(self.program.functions):
            write_function(build, index, function, self.pool)
        self._loop(build).write()
        write_probes(build, self.tables)
        self._write_reset(build)
        timed = mask([plan for plan in self.plans if plan.timed])
        write_methods(build, bool(self.program.assertions), timed)
        return build.statements

    def _search(self, plan: RulePlan, facts: FactWriter) -> Block:
        """Return a rule's own functions; what indices they need is laid out with that."""
        build = FormBuilder()
        search = SearchWriter(plan, build, self.pool, self.tables)
        search.write()
        if plan.way is Way.REMATCH:
            search.write_each(may_index=True)
            build(Define(plan.functions.find, ("vm", "now"), (Evaluate(f"vm.rematch({plan.index}, now)"),)))
        else:
            atom = plan.atoms[0][1]
            columns = [column("f", i) for i in range(self.tables[atom.predicate].arity)]
            search.write_restart(facts.tests(atom, columns))
        if plan.valued:
            HeadWriter(self.program, plan.index, build, self.pool, self.tables, calls=True).write()
        return build.statements

    def _write_reset(self, build: FormBuilder) -> None:
        nothing = [name for plan in self.plans for name in plan.empty_slots]
        nothing += [name for table in self.tables for name in table.indices.values()]
        zero = [name for plan in self.plans for name in plan.zero_slots]
        self._slots = [*nothing, *zero, *[table.slot for table in self.tables]]
        with build.function("reset", "vm"):
            for names, value in ((nothing, "None"), (zero, "0")):
                if names:
                    build(AssignAll(tuple([f"{VM}{name}" for name in names]), value))
            build(*[Assign(table.name, "[]" if table.queued else "{}") for table in self.tables])


class Arrivals(dict[int, Callable[[Any, Instant, Args], None]]):
    """By predicate, the function that checks and inserts a fact from outside, made with the first one."""

    def __init__(self, module: Module, gate: Gate) -> None:
        super().__init__()
        self._module = module
        self._gate = gate

    def __missing__(self, predicate: int) -> Callable[[Any, Instant, Args], None]:
        tables = self._module.tables
        declared = tables[predicate].predicate if 0 <= predicate < len(tables) else None
        if declared is None or declared.kind is Kind.ACTION or declared.name.startswith(GOALS_OF):
            return lambda _vm, _now, args: self._refuse(predicate, args)
        arrive = self[predicate] = self._module.arrival(tables[predicate], self._gate)
        return arrive

    def _refuse(self, predicate: int, args: Args) -> None:
        """Raise ValueError: there are no facts of the predicate."""
        self._gate.fact(predicate, args)
