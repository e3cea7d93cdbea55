"""Actions of ROS 2: what a lab may say, what a field takes of an argument, and how an action ends."""

import math
from types import SimpleNamespace

import pytest

from rmr.base.geometry import Pose
from rmr.base.time import NS_PER_S, seconds
from rmr.base.values import Robot, Symbol
from rmr_ros import ros_facts
from rmr_ros.ros_actions import ActionCall, Nav2Drives, RosActions, fitting
from rmr_ros.ros_facts import TopicFactError
from rmr_world.fact_syntax import TermError, parse_ros_action


class Light:
    """A class of messages as rosidl makes them."""

    def __init__(self):
        self.level, self.on, self.name, self.header = 0, False, "", Header()

    @staticmethod
    def get_fields_and_field_types():
        return {"header": "std_msgs/Header", "level": "uint8", "on": "boolean", "name": "string<=4", "way": "double[3]"}


class Header:
    frame_id = ""

    @staticmethod
    def get_fields_and_field_types():
        return {"frame_id": "string"}


@pytest.fixture(autouse=True)
def messages(monkeypatch):
    def find(package):
        packages = {
            "lamp.msg": SimpleNamespace(Light=Light),
            "lamp.srv": SimpleNamespace(Shine=SimpleNamespace(Request=Light)),
            "std_msgs.msg": SimpleNamespace(Header=Header),
        }
        if package not in packages:
            raise ImportError(package)
        return packages[package]

    monkeypatch.setattr(ros_facts, "import_module", find)


class Future:
    """An answer that the test gives."""

    def __init__(self):
        self.answer = self.error = None

    def done(self):
        return self.answer is not None or self.error is not None

    def exception(self):
        return self.error

    def result(self):
        return self.answer


class Node:
    """A graph with the ends that it is given: names and types; it is the client and the publisher, too."""

    def __init__(self, **ends):
        self.ends = {f"/r4/{name}": kind for name, kind in ends.items()}
        self.said = []
        self.calls = []
        self.dropped = []

    def get_service_names_and_types(self):
        return [(name, [kind]) for name, kind in self.ends.items()]

    def get_subscriptions_info_by_topic(self, topic):
        return [SimpleNamespace(topic_type=self.ends[topic])] if topic in self.ends else []

    def create_client(self, _kind, _end):
        return self

    def create_publisher(self, _kind, _end, _quality):
        return self

    def service_is_ready(self):
        return bool(self.ends)

    get_subscription_count = service_is_ready

    def publish(self, message):
        self.said.append(message)

    def call_async(self, message):
        self.calls.append((message, Future()))
        return self.calls[-1][1]

    def remove_pending_request(self, future):
        self.dropped.append(future)


def call(action="shine(R, level)", types=("int",), kind="lamp/Light", end="lamp", called=False, fields=()):
    name, _, paths = parse_ros_action(action)
    return ActionCall(2, 4, name, types, paths, fields, kind, f"/r4/{end}", called, seconds(5.0))


def made(node, *calls):
    actions = RosActions(node, calls, lambda _infos, out: out)
    assert list(actions.missing()) == []
    return actions


ASKED = (4, 77, 1)


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"kind": "lamp/Ligt"}, "lamp has no messages Ligt; did you mean Light?"),
        ({"kind": "lamp/Shin", "called": True}, "lamp has no services Shin; did you mean Shine?"),
        ({"kind": "crane/Lift"}, "the messages of crane are not installed here"),
        ({"kind": "crane/Lift", "called": True}, "the services of crane are not installed here"),
        ({"action": "shine(R, levl)"}, "lamp/Light has no field levl; did you mean level?"),
        ({"action": "shine(R, header)"}, "header is a std_msgs/Header; name a field of it: header.frame_id"),
        ({"action": "shine(R, way)"}, r"the field way is a list \(double\[3\]\); name a field of one value"),
        ({"types": ("float",)}, "argument 2 of 'shine' is a float, and the field level a uint8"),
        ({"types": ("list",)}, "argument 2 of 'shine' is a list, and the field level a uint8"),
        ({"fields": (("level", 256),)}, "the field level is a uint8, not 256"),
        ({"fields": (("lit", True),)}, "lamp/Light has no field lit"),
    ],
)
def test_what_cannot_be_said_is_named_with_its_place_and_what_there_is(given, why):
    with pytest.raises(TopicFactError, match=r"^actions\.2: .*" + why):
        RosActions(Node(), [call(**given)], len)


