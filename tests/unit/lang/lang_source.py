"""Words that the tests of the language share."""

from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_source

CORRIDOR = """type sensor at(robot, area).
type action lineup(robot, area, int).
type action moveto(R: robot, A: area) -o at(R, A).
type !due(robot, float).
start(R).
start(R), due(R, D) -o crossing(R, D).
crossing: assert(crossing(R, D), at(R, exit), D, broadcast(R)).
crossing(R, D), turn(R, crossing, K) -o lineup(R, entry, K), cleared(R).
cleared(R) -o moveto(R, exit).
"""


def compiled(text: str) -> Program:
    """Compile a program that has no errors."""
    compilation = compile_source(text)
    assert compilation.program is not None, compilation.diagnostics
    return compilation.program


def codes(text: str) -> list[str]:
    """Return the codes of what is wrong with a program, in source order."""
    return [each.code for each in compile_source(text).diagnostics]


def errors(text: str) -> list[str]:
    """Return the codes of the errors alone."""
    return [code for code in codes(text) if code.startswith("E")]


def places(text: str) -> list[tuple[str, str]]:
    """Return every diagnostic's code and the text that it underlines."""
    compilation = compile_source(text)
    return [(each.code, text[each.span.start : each.span.end]) for each in compilation.diagnostics]
