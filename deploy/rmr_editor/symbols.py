"""Names of a program: what each one means, where it is declared and used, and what may be written at a place.

A *symbol* is a predicate or action, a function, a constant, or a variable of one item. Predicates and actions share one
name space. Everything is read off the compiler's results: the symbol table (`Names`), the inferred types, and the
syntax tree as it was read. Of a program with errors that is what the errors have left.
"""

import os
import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from rmr.base.printable import shortened
from rmr.base.values import Symbol
from rmr.bytecode import provided
from rmr.bytecode.program import Kind
from rmr.lang.analyse.names import FactRole, Signature
from rmr.lang.analyse.types import CALLABLE, declaration_text, type_text
from rmr.lang.checker import STRATEGIES
from rmr.lang.compiler import Compilation
from rmr.lang.explain import explain
from rmr.lang.explain.show import show_assertion
from rmr.lang.format import one_line
from rmr.lang.read.habits import AGGREGATES
from rmr.lang.read.include import in_library, included_name, library_files
from rmr.lang.read.lexer import OPEN_COMMENT, Token, scanner, tokens
from rmr.lang.read.source_text import SourceText, Span
from rmr.lang.read.syntax import (
    AssertionItem,
    Call,
    ConstantItem,
    FactItem,
    FunctionItem,
    GoalItem,
    IncludeItem,
    Item,
    Literal,
    Mark,
    RuleItem,
    StrategyItem,
    TypeDeclaration,
    Variable,
    walk,
)
from rmr.lang.read.tree_builder import RESERVED

NAMES_OF_ROBOTS = frozenset({"undelivered", *(each.effect for each in provided.ACTIONS.values() if each.effect)})
"""Predicates that a program declares and robots state under these names: they are provided in effect."""


class NameSpace(Enum):
    """The name spaces of symbols."""

    PREDICATE = "predicate"
    FUNCTION = "function"
    CONSTANT = "constant"
    VARIABLE = "variable"


@dataclass(frozen=True, slots=True)
class Named:
    """A symbol."""

    space: NameSpace
    name: str
    item: int = -1
    """The item of a variable; -1 for all others."""


@dataclass(frozen=True, slots=True)
class Occurrence:
    """One place where a symbol is named."""

    symbol: Named
    span: Span
    declares: bool = False


@dataclass(frozen=True, slots=True)
class Suggestion:
    """A word that may be written at a place."""

    word: str
    what: str
    """A predicate, action, function, constant, variable, keyword or file."""
    detail: str = ""
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Outlined:
    """An item of a file, for its outline."""

    name: str
    what: str
    span: Span
    head: Span
    """What names it."""


