"""Makes a case smaller while it still shows what it shows: less of the script, less of the program, simpler parts.

Whatever is tried must still verify. What is tried comes in the order of what it saves: whole rules before their
conjuncts, conjuncts before their arguments.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from itertools import islice

from fuzz_compare import Case
from fuzz_mutations import parts, put

from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import ANY, Constant, Instruction, Program, Slot, Strategy
from rmr.bytecode.verify import verify

TRIES_MAX = 3000
"""Cases tried for one shrinking; some take a few ms, some tens."""

LISTS = {"body", "head", "effects", "else_effects", "serving", "steps"}
"""Fields whose items may go one by one."""

NAMED_BY = {"predicate", "action"}
"""Fields that are indices into the table of predicates."""


def shrunk(case: Case, still: Callable[[Case], bool]) -> Case:
    """Return a smaller case of which `still` is true, as it is of `case`."""
    tries = TRIES_MAX
    changed = True
    while changed and tries > 0:
        changed = False
        place = 0
        while tries > 0:
            smaller = next(islice(_smaller(case), place, None), None)
            if smaller is None:
                break
            tries -= 1
            if not verify(smaller.program) and still(smaller):
                case, changed = smaller, True
            else:
                place += 1
    return case


def _smaller(case: Case) -> Iterator[Case]:
    """Yield cases that are smaller in one way."""
    script = case.script
    size = len(script) // 2
    while size:
        for start in range(0, len(script) - size + 1, size):
            yield replace(case, script=script[:start] + script[start + size :])
        size //= 2
    for program in _simpler(case.program):
        yield replace(case, program=program)
    for index in range(len(case.program.predicates)):
        yield from _without_predicate(case, index)
    for number, step in enumerate(script):
        for time in {0} - {*step.args[:1]}:
            if step.call not in ("serves", "holds"):
                timed = step._replace(args=(time, *step.args[1:]))
                yield replace(case, script=(*script[:number], timed, *script[number + 1 :]))
    if case.budget not in (1, 500):
        yield replace(case, budget=500)


def _simpler(program: Program) -> Iterator[Program]:
    if program.debug is not None:
        yield replace(program, debug=None)
    if program.strategy is not Strategy.TEXTUAL:
        yield replace(program, strategy=Strategy.TEXTUAL)
    bare = replace(program, goals=tuple([replace(goal, leads=None) for goal in program.goals]))
    if bare != program:
        yield bare
    for table in ("rules", "assertions", "goals", "facts"):
        entries = getattr(program, table)
        for place in range(len(entries)):
            yield replace(bare if table == "rules" else program, **{table: entries[:place] + entries[place + 1 :]})
    everything = parts(program)
    for path, part in everything:
        if type(part) is tuple and path and path[-1] in LISTS:
            for place in range(len(part)):
                yield put(program, path, part[:place] + part[place + 1 :])
    for path, part in everything:
        if path[-1:] != ("finisher",):  # a robot has no plainer form
            for other in _plainer(part):
                yield put(program, path, other)


def _plainer(part: object) -> Iterator[object]:
    """Yield what may stand in the place of a pattern or an expression."""
    if isinstance(part, Constant | Slot):
        yield ANY
    elif type(part) is tuple and len(part) > 1 and isinstance(part[0], Instruction):
        alone = [each for each in part if each.op in (Op.CONST, Op.INT, Op.LOAD)]
        yield from [(each,) for each in dict.fromkeys(alone)]


# ---- predicates that nothing names


def _without_predicate(case: Case, index: int) -> Iterator[Case]:
    """Yield the case without a predicate, if nothing names it."""
    program = replace(case.program, debug=None)
    bare = replace(program, predicates=())
    effects = [predicate.effects + predicate.else_effects for predicate in program.predicates]
    named = [*_indices(bare), *(each for one in effects for each in _indices(one))]
    calls = [_place(step.call) for step in case.script]
    named += [step.args[place] for step, place in zip(case.script, calls, strict=True) if place is not None]
    if index in named:
        return
    renumbered = _renumbered(program, index)
    left = renumbered.predicates
    script = tuple(
        step._replace(args=tuple([_moved(arg, index) if i == place else arg for i, arg in enumerate(step.args)]))
        for step, place in zip(case.script, calls, strict=True)
    )
    yield replace(case, program=replace(renumbered, predicates=left[:index] + left[index + 1 :]), script=script)


def _place(call: str) -> int | None:
    """Return which argument of a call is a predicate."""
    if call in ("serves", "holds"):
        return 0
    return 1 if call in ("insert", "withdraw", "want", "derive_action") else None


def _indices(thing: object) -> list[object]:
    return [part for path, part in parts(thing) if path and path[-1] in NAMED_BY]


def _moved(index: object, gone: int) -> object:
    return index - 1 if isinstance(index, int) and index > gone else index


def _renumbered(thing: object, gone: int) -> object:
    if is_dataclass(thing) and not isinstance(thing, type):
        parted = {each.name: getattr(thing, each.name) for each in fields(thing)}
        changed = {
            name: _moved(part, gone) if name in NAMED_BY else _renumbered(part, gone) for name, part in parted.items()
        }
        return replace(thing, **changed)
    return tuple([_renumbered(item, gone) for item in thing]) if type(thing) is tuple else thing
