"""Diagnostics as data: errors and warnings about a program.

A diagnostic answers three questions: what is wrong, where, and what to do. It is collected, never raised, and
rendered elsewhere (`render`). Codes are stable: a retired code is never reused.
"""

from collections.abc import Iterable
from enum import Enum

from rmr.base.record import record
from rmr.lang.read.source_text import Span

DIAGNOSTICS_MAX = 500
"""Largest number of errors, and of warnings, that are kept: a file of garbage must not cost memory without bound."""


HINTED_MAX = 100
"""Number of diagnostics after which no hint is searched for."""


class Severity(Enum):
    """Errors stop compilation, warnings do not."""

    ERROR = "error"
    WARNING = "warning"


CODES: dict[str, str] = {
    "E001": "syntax error",
    "E003": "unreadable source",
    "E004": "nested too deeply",
    "E005": "value out of range",
    "E006": "reserved word",
    "E007": "too many errors",
    "E008": "too large",
    "E009": "a circle of includes",
    "E010": "declared twice",
    "E011": "wrong number of arguments",
    "E012": "wrong kind",
    "E013": "undeclared action",
    "E014": "wrong signature of a provided action",
    "E015": "unknown name",
    "E020": "types contradict each other",
    "E021": "not a robot",
    "E022": "not a Boolean",
    "E023": "a constant is needed",
    "E030": "unbound variable",
    "E031": "bound twice",
    "E032": "a body without facts",
    "E033": "facts of another robot",
    "E034": "now() or random() outside a head",
    "E035": "a join of several robots' facts",
    "E036": "an aggregate in an inner body",
    "E037": "a robot behind another robot",
    "E038": "a part too large for a frame",
    "E039": "facts of too many robots at one instant",
    "E040": "a test that needs another robot's choice",
    "E041": "a rule over several robots that uses nothing up",
    "W101": "a variable that may be meant as a constant",
    "W102": "a rule that can never fire",
    "W103": "a goal that no rule can reach",
    "W104": "a finish fact that nothing derives",
    "W105": "a fact larger than a radio frame",
    "W106": "a deadline shorter than a tick",
    "W107": "an empty program",
    "W108": "a fact that nothing reads",
    "W109": "too many warnings",
    "W110": "an expression that never has a value",
    "W111": "a type that may be misspelt",
    "W112": "a symbol that may be misspelt",
    "W113": "a rule that never stops",
    "W114": "facts without end",
    "W115": "a program that nothing starts",
    "W116": "an assertion that nothing serves",
    "W117": "a fact used up before it is looked for",
}
"""Every code with its title. E: an error; W: a warning."""


@record
class DiagnosticNote:
    """A secondary place of a diagnostic, with its role."""

    span: Span
    message: str


@record
class Fix:
    """What to write in place of a part of the source, where the compiler knows it."""

    span: Span
    text: str


class WordHint(str):
    """A hint that names what to write, so that a fix can be made of it."""

    __slots__ = ("at", "word")

    def __new__(cls, text: str, word: str, at: Span | None = None) -> "WordHint":
        """Return the hint `text`: write `word` at the place `at`, by default that of the diagnostic."""
        hint = super().__new__(cls, text)
        hint.word = word
        hint.at = at
        return hint

    word: str
    at: Span | None


@record
class Diagnostic:
    """One mistake of the program's author."""

    code: str
    message: str
    span: Span
    hint: str | None = None
    notes: tuple[DiagnosticNote, ...] = ()
    fix: Fix | None = None

    @property
    def severity(self) -> Severity:
        """Error or warning, by the code's first letter."""
        return Severity.ERROR if self.code.startswith("E") else Severity.WARNING


