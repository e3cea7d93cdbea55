"""Habits between the conjuncts of a body and the parts of a head."""

from rmr.lang.read.grammar import END
from rmr.lang.read.habits.item_words import OPERANDS, RULE, Habit, MisfitContext, quoted
from rmr.lang.read.misfit import OR_HINT

COMPARING = {"EQ", "NE", "LT", "LE", "GT", "GE"}


def _is(place: MisfitContext) -> Habit | None:
    word = place.word
    previous = place.words[place.at - 1]
    if word.text not in {"is", "mod", "div", "rem"} or previous.kind not in OPERANDS or place.at == 0:
        return None
    if word.text == "is":
        hint = f"`=` gives a variable its value: `{previous.text} = ...`"
        return place.meant("unexpected `is`", hint, word, word, ("EQ", "="))
    if word.text == "div":
        hint = "`/` gives a float, `floor(X / Y)` an int"
        return place.given_up("unexpected `div`", hint)
    return place.meant(f"unexpected {quoted(word)}", "the remainder is `X % Y`", word, word, ("MODULO", "%"))


def _let(place: MisfitContext) -> Habit | None:
    """`p(R, N), let M = N + 1 -o ...`"""
    if place.at == 0 or place.is_in_head or place.word.kind not in {"VARIABLE", "NAME"} or place.kind(1) != "EQ":
        return None
    word = place.words[place.at - 1]
    if word.text not in {"let", "var"}:
        return None
    name = place.word.text[0].upper() + place.word.text[1:]
    hint = f"an equation gives a variable its value: `{name} = ...`"
    if place.word.kind == "NAME":
        return place.given_up(f"unexpected {quoted(word)}", hint, word)
    return place.meant(f"unexpected {quoted(word)}", hint, word, word)


def _let_without_in(place: MisfitContext) -> Habit | None:
    """`p(R, N), let M = N + 1, M > 2 -o ...`"""
    index = place.before("LET")
    if index is None or any(word.kind == "IN" for word in place.words[index : place.at]):
        return None
    name = place.words[index + 1].text
    hint = f"an equation gives a variable its value: `{name} = ...`"
    return place.given_up("unexpected `let`", hint, place.words[index])


def _choice_of_facts(place: MisfitContext) -> Habit | None:
    """`-o if(N > 2, stop(R), go(R))`."""
    opening = place.unclosed()
    if place.word.kind != "COMMA" or not place.is_in_head or not opening or place.kind(opening - 1 - place.at) != "IF":
        return None
    hint = "write `if N > 2 then stop(R) else go(R) end`"
    return place.given_up("`if(C, X, Y)` chooses between values, not between facts", hint, place.words[opening - 1])


def _semicolon(place: MisfitContext) -> Habit | None:
    word = place.word
    if word.text != ";":
        return None
    message = "unexpected `;`"
    following = place.words[place.at + 1] if place.at + 1 < len(place.words) else word
    ends = following.kind == END or "\n" in place.text[word.end : following.start]
    if place.at == 0:
        return place.meant(message, "every item ends with `.`", word, word)
    if place.unclosed() is not None:
        if not place.is_closed_behind:
            return None
        return place.meant(message, "`,` stands between arguments", word, word, ("COMMA", ","))
    if ends:
        return place.meant(message, "every item ends with `.`", word, word, ("DOT", "."))
    if place.is_in_head:
        return place.meant(message, "`,` stands between what a head derives", word, word, ("COMMA", ","))
    return place.meant(message, OR_HINT, word, word, ("COMMA", ","))._replace(uncertain=True)


def _not(place: MisfitContext) -> Habit | None:
    if place.kind(-1) == "NOT" and place.is_in_head and place.kind(-2) in {"ARROW", "COMMA", "THEN"}:
        hint = "a fact goes when a body uses it up: name it there, without `not` and `$`"
        return place.given_up("a head derives facts, not that there are none", hint, place.words[place.at - 1])
    if place.word.text in {"\\+", "~", "¬"}:
        message = f"unexpected {quoted(place.word)}"
        return place.meant(message, "`not p(R)` holds if there is no such fact", place.word, place.word, ("NOT", "not"))
    return None


