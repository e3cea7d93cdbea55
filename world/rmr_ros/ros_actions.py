"""Actions that ROS 2 carries out: a message is published, or a service called, with what the action's arguments say.

Types and fields are looked up before the lab begins, and so is who serves or listens (`missing`); what does not fit is
an error there. Later nothing stops a lab: what goes wrong fails the action, in a sentence. An action is known by its
robot, the process that it is and the action's number; what is asked again is not done again. Nothing here imports
rclpy; the node is handed in, and its thread only keeps the answers.

Nav2 is another action of ROS 2: a robot whose mind lets it drive has a goal there (`Nav2Drives`).
"""

import math
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rmr.base.geometry import Pose
from rmr.base.time import Duration, Instant, in_seconds, seconds
from rmr.base.values import Robot, Symbol, Value, format_value
from rmr.node.ports import NAVIGATED
from rmr_ros.ros_body import onward
from rmr_ros.ros_facts import TopicFactError, field_type, full_name, message_class

Asked = tuple[int, int, int]
"""A robot, the session of the process that it is, and the number of its action."""

EXAMPLES: Final[Mapping[str, Value]] = {
    "bool": True,
    "int": 1,
    "float": 0.5,
    "string": "a",
    "symbol": Symbol("a"),
    "robot": Robot(1),
}
"""A value of each type of arguments; any field may suit an open one."""

NAV2_TYPE: Final = "nav2_msgs/NavigateToPose"
SUCCEEDED: Final = 4
"""Ends of a goal, as action_msgs/GoalStatus numbers them; any other one means that it was given up."""
CANCELED: Final = 5


@dataclass(frozen=True, slots=True)
class ActionCall:
    """One action of one robot."""

    item: int
    """Of its entry under `actions` in the lab file."""
    robot: int
    name: str
    types: tuple[str, ...]
    """Of the arguments, as the program has them."""
    paths: tuple[str | None, ...]
    """For each argument the path of the field that gets it."""
    fields: tuple[tuple[str, Value], ...]
    type: str
    end: str
    """Of the topic or of the service, from the root."""
    called: bool
    """Whether it is a service."""
    within: Duration

    def given(self, args: Sequence[Value]) -> Iterator[tuple[str, Value]]:
        """Yield what the message gets, by paths."""
        yield from self.fields
        yield from ((path, arg) for path, arg in zip(self.paths, args, strict=True) if path is not None)


def fitting(value: Value, kind: str) -> Any:
    """Return what a field of type `kind` gets of a value; None: it does not take it."""
    bounded = re.fullmatch(r"(w?string)(?:<=?(\d+)>?)?", kind)
    if isinstance(value, bool) or kind == "boolean":
        return value if isinstance(value, bool) and kind == "boolean" else None
    if isinstance(value, str) or bounded:
        fits = isinstance(value, str) and bounded and len(value) <= int(bounded[2] or len(value))
        return str(value) if fits else None
    if isinstance(value, Robot):
        value = int(value)
    if not isinstance(value, int | float):
        return None
    if kind in ("float", "double"):
        return float(value) if kind == "double" or not math.isfinite(value) or abs(value) < 3.4e38 else None
    bits = re.fullmatch(r"u?int(8|16|32|64)", kind)
    if bits is None or not isinstance(value, int):
        return None
    low, high = (0, 1 << int(bits[1])) if kind[0] == "u" else (-(1 << int(bits[1]) - 1), 1 << int(bits[1]) - 1)
    return value if low <= value < high else None


def _check(call: ActionCall, kind: Any) -> None:
    """Raise TopicFactError if messages of the class `kind` lack a field, or one does not take what it gets."""
    for position, (path, wanted) in enumerate(zip(call.paths, call.types, strict=True), start=2):
        found = field_type(call.type, kind, path) if path is not None else ""
        if found and wanted != "open" and (wanted not in EXAMPLES or fitting(EXAMPLES[wanted], found) is None):
            raise TopicFactError(f"argument {position} of '{call.name}' is a {wanted}, and the field {path} a {found}")
    for path, value in call.fields:
        found = field_type(call.type, kind, path)
        if fitting(value, found) is None:
            raise TopicFactError(f"the field {path} is a {found}, not {format_value(value)}")


