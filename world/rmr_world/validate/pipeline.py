"""A lab and its program before they run: what makes a run senseless, and what a person should know.

The same for `rmr sim`, `rmr up`, `rmr world` and `rmr check`: areas and facts must fit the program, robots must have a
way to where they are to go. What can hardly be meant, deadlines that nothing can meet and turns that nobody takes are
warnings, and the run goes on, for missing them may be its point.
"""

from dataclasses import replace

from rmr.bytecode.program import Program
from rmr_world.document import LabError, Problem
from rmr_world.lab import Lab
from rmr_world.lab_program import LoadedProgram
from rmr_world.validate.deadline_feasibility import impossible
from rmr_world.validate.lab_warnings import doubtful
from rmr_world.validate.program_fit import check_program
from rmr_world.validate.reachability import unreachable
from rmr_world.validate.schedulability import unkept


def errors_of(lab: Lab, program: Program) -> list[Problem]:
    """Return why `program` cannot run in `lab`."""
    return check_program(lab, program) or unreachable(lab, program)


def warnings_of(lab: Lab, program: Program) -> list[Problem]:
    """Return what a person should know of a run of `program` in `lab`, which has no errors, in order of the files."""
    return sorted([*doubtful(lab, program), *impossible(lab, program), *unkept(lab, program)])


def judged(lab: Lab, loaded: LoadedProgram) -> LoadedProgram:
    """Return `loaded` with warnings of what it meets in `lab` beside its own. Raises LabError where they do not fit."""
    problems = errors_of(lab, loaded.program)
    if problems:
        raise LabError(problems)
    warnings = [f"{problem}\n" for problem in warnings_of(lab, loaded.program)]
    return replace(loaded, warnings="".join([loaded.warnings, *warnings]))