class Diagnostics:
    """A bounded collection of diagnostics; warnings never crowd out errors."""

    def __init__(self) -> None:
        self._found: dict[Severity, dict[tuple[str, str, Span], Diagnostic]] = {each: {} for each in Severity}
        self._dropped = dict.fromkeys(Severity, 0)
        self._wrong: set[Span] = set()
        self._uncertain: list[Span] = []

    def report(
        self,
        code: str,
        message: str,
        span: Span,
        *,
        hint: str | None = None,
        notes: tuple[DiagnosticNote, ...] = (),
        fix: Fix | None = None,
    ) -> None:
        """Add a diagnostic; one with equal code, message and place counts once. The fix may be that of the hint."""
        assert code in CODES, code
        if isinstance(hint, WordHint):
            fix = fix or Fix(hint.at or span, hint.word)
            hint = str(hint)
        diagnostic = Diagnostic(code, message, span, hint, notes, fix)
        found = self._found[diagnostic.severity]
        if diagnostic.severity is Severity.ERROR:
            self._wrong.add(span)
        key = (code, message, span)
        if key in found:
            return
        if len(found) >= DIAGNOSTICS_MAX:
            self._dropped[diagnostic.severity] += 1
        else:
            found[key] = diagnostic

    def branch(self) -> "Diagnostics":
        """Return an empty collection that shares the places of errors, for findings that may be discarded."""
        branch = Diagnostics()
        branch._wrong = set(self._wrong)
        return branch

    def absorb(self, other: "Diagnostics") -> None:
        """Add the diagnostics of `other`."""
        for found in other._found.values():
            for each in found.values():
                self.report(each.code, each.message, each.span, hint=each.hint, notes=each.notes, fix=each.fix)
        for severity, dropped in other._dropped.items():
            self._dropped[severity] += dropped

    @property
    def errors(self) -> list[Diagnostic]:
        """The kept errors in the order of their reports."""
        return list(self._found[Severity.ERROR].values())

    def wrong_within(self, span: Span) -> bool:
        """Whether an error has been reported at a place within `span`."""
        return any(each.file == span.file and span.start <= each.start and each.end <= span.end for each in self._wrong)

    def noted(self, span: Span) -> bool:
        """Whether an error has a note at `span`."""
        return any(note.span == span for each in self.errors for note in each.notes)

    def keep_syntax_errors_only(self, span: Span) -> None:
        """Suppress all but syntax errors in the item at `span`, whose repair may have changed its meaning."""
        self._uncertain.append(span)

    def _is_shown(self, each: Diagnostic) -> bool:
        if each.code.startswith("E00"):
            return True
        inside = (span.start <= each.span.start < span.end for span in self._uncertain if span.file == each.span.file)
        return not any(inside)

    def wrong_at(self, span: Span) -> bool:
        """Whether an error has been reported at exactly this place."""
        return span in self._wrong

    def reported(self, code: str) -> bool:
        """Whether there is a diagnostic of this code."""
        return any(each.code == code for found in self._found.values() for each in found.values())

    def reported_at(self, code: str, span: Span) -> bool:
        """Whether there is a diagnostic of this code at exactly this place."""
        return any(each.code == code and each.span == span for found in self._found.values() for each in found.values())

    @property
    def count(self) -> int:
        """Number of diagnostics, dropped ones included."""
        return sum(len(found) for found in self._found.values()) + sum(self._dropped.values())

    @property
    def many(self) -> bool:
        """Whether hints are no longer searched for, because of `HINTED_MAX`."""
        return self.count >= HINTED_MAX

    @property
    def failed(self) -> bool:
        """Whether an error has been reported."""
        return bool(self._found[Severity.ERROR])

    def in_order(self, files: Iterable[str] = ()) -> list[Diagnostic]:
        """Return the diagnostics in source order, file by file as in `files`, then the numbers of dropped ones."""
        rank = {file: index for index, file in enumerate(files)}
        every = [each for found in self._found.values() for each in found.values() if self._is_shown(each)]
        every.sort(key=lambda each: (rank.get(each.span.file, 0), each.span.start, each.code))
        for severity, code in ((Severity.ERROR, "E007"), (Severity.WARNING, "W109")):
            if dropped := self._dropped[severity]:
                every.append(Diagnostic(code, f"{dropped} more {severity.value}s are not shown", every[-1].span))
        return every
