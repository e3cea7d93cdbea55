"""All crossings of one robot: how a time assertion's job gets its use of a shared resource (paper IV.C).

A job whose finish some action serves takes part in the distributed schedule of its group. This module stands between
three machines that know nothing of each other: the jobs of the virtual machine, the coordination core, and the
navigator. It gives each crossing its situation and carries out the commands that the crossing returns. Crossings are
kept by group: a robot may have one for each of any number of resources.
"""

from collections.abc import Sequence

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.streams import stable_hash
from rmr.base.time import NEVER, Instant
from rmr.base.values import Symbol, Value
from rmr.coord.coordination import Coordination
from rmr.coord.events import (
    CoordEvent,
    JobRequest,
    LeaderChanged,
    LeadershipBegan,
    LeadershipEnded,
    PathReceived,
    ScheduleChanged,
)
from rmr.coord.timing import Order
from rmr.node.actions.dispatcher import Permit, RunningAction
from rmr.node.actions.job_steps import led_to
from rmr.node.crossing.crossing import TRIGGERS_APART, Crossing
from rmr.node.crossing.destination import Destinations
from rmr.node.crossing.observer import Observer
from rmr.node.crossing.phases import Inside, Preparing, SlotEvent
from rmr.node.crossing.request import area_among, goal_of, may_drive, without_deadline
from rmr.node.crossing.shared_path import GROUPS_KEPT, SharedPaths, keep
from rmr.node.crossing.situation import (
    ChangeRank,
    Command,
    InsideUntil,
    Leave,
    OpenHoldLine,
    Revise,
    RobotCommand,
    SetReady,
    TraceEntry,
    Unforeseen,
    Withdraw,
)
from rmr.node.crossing.station_area import contains
from rmr.node.parts import CrossingHost
from rmr.vm.job import TimedJob