@pytest.mark.parametrize(
    ("value", "kind", "found"),
    [
        (1, "uint8", 1),
        (-1, "uint8", None),
        (256, "uint8", None),
        (-128, "int8", -128),
        (2**63 - 1, "int64", 2**63 - 1),
        (0.5, "int32", None),
        (2, "float", 2.0),
        (1e39, "float", None),
        (math.inf, "float", math.inf),
        (1e39, "double", 1e39),
        (True, "boolean", True),
        (1, "boolean", None),
        (True, "uint8", None),
        (Robot(4), "uint16", 4),
        (Symbol("dock"), "string", "dock"),
        ("dock", "string<=4", "dock"),
        ("docks", "string<=4", None),
        (1, "string", None),
        ("a", "double", None),
        ((1,), "uint8", None),
        (1, "std_msgs/Header", None),
    ],
)
def test_a_field_takes_only_what_is_of_its_type(value, kind, found):
    assert fitting(value, kind) == found
    assert type(fitting(value, kind)) is type(found)


@pytest.mark.parametrize("text", ["shine(R, 4)", "shine(R, X)", "shine(R, 1..5)", "shine(R, [a])", 'shine(R, "a")'])
def test_an_argument_is_a_field_or_none(text):
    with pytest.raises(TermError, match="an argument is the field that gets it, such as data"):
        parse_ros_action(text)


def test_the_name_alone_is_an_action_without_arguments():
    assert parse_ros_action("close") == parse_ros_action("close(R)") == ("close", None, ())
    assert parse_ros_action("tell(@4, _, header.frame_id)") == ("tell", 4, (None, "header.frame_id"))
    with pytest.raises(TermError, match="the first argument is the owner"):
        parse_ros_action("close(data)")


def test_a_message_has_what_arguments_and_fields_say():
    node = Node(lamp="lamp/msg/Light")
    fields = (("header.frame_id", "base"), ("on", True))
    actions = made(node, call("shine(R, _, level, name)", ("float", "int", "symbol"), fields=fields))
    actions.perform(ASKED, "shine", (0.5, 9, Symbol("red")), 0)
    (said,) = node.said
    assert (said.level, said.on, said.name, said.header.frame_id) == (9, True, "red", "base")
    assert list(actions.ended()) == [(ASKED, "")]


@pytest.mark.parametrize(
    ("ends", "called", "why"),
    [
        ({}, True, "robot 4: nobody serves /r4/lamp (lamp/srv/Light): start its node, or correct the name under"),
        ({}, False, "robot 4: nobody subscribes to /r4/lamp (lamp/msg/Light): start its node, or correct the name"),
        ({"lamp": "a/srv/B"}, True, "robot 4: /r4/lamp has the type a/srv/B, and the lab says lamp/srv/Light"),
        ({"lamp": "a/msg/B"}, False, "robot 4: /r4/lamp has the type a/msg/B, and the lab says lamp/msg/Light"),
    ],
)
def test_an_action_that_nobody_is_there_for_is_named_until_somebody_comes(ends, called, why, monkeypatch):
    shine = SimpleNamespace(Light=SimpleNamespace(Request=Light)) if called else SimpleNamespace(Light=Light)
    monkeypatch.setattr(ros_facts, "import_module", lambda _package: shine)
    node = Node(**ends)
    actions = RosActions(node, [call(called=called)], lambda _infos, out: out)
    (said,) = actions.missing()
    assert said.startswith(why)
    node.ends = {"/r4/lamp": f"lamp/{'srv' if called else 'msg'}/Light"}
    assert list(actions.missing()) == []


