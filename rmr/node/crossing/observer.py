"""What a crossing's step is given: one situation a tick, of one robot and one resource.

Cheap facts are stated in every tick. An estimate plans a route, which costs milliseconds and is kept for a while, so it
is made only where the crossing's step is about to use it: to ask, at a poll, and for a new leader.
"""

from rmr.base.arena import BOTTLENECK, Area, Arena
from rmr.base.geometry import Point, Pose
from rmr.base.time import Instant
from rmr.base.values import Symbol
from rmr.coord.coordination import Coordination
from rmr.node.config import UNKNOWN_INSIDE
from rmr.node.crossing import resource, station_area
from rmr.node.crossing.approach import is_divided
from rmr.node.crossing.blocked_way import barring
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.lateness import READY
from rmr.node.crossing.phases import Inside, Preparing
from rmr.node.crossing.situation import STATION_NOTICE, CrossingPlan, Situation
from rmr.node.driver import Driver
from rmr.node.motion.estimate import Estimate
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.route import Route
from rmr.node.parts import CrossingHost
from rmr.node.peers.perception import LostRobot


class Observer:
    """Observes one robot for all of its crossings."""

    def __init__(self, robot: CrossingHost, core: Coordination) -> None:
        self._robot = robot
        self._core = core
        self._profile = robot.config.profile

    def situation(self, now: Instant, crossing: Crossing) -> Situation:
        """Return what the next step of `crossing` needs."""
        phase = crossing.phase
        if isinstance(phase, Preparing):
            return self.before_request(now, crossing)
        driver = self._robot.driver
        if crossing.station and driver is not None:
            return self._at_station(now, crossing, driver)
        if isinstance(phase, Inside):
            if driver is None or not crossing.plan.gated:
                return Situation()
            found = inside(driver.navigator, crossing, self._robot.pose, phase.route)
            return self.with_others(crossing, found) if found.retreating or found.before_hold_line else found
        if crossing.beyond and self._core.passes(crossing.group_id):
            return Situation(excused=True)
        if driver is not None and crossing.poll_is_due(now):
            return self._polled(now, crossing, driver.navigator)
        return self.at_event(crossing)

    def _at_station(self, now: Instant, crossing: Crossing, driver: Driver) -> Situation:
        """Return what concerns a station: whether the dead have all its places, or how the robot leaves it."""
        goal = crossing.goal
        assert goal is not None
        if crossing.waits:
            dead = station_area.occupants(self._robot.config.arena, goal, self._robot.known_dead(now))
            return self.at_event(crossing)._replace(barred=len(dead) >= crossing.capacity)
        pose = self._robot.pose
        bound_for = self._robot.driving is not None or driver.navigator.status == "moving"
        leads_in = driver.navigator.goal is not None and station_area.contains(goal, driver.navigator.goal)
        within = pose is None or station_area.touches(self._robot.config.arena, goal, Point(pose.x, pose.y))
        serves_here = any(not each.uses_wheels or Symbol(goal.name) in each.args for each in crossing.serving)
        stays = serves_here or (bound_for and leads_in)
        return Situation(cleared=not within and not stays, retreating=within and bound_for and not leads_in)

    def with_others(self, crossing: Crossing, found: Situation) -> Situation:
        """Return `found`, with whether anybody else is in the schedule."""
        return found._replace(alone=not self._core.contended(crossing.group_id))

    def at_event(self, crossing: Crossing, *, plan: CrossingPlan | None = None) -> Situation:
        """Return what costs nothing, which is all that events need; `plan`: if another one than before holds."""
        driver = self._robot.driver
        plan = plan or crossing.plan
        action = crossing.action
        navigator = None if driver is None else driver.navigator
        set_out = action is not None and action.started is not None
        ready = action is not None
        route = None if navigator is None else resource.entered_route(navigator)
        if route is not None and plan.gated and route.passage != plan.passage:
            route = None  # the drive leads through another passage for now
        if plan.gated:
            ready = set_out and navigator is not None and route is not None and navigator.reaches_gate(READY)
        return Situation(
            late_goes_next=self._profile.late_goes_next,
            set_out=set_out,
            ready=ready,
            route=route,
        )

    def before_request(self, now: Instant, crossing: Crossing) -> Situation:
        """Return what a request depends on."""
        arena = self._robot.config.arena
        pose = self._robot.pose
        goal = crossing.goal
        may_ask, plan = self.estimate(now, crossing)
        gated = (plan or crossing.plan).gated
        beyond = False
        if may_ask and not gated and not crossing.station and goal is not None and pose is not None:
            beyond = resource.is_beyond(arena, arena.passage(BOTTLENECK), goal, pose)
        excused = beyond and self._core.passes(crossing.group_id)
        return Situation(pose=pose, may_ask=may_ask, plan=plan, beyond=beyond, excused=excused)

    def for_new_leader(self, now: Instant, crossing: Crossing) -> Situation:
        """Return what a new leader has to hear."""
        if not crossing.release_may_be_old():
            return Situation()
        may_ask, plan = self.estimate(now, crossing)
        return Situation(may_ask=may_ask, plan=plan)

    def estimate(self, now: Instant, crossing: Crossing) -> tuple[bool, CrossingPlan | None]:
        """Return whether the robot may ask by what it knows, and a new estimate; None: no other than before."""
        robot = self._robot
        goal = crossing.goal
        if robot.driver is None or crossing.of_step:
            expected = crossing.takes or robot.config.turn
            notice = 0 if robot.driver is None else CrossingPlan().notice
            return True, CrossingPlan(inside=expected, headway=expected, notice=notice)
        if goal is None:
            return True, None
        pose = robot.pose
        if pose is None:
            return False, None
        found = robot.driver.approach.estimate(pose, self._place(now, robot.driver, crossing, goal))
        if crossing.station:
            within = station_area.contains(goal, Point(pose.x, pose.y))
            held = UNKNOWN_INSIDE if found is None else found.approach + found.inside + found.after + UNKNOWN_INSIDE
            return True, CrossingPlan(inside=held, headway=held, within=within, notice=STATION_NOTICE)
        if found is None:
            return True, None
        if found.inside <= 0:
            return True, CrossingPlan(inside=found.approach, headway=found.approach)
        plan = self._gated(robot.driver, found, goal, pose)
        first = isinstance(crossing.phase, Preparing) and not plan.within
        return not (first and self._profile.listens_first and robot.driver.listens(now, robot.peers)), plan

    def _place(self, now: Instant, driver: Driver, crossing: Crossing, goal: Area) -> Point:
        """Return where the way into `goal` ends: the first place, or the robot's own where passages divide the area."""
        if not is_divided(self._robot.config.arena, goal):
            return goal.places[0]
        own = crossing.course.destination or driver.place
        if own is not None and own in goal.places:
            return own
        return driver.place_of(now, goal, crossing.rank, crossing.place, self._robot.peers)

    def _gated(self, driver: Driver, found: Estimate, goal: Area, pose: Pose) -> CrossingPlan:
        arena = self._robot.config.arena
        passage = arena.passage(found.passage)
        return CrossingPlan(
            gated=True,
            passage=found.passage,
            direction=found.way,
            approach=found.approach,
            inside=found.inside,
            after=found.after,
            headway=driver.approach.headway(goal, passage, found.way),
            within=found.within or resource.stands_within(arena, passage, goal, pose),
            obstructs_exit=resource.obstructs_exit(arena, passage, goal, pose),
        )

    def _polled(self, now: Instant, crossing: Crossing, navigator: Navigator) -> Situation:
        """Return what a poll compares: a robot that stands inside has to get out, whatever its estimate is."""
        if finds_itself_within(navigator.arena, crossing, self._robot.pose):
            return Situation(within=True)
        pose = self._robot.pose
        _, plan = self.estimate(now, crossing)
        newest = plan or crossing.plan
        goal = crossing.goal
        if not newest.gated and goal is not None and is_divided(navigator.arena, goal):
            return Situation(excused=True)  # its place lies on this side of the passage: it needs no turn there
        passage = navigator.arena.passage(newest.passage) if newest.gated else None
        return self.with_others(crossing, self.at_event(crossing, plan=newest))._replace(
            pose=pose,
            plan=plan,
            in_entrance=resource.in_entrance(navigator, passage, crossing.goal, pose),
            barred=self._barred(now, crossing.goal, pose),
        )

    def stands_inside(self, crossing: Crossing, robot: int) -> bool:
        """Return whether `robot` was in the resource of `crossing`, and in the way there, when it was heard last."""
        peer = self._robot.peers.known.get(robot)
        arena = self._robot.config.arena
        goal = crossing.goal
        if peer is None or peer.hello is None or goal is None:
            return False
        if crossing.station:
            return station_area.touches(arena, goal, Point(peer.hello.x, peer.hello.y))
        if not crossing.plan.gated:
            return False
        place = Pose(peer.hello.x, peer.hello.y, peer.hello.theta)
        if not resource.stands_within(arena, arena.passage(crossing.plan.passage), goal, place, arena.shape.radius):
            return False
        pose = self._robot.pose
        body = {robot: LostRobot(Point(place.x, place.y), peer.hello_at)}
        return pose is None or bool(barring(arena, Point(pose.x, pose.y), goal.places[0], body))

    def _barred(self, now: Instant, goal: Area | None, pose: Pose | None) -> bool:
        """Return whether the dead bar the way to the first place of `goal` and to the last: not only a place."""
        lost = self._robot.known_dead(now)
        if not lost or goal is None or pose is None:
            return False
        here = Point(pose.x, pose.y)
        ends = dict.fromkeys((goal.places[0], goal.places[-1]))
        return all(barring(self._robot.config.arena, here, end, lost) for end in ends)


