"""What a robot process says of an entry of its trace: the failures that a person should see, each as a sentence."""

from collections.abc import Mapping
from typing import Any

from rmr.node.actions.dispatcher import INTERRUPTED


def failure_words(entry: Mapping[str, Any]) -> str | None:
    """Return the failure that `entry` tells, in words; None if it tells none."""
    match entry.get("what"):
        case "action_ended" if entry["failure"] not in (None, *INTERRUPTED):
            return f"action {entry['action']} failed: {entry['failure']}"
        case "undelivered":
            return f"{entry['predicate']} for robot {entry['destination']} was not delivered: {entry['why']}"
        case "bound_reached":
            return f"more than {entry['bound']} {entry['kept']}: the rest is dropped"
        case "deadline_missed":
            return f"deadline missed: {entry['job']}"
        case "restless":
            return "the program does not become quiescent: some rule is always satisfied"
        case "repeats":
            return f"a goal stays open: {entry['rule']} fires again and again for the same facts"
        case "other_program":
            return f"robot {entry['source']} runs another program: neither understands the other"
        case _:
            return None
