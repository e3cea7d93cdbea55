"""The way in from outside: `Machine.insert` and `Machine.run` with what the program leaves of them.

A fact from outside gets in by one function for each predicate that checks the arguments and inserts it. It says of
the values that come as a rule that they are what the predicate declares. Whatever else comes is left to the gate,
which looks more closely, converts, or refuses it.
"""

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol
from rmr.bytecode.conform import LENGTH_MAX
from rmr.bytecode.program import Base
from rmr.vm.generate.fact_tables import FactTable
from rmr.vm.generate.facts import FactWriter
from rmr.vm.generate.lines import Lines
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
"""What makes sure that a value conforms (`rmr.bytecode.conform`); there is nothing as short for lists."""


def write_methods(lines: Lines, jobs: bool, timed: int) -> None:
    """Write the machines' methods: `jobs` says that there are time assertions, `timed` which heads ask for the time."""
    due = "if vm._any_jobs is not None and vm._any_jobs.due"
    with lines.block("def insert(vm, now, predicate, args):"):
        lines("vm._now = now", *([f"{due} < now: vm._miss(now - 1)"] if jobs else ()))
        lines("ARRIVE[predicate](vm, now, args)")
    with lines.block("def run(vm, now):"):
        lines("vm._now = now", *([f"{due} < now: vm._miss(now - 1)"] if jobs else ()))
        with lines.block("if vm.busy:"):
            lines(*([f"vm.touched |= {timed}"] if timed else ()), "vm._fire(now)")
        lines(*([f"{due} <= now: vm._miss(now)"] if jobs else ()))


def write_arrival(lines: Lines, table: FactTable, pool: Pool, gate: Gate, facts: FactWriter) -> str:
    """Write the function for the facts of a predicate that is no action and return its name."""
    index, name = table.index, f"arrive{table.index}"
    names = [f"a{place}" for place in range(table.arity)]
    checked = f"{pool.helper('gate', gate)}.fact({index}, args)"
    for helper, thing in (("Robot", Robot), ("Symbol", Symbol)):
        pool.helper(helper, thing)
    checks = [CHECKS.get(kind.base, "").format(name) for kind, name in zip(table.predicate.types, names, strict=True)]
    with lines.block(f"def {name}(vm, now, args):"):
        if not names:
            lines(f"if args: {checked}")
        elif all(checks):
            lines(f"if len(args) != {len(names)}: {checked}", f"{', '.join(names)}, = args")
            lines(f"if not ({' and '.join(checks)}): {', '.join(names)}, = {checked}")
        else:
            lines(f"{', '.join(names)}, = {checked}")
        facts.insertion(index, names)
    return name
