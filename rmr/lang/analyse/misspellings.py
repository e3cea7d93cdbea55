"""Names that may be misspelt: of facts that nothing derives or reads, of types, and symbols.

The search for near names takes time, so only the first `SEARCHES_MAX` names get a hint. Type names are open sets of
symbols, and any word may be one: `lane` and `line`, `point` and `int`. A set that is named once is reported only if one
misspelling separates it from a built-in type or from a set that is named more often.

Symbols are open sets, so that any word is legal. One is reported only if

- it stands at one place of the program, and is four letters long or longer;
- another symbol differs from it by one letter that is missing, added, doubled, changed, or swapped with its neighbour;
  not by a digit, not by the first letter, not by what comes last (`wall_a` and `wall_b`, `slot1` and `slot2`);
- both may stand for the same thing: their types have one name, or they are arguments of the same predicate, or
  they stand where no type is declared, are six letters long or longer, end alike and differ by no changed letter;
- the other one is used more often, or one of the two is only read and the other one only written.
"""

from collections import Counter
from collections.abc import Iterator

from rmr.base.record import record
from rmr.base.values import Symbol
from rmr.bytecode import provided
from rmr.bytecode.program import Base
from rmr.lang.analyse.names import LETTERS_MAX, Names, meant, uses
from rmr.lang.analyse.supply import Supply
from rmr.lang.analyse.types import SYNONYMS, Types, declaration_text
from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Diagnostics, WordHint
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import (
    Binary,
    Condition,
    Conjunct,
    Expression,
    FactNode,
    Item,
    Literal,
    Mark,
    ModuleNode,
    RuleItem,
    TypeDeclaration,
    TypeName,
    walk,
)

SEARCHES_MAX = 100
"""Budget of searches for a similar name: more misspelt names in one program are no slips."""

BUILT_IN = ("robot", "int", "float", "bool", "string")

PROVIDED_SETS = tuple(
    dict.fromkeys(
        kind.name
        for types in (
            *(each.types for each in provided.PREDICATES.values()),
            *(each.types for each in provided.ACTIONS.values()),
        )
        for kind in types
        if kind.name
    )
)
"""Sets of symbols in the types of provided predicates and actions."""


class Speller:
    """Spelling suggestions for the names of one program."""

    def __init__(self, names: Names, supply: Supply, found: Diagnostics) -> None:
        self._names = names
        self._supply = supply
        self._found = found
        self._searches = 0
        self._unread: set[str] = set()
        self._known: dict[int, list[str]] = {}
        self._readable: dict[int, list[str]] = {}
        for each in names.signatures.values():
            if each.declaration is not None or supply.is_derived(each.name):
                self._known.setdefault(each.arity, []).append(each.name)
            if each.declaration is not None or supply.is_read(each.name):
                self._readable.setdefault(each.arity, []).append(each.name)
        for predicate in provided.PREDICATES.values():
            if predicate.sensed:
                self._known.setdefault(len(predicate.types) + 1, []).append(predicate.name)
        for action in provided.ACTIONS.values():
            self._readable.setdefault(len(action.types) + 1, []).append(action.name)

    def meant(self, name: str, candidates: list[str], at: Span | None = None) -> str | None:
        """Return the hint for a name that may be misspelt, or None; also None beyond the search budget."""
        return meant(name, candidates, at) if self._may_search() else None

    def known(self, fact: FactNode) -> str | None:
        """Return the hint with a similar predicate that has a source and the same arity, or None."""
        return self.meant(fact.name.text, self._known.get(len(fact.arguments), []), fact.name.span)

    def _may_search(self) -> bool:
        self._searches += 1
        return self._searches <= SEARCHES_MAX and not self._found.many

    # ---- facts that nobody reads

    def unread(self, fact: FactNode) -> None:
        """Report a fact of a head that nothing reads, if its name is near one that is read or is that of an action."""
        name = fact.name.text
        signature = self._names.of(fact)
        if self._supply.is_read(name) or signature.declaration is not None or not signature.is_fact:
            return
        message = f"nothing reads the fact `{name}`"
        action = provided.ACTIONS.get(name)
        if action is not None:
            declaration = declaration_text(name, action.types, "action ")
            hint = f"to act, declare the action: `{declaration}`"
            fix = self._names.declaring(fact.span.file, declaration)
            if len(action.types) + 1 != len(fact.arguments):
                hint += "; with other arguments it takes a handler of your own"
                fix = None
            self._found.report("W108", f"{message}; no action of that name is declared", fact.span, hint=hint, fix=fix)
        elif name not in self._unread and self._may_search():
            self._unread.add(name)
            near = meant(name, self._readable.get(len(fact.arguments), []), fact.name.span)
            if near is not None:
                self._found.report("W108", message, fact.span, hint=near)

    # ---- types

    def types(self, module: ModuleNode) -> None:
        """Report sets of symbols whose names are similar to those of other types."""
        places: dict[str, TypeName] = {}
        counts: Counter[str] = Counter()
        for item in module.items:
            for parameter in item.parameters if isinstance(item, TypeDeclaration) else ():
                kind = parameter.type
                while kind.element is not None:
                    kind = kind.element
                counts[kind.name] += 1
                places.setdefault(kind.name, kind)
        meant: dict[str, str] = {}
        for known in (*BUILT_IN, *(name for name in counts if counts[name] > 1), *PROVIDED_SETS):
            for slip in _slips(known) if len(known) <= LETTERS_MAX else ():
                meant.setdefault(slip, known)
        for name, kind in places.items():
            if name in BUILT_IN or name in PROVIDED_SETS:
                continue
            match = SYNONYMS.get(name) or (meant.get(name) if counts[name] == 1 else None)
            if match is not None and not self._found.noted(kind.span):
                message = f"`{name}` is a set of symbols" + (" that is named only here" if counts[name] == 1 else "")
                self._found.report("W111", message, kind.span, hint=WordHint(f"did you mean `{match}`?", match))


