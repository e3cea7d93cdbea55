"""The parser: source text to the syntax tree, one item at a time, with error recovery.

Tokens are read on demand, and only those of the present item are kept. An unexpected token is reported, and replaced
if the intention is clear (`repair`, phrase-level recovery). Otherwise the rest of the item is skipped (panic mode): the
next item begins behind the next `.`, or at a line that begins as items do. After `BROKEN_MAX` broken items in a row
the rest of the file is not read. The depth of nesting is bounded before anything recurses into a tree.
"""
# ruff: noqa: PLC0415 - what mistakes need is loaded when there is one

import re
from collections import deque
from itertools import islice
from typing import TYPE_CHECKING

from rmr.lang.diagnostics.diagnostic import Diagnostics, Fix
from rmr.lang.read.automaton import Automaton
from rmr.lang.read.grammar import END
from rmr.lang.read.kept_items import KeptItems
from rmr.lang.read.lexer import COMMENT_SIGNS, OPEN_COMMENT, Token, tokens, without_foreign_comments
from rmr.lang.read.source_text import SourceText, Span
from rmr.lang.read.syntax import Item, ModuleNode, children
from rmr.lang.read.tree_builder import Builder

if TYPE_CHECKING:
    from rmr.lang.read.habits import Habit
    from rmr.lang.read.misfit import Misfit
    from rmr.lang.read.repair import Repair

AHEAD_MAX = 64
"""Look-ahead of a repair: tokens read behind the unexpected one."""

NESTING_MAX = 100
"""Depth of nested brackets and operators: deeper is a mistake, or an attack on the call stack."""

STATES_MAX = 8 * NESTING_MAX
"""States on the automaton's stack within one item; a level of brackets takes about five."""

ITEM_WORDS_MAX = 100_000
"""Tokens of one item; no real rule or list is as long."""


BROKEN_MAX = 10
"""Broken items in a row after which the file counts as no RMR program."""

ITEMS_MAX = 100_000
"""Items of one program; far more initial facts than a robot holds."""

BEGINNINGS = frozenset(["TYPE", "CONST", "FUN", "INCLUDE", "ORDER", "ASSERT", "WATCH"])
"""Kinds of tokens that occur only as the first token of an item: synchronisation points of the recovery."""

_NAME = re.compile(r"[a-z][A-Za-z0-9_]*")


def parse(source: SourceText, found: Diagnostics, kept: KeptItems | None = None) -> ModuleNode:
    """Return the syntax tree of `source`; report syntax errors to `found`. Take what is the same from `kept`."""
    if kept is None:
        return _Parser(source, found, None).module()
    kept.begin(source.text)
    module = _Parser(source, found, kept).module()
    kept.end()
    return module


