"""One robot's part of the run's report, the line that shows how it is getting on, and what a recording shows of it."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

from rmr.base.geometry import Point, Pose, hypot
from rmr.base.time import Instant, in_seconds
from rmr.base.values import Robot, format_fact
from rmr.bytecode.program import Kind
from rmr.node.actions.dispatcher import Dispatcher
from rmr.node.config import NodeConfig
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.crossings import Crossings
from rmr.node.crossing.phases import Slotted, phase_name
from rmr.node.driver import Driver
from rmr.node.executive import Executive
from rmr.node.logic.machine_runner import MachineRunner
from rmr.node.messenger import Messenger
from rmr.node.services import RobotServices
from rmr.vm.job import TimedJob
from rmr.vm.machine import Machine
from rmr.vm.shared import shared_of


class UnsavedNode(Protocol):
    """What `unsaved` looks at: `rmr.node.node.Node`."""

    robot: int
    config: NodeConfig
    machine: Machine
    actions: Dispatcher
    messenger: Messenger


class ReportedNode(UnsavedNode, Protocol):
    """What the report looks at: `rmr.node.node.Node`."""

    driver: Driver | None
    crossings: Crossings
    executive: Executive
    runner: MachineRunner
    services: RobotServices

    @property
    def finish_at(self) -> Instant | None:
        """When the finish fact held first."""

    def finished(self) -> bool:
        """Return whether the finish fact holds, as of the last call."""


def job_entry(job: TimedJob) -> dict[str, Any]:
    """Return a job as the report lists it; `met` is None while undecided, `cause` says why a miss is one."""
    met = None if job.finish is None and not job.missed else not job.missed
    return {
        "name": job.name,
        "job": job.text,
        "start_s": round(in_seconds(job.start), 3),
        "finish_s": None if job.finish is None else round(in_seconds(job.finish), 3),
        "deadline_s": round(in_seconds(job.deadline), 3),
        "met": met,
        "cause": job.cause,
    }


def unsaved(node: UnsavedNode, facts: Sequence[str]) -> int:
    """Return the number of facts, actions and deliveries that a restart of the robot would lose now.

    `facts` are those that it holds now, as `Machine.facts` returns them.
    A delivery that has not been acknowledged counts, though the other robot may have got it. Facts that the program or
    the lab gives do not: the next life has them again.
    """
    held = Counter([*facts, *node.machine.set_aside()]) - Counter(_given(node))
    actions = node.actions
    under_way = len(actions.held) + len(actions.queue) + len(actions.running)
    return sum(held.values()) + under_way + node.messenger.deliveries.exchange.unsettled


def _given(node: UnsavedNode) -> Iterator[str]:
    """Yield the facts with which each life of the robot begins, as `Machine.facts` shows them."""
    program = node.machine.program
    robot = Robot(node.robot)
    initial = list(shared_of(program).facts(robot))
    for name, owner, args in node.config.facts:
        index = program.index(name)
        if index is not None and owner in (None, robot):
            initial.append((index, tuple(args)))
    for index, args in initial:
        predicate = program.predicates[index]
        mark = "!" if predicate.kind is Kind.PERSISTENT else ""
        yield format_fact(predicate.name, (robot, *args), mark)


def robot_report(node: ReportedNode, radio: dict[str, int], restarts: int = 0) -> dict[str, Any]:
    """Return robot's entry of the report; `radio` holds the link's counters."""
    jobs = node.machine.jobs
    now = node.services.now
    goals = node.machine.goals()
    log = node.services.action_log
    deliveries = node.messenger.deliveries
    facts = node.machine.facts()
    return {
        "finish_s": None if node.finish_at is None else round(in_seconds(node.finish_at), 3),
        "distance_m": 0.0 if node.driver is None else round(node.driver.localiser.travelled_m, 3),
        "estimates_dropped": 0 if node.driver is None else node.driver.localiser.dropped,
        "samples_refused": 0 if node.driver is None else node.driver.localiser.refused,
        "assertions": [
            {**job_entry(job), "steps": log.steps.entries(node.robot, job, now)} if job.missed else job_entry(job)
            for job in jobs
        ],
        "assertions_omitted": jobs[0].serial - 1 if jobs else 0,
        "facts": facts,
        **({"set_aside": aside} if (aside := node.machine.set_aside()) else {}),
        "goals": goals,
        "goals_omitted": node.runner.achieved - len(goals["achieved"]),
        "dropped": node.machine.dropped,
        "actions": [[at, text] for at, text in log],
        "actions_omitted": log.omitted,
        "actions_failed": log.failed,
        "actions_unhandled": log.unhandled,
        "first_failure": None if log.first_failure is None else list(log.first_failure),
        "restarts": restarts,
        "unsaved": unsaved(node, facts),
        "expression_failures": node.machine.expression_failures + node.runner.expression_failures,
        "undelivered": deliveries.undelivered,
        **({"unsendable": deliveries.unsendable} if deliveries.unsendable else {}),
        "first_undelivered": None if deliveries.first_undelivered is None else list(deliveries.first_undelivered),
        "frames": radio,
        "ticks": node.executive.frames_due,
        "ticks_late": node.executive.frames_late,
        "tasks_skipped": node.executive.skipped,
        "schedules": schedules(node),
    }


def off_m(node: ReportedNode, place: tuple[float, float] | Pose | None) -> float | None:
    """Return how far the robot's estimate is from its true `place`, metres; None where it has none.

    Hosts know the true place, for the radio; the robot does not.
    """
    pose = None if node.driver is None else node.driver.localiser.pose
    if pose is None or place is None:
        return None
    return round(hypot(pose.x - place[0], pose.y - place[1]), 3)


def schedules(node: ReportedNode) -> list[dict[str, Any]]:
    """Return the newest schedule of each event that the robot has heard or made."""
    return [
        {
            "event": str(node.crossings.name_of(event) or event.hex()),
            "leader": schedule.leader,
            "term": schedule.term,
            "order": list(schedule.order),
            "formed_s": round(in_seconds(schedule.formed), 3),
        }
        for event, schedule in node.crossings.schedules.items()
    ]


def progress(node: ReportedNode, now: Instant) -> str:
    """Return what the robot is doing in a few words."""
    if node.finish_at is not None:
        return f"finished at {in_seconds(node.finish_at):.1f} s"
    crossing = node.crossings.current
    action = node.services.actions.driving
    doing = action.text(node.robot) if action is not None else "waiting"
    if node.services.blocked:
        return f"{doing}, {node.services.blocked}"
    if crossing is None:
        return doing
    full = full_words(crossing, node.crossings.inside(now, crossing)) if crossing.station else ""
    if full:
        return f"{doing}, {full}"
    if isinstance(crossing.phase, Slotted):
        return f"{doing}, turn {crossing.rank} in {in_seconds(crossing.phase.start - now):.1f} s"
    return f"{doing}, {phase_name(crossing.phase)}"


def full_words(crossing: Crossing, inside: Sequence[int]) -> str:
    """Return that the station for which a robot waits is full, and of whom; empty if a place is left or it is in."""
    if not crossing.waits or crossing.goal is None or len(inside) < crossing.capacity:
        return ""
    robots = f"robot {inside[0]}" if len(inside) == 1 else "robots " + ", ".join(map(str, inside))
    return f"station {crossing.goal.name} is full: {robots}"


def pose_of(node: ReportedNode) -> Pose | None:
    """Return the pose that the robot believes to have; None while it does not know, or without a body."""
    return None if node.driver is None else node.driver.localiser.pose


def route_of(node: ReportedNode) -> Sequence[Point] | None:
    """Return the points of the route that the robot follows; None without one."""
    route = None if node.driver is None else node.driver.navigator.route
    return None if route is None else route.points


def status_of(node: ReportedNode, now: Instant, queue: int) -> dict[str, Any]:
    """Return the robot's state; `queue` is the number of frames that wait for the channel."""
    crossings = node.crossings
    return {
        "robot": node.robot,
        "progress": progress(node, now),
        "finished": node.finished(),
        "leads": [
            str(crossings.name_of(event) or event.hex())
            for event, schedule in crossings.schedules.items()
            if schedule.leader == node.robot
        ],
        "queue": queue,
    }