def finds_itself_within(arena: Arena, crossing: Crossing, pose: Pose | None, slack_m: float = 0.0) -> bool:
    """Return whether the robot at `pose` stands in the resource of `crossing`, or within `slack_m` of that."""
    goal = crossing.goal
    passage = arena.passage(crossing.plan.passage)
    return pose is not None and goal is not None and resource.stands_within(arena, passage, goal, pose, slack_m)


def inside(navigator: Navigator, crossing: Crossing, pose: Pose | None, entered: Route | None) -> Situation:
    """Return how a robot at `pose` gets on inside, which has `entered` by that route as far as is known."""
    passage = crossing.plan.passage
    if passage in navigator.behind:
        return Situation(route=entered, cleared=True)
    ahead = resource.entered_route(navigator)
    passed = navigator.passed_gate
    if ahead is not None and ahead.passage != passage:  # the way leads through another passage now
        return Situation(route=entered, retreating=True, cleared=resource.is_clear(navigator, entered, pose))
    route = entered or ahead
    starts = crossing.plan.within and route is None  # its action is still to begin
    if starts and finds_itself_within(navigator.arena, crossing, pose, resource.OFF_ROUTE_M):
        return Situation(within=True)
    before = navigator.status == "blocked" if ahead is None else not ahead.within
    return Situation(
        route=route,
        retreating=navigator.aside and not passed,
        before_hold_line=before and not passed,
        cleared=resource.is_clear(navigator, route, pose, stays=not crossing.serving),
        eta_clear=navigator.eta_clear(),
    )
