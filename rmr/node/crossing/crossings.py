"""All crossings of one robot: how a time assertion's job gets its use of a shared resource (paper IV.C).

A job whose finish some action serves takes part in the distributed schedule of its group. This module stands between
three machines that know nothing of each other: the jobs of the virtual machine, the coordination core, and the
navigator. It gives each crossing its situation and carries out the commands that the crossing returns. Crossings are
kept by group: a robot may have one for each of any number of resources.
"""

from collections.abc import Iterable, Sequence

from rmr.analysis.servers import EarlierStep
from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.time import NEVER, Duration, Instant, in_seconds
from rmr.base.values import Symbol, Value
from rmr.coord.coordination import Coordination
from rmr.coord.events import (
    CoordEvent,
    Entered,
    EntryMissed,
    LeaderChanged,
    LeadershipBegan,
    LeadershipEnded,
    PathReceived,
    ScheduleChanged,
    SlotAssigned,
    SlotLost,
)
from rmr.coord.timing import Order
from rmr.node.actions.dispatcher import Permit, RunningAction
from rmr.node.actions.job_steps import led_to
from rmr.node.crossing import resource
from rmr.node.crossing.command_executor import CommandExecutor
from rmr.node.crossing.crossing import TRIGGERS_APART, Crossing
from rmr.node.crossing.crossing_table import CrossingTable, crossing_of, gate_of
from rmr.node.crossing.destination import Destinations
from rmr.node.crossing.later_steps import time_of
from rmr.node.crossing.making_room import MakingRoom
from rmr.node.crossing.observer import Observer
from rmr.node.crossing.phases import Inside, Preparing, SlotEvent
from rmr.node.crossing.request import area_among, goal_among, goal_of, may_drive, without_deadline
from rmr.node.crossing.shared_path import SharedPaths, keep
from rmr.node.crossing.situation import (
    Command,
)
from rmr.node.crossing.station_area import contains
from rmr.node.parts import CrossingHost
from rmr.vm.assertions import earlier_steps, step_event
from rmr.vm.derive import Chain
from rmr.vm.job import TimedJob
from rmr.vm.machine_events import ActionDerived
from rmr.vm.match import pattern_agrees