def _filled(message: Any, call: ActionCall, args: Sequence[Value]) -> Any:
    """Return the message with all that it gets. Raises ValueError in a sentence."""
    for path, value in call.given(args):
        *outer, name = path.split(".")
        inner = message
        for each in outer:
            inner = getattr(inner, each)
        kind = inner.get_fields_and_field_types()[name]
        if (fits := fitting(value, kind)) is None:
            raise ValueError(f"{path} is a {kind}, which {format_value(value)} is not")
        setattr(inner, name, fits)
    return message


@dataclass(slots=True, eq=False)
class _Pending:
    """A call whose answer has not come."""

    asked: Asked
    call: ActionCall
    future: Any
    due: Instant


class RosActions:
    """The actions of a lab. Raises TopicFactError, a line for each that is wrong."""

    def __init__(self, node: Any, calls: Sequence[ActionCall], quality: Callable[..., Any]) -> None:
        """`quality` returns the quality of service that goes with the subscribers of a topic."""
        self._node = node
        self._quality = quality
        self._calls = {(each.robot, each.name): each for each in calls}
        self._kinds: dict[ActionCall, Any] = {}
        wrong: dict[str, None] = {}
        for each in calls:
            try:
                kind = message_class(each.type, "srv" if each.called else "msg")
                _check(each, kind.Request if each.called else kind)
                self._kinds[each] = kind
            except TopicFactError as error:
                wrong[f"actions.{each.item}: {error}"] = None
        if wrong:
            raise TopicFactError("\n".join(wrong))
        self._ways: dict[ActionCall, Any] = {}
        """Their publishers and clients, as far as there is somebody."""
        self._pending: list[_Pending] = []
        self._ended: dict[Asked, str] = {}
        """Why actions failed, those that did not with an empty text; the newest last."""
        self._news: deque[tuple[Asked, str]] = deque()

    # -- before the lab begins ----------------------------------------------------------------------------------

    def missing(self) -> Iterator[str]:
        """Yield a sentence for each action that nobody is there for; make the ways to those who are."""
        for each in self._calls.values():
            if each not in self._ways and (why := self._served(each) if each.called else self._heard(each)):
                yield f"robot {each.robot}: {why}"

    def _served(self, call: ActionCall) -> str:
        kinds = dict(self._node.get_service_names_and_types()).get(call.end, [])
        wanted = full_name(call.type, "srv")
        if not kinds:
            return f"nobody serves {call.end} ({wanted}): start its node, or correct the name under actions"
        if kinds != [wanted]:
            return f"{call.end} has the type {' and '.join(kinds)}, and the lab says {wanted}"
        self._ways[call] = self._node.create_client(self._kinds[call], call.end)
        return ""

    def _heard(self, call: ActionCall) -> str:
        infos = self._node.get_subscriptions_info_by_topic(call.end)
        others = sorted({info.topic_type for info in infos} - {full_name(call.type)})
        if others:
            return f"{call.end} has the type {' and '.join(others)}, and the lab says {full_name(call.type)}"
        if not infos:
            return (
                f"nobody subscribes to {call.end} ({full_name(call.type)}): start its node, or correct the name under "
                "actions"
            )
        self._ways[call] = self._node.create_publisher(self._kinds[call], call.end, self._quality(infos, out=True))
        return ""

    # -- while it runs ------------------------------------------------------------------------------------------

    def perform(self, asked: Asked, name: str, args: Sequence[Value], clock: Instant) -> None:
        """Begin an action; one that has begun, or ended, is not done again, and its end is told again."""
        if asked in self._ended:
            self._news.append((asked, self._ended[asked]))
        elif all(each.asked != asked for each in self._pending):
            failure = self._begin(asked, name, args, clock)
            if failure is not None:
                self._end(asked, failure)

    def _begin(self, asked: Asked, name: str, args: Sequence[Value], clock: Instant) -> str | None:
        """Begin an action; return its end if that is known, why it fails or an empty text."""
        call = self._calls.get((asked[0], name))
        if call is None or len(args) != len(call.paths):
            return f"the lab file has no {name} of robot {asked[0]} under actions"
        way = self._ways[call]
        kind = self._kinds[call]
        try:
            message = _filled(kind.Request() if call.called else kind(), call, args)
        except ValueError as error:
            return str(error)
        if call.called:
            if not way.service_is_ready():
                return f"nobody serves {call.end} any more"
            self._pending.append(_Pending(asked, call, way.call_async(message), clock + call.within))
            return None
        if not way.get_subscription_count():
            return f"nobody subscribes to {call.end} any more"
        way.publish(message)
        return ""

    def _end(self, asked: Asked, failure: str) -> None:
        self._ended[asked] = failure
        if len(self._ended) > 1024:  # ends that are remembered for robots that ask again
            del self._ended[next(iter(self._ended))]
        self._news.append((asked, failure))

    def cancel(self, asked: Asked) -> None:
        """Wait no longer for an answer; what has been called is not called back."""
        for each in [one for one in self._pending if one.asked == asked]:
            self._drop(each)

    def _drop(self, pending: _Pending) -> None:
        self._pending.remove(pending)
        self._ways[pending.call].remove_pending_request(pending.future)

    def step(self, clock: Instant) -> None:
        """Take in the answers, and give up those that have not come in time."""
        for each in self._pending.copy():
            if each.future.done():
                self._pending.remove(each)
                self._end(each.asked, _failure(each.future, each.call))
            elif clock >= each.due:
                self._drop(each)
                self._end(each.asked, f"no answer of {each.call.end} within {in_seconds(each.call.within):g} s")

    def ended(self) -> Iterator[tuple[Asked, str]]:
        """Yield the actions that have ended since, each with why it failed or an empty text."""
        while self._news:
            yield self._news.popleft()


