"""Habits within brackets: aggregates, comprehensions, the arguments of time assertions."""

from rmr.lang.read.habits.item_words import NUMBERS, Habit, MisfitContext, quoted

AGGREGATES = ("count", "sum", "min", "max", "collect")


def _aggregate(place: MisfitContext) -> Habit | None:
    opening = place.unclosed()
    if opening is None or place.words[opening].kind != "LSQB":
        return None
    inner = place.words[opening + 1 : place.at]
    bars, gives = [sum(word.text == sign for word in inner) for sign in ("|", "=>")]
    operator = inner[0].text if inner and inner[0].kind == "NAME" else ""
    form = f"[{operator or 'count'}{'' if operator in {'count', ''} else ' X'} => V | body | head]"
    is_first = place.at == opening + 2 and place.word.kind == "VARIABLE"
    if not place.is_in_head and operator in AGGREGATES and (is_first or place.word.text in {"=>", "|"}):
        message = "an aggregate in brackets stands in a head, not in a body"
        return place.given_up(message, aggregate_hint(operator), place.words[opening])
    if place.word.text == "|" and operator in AGGREGATES and not gives:
        return place.given_up("this aggregate does not name its result", f"it is written `{form}`", inner[0])
    if place.word.text == "]" and gives and bars < 2:
        return place.given_up("this aggregate derives nothing", f"it is written `{form}`")
    return None


def _aggregate_behind(place: MisfitContext) -> Habit | None:
    """`[count | near(R, B)] => N`."""
    if place.word.text != "=>" or place.kind(-1) != "RSQB":
        return None
    opening = place.before("LSQB")
    operator = "" if opening is None else place.words[opening + 1].text
    if opening is None or operator not in AGGREGATES:
        return None
    return place.given_up("this aggregate names its result behind the brackets", aggregate_hint(operator))


def aggregate_hint(operator: str) -> str:
    """Return how an aggregate is written and read."""
    call = f"V = {operator}({'' if operator == 'count' else 'X, '}...)"
    form = f"[{operator}{'' if operator == 'count' else ' X'} => V | body | head]"
    return f"in a body it is `{call}`, in a head `{form}`"


def _comprehension(place: MisfitContext) -> Habit | None:
    opening = place.unclosed()
    if opening is None or place.words[opening].kind != "LBRACE" or opening != place.at - 1:
        return None
    if place.word.kind == "NAME" and place.kind(1) in {"COMMA", "VBAR"}:
        name = place.word.text
        hint = f"variables begin with an upper-case letter: `{name[0].upper()}{name[1:]}`"
        return place.given_up(f"{quoted(place.word)} is a symbol, where a variable is needed", hint)
    if place.word.kind in {"NAME", "RBRACE", "BANG", "DOLLAR"}:
        hint = "it is written `{B | edge(R, B) | ready(B)}`: variables, body, head"
        return place.given_up("a comprehension begins with its new variables", hint)
    return None


def _assertion(place: MisfitContext) -> Habit | None:
    first = 2 if [word.kind for word in place.words[1:2]] == ["COLON"] else 0
    if len(place.words) <= first or place.words[first].kind not in {"ASSERT", "WATCH"} or place.at <= first + 1:
        return None
    if place.unclosed() != first + 1:
        return None
    word = place.word
    previous = place.words[place.at - 1]
    is_argument = previous.kind in {"LPAR", "COMMA"} and word.kind in {*NUMBERS, "MINUS", "STRING", "VARIABLE"}
    if not is_argument and word.kind not in {"RPAR", "COMMA"}:
        return None
    name = place.words[first].text
    message = f"`{name}` takes a start fact, a finish fact, a deadline and a violation, in this order"
    hint = f"`{name}(offline(R, L), online(R, L), 10, broadcast(R)).`"
    return place.given_up(message, hint)


HABITS = (
    _aggregate,
    _aggregate_behind,
    _comprehension,
    _assertion,
)
"""Habits in the order in which they are tried."""