class Crossings:
    """All crossings of one robot."""

    def __init__(self, robot: CrossingHost, core: Coordination, digest: int) -> None:
        self._robot = robot
        self._core = core
        self._observer = Observer(robot, core)
        self._table = CrossingTable(digest)
        self._paths = SharedPaths(robot, core, self.name_of)
        self.destinations = Destinations(robot)
        self._making_room = MakingRoom(robot)
        self._executor = CommandExecutor(robot, core, self.destinations)
        self._shares = robot.driver is not None and robot.config.arena.has_shared_passages
        """Whether there are passages that are resources of all robots, whatever their events."""
        self._looks = robot.driver is not None and bool(robot.config.arena.stations)
        """Whether the robot has not yet looked whether it stands in a station."""
        self.schedules: dict[bytes, ScheduleChanged] = {}
        """The newest schedule of each group."""
        self.next_wake: Instant = NEVER
        """When `step` has something to do even if nothing happens; at most once a frame."""
        self._took: dict[str, Duration] = {}
        """By name of an action that is a step of several: how long it took the last time."""
        self._chains = False
        """Whether any job has had several steps with turns."""

    # -- jobs -----------------------------------------------------------------------------------------------

    def started(self, now: Instant, job: TimedJob) -> None:
        """Handle a job that has started: it asks for a slot as soon as the robot knows where it is."""
        assertion = self._robot.program.assertions[job.assertion]
        if self._is_alone or not assertion.scheduled or not assertion.serving:
            return
        goal = self._goal_of(job)
        asking = [self._contend(now, job, None, step) for step in earlier_steps(self._robot.program, job)]
        if goal is not None and self._is_station(goal):
            self._hold_station(now, job, goal)
        elif goal is not None or not self._may_lead_to_station(job):
            asking.append(self._contend(now, job, goal))
        if len(asking) > 1:
            self._foresee(now, job)
            self._tell_if_hopeless(now, job, asking)
        for crossing in asking:
            self._ask(now, crossing)

    @property
    def _is_alone(self) -> bool:
        """Whether robots do not coordinate."""
        return self._robot.config.timing.order is Order.NONE

    def _may_lead_to_station(self, job: TimedJob) -> bool:
        """Return whether an action that serves `job` may drive into a station: which one, rules have to derive."""
        robot = self._robot
        return bool(robot.config.arena.stations) and may_drive(robot.program, robot.drives_to_area, job)

    def _contend(self, now: Instant, job: TimedJob, goal: Area | None, step: EarlierStep | None = None) -> Crossing:
        """Return the crossing of the robots of the job's event, or of an earlier step of it, which is yet to ask."""
        name = "" if step is None else step_event(self._robot.program, job, step)
        event_id = self._table.event_id(job, name)
        old = self._table.of_event(event_id)
        if old is not None and not old.over:
            shared = old.job is not job and old.job.finish is None and old.job.deadline <= job.deadline
            if step is None or not shared:  # of two jobs of the robot with the same step the one due first asks
                self._executor.execute(now, old, old.restart(now, job, goal))  # what it holds waits for this crossing
            return old
        trigger = max(now, old.trigger + TRIGGERS_APART if old else 0)
        if old is not None:
            self._table.remove(old)  # the newest crossing is the last
        if not earlier_steps(self._robot.program, job):
            return self._add(Crossing(job, event_id, event_id, trigger, goal))
        later = 0 if step is None else step.later
        serving = self._robot.program.assertions[job.assertion].serving if step is None else (step,)
        takes = max(TRIGGERS_APART, *[self._expected(each.action) for each in serving])
        self._chains = True
        crossing = Crossing(job, event_id, event_id, trigger, goal, of_step=name, steps_later=later, takes=takes)
        return self._add(crossing)

    def _expected(self, action: int) -> Duration:
        """Return how long an action takes: as long as the last time, else as its handler says."""
        took = self._took.get(self._robot.program.predicates[action].name)
        return self._robot.expected(action) if took is None else took

    def _foresee(self, now: Instant, job: TimedJob) -> None:
        """Work out when the steps of `job` can begin, and what they leave to those after them; tell what has changed.

        A step can begin when those before it end: at the end of their slots, else of the least that they take. Its
        deadline is that of the job less what the later ones take.
        """
        steps = [each for each in self._table if each.takes and each.job is job and not each.over]
        for crossing in sorted(steps, key=lambda each: -each.steps_later):
            before = [each.ends(now) for each in steps if each.steps_later > crossing.steps_later]
            takes = {each.steps_later: each.length for each in steps}
            later = [time for place, time in takes.items() if place < crossing.steps_later]
            ready_from = now if crossing.serving else max(before, default=0)
            passed_over = any(each.serving and each.steps_later < crossing.steps_later for each in steps)
            if passed_over and crossing.waits and not crossing.serving:
                commands = crossing.finish()  # it asks again when it is derived after all
            else:
                commands = crossing.foresee(now, ready_from, later)
                for running in crossing.serving:
                    running.job = job
                    running.due = crossing.due
            self._executor.execute(now, crossing, commands)

    def _tell_if_hopeless(self, now: Instant, job: TimedJob, steps: Sequence[Crossing]) -> None:
        """Tell at once of a deadline that is nearer than the least that the steps take, one after the other."""
        takes = {each.steps_later: each.length for each in steps}
        needs = sum(takes.values())
        if now + needs > job.deadline:
            longest = max(steps, key=lambda each: each.length).told
            times = {"needs_s": in_seconds(needs), "left_s": in_seconds(job.deadline - now)}
            self._robot.trace(now, "cannot_meet", job=job.text, step=longest, **times)

    def _add(self, crossing: Crossing) -> Crossing:
        self._forget(self._table.add(crossing))
        return crossing

    def finished(self, now: Instant, job: TimedJob) -> None:
        """Handle a job that has ended: its crossing is over, or will be as soon as the robot is clear."""
        for crossing in [each for each in self._table if each.job is job and not each.over]:
            if isinstance(crossing.phase, Inside):
                self._step(now, crossing)
            elif not (crossing.station and crossing.serving):  # a drive into a station waits for a place all the same
                self._executor.execute(now, crossing, crossing.finish())

    def _ask(self, now: Instant, crossing: Crossing) -> None:
        """Ask for a slot; if the job leaves its goal to the action, `step` asks once rules have derived that."""
        if not isinstance(crossing.phase, Preparing):
            return
        if crossing.goal is None and not crossing.of_step:
            servings = self._robot.program.assertions[crossing.job.assertion].serving
            if any(self._robot.drives_to_area(serving.action) for serving in servings):
                return
        self._step(now, crossing)

    def _moved(self, now: Instant, crossing: Crossing) -> bool:
        """Take a crossing that is being prepared to the group of its resource; return whether it may ask there.

        The resource is the next passage on its way, or its event. A robot asks once at a passage: another crossing of
        it, whose drive is not under way, steps back for one whose drive is.
        """
        knows, plan = self._observer.estimate(now, crossing)
        if plan is None and not knows:
            return False
        passage = None if plan is None or not plan.gated else plan.passage
        group_id = crossing.event_id if passage is None else self._table.passage_id(passage)
        if passage is None and crossing.of_drive:
            self._executor.execute(
                now, crossing, crossing.finish()
            )  # its way leads through no passage now: nothing to ask for
            return False
        if group_id == crossing.group_id:
            return True
        other = self._table.at(group_id)
        if other is not None and not other.over:
            if not crossing.serving or other.serving or not other.waits:
                return False
            self._executor.execute(now, other, other.renew(now, other.job, other.goal))
            self._forget(self._table.move(other, other.event_id))
        trigger = 0 if other is None else other.trigger + TRIGGERS_APART
        self._forget(self._table.move(crossing, group_id, trigger))
        return True

    def _drive_to(self, now: Instant, job: TimedJob | None, area: Area, later: Duration = 0) -> Crossing:
        """Return the crossing of a drive that serves no event: it needs a turn at the passages on its way.

        `job` is the one whose finish can follow from a later action, which takes `later` from the end of the drive on;
        None: the drive goes behind all deadlines.
        """
        event_id = self._table.drive_id()
        job = without_deadline(now, self._robot.config.robot, area.name) if job is None else job
        crossing = self._add(Crossing(job, event_id, event_id, now, area, of_drive=True, later=later))
        self._ask(now, crossing)
        return crossing

    def _ask_at_gate(self, now: Instant) -> None:
        """Ask for a turn at the gate before which the drive under way is, if it has none and has not asked.

        Whatever drives through a passage that all robots share needs a turn: also a drive that serves no job, one that
        passes several, which asks at each of them as it comes out of the one before, and one into a station, whose
        place it has already.
        """
        running = self._robot.driving
        driver = self._robot.driver
        if running is None or driver is None:
            return
        navigator = driver.navigator
        route = resource.entered_route(navigator)
        if route is None or navigator.passed_gate or navigator.goal is None:
            return
        crossing = gate_of(running)
        if crossing is None or crossing.station:
            job = None if crossing is None else crossing.job
            gate = self._drive_to(now, job, goal_among(None, navigator.goal))
            running.gate = gate
            gate.serving.append(running)
        elif crossing.over or (not crossing.waits and not crossing.plan.gated):
            goal = goal_among(crossing.goal, navigator.goal)
            commands = crossing.restart if crossing.over else crossing.renew
            self._renewed(now, crossing, commands(now, crossing.job, goal))

    def _forget(self, groups: Iterable[bytes]) -> None:
        """Forget what is known of `groups` whose crossings were dropped."""
        for group_id in groups:
            self.schedules.pop(group_id, None)

    def group_of(self, job: TimedJob) -> bytes:
        """Return the six octets that name the group of `job`: program, assertion and finish arguments."""
        return self._table.event_id(job)

    def _goal_of(self, job: TimedJob) -> Area | None:
        robot = self._robot
        return goal_of(robot.program, robot.config.arena, robot.drives_to_area, job)

    # -- actions --------------------------------------------------------------------------------------------

    def permit(
        self, now: Instant, jobs: Sequence[TimedJob], live: Sequence[TimedJob], derived: ActionDerived, then: Chain
    ) -> Permit | None:
        """Return the crossing by which an action goes that was `derived`; None: it needs none.

        It serves `jobs`, first due first. A drive into a station, or through passages that all robots share, also
        serves those of the jobs without finish, `live`, whose finish can follow from a later action, and needs its turn
        even if it serves none. Later steps of its chain, `then`, have their part of the time until the deadline. What
        else serves a job that has held a station goes by that.
        """
        action = derived.predicate
        args = derived.args
        robot = self._robot
        area = area_among(robot.config.arena, args) if robot.drives_to_area(action) else None
        if self._is_alone:
            return None
        if area is not None and self._is_station(area):
            job = next(iter(jobs or led_to(self._robot.program, live, action)), None)
            return self._hold_station(now, job, area)
        step = None if jobs else self._of_step(now, live, derived)
        if step is not None:
            return step
        if not jobs:
            # The passage has turns by itself, so the deadline of a job that is watched counts, too.
            job = next(iter(led_to(robot.program, live, action, scheduled=False)), None)
            if area is None or not self._shares:
                return None
            later = 0
            if job is not None and then:
                later = time_of(robot.program, robot.config.arena, robot.drives_to_area, area.places[0], then)
            return self._drive_to(now, job, area, later)
        # The jobs are in order of their deadlines: an action that serves several waits for that of the most urgent one.
        job = jobs[0]
        held = next((each for each in self._table if each.station and each.job is job), None)
        if held is not None:
            return held
        if self._table.of_event(self.group_of(job)) is None and self._may_lead_to_station(job):
            self._ask(now, self._contend(now, job, self._goal_of(job)))
        return self._permit(now, job, action, args)

    def _of_step(self, now: Instant, live: Sequence[TimedJob], derived: ActionDerived) -> Permit | None:
        """Return the crossing of the earlier step that an action is, of the job that is due first."""
        program = self._robot.program
        for job in sorted(live, key=lambda each: (each.deadline, each.serial)):
            for step in earlier_steps(program, job):
                if step.action != derived.predicate or not pattern_agrees(step.args, derived.args, job.bindings):
                    continue
                crossing = self._table.of_event(self._table.event_id(job, step_event(program, job, step)))
                if crossing is None:
                    crossing = self._contend(now, job, None, step)
                    self._ask(now, crossing)
                elif crossing.over:
                    self._renewed(now, crossing, crossing.restart(now, job, None))
                return crossing
        return None

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
        group_id = self._table.station_id(area.name)
        found = self._table.at(group_id)
        if job is None:
            if found is not None and not found.over:
                return found
            job = without_deadline(now, self._robot.config.robot, area.name)
        old = self._table.of_job(job)
        if old is not None and old.waits and not old.serving:  # the station takes the place of the event
            self._executor.execute(now, old, old.finish())
        if found is not None and not found.over:
            if found.job is not job and (found.job.finish is not None or found.job.assertion < 0 or not found.waits):
                self._renewed(now, found, found.restart(now, job, area))
            return found
        trigger = max(now, found.trigger + TRIGGERS_APART if found else 0)
        capacity = self._robot.config.arena.capacity(area.name)
        crossing = self._add(Crossing(job, group_id, group_id, trigger, area, station=True, capacity=capacity))
        self._ask(now, crossing)
        return crossing

    def _permit(self, now: Instant, job: TimedJob, action: int, args: Sequence[Value]) -> Permit | None:
        """Return the crossing of the event of `job`, which has not ended and which `action` serves.

        A crossing that was used up without an end of the job, by an action that failed, is asked for again: else the
        next try would go while others have their slots.
        """
        crossing = self._table.of_job(job)
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
            self._executor.execute(now, crossing, commands)
            self._ask(now, crossing)

    def crossing(self, running: RunningAction | None) -> Crossing | None:
        """Return the crossing by which an action goes."""
        return crossing_of(running)

    def action_derived(self, running: RunningAction) -> None:
        """Note that an action serves its crossing."""
        crossing = self.crossing(running)
        if crossing is not None:
            crossing.serving.append(running)
            running.job = crossing.job
            running.due = crossing.due

    def action_ended(self, now: Instant, running: RunningAction, *, failed: bool) -> None:
        """Handle the end of an action; where several serve a crossing, the last one ends it."""
        permit = self.crossing(running)
        gate = gate_of(running)
        if permit is not None:
            self._served(now, running, permit, failed=failed)
        if gate is not None and gate is not permit:
            self._served(now, running, gate, failed=failed)

    def _served(self, now: Instant, running: RunningAction, crossing: Crossing, *, failed: bool) -> None:
        crossing.serving.remove(running)
        if crossing.takes and running.started is not None and not failed:
            self._took[running.name] = now - running.started
        if (failed or crossing.of_drive) and not crossing.serving:
            self._executor.execute(now, crossing, crossing.fail())
        if crossing.station:
            self._step(now, crossing)
        elif isinstance(crossing.phase, Inside) and not crossing.plan.gated and not crossing.serving:
            self._executor.execute(now, crossing, crossing.leave())

    def depart(self, now: Instant, goal: Point, heading: float | None, permit: Permit | None) -> None:
        """Set out for `goal`, facing `heading` in the end; by a gated crossing through its hold line."""
        robot = self._robot
        assert robot.driver is not None
        crossing = permit if isinstance(permit, Crossing) else None
        gate = gate_of(robot.driving) or crossing
        gated = gate is not None and gate.plan.gated and not gate.over
        shared = self._paths.path(gate.group_id, gate.plan.direction) if gate and gated else None
        robot.driver.depart(now, goal, robot.peers, heading=heading, gated=gated or self._shares, shared=shared)
        if crossing is not None:
            crossing.course.planned(now)
        if gate is not None and gated:
            self._executor.execute(now, gate, [gate.hold_line()])

    # -- what others ask ------------------------------------------------------------------------------------

    @property
    def current(self) -> Crossing | None:
        """The newest crossing that is not over."""
        return next((crossing for crossing in reversed(self._table) if not crossing.over), None)

    @property
    def all_current(self) -> list[Crossing]:
        """The crossings that are not over, oldest first: a robot that has a station may wait at a passage."""
        return [crossing for crossing in self._table if not crossing.over]

    def needs_no_queue(self, since: Instant) -> bool:
        """Return whether the robot need not line up: it has entered after `since`, wasted a slot, or is beyond."""
        return any(
            crossing.entered_at > since or crossing.beyond or (crossing.late.slots_wasted > 0 and not crossing.over)
            for crossing in self._table
            if not crossing.of_step
        )

    def inside(self, now: Instant, crossing: Crossing) -> list[int]:
        """Return the other robots that are in the resource of `crossing`, as far as this one has heard."""
        return self._core.inside(now, crossing.group_id)

    @property
    def rank(self) -> int:
        """The robot's place in the newest crossing's schedule, 0 without one."""
        return next((each.rank for each in reversed(self._table) if each.rank and not each.of_step), 0)

    def name_of(self, group_id: bytes) -> Symbol | None:
        """Return the name of the assertion behind a group."""
        crossing = self._table.at(group_id)
        return None if crossing is None else Symbol(crossing.name)

    def _told(self, group_id: bytes) -> str:
        """Return what the trace calls a group."""
        crossing = self._table.at(group_id)
        return group_id.hex() if crossing is None else crossing.told

    def stands_inside(self, group_id: bytes, robot: int) -> bool:
        """Return whether `robot` was in the resource of a group, and in the way there, when it was heard last."""
        crossing = self._table.at(group_id)
        return crossing is not None and self._observer.stands_inside(crossing, robot)

    # -- each call ------------------------------------------------------------------------------------------

    def step(self, now: Instant) -> None:
        """Advance every crossing."""
        if self._looks:
            self._find_itself(now)
        if self._shares:
            self._ask_at_gate(now)
        soonest = NEVER
        wanted = self._wanted_station() if self._robot.config.arena.stations else None
        if self._chains:
            for job in dict.fromkeys([each.job for each in self._table if each.takes and not each.over]):
                self._foresee(now, job)
        for crossing in self._table:
            if crossing.course.destination is not None:
                self.destinations.follow(now, crossing)
            if crossing.over:
                continue
            prepared = isinstance(crossing.phase, Preparing)
            self._step(now, crossing)
            if not prepared:
                self._ask(now, crossing)
            if crossing.waits:
                inside = self.inside(now, crossing)
                schedule = self.schedules.get(crossing.group_id)
                self._making_room.step(now, crossing, inside, schedule.order if schedule else (), wanted)
                for running in crossing.serving if inside else ():
                    running.behind = tuple(dict.fromkeys([*running.behind, *inside]))
            wake = crossing.next_wake
            soonest = wake if wake < soonest else soonest
        self.next_wake = max(soonest, self._robot.frame_ends) if soonest < NEVER else NEVER

    def _wanted_station(self) -> Area | None:
        """Return the station that the robot has, and in which others need its place."""
        for held in self._table:
            if held.station and isinstance(held.phase, Inside):
                schedule = self.schedules.get(held.group_id)
                others = set(() if schedule is None else schedule.order) - {self._robot.config.robot}
                if len(others) >= held.capacity:
                    return held.goal
        return None

    def _step(self, now: Instant, crossing: Crossing) -> None:
        prepares = isinstance(crossing.phase, Preparing) and not crossing.station
        if self._shares and prepares and not self._moved(now, crossing):
            crossing.polled(now)
            return
        self._executor.execute(now, crossing, crossing.step(now, self._observer.situation(now, crossing)))

    def handle(self, now: Instant, event: CoordEvent) -> None:
        """Take in one event of the coordination core."""
        group_id = event.group_id
        match event:
            case PathReceived(direction=direction, path=path):
                self._paths.received(group_id, direction, path)
            case LeadershipBegan(term=term):
                self._robot.trace(now, "leads", event=self._told(group_id), term=term)
                self._leader_changed(now, group_id, leads=True)
                crossing = self._table.at(group_id)
                if crossing is not None:
                    self._paths.offer(now, crossing)
            case LeadershipEnded() | LeaderChanged():
                self._leader_changed(now, group_id, leads=False)
            case ScheduleChanged(leader=leader, term=term, order=order):
                keep(self.schedules, group_id, event)
                told = self._told(group_id)
                self._robot.trace(now, "scheduled", event=told, leader=leader, term=term, order=list(order))
            case SlotAssigned() | SlotLost() | Entered() | EntryMissed():
                self._handle_slot(now, event)

    def _leader_changed(self, now: Instant, group_id: bytes, *, leads: bool) -> None:
        self._paths.leads(now, group_id, does=leads)
        crossing = self._table.at(group_id)
        if crossing is not None:
            self._executor.execute(
                now, crossing, crossing.follow_leader(now, self._observer.for_new_leader(now, crossing))
            )

    def _handle_slot(self, now: Instant, event: SlotEvent) -> None:
        crossing = self._table.at(event.group_id)
        if crossing is None:
            return
        if not crossing.over:
            self.next_wake = min(self.next_wake, self._robot.frame_ends)
        situation = self._observer.at_event(crossing)
        if isinstance(event, EntryMissed):
            situation = self._observer.with_others(crossing, situation)
        self._executor.execute(now, crossing, crossing.handle(now, event, situation))
        if crossing.takes and not crossing.over:
            self._foresee(now, crossing.job)
            waits = crossing.serving or crossing.ready_from or self._robot.acts
            if crossing.of_step and isinstance(event, EntryMissed) and not waits:
                # Nothing of it is derived, and nothing before it is under way: it asks again when it is.
                self._executor.execute(now, crossing, crossing.finish())