def _then(place: MisfitContext) -> Habit | None:
    if place.word.text in {"and", "&"} and place.kind(1) == "THEN":
        hint = "`a(R) then b(R)`: `then` stands alone between two steps"
        return place.meant(f"unexpected {quoted(place.word)} before `then`", hint, place.word, place.word)
    if place.kind(-1) == "THEN":
        then = place.words[place.at - 1]
        if place.kind(-2) == "COMMA" and place.word.kind == "NAME":
            comma = place.words[place.at - 2]
            hint = "`a(R) then b(R)`: no comma stands before or behind `then`"
            return place.meant("unexpected `,` before `then`", hint, comma, comma)
        if place.word.kind == "COMMA":
            hint = "`a(R) then b(R)`: no comma stands before or behind `then`"
            return place.meant("unexpected `,` behind `then`", hint, place.word, place.word)
        if place.kind(-2) == "ARROW":
            hint = "`a(R) then b(R)`: `then` stands between two steps"
            return place.meant("unexpected `then`", hint, then, then)
    if place.word.kind == "THEN" and not place.is_in_head:
        return place.given_up("unexpected `then`", f"{RULE}; `then` stands between steps of a head")
    return None


def _condition_in_head(place: MisfitContext) -> Habit | None:
    if not place.is_in_head or place.unclosed() is not None:
        return None
    hint = "name it in the body, `load(R, N), N > 2 -o ...`, or write `if N > 2 then ... else ... end`"
    follows = place.kind(1) in COMPARING | {"PLUS", "MINUS", "FOREIGN"} or place.kind(1) == "->"
    behind = place.words[place.at + 1].text if place.at + 1 < len(place.words) else ""
    if place.word.kind == "VARIABLE" and (follows or behind in {"is", ":="}):
        if behind in {"++", "--"}:
            hint = f"what is derived is worked out in its arguments: `load(R, {place.word.text} {behind[0]} 1)`"
            return place.given_up("a head derives facts, it sets no variable", hint)
        if behind in {"is", "=", ":=", "+=", "-="}:
            hint = "what is derived is worked out in its arguments, `load(R, N + 1)`, or in the body, `M = N + 1`"
            return place.given_up("a head derives facts, it sets no variable", hint)
        return place.given_up("a head has no conditions", hint)
    return None


def _ternary(place: MisfitContext) -> Habit | None:
    behind = [word.kind for word in place.words[place.at :]]
    has_colon = "COLON" in behind[: behind.index("DOT") if "DOT" in behind else None]
    if place.word.kind == "QUESTION" and place.kind(-1) in OPERANDS | {"NAME"} and has_colon:
        return place.given_up("unexpected `?`", "`if(C, X, Y)` is X if C is true, else Y")
    return None


def _chain(place: MisfitContext) -> Habit | None:
    if place.word.kind not in COMPARING:
        return None
    for index in range(place.at - 1, -1, -1):
        word = place.words[index]
        if word.kind in COMPARING:
            hint = "write each of them: `0 < N, N < 9`"
            return place.given_up("comparisons do not chain", hint)
        if word.kind not in {"VARIABLE", "INT", "FLOAT", "NAME", "PLUS", "MINUS", "TIMES"}:
            return None
    return None


def _cut(place: MisfitContext) -> Habit | None:
    if place.kind(-1) == "BANG" and place.word.kind in {"ARROW", "COMMA", "DOT"}:
        bang = place.words[place.at - 1]
        return place.given_up("unexpected `!`", "`!` stands before a persistent fact, `!edge(A, B)`; drop it", bang)
    return None


HABITS = (
    _is,
    _let,
    _let_without_in,
    _choice_of_facts,
    _semicolon,
    _not,
    _then,
    _condition_in_head,
    _ternary,
    _chain,
    _cut,
)
"""Habits in the order in which they are tried."""