def test_what_is_asked_again_is_not_done_again_and_its_end_is_told_again():
    node = Node(lamp="lamp/srv/Shine")
    actions = made(node, call(kind="lamp/Shine", called=True))
    for _ in range(3):
        actions.perform(ASKED, "shine", (1,), 0)
        actions.step(NS_PER_S)
    assert list(actions.ended()) == []
    ((_, future),) = node.calls
    future.answer = SimpleNamespace(success=True)
    actions.step(NS_PER_S)
    actions.perform(ASKED, "shine", (1,), NS_PER_S)
    assert list(actions.ended()) == [(ASKED, "")] * 2
    actions.perform((4, 78, 1), "shine", (1,), NS_PER_S)
    assert len(node.calls) == 2, "another process of the same robot counts anew"


@pytest.mark.parametrize(
    ("answer", "error", "why"),
    [
        (SimpleNamespace(success=False, message="jammed"), None, "/r4/lamp: jammed"),
        (SimpleNamespace(success=False), None, "/r4/lamp: it says no success"),
        (SimpleNamespace(), None, ""),
        (None, RuntimeError("broken"), "/r4/lamp: broken"),
    ],
)
def test_an_answer_says_whether_the_action_has_failed(answer, error, why):
    node = Node(lamp="lamp/srv/Shine")
    actions = made(node, call(kind="lamp/Shine", called=True))
    actions.perform(ASKED, "shine", (1,), 0)
    node.calls[0][1].answer, node.calls[0][1].error = answer, error
    actions.step(NS_PER_S)
    assert list(actions.ended()) == [(ASKED, why)]


def test_what_goes_wrong_later_fails_the_action_in_a_sentence():
    node = Node(lamp="lamp/msg/Light", shine="lamp/srv/Shine")
    served = call("call(R, level)", kind="lamp/Shine", called=True, end="shine")
    actions = made(node, call(), served)
    actions.perform((4, 77, 1), "shine", (300,), 0)
    actions.perform((4, 77, 2), "dim", (), 0)
    actions.perform((4, 77, 3), "call", (3,), 0)
    actions.step(seconds(4.9))
    actions.step(seconds(5.0))
    node.ends = {}
    actions.perform((4, 77, 4), "shine", (3,), 0)
    actions.perform((4, 77, 5), "call", (3,), 0)
    assert [why for _, why in actions.ended()] == [
        "level is a uint8, which 300 is not",
        "the lab file has no dim of robot 4 under actions",
        "no answer of /r4/shine within 5 s",
        "nobody subscribes to /r4/lamp any more",
        "nobody serves /r4/shine any more",
    ]
    assert node.said == []
    assert node.dropped == [node.calls[0][1]]


def test_an_action_that_is_broken_off_is_not_waited_for():
    node = Node(lamp="lamp/srv/Shine")
    actions = made(node, call(kind="lamp/Shine", called=True))
    actions.perform(ASKED, "shine", (1,), 0)
    actions.cancel(ASKED)
    actions.step(seconds(9.0))
    assert node.dropped == [node.calls[0][1]]
    assert list(actions.ended()) == []


class Goal:
    """A handle of a goal."""

    def __init__(self, accepted=True):
        self.accepted = accepted
        self.result = Future()
        self.cancelled = 0

    def get_result_async(self):
        return self.result

    def cancel_goal_async(self):
        self.cancelled += 1


class Nav2:
    """An action client whose server the test plays; it is the module nav2_msgs.action, too."""

    def __init__(self):
        self.ready = True
        self.sent = []
        self.NavigateToPose = SimpleNamespace(Goal=self.goal)

    @staticmethod
    def goal():
        parts = SimpleNamespace(position=SimpleNamespace(x=0.0, y=0.0), orientation=SimpleNamespace(z=0.0, w=1.0))
        return SimpleNamespace(pose=SimpleNamespace(header=SimpleNamespace(frame_id=""), pose=parts))

    def server_is_ready(self):
        return self.ready

    def send_goal_async(self, goal):
        self.sent.append((goal.pose.pose.position.x, goal.pose.pose.position.y, Future()))
        return self.sent[-1][2]

    def accept(self, index=-1, accepted=True):
        self.sent[index][2].answer = goal = Goal(accepted)
        return goal


@pytest.fixture
def nav2(monkeypatch):
    found = Nav2()
    monkeypatch.setattr(ros_facts, "import_module", lambda _package: found)
    found.drives = Nav2Drives({4: ("/r4/nav", Pose(1.0, 2.0, math.pi / 2))}, lambda _kind, _name: found)
    return found