class _Parser:
    """The parser of one file."""

    def __init__(self, source: SourceText, found: Diagnostics, kept: KeptItems | None) -> None:
        self._source = source
        self._found = found
        self._kept = kept
        self._words = tokens(source.text)
        self._ahead: deque[Token] = deque()
        """Tokens of the look-ahead that are not consumed yet."""
        self._builder = Builder(source.file, found)
        self._automaton = Automaton(source.file, self._builder)
        self._broken: set[str] = set()
        self._repairs = 100  # each costs look-ahead, and no reader wants more messages
        self._is_uncertain = False
        """A repair of this item dropped tokens, so that its meaning may differ from the intended one."""
        self._is_as_meant = True
        """Nothing of this item was unexpected."""
        self._end = 0
        """The offset behind the last full stop that ended an item."""
        self._is_lost = False
        """The parser has given up, and has reported why."""
        self._are_comments_foreign = False
        """Comment signs of another language have been reported; such comments are now skipped."""
        self._capitals: set[str] = set()
        """Messages about names with capital letters that have been reported: once each for a file."""

    def module(self) -> ModuleNode:
        """Return all items."""
        items: list[Item] = []
        in_a_row = 0
        while in_a_row < BROKEN_MAX and not self._is_lost:
            is_ahead = bool(self._ahead)
            first = self._next()
            if first.kind == OPEN_COMMENT:
                self._open_comment(first)
            if first.kind in {END, OPEN_COMMENT}:
                return ModuleNode(tuple(items), frozenset(self._broken))
            item = self._item(first) if self._kept is None else self._item_again(self._kept, first, is_ahead)
            in_a_row = in_a_row + 1 if item is None else 0
            if item is not None:
                items.append(item)
                if len(items) > ITEMS_MAX:
                    self._lose("E008", f"the program has more than {ITEMS_MAX} items", item.span)
        if not self._is_lost:
            start = self._next().start
            self._lose("E007", f"{BROKEN_MAX} items in a row have syntax errors", Span(self._source.file, start, start))
        return ModuleNode((), frozenset(self._broken), complete=False)

    def _lose(self, code: str, message: str, span: Span) -> None:
        """Report why the rest of the file is not read, and stop."""
        hint = "is it an RMR program?" if code == "E007" else None
        self._found.report(code, f"{message}: what follows is not read", span, hint=hint)
        self._is_lost = True

    # ---- tokens

    def _next(self) -> Token:
        return self._ahead.popleft() if self._ahead else next(self._words)

    def _following(self, word: Token) -> list[Token]:
        """Return `word` and the look-ahead behind it."""
        self._ahead.extend(islice(self._words, max(0, AHEAD_MAX - len(self._ahead))))
        return [word, *islice(self._ahead, AHEAD_MAX)]

    def _begins(self, word: Token, previous: Token, first: Token) -> bool:
        """Whether `word` is the first on its line and indented no further than the item's `first` token."""
        if self._source.text.find("\n", previous.end, word.start) < 0:
            return False
        (_, column), (_, own) = (self._source.position(each.start) for each in (word, first))
        return column <= own

    # ---- items

    def _item_again(self, kept: KeptItems, first: Token, is_ahead: bool) -> Item | None:
        """Return the item that begins with `first`: a kept one, or one that is parsed now and may be kept.

        `is_ahead`: the token is one of the look-ahead, which a repair may have changed.
        """
        again = None if is_ahead or self._are_comments_foreign else kept.item(first.start)
        if again is not None:
            self._words = tokens(self._source.text, again.end)
            return again.item
        count = self._found.count
        self._is_as_meant = True
        item = self._item(first)
        if item is not None and self._is_as_meant and self._found.count == count:
            kept.keep(first.start, item, self._end)
        return item

    def _item(self, first: Token) -> Item | None:
        """Return the item that begins with `first`, or None after reporting an error that was not repaired."""
        automaton = self._automaton
        automaton.reset()
        self._is_uncertain = False
        word = first
        previous = first
        repairs = 4  # with more errors in one item the intention is no longer clear
        read: list[Token] = []
        while True:
            if automaton.take(word):
                read.append(word)
                if word.kind == "DOT":
                    self._end = word.end
                    return self._finished(automaton.item(), len(read))
                if len(automaton.states) > STATES_MAX or len(read) > ITEM_WORDS_MAX:
                    self._endless(first, word, len(read))
                    return None
                previous = word
                word = self._next()
                continue
            # In order: a known habit of another language, which replaces tokens of the item and parses it again;
            # a repair at the unexpected token; panic mode.
            self._is_as_meant = False
            misfit = self._misfit(first, previous, word)
            habit = self._habit(read, misfit) if repairs else None
            if habit is not None and habit.patch is not None:
                self._read_instead(first, [*read, word], habit)
                automaton.reset()
                read.clear()
                first = previous = word = self._next()
                repairs -= 1
                if first.kind in {END, OPEN_COMMENT}:
                    self._ahead.appendleft(first)
                    return None
                continue
            if habit is not None or repairs == 0 or not self._is_repaired(misfit):
                self._give_up(first, misfit, reported=habit is not None)
                return None
            repairs -= 1
            word = self._next()

    def _finished(self, item: Item, count: int) -> Item | None:
        self._builder.finish()
        # After a repair that dropped tokens, findings of later phases about this item would be guesses.
        if self._is_uncertain:
            self._break(item.span.start, item.span.end)
            self._found.keep_syntax_errors_only(item.span)
        # No item is deeper than it has tokens; the walk is needed for long ones only.
        if count <= NESTING_MAX or not _is_deep(item):
            return item
        self._found.report("E004", f"the expression is nested more than {NESTING_MAX} deep", item.span)
        self._break(item.span.start, item.span.end)
        return None

    def _endless(self, first: Token, word: Token, count: int) -> None:
        if count <= ITEM_WORDS_MAX:
            span = Span(self._source.file, first.start, word.end)
            self._found.report("E004", f"brackets or signs are nested more than {NESTING_MAX} deep", span)
        self._skip(first, word, word, count)

    # ---- habits from other languages

    def _habit(self, read: list[Token], misfit: "Misfit") -> "Habit | None":
        """Report a habit that explains `misfit`, if one does."""
        from rmr.lang.read.habits import LOOKED_AT_MAX, MisfitContext, habit

        if misfit.word.kind == OPEN_COMMENT or self._repairs == 0 or len(read) > LOOKED_AT_MAX:
            return None
        words = [*read, *misfit.following]
        found = self._foreign_comment(words, len(read))
        found = found or habit(MisfitContext(self._source.file, self._source.text, words, len(read)))
        if found is None:
            return None
        self._repairs -= 1
        fix = None
        if found.patch is not None and not found.uncertain:
            start, end, meant = found.patch
            is_comment = found.span.start == start == end  # the sign is read as that of a comment
            text = "//" if is_comment else " ".join([word.text for word in meant])
            fix = Fix(found.span if is_comment else Span(self._source.file, start, end), text)
        self._found.report(found.code, found.message, found.span, hint=found.hint, fix=fix)
        self._is_uncertain |= found.uncertain
        return found

    def _foreign_comment(self, words: list[Token], at: int) -> "Habit | None":
        """Return the report of a comment of another language at the unexpected token or before it on its line."""
        from rmr.lang.read.habits import Habit

        if self._are_comments_foreign:
            return None
        text = self._source.text
        left = list(without_foreign_comments(words[: at + 1], text))
        kept = {word.start for word in left}
        sign = next((word for word in words[: at + 1] if word.start not in kept), None)
        if sign is None or not text.startswith(COMMENT_SIGNS, sign.start):
            return None
        self._are_comments_foreign = True
        written = next(each for each in COMMENT_SIGNS if text.startswith(each, sign.start))
        span = Span(self._source.file, sign.start, sign.start + len(written))
        return Habit(f"unexpected `{written}`", span, "comments begin with `//`", (sign.start, sign.start, ()))

    def _read_instead(self, first: Token, read: list[Token], habit: "Habit") -> None:
        """Rewind to the beginning of the item, with the habit's patch in place; `read` are its tokens so far."""
        if self._are_comments_foreign and habit.patch == (habit.span.start, habit.span.start, ()):
            self._ahead.clear()
            self._words = without_foreign_comments(tokens(self._source.text, first.start), self._source.text)
            return
        assert habit.patch is not None
        start, end, meant = habit.patch
        words = [*read, *self._ahead]
        self._ahead = deque([each for each in words if each.end <= start])
        self._ahead += meant
        self._ahead += [each for each in words if each.start >= end and each.end > start]

    # ---- mistakes

    def _misfit(self, first: Token, previous: Token, word: Token) -> "Misfit":
        from rmr.lang.read.misfit import Misfit

        begins = self._begins(word, previous, first)
        return Misfit(self._source.file, self._source.text, previous, self._following(word), begins)

    def _is_repaired(self, misfit: "Misfit") -> bool:
        """Whether the unexpected token could be repaired; if so, report it and put the replacement before the input."""
        from rmr.lang.read.repair import repair

        if self._repairs == 0 or misfit.word.kind == OPEN_COMMENT:
            return False
        better = repair(self._automaton, misfit)
        if better is None:
            return False
        self._repairs -= 1
        if not self._is_uncertain and not self._is_known_capital(better):
            fix = better.fix
            self._found.report("E001", better.message, better.span, hint=better.hint, notes=better.notes, fix=fix)
        self._is_uncertain |= better.uncertain
        self._automaton.back(better.forget)
        self._ahead.extendleft(reversed(better.words))
        return True

    def _is_known_capital(self, repair: "Repair") -> bool:
        """Whether `repair` renames a capitalised name that has been reported already."""
        if not repair.renames:
            return False
        is_known = repair.message in self._capitals
        self._capitals.add(repair.message)
        return is_known

    def _give_up(self, first: Token, misfit: "Misfit", *, reported: bool) -> None:
        """Report an unexpected token, unless it is reported already, and skip the rest of its item."""
        from rmr.lang.read.misfit import unexpected

        if reported or self._is_uncertain:
            pass
        elif misfit.word.kind == OPEN_COMMENT:
            self._open_comment(misfit.word)
        else:
            message, span, hint = unexpected(self._automaton, misfit)
            self._found.report("E001", message, span, hint=hint)
        self._builder.finish()
        word = misfit.word
        if word.kind == "DOT" and not self._ends(word):
            word = self._next()
        self._skip(first, misfit.previous, word)

    def _open_comment(self, word: Token) -> None:
        span = Span(self._source.file, word.start, word.start + 2)
        self._found.report("E001", "this comment has no end", span, hint="`*/`")
        self._break(word.start, word.end)

    def _skip(self, first: Token, previous: Token, word: Token, count: int = 0) -> None:
        """Skip to the end of an item, from `word` on (panic mode); `count` tokens of it have been read."""
        while word.kind != END and not self._ends(word) and not self._is_beginning(first, previous, word):
            previous = word
            word = self._next()
            count += 1
            if count > ITEM_WORDS_MAX:
                place = Span(self._source.file, first.start, first.end)
                self._lose("E008", f"this item has more than {ITEM_WORDS_MAX} words", place)
                break
        if word.kind != "DOT":
            self._ahead.appendleft(word)
        self._break(first.start, previous.end)

    def _ends(self, word: Token) -> bool:
        """Whether a skipped token ends its item: a full stop does, the point in `robot.x` does not."""
        if word.kind != "DOT":
            return False
        before = self._source.text[word.start - 1 : word.start]
        behind = self._source.text[word.end : word.end + 1]
        return not (before.isalnum() and behind.isalnum())

    def _is_beginning(self, first: Token, previous: Token, word: Token) -> bool:
        """Whether `word` begins a new item although the present one has no full stop."""
        if word is first or not self._begins(word, previous, first):
            return False
        return word.kind in BEGINNINGS or self._source.text.count("\n", previous.end, word.start) > 1

    def _break(self, start: int, end: int) -> None:
        """Add the names in a broken item to `_broken`: it may have declared any of them."""
        self._broken.update(_NAME.findall(self._source.text, start, end))


def _is_deep(item: Item) -> bool:
    """Whether an item is nested deeper than `NESTING_MAX`; level by level, since recursion is what is to be avoided."""
    level: list[object] = [item]

    for _ in range(NESTING_MAX):
        inside = [part for node in level for part in children(node)]
        level = [node for part in inside for node in (part if isinstance(part, tuple) else (part,)) if node is not None]
        if not level:
            return False
    return True
