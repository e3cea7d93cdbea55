"""Phase 2, fit of the program: the lab defines the areas that the program uses, the program takes the lab's facts.

Each check takes the lab and its program and yields the errors of one rule.
"""

from collections.abc import Iterator
from itertools import count

from rmr.analysis.area_uses import LINEUP, AreaUse, area_uses, areas_in_fact
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.program import Base, Kind, Program, Type
from rmr.bytecode.provided import PREDICATES
from rmr_world.finding import Finding, near_miss
from rmr_world.lab import Lab
from rmr_world.random_facts import Range, StatedFact

PROVIDED_FACTS = tuple(PREDICATES)
"""Facts that a robot states whether or not the program mentions them."""


def areas_defined(lab: Lab, program: Program) -> Iterator[Finding]:
    """The lab defines each area that the program uses."""
    for use in area_uses(program):
        if lab.arena.area(use.area) is None:
            hint = near_miss(use.area, _area_names(lab))
            message = f"area '{use.area}', used {use.where}, is not defined{_in_file(lab, use)}{hint}"
            yield _at_use(lab, use, message)


def queues_defined(lab: Lab, program: Program) -> Iterator[Finding]:
    """Each area at which the program lines robots up has a queue."""
    for use in area_uses(program):
        area = lab.arena.area(use.area)
        if use.needs_queue and area is not None and not area.queue:
            message = f"area '{use.area}' has no queue{_in_file(lab, use)}, which {LINEUP} {use.where} needs"
            yield _at_use(lab, use, message)


def facts_typed(lab: Lab, program: Program) -> Iterator[Finding]:
    """The program has the predicate of each fact of the lab, with arguments of these types."""
    for index, fact in _numbered_facts(lab):
        message = _type_error(fact, program)
        if message:
            yield lab.error(("facts", index), message)


def topic_facts_typed(lab: Lab, program: Program) -> Iterator[Finding]:
    """Facts from topics are sensed ones of the program, with as many arguments, and constants of these types."""
    for each in lab.topic_facts:
        fact = each.fact
        known = program.index(fact.name)
        provided = PREDICATES.get(fact.name)
        if known is None:
            message = f"the program knows no fact '{fact.name}'{_near_fact(fact.name, program)}"
        elif provided is not None and provided.sensed:
            message = f"the robot senses '{fact.name}' itself: declare another one"
        elif program.predicates[known].kind is not Kind.SENSED:
            message = f"a fact from a topic is a sensed one: declare 'type sensor {fact.name}(robot, ...)'"
        elif len(program.predicates[known].types) != len(fact.args):
            message = _arity(fact.name, len(program.predicates[known].types) + 1, len(fact.args) + 1)
        else:
            types = enumerate(zip(program.predicates[known].types, fact.args, strict=True), start=2)
            wrong = [(k, kind) for k, (kind, arg) in types if not isinstance(arg, Symbol) and not _fits(kind, arg)]
            message = f"argument {wrong[0][0]} of '{fact.name}' should be {_type_name(wrong[0][1])}" if wrong else ""
        if message:
            yield lab.error(("facts", each.item, "fact"), message)


def ros_actions_known(lab: Lab, program: Program) -> Iterator[Finding]:
    """The program declares each action that ROS 2 carries out, with as many arguments."""
    for each in lab.ros_actions:
        known = program.index(each.name)
        if known is None or program.predicates[known].kind is not Kind.ACTION:
            names = [p.name for p in program.predicates if p.kind is Kind.ACTION]
            message = f"the program declares no action '{each.name}'{near_miss(each.name, names)}"
        elif len(program.predicates[known].types) != len(each.args):
            message = _arity(each.name, len(program.predicates[known].types) + 1, len(each.args) + 1)
        else:
            continue
        yield lab.error(("actions", each.item, "action"), message)


def fact_areas_defined(lab: Lab, program: Program) -> Iterator[Finding]:
    """The lab defines each area that its facts name."""
    for index, fact in _numbered_facts(lab):
        if _type_error(fact, program):
            continue  # which arguments are areas is not known
        for use in areas_in_fact(program, program.index(fact.name) or 0, fact.args):
            if lab.arena.area(use.area) is None:
                hint = near_miss(use.area, _area_names(lab))
                yield lab.error(("facts", index), f"area '{use.area}' is not defined{hint}")


