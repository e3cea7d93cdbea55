"""What is said of a run that is over, from its report: failures and losses that did not end it, and how to go on.

These are failed actions, undelivered messages, entries that a robot dropped at a bound, and omissions of the report.
The launcher and the simulator print these lines to standard error after the table, and then the commands that show the
run and tell why deadlines were missed.
"""

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rmr.bus.late_messages import ROW_MIN
from rmr.bus.rates import sender_name
from rmr.node.motion.localiser import MISTAKEN_M

TEXT_MAX = 120
"""Characters of a fact, an action or a reason that are printed."""
OMITTED = {"actions_omitted": "actions", "assertions_omitted": "jobs", "goals_omitted": "achieved goals"}
"""Fields of a robot's part that count omissions, and the words for what is omitted."""


def run_warnings(report: Mapping[str, Any]) -> list[str]:
    """Return a line for each kind of failure or loss in `report`."""
    parts: Mapping[str, Mapping[str, Any]] = report["robots"]
    failed = _total(parts, "actions_failed")
    lines = []
    if failed:
        were = "action" if failed == 1 else "actions"
        started = sum(len(part.get("actions", ())) + part.get("actions_omitted", 0) for part in parts.values())
        lines.append(f"{failed} {were} failed, of {started} started; the first: {_first(parts, 'first_failure')}")
    if unhandled := unhandled_failures(report):
        lines.append(f"{unhandled} of the failed actions have no `else` in the program, so the run has failed")
    undelivered = _total(parts, "undelivered")
    if undelivered:
        lines.append(
            f"{undelivered} of the facts, goals and actions for other robots not delivered; the first: "
            f"{_first(parts, 'first_undelivered')}"
        )
    if unsendable := unsendable_facts(report):
        lines.append(f"{unsendable} of these can never be sent, as no frames can carry them, so the run has failed")
    lost = {robot: part["lost_in_restart"] for robot, part in parts.items() if part.get("lost_in_restart")}
    if lost:
        which = ", ".join(f"robot {robot}: {count}" for robot, count in lost.items())
        lines.append(
            f"lost with the memory of restarted robots (facts, actions, deliveries): {sum(lost.values())} ({which})"
        )
    lines += [words for robot, part in parts.items() for words in position_warnings(robot, part)]
    return [*lines, *_exceeded(report), *_braked(report), *_stood(parts), *_dropped(parts), *_omitted(parts, report)]


def position_warnings(robot: str, part: Mapping[str, Any]) -> Iterator[str]:
    """Yield what is amiss with how `robot` knew where it was, from its part of the report."""
    off_m = part.get("off_m")
    if off_m is not None and off_m > MISTAKEN_M:
        yield f"robot {robot} was mistaken about its position: at the end its estimate was {off_m:.2f} m off"
    if dropped := part.get("estimates_dropped"):
        times = "once" if dropped == 1 else f"{dropped} times"
        why = "ranges or fixes contradicted it, or none came"
        yield f"robot {robot} dropped its estimate of its position {times}: {why}; it stood meanwhile"
    if refused := part.get("samples_refused"):
        yield f"robot {robot} dropped {refused} samples that no body can produce after the ones before"


def unhandled_failures(report: Mapping[str, Any]) -> int:
    """Return the number of failures of the user's own handlers for which the program declares no `else`."""
    return _total(report["robots"], "actions_unhandled")


def unsendable_facts(report: Mapping[str, Any]) -> int:
    """Return the number of facts, goals and actions for other robots that were dropped, as no frames carry them."""
    return _total(report["robots"], "unsendable")


def _total(parts: Mapping[str, Mapping[str, Any]], field: str) -> int:
    return sum(part.get(field, 0) for part in parts.values())


def _first(parts: Mapping[str, Mapping[str, Any]], field: str) -> str:
    """Return the earliest entry of `field` among the robots; an entry is [seconds, what, why]."""
    told = [(part[field][0], int(robot), *part[field][1:]) for robot, part in parts.items() if part.get(field)]
    if not told:
        return "not known"
    at_s, robot, what, why = min(told)
    return f"robot {robot} at {at_s:.3f} s: {_cut(what)}: {_cut(why)}"


def _cut(text: str) -> str:
    return text if len(text) <= TEXT_MAX else f"{text[:TEXT_MAX]}..."


def _exceeded(report: Mapping[str, Any]) -> Iterator[str]:
    for sender, count in report.get("bus", {}).get("excess", ()):
        yield (
            f"{sender_name(sender)} sent more on the bus than others take of one sender: {count} of its messages were "
            "dropped; its program is wrong, or somebody has its keys"
        )


def _braked(report: Mapping[str, Any]) -> Iterator[str]:
    for robot, count, worst_s in report.get("bus", {}).get("late_commands", ()):
        if count >= ROW_MIN:
            yield (
                f"robot {robot} braked although it drove: {count} of its wheel commands arrived too late, the latest "
                f"{worst_s:.3f} s after it was decided; the bus is delayed or the machine is too slow"
            )


def _stood(parts: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    for robot, part in parts.items():
        count = part.get("late_samples", 0)
        if count >= ROW_MIN:
            yield (
                f"robot {robot} stood although it was to drive: {count} of its samples arrived too late; "
                f"the bus is delayed or the machine is too slow"
            )


def _dropped(parts: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    for robot, part in parts.items():
        for what, count in part.get("dropped", {}).items():
            yield f"robot {robot} dropped {count} {what}: more than it keeps (`bound_reached` in its trace)"


def _omitted(parts: Mapping[str, Mapping[str, Any]], report: Mapping[str, Any]) -> Iterator[str]:
    for field, what in OMITTED.items():
        count = _total(parts, field)
        if count:
            deadlines = ", which `deadlines` does not count" if field == "assertions_omitted" else ""
            yield f"the report leaves out the {count} oldest {what}{deadlines}"
    if report.get("violations_omitted"):
        yield f"the report leaves out {report['violations_omitted']} violations"


def view_hint(recording: Path) -> str:
    """Return the last line of a run that was recorded in a folder or a file: the command that shows it."""
    return f"see it: rmr view {shlex.quote(str(recording))}"


def missed_hint(report: Mapping[str, Any], recording: Path) -> list[str]:
    """Return the line to print for a run with this report, which was recorded in a folder or a file; or no line."""
    missed = [
        (job["deadline_s"], int(robot), job["name"])
        for robot, part in report["robots"].items()
        for job in part.get("assertions", ())
        if job["met"] is False
    ]
    if not missed:
        return []
    command = f"rmr why {shlex.quote(str(recording))} --missed"
    _, robot, name = min(missed)
    if len(missed) == 1:
        return [f"why a deadline was missed: {command} {name}@{robot}"]
    return [f"why {len(missed)} deadlines were missed: {command}; of one: {command} {name}@{robot}"]
