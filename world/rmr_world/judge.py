"""A lab and its program before they run: what makes a run senseless, and what a person should know.

The same for `rmr sim`, `rmr up` and `rmr world`: areas and facts must fit the program, robots must have a way to where
they are to go; what can hardly be meant and deadlines that nothing can meet are told, and the run goes on, for missing
them may be its point.
"""

from dataclasses import replace

from rmr_world.document import LabError
from rmr_world.doubts import doubtful
from rmr_world.exclusion import unkept
from rmr_world.lab import Lab
from rmr_world.possible import impossible
from rmr_world.program import LoadedProgram
from rmr_world.reach import unreachable
from rmr_world.usage import check_program


def judged(lab: Lab, loaded: LoadedProgram) -> LoadedProgram:
    """Return `loaded` with warnings of what it meets in `lab` beside its own. Raises LabError where they do not fit."""
    problems = check_program(lab, loaded.program) or unreachable(lab, loaded.program)
    if problems:
        raise LabError(problems)
    program = loaded.program
    doubts = [*doubtful(lab, program), *impossible(lab, program), *unkept(lab, program)]
    warnings = [f"{problem}\n" for problem in sorted(doubts)]
    return replace(loaded, warnings="".join([loaded.warnings, *warnings]))