def finish_known(lab: Lab, program: Program) -> Iterator[Finding]:
    """The program has the predicate of `finish`, with as many arguments, or every robot states it anyway."""
    pattern = lab.finish_pattern
    if pattern is None:
        return
    known = program.index(pattern.name)
    if known is None and pattern.name in PROVIDED_FACTS:
        return
    if known is None or program.predicates[known].kind is Kind.ACTION:
        yield lab.error(("finish",), f"the program knows no fact '{pattern.name}'{_near_fact(pattern.name, program)}")
        return
    types = program.predicates[known].types
    if len(types) != len(pattern.patterns):
        yield lab.error(("finish",), _arity(pattern.name, len(types) + 1, len(pattern.patterns) + 1))


CHECKS = (
    areas_defined,
    queues_defined,
    facts_typed,
    topic_facts_typed,
    ros_actions_known,
    fact_areas_defined,
    finish_known,
)
"""The rules of lab and program."""


def _at_use(lab: Lab, use: AreaUse, message: str) -> Finding:
    """Return an error at a use of an area: in the program's source if that is known, else in the lab file."""
    if use.place is None:
        return lab.error(("program",), message)
    return Finding(use.place.file, use.place.line, use.place.column, "", message)


def _in_file(lab: Lab, use: AreaUse) -> str:
    """Return the lab file, for a message that stands in the program's source."""
    return f" in {lab.path}" if use.place is not None else ""


def _area_names(lab: Lab) -> list[str]:
    return sorted(area.name for area in lab.arena.areas)


def _numbered_facts(lab: Lab) -> Iterator[tuple[int, StatedFact]]:
    """Yield the facts of the lab with their indices in the file."""
    return zip(lab.fact_items or count(), lab.stated_facts, strict=False)


def _type_error(fact: StatedFact, program: Program) -> str:
    """Return the error of a fact that the program cannot hold; empty for a fact that it can."""
    known = program.index(fact.name)
    if known is None:
        return f"the program knows no fact '{fact.name}'{_near_fact(fact.name, program)}"
    predicate = program.predicates[known]
    if predicate.kind is Kind.ACTION:
        return f"'{fact.name}' is an action, not a fact"
    if len(predicate.types) != len(fact.args):
        return _arity(fact.name, len(predicate.types) + 1, len(fact.args) + 1)
    for position, (wanted, value) in enumerate(zip(predicate.types, fact.args, strict=True), start=2):
        if not _fits(wanted, value):
            return f"argument {position} of '{fact.name}' should be {_type_name(wanted)}"
    return ""


def _near_fact(name: str, program: Program) -> str:
    return near_miss(name, [p.name for p in program.predicates if p.kind is not Kind.ACTION])


def _arity(name: str, wanted: int, given: int) -> str:
    return f"'{name}' has {wanted} argument{'s' if wanted > 1 else ''} in the program, here {given}"


def _fits(wanted: Type, value: Value | Range) -> bool:
    """Return whether `value` may be an argument of type `wanted`; an int is also a float."""
    if isinstance(value, Range):
        value = 0 if value.whole else 0.0
    match wanted.base:
        case Base.ROBOT:
            return isinstance(value, Robot)
        case Base.INT:
            return type(value) is int
        case Base.FLOAT:
            return type(value) in {int, float}
        case Base.BOOL:
            return isinstance(value, bool)
        case Base.STRING:
            return isinstance(value, str) and not isinstance(value, Symbol)
        case Base.SYMBOL:
            return isinstance(value, Symbol)
        case Base.LIST:
            inner = wanted.element
            return isinstance(value, tuple) and (inner is None or all(_fits(inner, item) for item in value))
        case Base.OPEN:
            return True


def _type_name(wanted: Type) -> str:
    if wanted.base is Base.LIST and wanted.element is not None:
        return f"list {_type_name(wanted.element)}"
    return wanted.name or wanted.base.name.lower()
