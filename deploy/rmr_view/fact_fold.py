"""Facts over time, folded from a trace of the level FACTS: what a robot held at an instant."""

from collections import Counter
from collections.abc import Collection, Iterable
from typing import Any

FIRED_MAX = 50
"""Firings, actions and achieved goals that are listed at most, the newest."""


def robot_at(entries: Iterable[dict[str, Any]], robot: int, t: float, sensed: Collection[str] = ()) -> dict[str, Any]:
    """Return facts, achieved goals, firings and actions of `robot` at `t`, from the entries of a trace.

    `sensed` are the names of the predicates that robots state by themselves.
    """
    facts: Counter[str] = Counter()
    fired: list[dict[str, Any]] = []
    achieved: list[list[Any]] = []
    actions: list[dict[str, Any]] = []
    for entry in entries:
        if entry["robot"] != robot or entry["t"] > t:
            continue
        what = entry["what"]
        if what == "inserted":
            facts[entry["fact"]] += 1
        elif what == "removed":
            facts[entry["fact"]] -= 1
        elif what == "fired":
            fired.append({"t": entry["t"], "rule": entry["rule"]})
        elif what == "achieved":
            achieved.append([entry["goal"], entry["t"]])
        elif what == "action":
            actions.append({"begin_s": entry["t"], "action": entry["action"], "end_s": None, "failure": None})
        elif what == "action_ended":
            _end(actions, entry)
        elif what == "fault" and entry["fault"] == "restarted":
            facts.clear()
    held = sorted(fact for fact, count in facts.items() for _ in range(count))
    return {
        "facts": [fact for fact in held if fact.partition("(")[0] not in sensed],
        "sensed": [fact for fact in held if fact.partition("(")[0] in sensed],
        "goals": {"achieved": achieved[-FIRED_MAX:], "open": None},
        "fired": fired[-FIRED_MAX:],
        "actions": actions[-FIRED_MAX:],
    }


def _end(actions: list[dict[str, Any]], entry: dict[str, Any]) -> None:
    for action in reversed(actions):
        if action["action"] == entry["action"] and action["end_s"] is None:
            action["end_s"] = entry["t"]
            action["failure"] = entry["failure"]
            return
