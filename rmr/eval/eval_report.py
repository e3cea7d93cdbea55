"""The report of a run, and messages about the work still outstanding at its end."""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Protocol

from rmr.base.time import Instant, in_seconds
from rmr.eval.acting import Acting
from rmr.eval.eval_ether import LATENCY, EvalEther, Messages
from rmr.eval.given import Insertion
from rmr.eval.options import Death
from rmr.eval.topology import Topology
from rmr.node.report import job_entry, unsaved

if TYPE_CHECKING:
    from rmr.node.node import Node

DIED = "died"
"""The `cause` of a job that its robot's death has left undecided."""
REASONS_MAX = 8
"""Reasons listed why a run did not become quiescent; thousands of robots may have the same one."""


class HostedNode(Protocol):
    """One robot of the run: `rmr.eval.ensemble.Hosted`."""

    robot: int
    node: "Node"
    alive: bool
    past: list[dict[str, Any]]
    firings: int
    last_rule: str | None


class Connected(Protocol):
    """The conditions of a run, as far as the report names them."""

    @property
    def topology(self) -> Topology:
        """Which robots are in range of each other."""


class NodeRun(Protocol):
    """A run of nodes: `rmr.eval.ensemble.Ensemble`."""

    acting: Acting
    ether: EvalEther
    repeats: dict[tuple[int, str], int]
    undelivered: dict[tuple[int, int, str, str], None]
    unheard: list[tuple[int, str]]
    hopeless: list[tuple[int, dict[str, Any]]]

    @property
    def robots(self) -> Mapping[int, HostedNode]:
        """All robots by number."""

    @property
    def conditions(self) -> Connected:
        """The conditions of the run."""


