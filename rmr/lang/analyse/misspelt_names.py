"""Names that may be misspelt: of facts that nothing derives or reads, and of types.

The search for near names takes time, so only the first `SEARCHES_MAX` names get a hint. Type names are open sets of
symbols, and any word may be one: `lane` and `line`, `point` and `int`. A set that is named once is reported only if one
misspelling separates it from a built-in type or from a set that is named more often.
"""

from collections import Counter
from collections.abc import Iterator

from rmr.bytecode import provided
from rmr.lang.analyse.names import LETTERS_MAX, Names, meant
from rmr.lang.analyse.supply import Supply
from rmr.lang.analyse.type_spelling import SYNONYMS, declaration_text
from rmr.lang.diagnostics.diagnostic import Diagnostics, WordHint
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import FactNode, ModuleNode, TypeDeclaration, TypeName

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