def test_a_goal_is_given_in_the_frame_of_the_map_and_its_end_is_told(nav2):
    nav2.drives.go(ASKED, (0.5, 0.1, 0.0), 0)
    nav2.drives.go(ASKED, (0.5, 0.1, 0.0), NS_PER_S)
    ((x, y, _),) = nav2.sent
    assert (x, y) == pytest.approx((0.9, 2.5))
    nav2.drives.step(NS_PER_S)
    assert (nav2.drives.told(4), nav2.drives.is_news(4)) == ((), False)
    nav2.accept().result.answer = SimpleNamespace(status=4, result=SimpleNamespace())
    nav2.drives.step(NS_PER_S)
    assert nav2.drives.told(4) == (("navigated", (1, "")),)
    assert (nav2.drives.is_news(4), nav2.drives.is_news(4)) == (True, False)


@pytest.mark.parametrize(
    ("status", "result", "why"),
    [
        (6, SimpleNamespace(error_code=103, error_msg="no path"), "Nav2 has given up: no path"),
        (6, SimpleNamespace(error_code=103, error_msg=""), "Nav2 has given up: error 103"),
        (6, SimpleNamespace(), "Nav2 has given up"),
        (5, SimpleNamespace(error_code=0), "somebody has cancelled the goal of Nav2"),
    ],
)
def test_a_goal_that_fails_is_told_with_what_nav2_says(nav2, status, result, why):
    nav2.drives.go(ASKED, (0.5, 0.1, 0.0), 0)
    nav2.accept().result.answer = SimpleNamespace(status=status, result=result)
    nav2.drives.step(0)
    assert nav2.drives.told(4) == (("navigated", (1, why)),)


def test_a_goal_that_is_refused_fails(nav2):
    nav2.drives.go(ASKED, (0.5, 0.1, 0.0), 0)
    nav2.accept(accepted=False)
    nav2.drives.step(0)
    assert nav2.drives.told(4) == (("navigated", (1, "Nav2 refuses the goal")),)


def test_a_newer_goal_takes_the_place_of_an_older_one_which_is_cancelled_when_the_newer_is_accepted(nav2):
    nav2.drives.go(ASKED, (0.5, 0.1, 0.0), 0)
    old = nav2.accept()
    nav2.drives.step(0)
    nav2.drives.go((4, 77, 2), (0.9, 0.1, 0.0), 0)
    nav2.drives.step(0)
    assert old.cancelled == 0
    new = nav2.accept()
    old.result.answer = SimpleNamespace(status=6, result=SimpleNamespace())
    nav2.drives.step(0)
    assert (old.cancelled, new.cancelled, nav2.drives.told(4)) == (1, 0, ())


def test_a_goal_is_cancelled_when_its_mind_says_so_when_it_says_nothing_and_at_the_end(nav2):
    for number, leave in enumerate(
        (
            lambda asked: nav2.drives.go(asked, (), 0),
            lambda _: nav2.drives.step(seconds(1.6)),
            lambda _: nav2.drives.close(),
        )
    ):
        asked = (4, 77, number)
        nav2.drives.go(asked, (0.5, 0.1, 0.0), 0)
        goal = nav2.accept()
        nav2.drives.step(seconds(1.4))
        assert goal.cancelled == 0
        nav2.drives.go((4, 77, 99), (), 0)
        leave(asked)
        nav2.drives.step(0)
        assert goal.cancelled == 1
        assert nav2.drives.told(4) == ()


def test_a_nav2_that_is_not_there_is_named(nav2, monkeypatch):
    nav2.ready = False
    assert list(nav2.drives.missing()) == [
        "robot 4: nobody serves /r4/nav (nav2_msgs/action/NavigateToPose): start its Nav2, or correct the name under "
        "bodies"
    ]

    def none(package):
        raise ImportError(package)

    monkeypatch.setattr(ros_facts, "import_module", none)
    with pytest.raises(
        TopicFactError, match=r"^bodies: the actions of nav2_msgs are not installed here; source the set-up"
    ):
        Nav2Drives({4: ("/r4/nav", Pose(0.0, 0.0, 0.0))}, lambda _kind, _name: None)
    assert Nav2Drives({}, lambda _kind, _name: None).drives(4) is False