class EvaluatedRun(Protocol):
    """The interface of a run, by nodes (`Ensemble`) or in columns."""

    firings: int
    busy: int
    """Robots that are not idle."""
    happened: Instant
    """When the last thing happened."""
    outstanding: list[Insertion | Death]
    """Events from outside that are yet to come."""

    @property
    def now(self) -> Instant:
        """How far the run has come."""

    @property
    def messages(self) -> Messages:
        """What was on the air."""

    @property
    def frames(self) -> int:
        """How many frames were about something that the program says."""

    @property
    def quiescent(self) -> bool:
        """Whether nothing is left to do."""

    @property
    def exhausted(self) -> bool:
        """Whether the run has used up its firings or frames."""

    def run(self, until: Instant, look: Callable[[], None]) -> bool:
        """Run to quiescence, or to `until` (included) at the latest; return whether it became quiescent."""

    def stop(self) -> None:
        """End the run soon."""

    def entries(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield each robot with its part of the report."""

    def unfinished(self) -> Iterator[tuple[int, Iterator[str]]]:
        """Yield the robots that are not idle, with what each has yet to do."""

    @property
    def unsendable(self) -> int:
        """How many facts, goals and actions no frames can carry; they were dropped."""

    def warnings(self) -> tuple[Iterator[str], ...]:
        """Return what is to be said beside the report, by kind."""


def report(run: EvaluatedRun) -> dict[str, Any]:
    """Return the report of a run; equal seeds give equal reports."""
    messages = run.messages
    return {
        "quiescent": run.quiescent,
        "time_s": round(in_seconds(run.happened), 6),
        "firings": run.firings,
        "robots": {str(robot): each for robot, each in run.entries()},
        "messages": {
            "sent": messages.sent,
            "delivered": messages.delivered,
            "lost": messages.lost,
            "repeated": messages.repeated,
            "bytes": messages.octets,
        },
    }


def reasons(run: EvaluatedRun) -> list[str]:
    """Return what still went on when the run was ended, a line each, REASONS_MAX at most."""
    lines: list[str] = []
    more = 0
    for robot, unfinished in run.unfinished():
        if len(lines) >= REASONS_MAX:
            more += 1
        else:
            lines += [f"robot {robot}: {what}" for what in unfinished]
    del lines[REASONS_MAX:]
    if more:
        lines.append(f"and {more} more robots are not idle")
    still = len(run.outstanding)
    if still:
        others = f" and {still - 1} more" if still > 1 else ""
        event = run.outstanding[0]
        option = event.option if isinstance(event, Death) else "--insert"
        lines.append(f"{option} '{event.text}'{others} yet to come")
    return lines or ["a message is under way"]


def satisfied(firings: int, last: str | None) -> str:
    """Return the message that rules are still satisfied; `last` is the position of the rule that fired last."""
    return f"rules are still satisfied after {firings} firings" + (f", the last at {last}" if last is not None else "")


# ---- of robots as nodes


def entry(hosted: HostedNode) -> dict[str, Any]:
    """Return a robot's part of the report; for one that was killed also its restarts and whether it lives."""
    part = _life(hosted)
    if not hosted.past and hosted.alive:
        return part
    lost = sum(past["unsaved"] for past in hosted.past)
    if not hosted.alive:
        part = _died(part)
    for name in ("undelivered", "expression_failures"):
        part[name] += sum(past[name] for past in hosted.past)
    for name in ("actions", "assertions"):
        part[name] = [item for past in (*hosted.past, part) for item in past[name]]
    return part | {"restarts": len(hosted.past), "lost_in_restart": lost, "alive": hosted.alive}


def past_life(hosted: HostedNode) -> dict[str, Any]:
    """Return the part of the report of a node that has died."""
    life = _life(hosted)
    return _died(life) | {"unsaved": unsaved(hosted.node, life["facts"])}


def _died(part: dict[str, Any]) -> dict[str, Any]:
    """Return the part with the jobs marked that the robot's death has left undecided."""
    return part | {"assertions": [job | {"cause": DIED} if job["met"] is None else job for job in part["assertions"]]}


def _life(hosted: HostedNode) -> dict[str, Any]:
    node = hosted.node
    aside = node.machine.set_aside()
    deliveries = node.messenger.deliveries
    return {
        "facts": node.machine.facts(),
        **({"set_aside": aside} if aside else {}),
        "goals": node.machine.goals(),
        "actions": [[at, text] for at, text in node.services.action_log],
        "assertions": [job_entry(job) for job in node.machine.jobs],
        "undelivered": deliveries.undelivered,
        **({"unsendable": deliveries.unsendable} if deliveries.unsendable else {}),
        "expression_failures": node.machine.expression_failures,
    }


def lost_in_restarts(ensemble: NodeRun) -> Iterator[str]:
    """Yield how much each robot has lost with its memory."""
    for identity, hosted in ensemble.robots.items():
        count = sum(past["unsaved"] for past in hosted.past)
        if count:
            yield f"robot {identity}: lost in restarts (facts, actions, deliveries): {count}"


def outstanding(hosted: HostedNode) -> Iterator[str]:
    """Yield what a robot has yet to do, with names where there are any."""
    node = hosted.node
    if not node.machine.quiescent:
        yield satisfied(hosted.firings, hosted.last_rule)
    for fact in node.machine.set_aside():
        yield f"{fact} is set aside until another robot has decided"
    for running in node.actions.running:
        yield f"action {running.text(hosted.robot)} is under way"
    for running in (*node.actions.held, *node.actions.queue):
        yield f"action {running.text(hosted.robot)} waits for its turn"
    for job in node.machine.jobs:
        if job.finish is None and not job.missed:
            yield f"the deadline of {job.name}, {job.text}, is at {in_seconds(job.deadline):g} s"
    if node.messenger.waiting:
        yield f"{len(node.messenger.exchange.arrivals)} deliveries have arrived and wait until no rule is satisfied"
    if not node.messenger.exchange.idle:
        yield "a fact for another robot is not acknowledged yet"
    if node.messenger.shared.outstanding:
        yield "shared facts are to be told to neighbours"


def dropped(ensemble: NodeRun) -> Iterator[str]:
    """Yield what was more than a robot keeps, and so was dropped."""
    for identity, robot in ensemble.robots.items():
        for what, count in robot.node.machine.dropped.items():
            yield f"robot {identity} dropped {count} {what}: more than it keeps (`--trace` says where)"
        for predicate, count in robot.node.messenger.shared.untold.items():
            name = robot.node.program.predicates[predicate].name
            yield f"robot {identity}: neighbours are not told {count} facts {name}/...: no frame has room for them"


def omitted(ensemble: NodeRun) -> Iterator[str]:
    """Yield whose oldest actions the report leaves out."""
    for identity, robot in ensemble.robots.items():
        count = robot.node.services.action_log.omitted
        if count:
            yield f"robot {identity}: the report leaves out its {count} oldest actions (`--trace` has all)"


def repeating(ensemble: NodeRun) -> Iterator[str]:
    """Yield the rules that fired again and again for the same facts, of robots whose goals are still open."""
    for (identity, rule), firings in ensemble.repeats.items():
        still = ensemble.robots[identity].node.machine.goals()["open"]
        if still:
            more = f" and {len(still) - 1} more" if len(still) > 1 else ""
            goals = f"goal {still[0]}{more} is open"
            yield f"robot {identity}: {goals}, and {rule} fired {firings} times for the same facts"


def hopeless(ensemble: NodeRun) -> Iterator[str]:
    """Yield the jobs whose deadline was nearer from the start than what their steps take."""
    for robot, note in ensemble.hopeless:
        needs = f"needs {note['needs_s']:g} s and has {note['left_s']:g} s"
        yield f"robot {robot}: {note['job']} cannot be in time: it {needs}; the longest step is {note['step']}"


def undelivered(ensemble: NodeRun) -> Iterator[str]:
    """Yield what could not be delivered, each once, and why."""
    topology = ensemble.conditions.topology
    for source, destination, name, why in ensemble.undelivered:
        known = destination in ensemble.robots
        told = "it is out of range" if known and not topology.adjacent(source, destination) else why
        yield f"`{name}` of robot {source} did not reach robot {destination}: {told}"


def unheard(ensemble: NodeRun) -> Iterator[str]:
    """Yield the facts from outside that came while their robot was dead."""
    for robot, text in ensemble.unheard:
        yield f"--insert '{text}' came while robot {robot} was dead; it is dropped"


def unmatched(ensemble: NodeRun) -> Iterator[str]:
    """Yield the `--fail` that no action has met."""
    for each in ensemble.acting.failing:
        if each.met < (each.wanted.number or 1):
            begun = {0: "none began", 1: "one began"}.get(each.met, f"{each.met} began")
            yield f"--fail '{each.wanted.text}' failed no action: of those that match {begun}"


def slowed(ensemble: NodeRun) -> Iterator[str]:
    """Yield that frames had to be slowed down, if they had."""
    if ensemble.ether.slowed_at is not None:
        since = in_seconds(ensemble.ether.slowed_at)
        least = LATENCY / 1e6
        yield f"robots answer each other without end; from {since:g} s on every frame takes {least:g} ms"