def _failure(future: Any, call: ActionCall) -> str:
    """Return why a call has failed by its answer: by convention a field `success` says so, and `message` why."""
    if future.exception() is not None:
        return f"{call.end}: {future.exception()}"
    answer = future.result()
    if getattr(answer, "success", True) is not False:
        return ""
    return f"{call.end}: {getattr(answer, 'message', '') or 'it says no success'}"


# ---- Nav2: robots that drive by a driver of their own


@dataclass(slots=True, eq=False)
class _Goal:
    """What Nav2 has been given for one robot."""

    asked: Asked
    heard: Instant
    """When its robot said so last."""
    sent: Any
    """The future of its handle."""
    result: Any = None
    """The future of its result, once it has been accepted."""
    end: str | None = None
    """Why it failed, an empty text if it did not; None before its end."""


class Nav2Drives:
    """The goals of robots that Nav2 drives. Raises TopicFactError if its types are not there.

    A robot has one goal: a newer one takes its place, and the old one is cancelled once the new one is accepted. A goal
    whose robot has not spoken of it for 1.5 s is cancelled, too: its mind is gone.
    """

    def __init__(self, drives: Mapping[int, tuple[str, Pose]], client: Callable[[Any, str], Any]) -> None:
        """`drives` has the action's name from the root, and the floor's pose in the map, by robot."""
        self._drives = drives
        try:
            self._kind = message_class(NAV2_TYPE, "action") if drives else None
        except TopicFactError as error:
            raise TopicFactError(f"bodies: {error}; source the set-up file of a ROS 2 that has Nav2") from None
        self._ways = {robot: client(self._kind, name) for robot, (name, _) in drives.items()}
        self._goals: dict[int, _Goal] = {}
        self._left: list[_Goal] = []
        """Goals to cancel."""
        self._news: set[int] = set()
        """Robots whose goals have ended since they were told last."""

    def missing(self) -> Iterator[str]:
        """Yield a sentence for each robot whose Nav2 is not there."""
        for robot, way in self._ways.items():
            if not way.server_is_ready():
                where = f"{self._drives[robot][0]} ({full_name(NAV2_TYPE, 'action')})"
                yield f"robot {robot}: nobody serves {where}: start its Nav2, or correct the name under bodies"

    def drives(self, robot: int) -> bool:
        """Return whether Nav2 drives `robot`."""
        return robot in self._ways

    def go(self, asked: Asked, target: Sequence[Value], clock: Instant) -> None:
        """Let Nav2 drive to x, y and heading on the floor; without these it is to drive no more."""
        robot = asked[0]
        goal = self._goals.get(robot)
        numbers = [float(each) for each in target if isinstance(each, int | float)]
        if len(numbers) != 3:
            if goal is not None and goal.asked == asked:
                self._leave(robot)
        elif goal is not None and goal.asked == asked:
            goal.heard = clock
        else:
            self._leave(robot)
            sent = self._ways[robot].send_goal_async(self._message(robot, Pose(*numbers)))
            self._goals[robot] = _Goal(asked, clock, sent)

    def _message(self, robot: int, target: Pose) -> Any:
        assert self._kind is not None
        at = onward(self._drives[robot][1], Pose(0.0, 0.0, 0.0), target)
        goal = self._kind.Goal()
        goal.pose.header.frame_id = "map"
        pose = goal.pose.pose
        pose.position.x = at.x
        pose.position.y = at.y
        pose.orientation.z = math.sin(at.theta / 2)
        pose.orientation.w = math.cos(at.theta / 2)
        return goal

    def _leave(self, robot: int) -> None:
        goal = self._goals.pop(robot, None)
        if goal is not None and goal.end is None:
            self._left.append(goal)

    def step(self, clock: Instant) -> None:
        """Take in what has become of the goals, and cancel those that are to be."""
        for robot, goal in list(self._goals.items()):
            if goal.end is None and clock - goal.heard > seconds(1.5):
                self._leave(robot)
            elif goal.end is None and (end := _goal_end(goal)) is not None:
                goal.end = end
                self._news.add(robot)
        for goal in self._left.copy():
            newer = self._goals.get(goal.asked[0])
            if goal.sent.done() and (newer is None or newer.sent.done()):
                self._left.remove(goal)
                if (handle := goal.sent.result()) is not None and handle.accepted:
                    handle.cancel_goal_async()

    def is_news(self, robot: int) -> bool:
        """Return whether the goal of `robot` has ended since this was asked last."""
        found = robot in self._news
        self._news.discard(robot)
        return found

    def told(self, robot: int) -> tuple[tuple[str, tuple[Value, ...]], ...]:
        """Return the fact by which the mind of `robot` hears how its goal has ended, if it has."""
        goal = self._goals.get(robot)
        return () if goal is None or goal.end is None else ((NAVIGATED, (goal.asked[2], goal.end)),)

    def close(self) -> None:
        """Cancel all goals."""
        for robot in list(self._goals):
            self._leave(robot)
        self.step(0)


def _goal_end(goal: _Goal) -> str | None:
    """Return why a goal has failed, an empty text if it has not, None while it is on its way."""
    if not goal.sent.done():
        return None
    if goal.result is None:
        handle = goal.sent.result()
        if handle is None or not handle.accepted:
            return "Nav2 refuses the goal"
        goal.result = handle.get_result_async()
    if not goal.result.done():
        return None
    answer = goal.result.result()
    if answer.status == SUCCEEDED:
        return ""
    what = "somebody has cancelled the goal of Nav2" if answer.status == CANCELED else "Nav2 has given up"
    code = getattr(answer.result, "error_code", 0)
    why = getattr(answer.result, "error_msg", "") or (f"error {code}" if code else "")
    return f"{what}: {why}" if why else what