class Crossings:
    """All crossings of one robot."""

    def __init__(self, robot: CrossingHost, core: Coordination, digest: int) -> None:
        self._robot = robot
        self._core = core
        self._digest = digest
        self._observer = Observer(robot, core)
        self._crossings: dict[bytes, Crossing] = {}
        self._paths = SharedPaths(robot, core, self.name_of)
        self.destinations = Destinations(robot)
        self._looks = robot.driver is not None and bool(robot.config.arena.stations)
        """Whether the robot has not yet looked whether it stands in a station."""
        self.schedules: dict[bytes, ScheduleChanged] = {}
        """The newest schedule of each group."""
        self.next_wake: Instant = NEVER
        """When `step` has something to do even if nothing happens; at most once a frame."""

    # -- jobs -----------------------------------------------------------------------------------------------

    def started(self, now: Instant, job: TimedJob) -> None:
        """Handle a job that has started: it asks for a slot as soon as the robot knows where it is."""
        assertion = self._robot.program.assertions[job.assertion]
        if self._is_alone or not assertion.scheduled or not assertion.serving:
            return
        goal = self._goal_of(job)
        if goal is not None and self._is_station(goal):
            self._hold_station(now, job, goal)
        elif goal is not None or not self._may_lead_to_station(job):
            self._contend(now, job, goal)

    @property
    def _is_alone(self) -> bool:
        """Whether robots do not coordinate."""
        return self._robot.config.timing.order is Order.NONE

    def _may_lead_to_station(self, job: TimedJob) -> bool:
        """Return whether an action that serves `job` may drive into a station: which one, rules have to derive."""
        robot = self._robot
        return bool(robot.config.arena.stations) and may_drive(robot.program, robot.drives_to_area, job)

    def _contend(self, now: Instant, job: TimedJob, goal: Area | None) -> None:
        """Ask for a turn among the robots of the job's event."""
        group_id = self.group_of(job)
        old = self._crossings.get(group_id)
        if old is not None and not old.over:
            self._renewed(now, old, old.restart(now, job, goal))  # what it holds waits for this very crossing
            return
        trigger = max(now, old.trigger + TRIGGERS_APART if old else 0)
        self._crossings.pop(group_id, None)  # the newest crossing is the last
        self._crossings[group_id] = Crossing(job, group_id, trigger, goal)
        self._forget()
        self._ask(now, self._crossings[group_id])

    def finished(self, now: Instant, job: TimedJob) -> None:
        """Handle a job that has ended: its crossing is over, or will be as soon as the robot is clear."""
        for crossing in [each for each in self._crossings.values() if each.job is job and not each.over]:
            if isinstance(crossing.phase, Inside):
                self._step(now, crossing)
            elif not (crossing.station and crossing.serving):  # a drive into a station waits for a place all the same
                self._execute(now, crossing, crossing.finish())

    def _ask(self, now: Instant, crossing: Crossing) -> None:
        """Ask for a slot; if the job leaves its goal to the action, `step` asks once rules have derived that."""
        if not isinstance(crossing.phase, Preparing):
            return
        if crossing.goal is None:
            servings = self._robot.program.assertions[crossing.job.assertion].serving
            if any(self._robot.drives_to_area(serving.action) for serving in servings):
                return
        self._step(now, crossing)

    def _forget(self) -> None:
        """Keep memory bounded: drop the oldest crossings that are over, with what is known of their groups."""
        over = [group_id for group_id, crossing in self._crossings.items() if crossing.over]
        for group_id in over[: max(0, len(self._crossings) - GROUPS_KEPT)]:
            del self._crossings[group_id]
            self.schedules.pop(group_id, None)

    def group_of(self, job: TimedJob) -> bytes:
        """Return the six octets that name the group of `job`: program, assertion and finish arguments."""
        return stable_hash(f"{self._digest}/{job.assertion}/{job.event}", 6).to_bytes(6, "big")

    def _crossing_of(self, job: TimedJob) -> Crossing | None:
        crossing = self._crossings.get(self.group_of(job))
        return None if crossing is None or crossing.job is not job else crossing

    def _goal_of(self, job: TimedJob) -> Area | None:
        robot = self._robot
        return goal_of(robot.program, robot.config.arena, robot.drives_to_area, job)

    # -- actions --------------------------------------------------------------------------------------------

    def permit(
        self, now: Instant, jobs: Sequence[TimedJob], live: Sequence[TimedJob], action: int, args: Sequence[Value]
    ) -> Permit | None:
        """Return the crossing by which `action` goes; None: it needs none.

        It serves `jobs`, first due first; a drive into a station also serves those of the jobs without finish, `live`,
        whose finish can follow from a later action, and needs a place even if it serves none. What else serves a job
        that has held a station goes by that.
        """
        area = area_among(self._robot.config.arena, args) if self._robot.drives_to_area(action) else None
        if self._is_alone:
            return None
        if area is not None and self._is_station(area):
            job = next(iter(jobs or led_to(self._robot.program, live, action)), None)
            return self._hold_station(now, job, area)
        if not jobs:
            return None
        # The jobs are in order of their deadlines: an action that serves several waits for that of the most urgent one.
        job = jobs[0]
        held = next((each for each in self._crossings.values() if each.station and each.job is job), None)
        if held is not None:
            return held
        if self.group_of(job) not in self._crossings and self._may_lead_to_station(job):
            self._contend(now, job, self._goal_of(job))
        return self._permit(now, job, action, args)

    def _is_station(self, area: Area) -> bool:
        return self._robot.driver is not None and self._robot.config.arena.capacity(area.name) > 0

    def _find_itself(self, now: Instant) -> None:
        """Hold the station in which the robot finds itself at its start, as after a restart or a new program."""
        pose = self._robot.pose
        self._looks = pose is None
        for name, _ in () if pose is None or self._is_alone else self._robot.config.arena.stations:
            area = self._robot.config.arena.area(name)
            if area is not None and pose is not None and contains(area, Point(pose.x, pose.y)):
                self._hold_station(now, None, area)

    def _hold_station(self, now: Instant, job: TimedJob | None, area: Area) -> Crossing:
        """Return the crossing of a station, which is asked for unless the robot has one that is not over.

        `job` None: the drive serves no job, and goes behind all deadlines. All that drive into a station are one group,
        whatever their events: its places are the same.
        """
        group_id = stable_hash(f"{self._digest}/station/{area.name}", 6).to_bytes(6, "big")
        found = self._crossings.get(group_id)
        if job is None:
            if found is not None and not found.over:
                return found
            job = without_deadline(now, self._robot.config.robot, area.name)
        old = self._crossing_of(job)
        if old is not None and old.waits and not old.serving:  # the station takes the place of the event
            self._execute(now, old, old.finish())
        if found is not None and not found.over:
            if found.job is not job and (found.job.finish is not None or found.job.assertion < 0 or not found.waits):
                self._renewed(now, found, found.restart(now, job, area))
            return found
        trigger = max(now, found.trigger + TRIGGERS_APART if found else 0)
        capacity = self._robot.config.arena.capacity(area.name)
        crossing = Crossing(job, group_id, trigger, area, station=True, capacity=capacity)
        self._crossings.pop(group_id, None)
        self._crossings[group_id] = crossing
        self._forget()
        self._ask(now, crossing)
        return crossing

    def _permit(self, now: Instant, job: TimedJob, action: int, args: Sequence[Value]) -> Permit | None:
        """Return the crossing of the event of `job`, which has not ended and which `action` serves.

        A crossing that was used up without an end of the job, by an action that failed, is asked for again: else the
        next try would go while others have their slots.
        """
        crossing = self._crossing_of(job)
        if crossing is None:
            return None
        if crossing.over:
            plan = self._observer.estimate(now, crossing)[1] if crossing.plan.gated else None
            self._renewed(now, crossing, crossing.retry(now, plan))
        if self._robot.drives_to_area(action) and self._goal_of(job) is None:
            goal = area_among(self._robot.config.arena, args)
            self._renewed(now, crossing, crossing.lead_to(now, goal))
        return crossing

    def _renewed(self, now: Instant, crossing: Crossing, commands: Sequence[Command]) -> None:
        """Carry out what gives up a request, if it has been given up, and request again."""
        if commands:
            self._execute(now, crossing, commands)
            self._ask(now, crossing)

    def crossing(self, running: RunningAction | None) -> Crossing | None:
        """Return the crossing by which an action goes."""
        permit = None if running is None else running.permit
        return permit if isinstance(permit, Crossing) else None

    def action_derived(self, running: RunningAction) -> None:
        """Note that an action serves its crossing."""
        crossing = self.crossing(running)
        if crossing is not None:
            crossing.serving.append(running)

    def action_ended(self, now: Instant, running: RunningAction, *, failed: bool) -> None:
        """Handle the end of an action; where several serve a crossing, the last one ends it."""
        crossing = self.crossing(running)
        if crossing is None:
            return
        crossing.serving.remove(running)
        if failed and not crossing.serving:
            self._execute(now, crossing, crossing.fail())
        if crossing.station:
            self._step(now, crossing)
        elif isinstance(crossing.phase, Inside) and not crossing.plan.gated and not crossing.serving:
            self._execute(now, crossing, crossing.leave())

    def depart(self, now: Instant, goal: Point, heading: float | None, permit: Permit | None) -> None:
        """Set out for `goal`, facing `heading` in the end; by a gated crossing through its hold line."""
        robot = self._robot
        assert robot.driver is not None
        crossing = permit if isinstance(permit, Crossing) else None
        gated = crossing is not None and crossing.plan.gated and not crossing.over
        shared = self._paths.path(crossing.group_id, crossing.plan.direction) if crossing and gated else None
        robot.driver.depart(now, goal, robot.peers, heading=heading, gated=gated, shared=shared)
        if crossing is not None:
            crossing.course.planned(now)
            if gated:
                self._execute(now, crossing, [crossing.hold_line()])

    # -- what others ask ------------------------------------------------------------------------------------

    @property
    def current(self) -> Crossing | None:
        """The newest crossing that is not over."""
        return next((crossing for crossing in reversed(self._crossings.values()) if not crossing.over), None)

    def needs_no_queue(self, since: Instant) -> bool:
        """Return whether the robot need not line up: it has entered after `since`, wasted a slot, or is beyond."""
        return any(
            crossing.entered_at > since or crossing.beyond or (crossing.late.slots_wasted > 0 and not crossing.over)
            for crossing in self._crossings.values()
        )

    def inside(self, now: Instant, crossing: Crossing) -> list[int]:
        """Return the other robots that are in the resource of `crossing`, as far as this one has heard."""
        return self._core.inside(now, crossing.group_id)

    @property
    def rank(self) -> int:
        """The robot's place in the newest crossing's schedule, 0 without one."""
        return next((crossing.rank for crossing in reversed(self._crossings.values()) if crossing.rank), 0)

    def name_of(self, group_id: bytes) -> Symbol | None:
        """Return the name of the assertion behind a group."""
        crossing = self._crossings.get(group_id)
        return None if crossing is None else Symbol(crossing.job.name)

    def stands_inside(self, group_id: bytes, robot: int) -> bool:
        """Return whether `robot` was in the resource of a group, and in the way there, when it was heard last."""
        crossing = self._crossings.get(group_id)
        return crossing is not None and self._observer.stands_inside(crossing, robot)

    # -- each call ------------------------------------------------------------------------------------------

    def step(self, now: Instant) -> None:
        """Advance every crossing."""
        if self._looks:
            self._find_itself(now)
        soonest = NEVER
        for crossing in self._crossings.values():
            if crossing.course.destination is not None:
                self.destinations.follow(now, crossing)
            if crossing.over:
                continue
            prepared = isinstance(crossing.phase, Preparing)
            self._step(now, crossing)
            if not prepared:
                self._ask(now, crossing)
            soonest = min(soonest, crossing.next_wake)
        self.next_wake = max(soonest, self._robot.frame_ends) if soonest < NEVER else NEVER

    def _step(self, now: Instant, crossing: Crossing) -> None:
        self._execute(now, crossing, crossing.step(now, self._observer.situation(now, crossing)))

    def handle(self, now: Instant, event: CoordEvent) -> None:
        """Take in one event of the coordination core."""
        group_id = event.group_id
        match event:
            case PathReceived(direction=direction, path=path):
                self._paths.received(group_id, direction, path)
            case LeadershipBegan(term=term):
                self._robot.trace(now, "leads", term=term)
                self._leader_changed(now, group_id, leads=True)
                crossing = self._crossings.get(group_id)
                if crossing is not None:
                    self._paths.offer(now, crossing)
            case LeadershipEnded() | LeaderChanged():
                self._leader_changed(now, group_id, leads=False)
            case ScheduleChanged(leader=leader, term=term, order=order):
                keep(self.schedules, group_id, event)
                self._robot.trace(now, "scheduled", leader=leader, term=term, order=list(order))
            case _:
                self._handle_slot(now, event)

    def _leader_changed(self, now: Instant, group_id: bytes, *, leads: bool) -> None:
        self._paths.leads(now, group_id, does=leads)
        crossing = self._crossings.get(group_id)
        if crossing is not None:
            self._execute(now, crossing, crossing.follow_leader(now, self._observer.for_new_leader(now, crossing)))

    def _handle_slot(self, now: Instant, event: SlotEvent) -> None:
        crossing = self._crossings.get(event.group_id)
        if crossing is None:
            return
        if not crossing.over:
            self.next_wake = min(self.next_wake, self._robot.frame_ends)
        self._execute(now, crossing, crossing.handle(now, event, self._observer.at_event(crossing)))

    def _execute(self, now: Instant, crossing: Crossing, commands: Sequence[Command]) -> None:
        """Carry out what a crossing orders: nothing else tells the coordination core of it."""
        core = self._core
        group_id = crossing.group_id
        for command in commands:
            match command:
                case SetReady(ready=ready):
                    core.ready(now, group_id, ready)
                case InsideUntil(end=end):
                    core.inside_until(now, group_id, end)
                case Revise(release=release, deadline=deadline, committed=committed):
                    core.revise(now, group_id, release=release, deadline=deadline, underway=committed)
                case JobRequest():
                    core.trigger(now, command)
                case Withdraw():
                    core.withdraw(now, group_id)
                case Leave():
                    core.leave(now, group_id)
                case _:
                    self._execute_here(now, crossing, command)

    def _execute_here(self, now: Instant, crossing: Crossing, command: RobotCommand) -> None:
        """Carry out what concerns the robot alone."""
        robot = self._robot
        driver = self._robot.driver
        match command:
            case OpenHoldLine(opens_at=opens_at, opened=opened):
                if driver is not None and self.crossing(robot.driving) is crossing:
                    driver.navigator.gate(opens_at, opened)
            case ChangeRank():
                self.destinations.rank_changed(now, crossing)
            case TraceEntry(what=what, fields=fields):
                robot.trace(now, what, **fields)
            case Unforeseen():
                robot.tell(command)
