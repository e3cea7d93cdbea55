"""The names of variables, which byte-code does not keep: from the source of the program, if it is still the same."""

from collections.abc import Iterator, Mapping

from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_text
from rmr.lang.lower.robot_rules import Derived, Environment, inner_parts
from rmr.lang.read.source_text import SourceText

Variables = tuple[Mapping[int, str], ...]
"""For each rule of a program the names of its slots."""


def variable_names(program: Program, source: str, file: str) -> Variables:
    """Return the names of the variables of each rule of `program`; none if `source`, the text of `file`, is another."""
    compilation = compile_text(SourceText(file, source))
    checked = compilation.checked
    if checked is None or compilation.program is None or compilation.program.rules != program.rules:
        return ()
    return tuple([dict(_names(projected.environment, projected.head)) for projected in checked.rules])


def _names(environment: Environment, head: tuple[Derived, ...]) -> Iterator[tuple[int, str]]:
    """Yield slots with their names; of a slot that two inner bodies use the name in the first one comes last."""
    inner = [part.environment for part in inner_parts(head)]
    for each in (*reversed(inner), environment):
        for name, slot in each.slots.items():
            if name.isidentifier():
                yield slot, name
