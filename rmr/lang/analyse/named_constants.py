"""Named constants: replacement of `const` names, and folding of constant expressions.

The scope of a constant is the whole program, but in other constants only the text behind its definition. All constant
expressions are folded here (`folding`), so that later phases see values. An expression without a value is an error
where a constant is required; in a rule it is a warning, and stays for evaluation at run time.
"""

from dataclasses import replace
from typing import Any

from rmr.base.values import Symbol
from rmr.lang.analyse.folding import Folder, Valueless
from rmr.lang.analyse.let_lifting import Lifter
from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Diagnostics
from rmr.lang.read.syntax import (
    ConstantItem,
    Expression,
    FactItem,
    FunctionItem,
    GoalItem,
    Item,
    Literal,
    ModuleNode,
    Name,
    parts,
    walk,
)

Places = dict[Symbol, Name]
"""The place of each constant's first definition."""


def resolve(module: ModuleNode, found: Diagnostics) -> ModuleNode:
    """Return `module` with named constants replaced by their values, and constant expressions folded.

    A stated fact or goal with an argument without a value is dropped, and its name counts as broken.
    """
    lifter = Lifter()
    own = frozenset(item.name.text for item in module.items if isinstance(item, FunctionItem))
    values = _defined(module, found)
    items: list[Item] = []
    broken = set(module.broken)
    for item in module.items:
        if isinstance(item, ConstantItem):
            continue
        folder = Folder(values, lifter, own)
        resolved = _mapped(item, folder)
        if isinstance(item, FactItem | GoalItem) and folder.valueless:
            broken.add(item.fact.name.text)
            _no_constants(folder.valueless, found)
            continue
        items.append(resolved)
        for each in folder.valueless:
            hint = "a match that needs it does not count"
            found.report("W110", f"this never has a value: {each.reason}", each.span, hint=hint)
    items += lifter.functions
    return replace(module, items=tuple(items), broken=frozenset(broken))


def _mapped(node: Any, folder: Folder) -> Any:
    """Return `node` with the expressions in it folded."""
    if isinstance(node, Expression):
        return folder.fold(node)
    if isinstance(node, tuple):
        mapped = [_mapped(each, folder) for each in node]
        return tuple(mapped) if any(new is not old for new, old in zip(mapped, node, strict=True)) else node
    changes = {}
    for name in parts(type(node)):
        part = getattr(node, name)
        new = _mapped(part, folder)
        if new is not part:
            changes[name] = new
    return replace(node, **changes) if changes else node


# ---- definitions


def _defined(module: ModuleNode, found: Diagnostics) -> dict[Symbol, Literal]:
    """Return the values of the program's constants."""
    definitions = [item for item in module.items if isinstance(item, ConstantItem)]
    places: Places = {}
    for item in definitions:
        places.setdefault(Symbol(item.name.text), item.name)
    values: dict[Symbol, Literal] = {}
    for item in definitions:
        name = Symbol(item.name.text)
        if places[name] is item.name:
            values[name] = _value(item, values, places, found)
        else:
            notes = (DiagnosticNote(places[name].span, "first defined here"),)
            found.report("E010", f"the constant `{name}` is defined twice", item.name.span, notes=notes)
    return values


def _value(item: ConstantItem, values: dict[Symbol, Literal], places: Places, found: Diagnostics) -> Literal:
    """Return the value of a constant; 0 after reporting an error, so that its uses are not reported as well."""
    folder = Folder(values)
    value = folder.fold(item.value)
    early = [each for each in walk(item.value) if _is_early(each, values, places)]
    _no_constants(folder.valueless, found)
    for each in early:
        assert isinstance(each, Literal)
        assert isinstance(each.value, Symbol)
        notes = (DiagnosticNote(places[each.value].span, "defined here"),)
        hint = "a constant is made of numbers, symbols and constants before it"
        found.report("E023", f"`{each.value}` has no value yet", each.span, hint=hint, notes=notes)
    if isinstance(value, Literal) and not early:
        return value
    if not folder.valueless and not early:
        hint = "numbers, robots, strings, symbols, lists, earlier constants, and what is worked out from these"
        found.report("E023", f"the value of `{item.name.text}` is not constant", item.value.span, hint=hint)
    return Literal(0, item.value.span)


def _is_early(node: object, values: dict[Symbol, Literal], places: Places) -> bool:
    """Whether `node` names a constant that is defined later, or the one being defined."""
    if not isinstance(node, Literal) or not isinstance(node.value, Symbol):
        return False
    return node.value in places and node.value not in values


def _no_constants(valueless: list[Valueless], found: Diagnostics) -> None:
    for each in valueless:
        if each.out_of_range:
            found.report("E005", f"the value of this does not fit: {each.reason}", each.span)
        else:
            found.report("E023", f"this has no value: {each.reason}", each.span)
