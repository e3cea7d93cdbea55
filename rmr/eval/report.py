"""What is told of a run: the report, and in words what still went on at its end."""

from collections.abc import Iterator
from typing import Any

from rmr.base.time import in_seconds
from rmr.eval.ensemble import Ensemble, Hosted
from rmr.node.report import job_entry

REASONS_MAX = 8
"""Reasons why a run did not become quiescent that are told; thousands of robots may have the same."""


def report(ensemble: Ensemble) -> dict[str, Any]:
    """Return the report of a run; equal seeds give equal reports."""
    messages = ensemble.ether.messages
    return {
        "quiescent": ensemble.quiescent,
        "time_s": round(in_seconds(ensemble.happened), 6),
        "firings": ensemble.firings,
        "robots": {str(robot): _robot(hosted) for robot, hosted in ensemble.robots.items()},
        "messages": {
            "sent": messages.sent,
            "delivered": messages.delivered,
            "lost": messages.lost,
            "repeated": messages.repeated,
            "bytes": messages.octets,
        },
    }


def _robot(hosted: Hosted) -> dict[str, Any]:
    node = hosted.node
    return {
        "facts": node.machine.facts(),
        "goals": node.machine.goals(),
        "actions": [[at, text] for at, text in node.action_log],
        "assertions": [job_entry(job) for job in node.machine.jobs],
        "undelivered": node.talk.deliveries.undelivered,
        "expression_failures": node.machine.expression_failures,
    }


def reasons(ensemble: Ensemble) -> list[str]:
    """Return what still went on when the run was ended, a line each, REASONS_MAX at most."""
    lines: list[str] = []
    more = 0
    for hosted in ensemble.robots.values():
        if hosted.idle:
            continue
        if len(lines) >= REASONS_MAX:
            more += 1
        else:
            lines += [f"robot {hosted.robot}: {what}" for what in _outstanding(hosted)]
    del lines[REASONS_MAX:]
    if more:
        lines.append(f"and {more} more robots are not idle")
    still = len(ensemble.outstanding)
    if still:
        others = f" and {still - 1} more" if still > 1 else ""
        lines.append(f"--insert '{ensemble.outstanding[0].text}'{others} yet to come")
    return lines or ["a message is under way"]


def _outstanding(hosted: Hosted) -> Iterator[str]:
    """Yield what a robot has yet to do, with names where there are any."""
    node = hosted.node
    if not node.machine.quiescent:
        last = f", the last at {hosted.last_rule}" if hosted.last_rule is not None else ""
        yield f"rules are still satisfied after {hosted.firings} firings{last}"
    for running in node.actions.running:
        yield f"action {running.text(hosted.robot)} is under way"
    for running in (*node.actions.held, *node.actions.queue):
        yield f"action {running.text(hosted.robot)} waits for its turn"
    for job in node.machine.jobs:
        if job.finish is None and not job.missed:
            yield f"the deadline of {job.name}, {job.text}, is at {in_seconds(job.deadline):g} s"
    if not node.talk.exchange.idle:
        yield "a fact for another robot is not acknowledged yet"


def dropped(ensemble: Ensemble) -> Iterator[str]:
    """Yield what was more than a robot keeps, and so was dropped."""
    for identity, robot in ensemble.robots.items():
        for what, count in robot.node.machine.dropped.items():
            yield f"robot {identity} dropped {count} {what}: more than it keeps (`--trace` says where)"


def undelivered(ensemble: Ensemble) -> Iterator[str]:
    """Yield what could not be delivered, each once, and why."""
    topology = ensemble.conditions.topology
    for source, destination, name, why in ensemble.undelivered:
        known = destination in ensemble.robots
        told = "it is out of range" if known and not topology.adjacent(source, destination) else why
        yield f"`{name}` of robot {source} did not reach robot {destination}: {told}"