class SymbolIndex:
    """The symbols of one program."""

    def __init__(self, program: Compilation) -> None:
        self.program = program
        self._by_symbol: dict[Named, list[Occurrence]] = {}
        self._by_file: dict[str, list[Occurrence]] = {}
        for each in sorted(set(self._found()), key=lambda found: (found.span.file, found.span.start)):
            self._by_symbol.setdefault(each.symbol, []).append(each)
            self._by_file.setdefault(each.span.file, []).append(each)

    def _found(self) -> Iterator[Occurrence]:
        known = self.program.known
        if known is None:
            return
        facts: set[Span] = set()
        for use in known.names.uses:
            facts.add(use.fact.name.span)
            yield Occurrence(Named(NameSpace.PREDICATE, use.fact.name.text), use.fact.name.span)
        functions = known.names.functions.keys() | CALLABLE.keys()
        constants = {each.name.text for each in self._items() if isinstance(each, ConstantItem)}
        for number, item in enumerate(self._items()):
            match item:
                case TypeDeclaration(name=name):
                    yield Occurrence(Named(NameSpace.PREDICATE, name.text), name.span, declares=True)
                case FunctionItem(name=name):
                    yield Occurrence(Named(NameSpace.FUNCTION, name.text), name.span, declares=True)
                case ConstantItem(name=name):
                    yield Occurrence(Named(NameSpace.CONSTANT, name.text), name.span, declares=True)
                case IncludeItem() | FactItem() | GoalItem() | RuleItem() | AssertionItem() | StrategyItem():
                    pass
            for node in walk(item):
                match node:
                    case Variable(name=variable) if variable != "_":
                        yield Occurrence(Named(NameSpace.VARIABLE, variable, number), node.span)
                    case Call(name=name) if name.span not in facts and name.text in functions:
                        yield Occurrence(Named(NameSpace.FUNCTION, name.text), name.span)
                    case Literal(value=Symbol() as constant) if constant in constants:
                        yield Occurrence(Named(NameSpace.CONSTANT, str(constant)), node.span)
                    case _:
                        pass

    def at(self, file: str, offset: int) -> Occurrence | None:
        """Return what is named at an offset of a file, also directly behind the name."""
        there = self._by_file.get(file, [])
        index = bisect_right(there, offset, key=lambda each: each.span.start) - 1
        return there[index] if index >= 0 and offset <= there[index].span.end else None

    def all(self, symbol: Named) -> list[Occurrence]:
        """Return every place where a symbol is named."""
        return self._by_symbol.get(symbol, [])

    def definitions(self, symbol: Named) -> list[Occurrence]:
        """Return where a symbol is declared; the first place that names it if it is declared nowhere."""
        every = self.all(symbol)
        return [each for each in every if each.declares] or every[:1]

    # ---- other names

    def why_fixed(self, symbol: Named) -> str | None:
        """Return why a symbol keeps its name, as a sentence; None if it may get another one."""
        known = self.program.known
        if symbol.space is NameSpace.FUNCTION and (known is None or symbol.name not in known.names.functions):
            return f"`{symbol.name}` is a function of the language"
        if symbol.space is NameSpace.PREDICATE and known is not None:
            signature = known.names.signatures[symbol.name]
            is_action = not signature.is_fact and symbol.name in provided.ACTIONS
            if is_action or signature.provided or symbol.name in NAMES_OF_ROBOTS:
                return f"`{symbol.name}` is provided by robots under this name"
        library = [each.span.file for each in self.all(symbol) if in_library(each.span.file)]
        if library:
            return f"`{symbol.name}` has this name in the library, in std/{os.path.basename(library[0])}"
        return None

    def why_not(self, symbol: Named, name: str) -> str | None:
        """Return why a symbol cannot be called `name`, as a sentence; None if it can."""
        is_variable = symbol.space is NameSpace.VARIABLE
        if not re.fullmatch(r"[A-Z_][A-Za-z0-9_]*" if is_variable else r"[a-z][A-Za-z0-9_]*", name) or name == "_":
            first = "an upper-case letter or `_`" if is_variable else "a lower-case letter"
            return f"`{name}` is no name of a {symbol.space.value}: {first}, then letters, digits and `_`"
        if name in RESERVED:
            return f"`{name}` is a reserved word"
        if name != symbol.name and self._is_taken(symbol, name):
            return f"`{name}` is taken: it means something else in this program"
        module = self.program.module
        if module is not None and (symbol.name in module.broken or not module.complete):
            return f"`{symbol.name}` stands in an item with a syntax error, which comes first"
        return None

    def _is_taken(self, symbol: Named, name: str) -> bool:
        if symbol.space is NameSpace.VARIABLE:
            return bool(self.all(Named(symbol.space, name, symbol.item)))
        others = [Named(space, name) for space in NameSpace if space is not NameSpace.VARIABLE]
        is_provided = any(name in names for names in (provided.PREDICATES, provided.ACTIONS, CALLABLE, NAMES_OF_ROBOTS))
        # A constant stands for each symbol of its name.
        literals = (node for node in walk(self._items()) if isinstance(node, Literal))
        is_symbol = symbol.space is NameSpace.CONSTANT and any(each.value == Symbol(name) for each in literals)
        return is_provided or is_symbol or any(map(self.all, others))

    # ---- what a symbol is

    def described(self, occurrence: Occurrence) -> str | None:
        """Return in Markdown what is known of a symbol; None if nothing is."""
        symbol = occurrence.symbol
        match symbol.space:
            case NameSpace.PREDICATE:
                return self._predicate(symbol.name)
            case NameSpace.FUNCTION:
                return self._function(symbol.name)
            case NameSpace.CONSTANT:
                [item, *_] = [each for each in self._items() if _names(each, ConstantItem, symbol.name)]
                return _code(self._text(item.span))
            case NameSpace.VARIABLE:
                known = self.program.known
                cell = None if known is None else known.types.expressions.get(occurrence.span)
                return _code(f"{symbol.name}: {type_text(cell.type)}", "") if cell is not None else None

    def _predicate(self, name: str) -> str | None:
        known = self.program.known
        signature = None if known is None else known.names.signatures.get(name)
        if known is None or signature is None:
            return None
        declared = signature.declaration
        text = self.declaration(signature) if declared is None else self._text(declared.span)
        line = f"{_kind(signature)}, {'declared' if declared is not None else 'first used'} {self._spot(signature)}"
        uses = [use for use in known.names.uses if use.fact.name.text == name]
        if any(use.role is FactRole.GOAL or use.fact.mark is Mark.GOAL for use in uses):
            line += "; a goal"
        doc = provided_doc(signature)
        return _code(text) + f"\n{line}\n" + (f"\nProvided: {doc}\n" if doc else "")

    def declaration(self, signature: Signature) -> str:
        """Return the declaration of a predicate or action with the types that are known of it."""
        known = self.program.known
        types = signature.types
        if known is not None and signature.name in known.types.positions:
            types = known.types.arguments(signature.name)
        words = {Kind.PERSISTENT: "!", Kind.SENSED: "sensor ", Kind.ACTION: "action ", Kind.TEMPORARY: ""}
        return declaration_text(signature.name, types, words[signature.kind])

    def _function(self, name: str) -> str:
        own = next((each for each in self._items() if _names(each, FunctionItem, name)), None)
        if own is not None:
            return _code(self._text(own.span))
        return _code(CALLABLE[name].signature, "") + f"\n{CALLABLE[name].doc}\n"

    def serving(self, file: str, offset: int) -> str | None:
        """Return which actions serve the time assertion whose name or keyword is at an offset, as `--explain` does."""
        checked = self.program.checked
        for index, each in enumerate(checked.assertions if checked is not None else ()):
            span = each.item.span
            if span.file == file and span.start <= offset < each.item.start.span.start:
                explanation = explain(self.program)
                assert explanation is not None
                return _code(show_assertion(explanation, explanation.assertions[index]), "text")
        return None

    def _items(self) -> tuple[Item, ...]:
        return () if self.program.module is None else self.program.module.items

    def _text(self, span: Span) -> str:
        text = self.program.sources[span.file].text[span.start : span.end]
        return one_line(text)

    def _spot(self, signature: Signature) -> str:
        source = self.program.sources[signature.place.file]
        line, _ = source.position(signature.place.start)
        return f"in {os.path.basename(source.file)}, line {line}"

    # ---- what may be written

    def suggestions(self, file: str, offset: int) -> list[Suggestion]:
        """Return the words that may be written at an offset; none within a comment or a string but an include's."""
        text = self.program.sources[file].text
        if included_at(self.program.sources[file], offset) is not None:
            return [Suggestion(each, "file", "of the library") for each in library_files()]
        variables: dict[str, None] = {}
        begun = 0
        for word in tokens(text, ignored=True):
            if word.start < offset <= word.end and _is_text(word, offset):
                return []
            if word.kind == "DOT" and word.end <= offset:
                begun = word.end
                variables.clear()
            elif word.kind == "VARIABLE" and not word.start < offset <= word.end:
                variables[word.text] = None
            elif word.kind == "DOT" and word.start >= offset > begun:
                break
        found = [Suggestion(each, "variable") for each in variables if each != "_"]
        return [*found, *self._predicates(), *self._others()]

    def _predicates(self) -> Iterator[Suggestion]:
        known = self.program.known
        signatures = {} if known is None else known.names.signatures
        hidden = set() if known is None else {each.name for each in known.ensemble.made}
        for each in signatures.values():
            if each.name not in hidden:
                what = "predicate" if each.is_fact else "action"
                yield Suggestion(each.name, what, self.declaration(each), provided_doc(each))
        for row in provided.PREDICATES.values():
            if row.name not in signatures:
                detail = declaration_text(row.name, row.types, "sensor " if row.kind is Kind.SENSED else "!")
                yield Suggestion(row.name, "predicate", detail, row.doc)
        for action in provided.ACTIONS.values():
            if action.name not in signatures:
                yield Suggestion(
                    action.name, "action", declaration_text(action.name, action.types, "action "), action.doc
                )

    def _others(self) -> Iterator[Suggestion]:
        own = {item.name.text: item for item in self._items() if isinstance(item, FunctionItem | ConstantItem)}
        for name, item in own.items():
            what = "function" if isinstance(item, FunctionItem) else "constant"
            yield Suggestion(name, what, self._text(item.span))
        for function in CALLABLE.values():
            if function.name not in own:
                yield Suggestion(function.name, "function", function.signature, function.doc)
        for word in (*scanner().reserved, *AGGREGATES, *STRATEGIES):
            if word not in CALLABLE:
                yield Suggestion(word, "keyword")


