"""Choice of the engine for a program: the interpreter, which is the specification, or code generated from the program.

Both are equivalent, firing by firing and draw by draw, and emit the same events.
"""

from enum import Enum

from rmr.base.identity import ByIdentity
from rmr.base.streams import Choices
from rmr.bytecode.program import Program
from rmr.vm.generate.plan import is_small
from rmr.vm.generated import machine_of
from rmr.vm.interpreted import Interpreted
from rmr.vm.machine import FIRING_BUDGET, Machine
from rmr.vm.observed_machine import ObservedMachine
from rmr.vm.provenance import ProvenanceLog


class Engine(Enum):
    """How a machine runs its program."""

    INTERPRETER = "interpreter"
    GENERATED = "generated"


def new_machine(
    program: Program,
    robot: int,
    choices: Choices,
    *,
    engine: Engine = Engine.GENERATED,
    firing_budget: int = FIRING_BUDGET,
    trace: bool = False,
    log: ProvenanceLog | None = None,
) -> Machine:
    """Return a machine for a verified `program`; it draws from `choices` and fires `firing_budget` times in one run.

    With a provenance `log` the machine is interpreted, whatever `engine` says.
    """
    if log is not None:
        return ObservedMachine(program, robot, choices, log, firing_budget=firing_budget, trace=trace)
    made = _generated(program) if engine is Engine.GENERATED else Interpreted
    return made(program, robot, choices, firing_budget=firing_budget, trace=trace)


_generated: ByIdentity[Program, type[Machine]] = ByIdentity(
    lambda program: machine_of(program) if is_small(program) else Interpreted
)
"""Returns the class of a program's machines; a program too large for Python's compiler is interpreted."""
