"""What a lab says that can hardly be meant, told before the run as warnings: the run goes on.

A duration that is over before the physical bound, faults that begin when the run has ended, and a localisation service
that tells no robot where it is though the program has it drive.
"""

import re
from collections.abc import Iterator
from math import inf

from rmr.base.time import in_seconds
from rmr.bytecode.program import Kind, Program
from rmr_world.bound import bound_s
from rmr_world.document import Problem
from rmr_world.faults import ended
from rmr_world.lab import Lab
from rmr_world.validate.program_fit import problem_at

DRIVES = ("moveto", "lineup", "goto", "reach")
"""The provided actions that begin only when the robot knows where it is."""


def doubtful(lab: Lab, program: Program) -> list[Problem]:
    """Return a warning for each thing that can hardly be meant."""
    return [*_too_short(lab), *_too_late(lab), *_lost(lab, program), *_variable_for_area(lab)]


def _too_short(lab: Lab) -> Iterator[Problem]:
    duration_s, least_s = in_seconds(lab.duration), bound_s(lab)
    if duration_s < least_s < inf:
        message = f"warning: nothing can finish within {duration_s:g} s: no schedule takes less than {least_s:.2f} s"
        yield problem_at(lab, ("duration",), message)


def _variable_for_area(lab: Lab) -> Iterator[Problem]:
    """Yield a warning for a variable of `finish` that is spelt like an area: it matches any."""
    for word in re.findall(r"\b[A-Z]\w*", lab.finish):
        area = next(
            (area.name for area in lab.arena.areas if area.name.lower() == word.lower() and len(word) > 1), None
        )
        if area is not None:
            message = f"warning: {word} is a variable, which matches anything; did you mean '{area}'?"
            yield problem_at(lab, ("finish",), message)


def _too_late(lab: Lab) -> Iterator[Problem]:
    for fault in ended(lab):
        message = f"warning: {fault} begins when the duration of {in_seconds(lab.duration):g} s is over"
        yield problem_at(lab, ("faults",), message)


def _lost(lab: Lab, program: Program) -> Iterator[Problem]:
    drives = [p.name for p in program.predicates if p.kind is Kind.ACTION and p.name in DRIVES]
    if not drives:
        return
    if len(set(lab.arena.beacons)) < 2:
        path, why = ("localisation", "beacons"), "that takes two beacons in different places"
    elif lab.localisation.dropout == 1.0:
        path, why = ("localisation", "dropout"), "all pulses are lost"
    else:
        return
    message = f"warning: no robot will know where it is, and {drives[0]} will never begin: {why}"
    yield problem_at(lab, path, message)