def _slips(name: str) -> Iterator[str]:
    """Yield the misspellings of `name`: a transposition, a missing or doubled letter, the plural."""
    for place in range(len(name)):
        before = name[:place]
        letter = name[place]
        behind = name[place + 1 :]
        yield before + behind
        yield before + letter + letter + behind
        yield before + behind[:1] + letter + behind[1:]
    yield f"{name}s"


# ---- symbols

LETTERS_MIN = 4
"""Shortest symbol that is checked: shorter ones are one slip from too many words."""

SYMBOLS_MAX = 2000
"""Largest number of symbols of a program that is checked; more are generated."""


@record
class SymbolUse:
    """One occurrence of a symbol."""

    span: Span
    key: str | None
    """The name of its set, else the predicate and position, as in ``p/1``; None if unknown."""
    written: bool
    """True if it is stated or derived there, not matched."""


def lint_symbols(module: ModuleNode, counts: dict[str, int], types: Types, found: Diagnostics) -> None:
    """Report the symbols of `module` that look misspelt; `counts` says how often each is used."""
    pairs = list(_pairs(counts))
    if not pairs:
        return
    wanted = {name for pair in pairs for name in pair}
    places: dict[str, list[SymbolUse]] = {}
    for name, place in _places(module.items, types):
        if name in wanted:
            places.setdefault(name, []).append(place)
    reported: set[str] = set()
    for rare, other in pairs:
        here = places.get(rare, [])
        there = places.get(other, [])
        if rare in reported or len(here) != 1 or not there:
            continue
        if not _are_one_set(here, there) and not _are_open(rare, other, here, there):
            continue
        if counts[other] == 1 and not _is_misspelt(here[0], there[0]):
            continue
        reported.update((rare, other))
        notes = (DiagnosticNote(there[0].span, "used here"),)
        message = f"`{rare}` is used only here"
        found.report("W112", message, here[0].span, hint=WordHint(f"did you mean `{other}`?", other), notes=notes)


def lint_letters(letters: dict[str, Item | None], types: Types, found: Diagnostics) -> None:
    """Report letters that one rule matches and hands on, and nothing else names: they are meant as variables.

    `letters` are the symbols of one letter, each with the item that it stands in if there is only one.
    """
    for name, item in letters.items():
        if isinstance(item, RuleItem):
            here = [place for symbol, place in _places((item,), types) if symbol == name]
            if {each.written for each in here} == {True, False}:
                message = f"the symbol `{name}` is used in this rule only"
                found.report("W112", message, here[0].span, hint=f"did you mean the variable `{name.upper()}`?")


def _are_one_set(here: list[SymbolUse], there: list[SymbolUse]) -> bool:
    keys = {each.key for each in here}
    return any(each.key is None or each.key in keys or None in keys for each in there)


