"""Syntax that other languages have (Prolog, Datalog, Meld, Python, C) and people type by habit.

Habits are looked for where a token does not fit, before the general repair (`rmr.lang.read.repair`). Each is a
function of the item's tokens around the unexpected one. It answers with one message, the form that RMR has as the
hint, and, where what was meant is clear, with other tokens to read instead; else the item is given up.
"""

from rmr.lang.read.habits import brackets, conditions, items, single_words
from rmr.lang.read.habits.item_words import Habit, MisfitContext

__all__ = ["LOOKED_AT_MAX", "Habit", "MisfitContext", "habit"]

LOOKED_AT_MAX = 300
"""Largest number of tokens before the unexpected token for which habits are searched; habits scan all of them."""

HABITS = (*items.HABITS, *conditions.HABITS, *single_words.HABITS, *brackets.HABITS)


def habit(place: MisfitContext) -> Habit | None:
    """Return the first habit that explains the unexpected token in `place`, or None."""

    return next((found for look in HABITS if (found := look(place)) is not None), None)
