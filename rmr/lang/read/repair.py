"""Phrase-level error recovery: the best local repair of an unexpected token, so that the rest of the item is parsed.

Candidates: insert a comma, full stop or bracket before the token; replace the token; delete it; delete the comma before
it. Each gets a trial parse of the look-ahead. The one that gets furthest wins, the first of equal ones, provided that
it gets far enough to be credible. One mistake thus gives one message, and semantic errors of the same item are found.
"""

from collections.abc import Iterator
from typing import NamedTuple

from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Fix
from rmr.lang.read.automaton import Automaton, TrialReach
from rmr.lang.read.grammar import END
from rmr.lang.read.lexer import Token, spelling
from rmr.lang.read.misfit import OR_HINT, Misfit, foreign_hint, quoted, unexpected
from rmr.lang.read.source_text import Span

SURE = 3
"""Tokens that must fit behind a repair to make it credible, unless they complete the item."""

CLOSING = {"RPAR": "LPAR", "RSQB": "LSQB", "RBRACE": "LBRACE"}
"""Closing brackets that a repair inserts, with their opening ones."""

ARROWS = ("->", "=>", "-->", "--o", "→", "⇒", "⟶", "⊢", "\u2013o", "\u2014o", "\u2212o")

MEANT = {
    **dict.fromkeys(ARROWS, (("ARROW", "-o"),)),
    **dict.fromkeys(("==", "===", "=:=", "≡"), (("EQ", "="),)),
    **dict.fromkeys(("\\=", "\\==", "=\\=", "!==", "≠"), (("NE", "!="),)),
    **dict.fromkeys(("=<", "≤"), (("LE", "<="),)),
    "≥": (("GE", ">="),),
    ":=": (("EQ", "="),),
    **dict.fromkeys(("and", "&", "∧"), (("COMMA", ","), ("AND", "&&"))),
    **dict.fromkeys(("or", "\u2228"), (("OR", "||"),)),
}
"""Operators of other languages, each with the candidates of its replacement."""


class Repair(NamedTuple):
    """A replacement for the unexpected token, with its report."""

    words: tuple[Token, ...]
    """The tokens to read in place of the unexpected one."""
    message: str
    span: Span
    hint: str | None = None
    notes: tuple[DiagnosticNote, ...] = ()
    forget: int = 0
    """Number of tokens before it to delete."""
    uncertain: bool = False
    """True if a meaningful token is deleted or reinterpreted: the repaired item may differ from the intended one."""
    renames: bool = False
    """True if the repair lower-cases the capital letter of a name."""
    fix: Fix | None = None
    """The same in the text; None if what was meant is not certain enough to write it."""


_Option = tuple[TrialReach, Repair]


def repair(automaton: Automaton, misfit: Misfit) -> Repair | None:
    """Return the best repair, or None if none is credible."""
    options = list(_options(automaton, misfit))
    if not options:
        return None
    reach, best = max(options, key=lambda option: option[0])
    return best if reach.complete or reach.words >= SURE else None


def _options(automaton: Automaton, misfit: Misfit) -> Iterator[_Option]:
    stop = _stop(automaton, misfit)
    comma = _missing(automaton, misfit, "COMMA")
    yield from _instead(automaton, misfit)
    yield from (*stop, *comma) if misfit.begins else (*comma, *stop)
    for kind in CLOSING:
        yield from _missing(automaton, misfit, kind)
    yield from _surplus(automaton, misfit)