def provided_doc(signature: Signature) -> str:
    """Return what the predicate or action of this name does if it is one that robots provide."""
    row = provided.ACTIONS.get(signature.name) if not signature.is_fact else None
    if row is not None:
        return row.doc
    return provided.PREDICATES[signature.name].doc if signature.provided else ""


def _kind(signature: Signature) -> str:
    if signature.kind is Kind.ACTION:
        return "an action"
    return f"a {signature.kind.name.lower()} predicate"


def _names(item: Item, kind: type[ConstantItem] | type[FunctionItem], name: str) -> bool:
    return isinstance(item, kind) and item.name.text == name


def _code(text: str, language: str = "rmr") -> str:
    return f"```{language}\n{text.rstrip()}\n```\n"


def _is_text(word: Token, offset: int) -> bool:
    """Whether what is written at `offset`, within or directly behind `word`, becomes a part of a comment or string."""
    if word.kind == OPEN_COMMENT or (word.kind == "COMMENT" and word.text.startswith("//")):
        return True
    return word.kind in {"COMMENT", "STRING"} and offset < word.end


def included_at(source: SourceText, offset: int) -> str | None:
    """Return the file that an include names at an offset."""
    for found in re.finditer(r'\binclude\s+"((?:[^"\\\n]|\\.)*)"', source.text):
        if found.start(1) - 1 <= offset <= found.end(1) + 1:
            return included_name(found[1], source.file)
    return None


NAME_MAX = 60
"""Length of a rule's name in an outline: as much as a narrow panel shows."""


def outline(program: Compilation, file: str) -> Iterator[Outlined]:
    """Yield the items of one file of a program, in source order."""
    if program.module is None:
        return
    text = program.sources[file].text
    for item in program.module.items:
        if item.span.file != file:
            continue
        written = " ".join(text[item.span.start : item.span.end].split())
        short = shortened(written, NAME_MAX)
        match item:
            case TypeDeclaration(name=name, kind=kind):
                yield Outlined(name.text, "action" if kind.value == "action" else "predicate", item.span, name.span)
            case FunctionItem(name=name):
                yield Outlined(name.text, "function", item.span, name.span)
            case ConstantItem(name=name):
                yield Outlined(name.text, "constant", item.span, name.span)
            case AssertionItem(name=name):
                yield Outlined(
                    short if name is None else name.text, "assertion", item.span, name.span if name else item.span
                )
            case GoalItem(fact=fact) | FactItem(fact=fact):
                yield Outlined(short, "goal" if isinstance(item, GoalItem) else "fact", item.span, fact.name.span)
            case RuleItem() | StrategyItem():
                yield Outlined(short, "rule", item.span, item.span)
            case IncludeItem():
                pass
