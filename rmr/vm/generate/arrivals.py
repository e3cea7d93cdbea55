"""Specialised entry points: `Machine.insert` and `Machine.run` without the parts that the program does not need.

A fact from outside is checked and inserted by one function for each predicate. Its in-line checks accept the usual
values of the declared types. All other arguments go to `rmr.vm.outside.Gate`, which converts or rejects them.
"""

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol
from rmr.bytecode.conform import LENGTH_MAX
from rmr.bytecode.program import Base
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.fact_tables import FactTable
from rmr.vm.generate.facts import FactWriter
from rmr.vm.generate.form import Assign, Evaluate, If, Statement, Update, tuple_of
from rmr.vm.generate.source import Pool
from rmr.vm.outside import Gate

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