def _are_open(rare: str, other: str, here: list[SymbolUse], there: list[SymbolUse]) -> bool:
    """Whether two long symbols stand where no type is declared, and may be of one set although no rule says so."""
    is_changed = len(rare) == len(other) and sorted(rare) != sorted(other)  # `packing` and `parking` are two words
    # At different undeclared arguments, pairs of shorter symbols are usually two words.
    if is_changed or min(len(rare), len(other)) < 6 or rare[-1] != other[-1]:
        return False
    return all(each.key is not None and "/" in each.key for each in (*here, *there))


def _is_misspelt(here: SymbolUse, there: SymbolUse) -> bool:
    """Whether the first of two symbols used once is the wrong one: it is read, and the other one written."""
    return there.written and not here.written


def _pairs(counts: dict[str, int]) -> Iterator[tuple[str, str]]:
    """Yield symbols that are used once, each with one that differs from it by a slip."""
    once = [name for name, count in counts.items() if count == 1 and LETTERS_MIN <= len(name) <= LETTERS_MAX]
    if not once or len(counts) > SYMBOLS_MAX:
        return
    shorter: dict[str, list[str]] = {}
    """Symbols by what is left of them without one letter."""
    for name in counts:
        if LETTERS_MIN - 1 <= len(name) <= LETTERS_MAX:
            for form in dict.fromkeys((name, *_without_one(name))):
                shorter.setdefault(form, []).append(name)
    for name in once:
        near = {other: None for form in (name, *_without_one(name)) for other in shorter[form] if other != name}
        for other in sorted(near, key=lambda each: -counts[each]):
            if _is_slip(name, other):
                yield name, other


def _without_one(name: str) -> Iterator[str]:
    return (name[:place] + name[place + 1 :] for place in range(1, len(name)))


def _is_slip(one: str, other: str) -> bool:
    """Whether two words differ by one slip that hardly makes another word."""
    short, long = sorted((one, other), key=len)
    if len(long) - len(short) > 1 or one[0] != other[0]:
        return False
    place = next((k for k, (a, b) in enumerate(zip(short, long, strict=False)) if a != b), len(short))
    if len(short) < len(long):
        letter = long[place]
        at_end = place == len(short) and letter != "s"
        return letter.isalpha() and short[place:] == long[place + 1 :] and (not at_end or letter == long[place - 1])
    if one[place + 2 :] == other[place + 2 :] and one[place : place + 2] == other[place : place + 2][::-1]:
        return one[place : place + 2].isalpha()
    letters = one[place] + other[place]
    is_inside = place < len(one) - 1 and "_" not in {one[place + 1], one[place - 1]}
    # Where a letter is changed, shorter pairs are usually two words (`load`, `lead`).
    return letters.isalpha() and is_inside and len(one) >= 5 and one[place + 1 :] == other[place + 1 :]


# ---- where symbols stand


def _places(items: tuple[Item, ...], types: Types) -> Iterator[tuple[str, SymbolUse]]:
    for item in items:
        for use in uses(item):
            fact = use.fact
            name = use.fact.name.text
            written = use.role.derives and fact.mark is not Mark.GOAL
            cells = types.positions[name]
            for index, argument in enumerate(fact.arguments[1:], start=1):
                key = _key(types, argument) or f"{name}/{index}"
                if index < len(cells) and cells[index].kind.base is Base.SYMBOL and cells[index].kind.name:
                    key = cells[index].kind.name
                for symbol, span in _symbols(argument):
                    yield symbol, SymbolUse(span, key, written)
        if isinstance(item, RuleItem):
            yield from _compared(item, types)


def _compared(rule: RuleItem, types: Types) -> Iterator[tuple[str, SymbolUse]]:
    """Yield the symbols in the conditions of a rule."""
    bodies: list[tuple[Conjunct, ...]] = [rule.body, *(getattr(part, "body", ()) for part in rule.head)]
    for conjunct in (each for body in bodies for each in body):
        if not isinstance(conjunct, Condition):
            continue
        keys: dict[Span, str] = {}
        for node in walk(conjunct.expression):
            if isinstance(node, Binary):
                for side, other in ((node.left, node.right), (node.right, node.left)):
                    keys[side.span] = _key(types, other) or ""
        for symbol, span in _symbols(conjunct.expression):
            yield symbol, SymbolUse(span, keys.get(span) or None, written=False)


def _symbols(expression: Expression) -> Iterator[tuple[str, Span]]:
    for node in walk(expression):
        if isinstance(node, Literal) and isinstance(node.value, Symbol):
            yield str(node.value), node.span


def _key(types: Types, expression: Expression) -> str | None:
    cell = types.expressions.get(expression.span)
    return cell.kind.name or None if cell is not None and cell.kind.base is Base.SYMBOL else None