def _instead(automaton: Automaton, misfit: Misfit) -> Iterator[_Option]:
    word = misfit.word
    kinds = [each.kind for each in misfit.following]
    for kind, text in MEANT.get(word.text.lower(), ()):
        hint = foreign_hint(misfit.text, word.start)
        span = misfit.span(word)
        found = Repair((word._replace(kind=kind, text=text),), f"unexpected {quoted(word)}", span, hint)
        found = found._replace(fix=Fix(span, text))
        if kind == "OR" and kinds[1:3] == ["NAME", "LPAR"]:  # between facts there is no or
            found = found._replace(hint=OR_HINT, uncertain=True, fix=None)
        yield automaton.reach(automaton.states, [kind, *kinds[1:]]), found
    if kinds[:2] == ["VARIABLE", "LPAR"]:
        yield automaton.reach(automaton.states, ["NAME", *kinds[1:]]), _uncapitalised(misfit, word)
    elif word.kind == "LPAR" and (last := automaton.last("VARIABLE")):
        found = _uncapitalised(misfit, *last)
        found = found._replace(words=(*found.words, word), forget=1)
        yield automaton.reach(automaton.states[:-1], ["NAME", *kinds]), found
    elif (last := automaton.last("MINUS", "NAME")) and last[1].text == "o":
        arrow = Token("ARROW", "-o", last[0].start, last[1].end)
        hint = "an arrow is written `-o`, without a space"
        span = misfit.span(arrow)
        found = Repair((arrow, word), "unexpected `- o`", span, hint, forget=2, fix=Fix(span, "-o"))
        yield automaton.reach(automaton.states[:-2], ["ARROW", *kinds]), found


def _uncapitalised(misfit: Misfit, variable: Token) -> Repair:
    text = variable.text.strip("_") or "p"
    name = variable._replace(kind="NAME", text=text[0].lower() + text[1:])
    hint = f"names of facts and actions begin with a lower-case letter: `{name.text}`"
    span = misfit.span(variable)
    return Repair((name,), f"unexpected {quoted(variable)}", span, hint, renames=True, fix=Fix(span, name.text))


def _stop(automaton: Automaton, misfit: Misfit) -> Iterator[_Option]:
    """Yield the insertion of a full stop: the unexpected token begins the next item."""
    if not automaton.feed(automaton.states[:], "DOT"):
        return
    where = "at the end of the file" if misfit.word.kind == END else f"before {quoted(misfit.word)}"
    words = (Token("DOT", ".", misfit.previous.end, misfit.previous.end), misfit.word)
    found = Repair(words, f"a `.` is missing {where}", misfit.before, "every item ends with `.`")
    found = found._replace(fix=Fix(misfit.before, "."))
    if misfit.word.kind == END:
        yield TrialReach(True, 0, 0), found
    else:
        yield automaton.reach(None, [each.kind for each in misfit.following]), found


def _missing(automaton: Automaton, misfit: Misfit, kind: str) -> Iterator[_Option]:
    reach = automaton.reach(automaton.states, [kind, *(each.kind for each in misfit.following)])
    if reach.words < 2:
        return
    sign = spelling(kind) or ""
    words = (Token(kind, sign, misfit.previous.end, misfit.previous.end), misfit.word)
    message = f"a `{sign}` is missing before {quoted(misfit.word)}"
    hint: str | None = "`,` stands between arguments, between conditions, and between what a head derives"
    notes: tuple[DiagnosticNote, ...] = ()
    if kind in CLOSING:
        opening = automaton.unclosed(CLOSING[kind])
        hint = None
        notes = () if opening is None else (DiagnosticNote(misfit.span(opening), "opened here"),)
    # The inserted token itself earns nothing.
    found = Repair(words, message, misfit.before, hint, notes, fix=Fix(misfit.before, sign))
    yield reach._replace(words=reach.words - 1), found


def _surplus(automaton: Automaton, misfit: Misfit) -> Iterator[_Option]:
    previous = misfit.previous
    word = misfit.word
    kinds = [each.kind for each in misfit.following]
    if automaton.last("COMMA"):
        span = misfit.span(previous)
        found = Repair((word,), "unexpected `,`", span, "drop it", forget=1, fix=Fix(span, ""))
        yield automaton.reach(automaton.states[:-1], kinds), found
    if word.kind in {"DOT", END}:
        return
    found = Repair((), *unexpected(automaton, misfit), uncertain=True)
    if not word.text[0].isalnum():
        comma = word._replace(kind="COMMA", text=",")
        yield automaton.reach(automaton.states, ["COMMA", *kinds[1:]]), found._replace(words=(comma,))
    yield automaton.reach(automaton.states, kinds[1:]), found
