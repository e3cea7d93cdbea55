"""Facts from topics: what a lab may say, what an argument takes of a field, and what is told to robots and people."""

import logging
import math
from types import SimpleNamespace

import pytest

from rmr.base.time import NS_PER_S, milliseconds
from rmr.base.values import Robot, Symbol
from rmr_ros import ros_facts
from rmr_ros.ros_facts import FactTopics, TopicFactError, TopicReading, taken
from rmr_world.fact_syntax import TermError, parse_topic_fact


class Battery:
    """A class of messages as rosidl makes them."""

    def __init__(self, voltage=12.0, name="main", present=True):
        self.voltage, self.name, self.present = voltage, name, present
        self.header = SimpleNamespace(frame_id="base")

    @staticmethod
    def get_fields_and_field_types():
        return {
            "header": "std_msgs/Header",
            "voltage": "float",
            "name": "string<=20",
            "present": "boolean",
            "power_supply_status": "uint8",
            "cell_voltage": "sequence<float>",
        }


class Header:
    @staticmethod
    def get_fields_and_field_types():
        return {"stamp": "builtin_interfaces/Time", "frame_id": "string"}


@pytest.fixture(autouse=True)
def messages(monkeypatch):
    def find(package):
        if package == "sensor_msgs.msg":
            return SimpleNamespace(BatteryState=Battery)
        if package == "std_msgs.msg":
            return SimpleNamespace(Header=Header)
        raise ImportError(package)

    monkeypatch.setattr(ros_facts, "import_module", find)


def reading(fact="battery(R, voltage)", types=("float",), kind="sensor_msgs/BatteryState", **more):
    parsed = parse_topic_fact(fact)
    named = {"item": 2, "robot": 4, "topic": "/r4/battery"} | more
    return TopicReading(type=kind, name=parsed.name, args=parsed.args, types=types, every=NS_PER_S, **named)


class Node:
    """A graph with the publishers that it is given, by topic."""

    def __init__(self, **types):
        self.types = {f"/r4/{name}": kind for name, kind in types.items()}
        self.taking = {}

    def get_publishers_info_by_topic(self, topic):
        return [SimpleNamespace(topic_type=self.types[topic])] if topic in self.types else []

    def create_subscription(self, _kind, topic, take, _quality):
        self.taking[topic] = take


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"kind": "sensor_msgs/BatteryStat"}, "sensor_msgs has no messages BatteryStat; did you mean BatteryState?"),
        ({"kind": "power_msgs/Battery"}, "the messages of power_msgs are not installed here"),
        ({"fact": "battery(R, voltag)"}, "sensor_msgs/BatteryState has no field voltag; did you mean voltage?"),
        ({"fact": "battery(R, x)"}, "has no field x; it has header, voltage, name, present"),
        ({"fact": "battery(R, header.frame)"}, "std_msgs/Header has no field frame; did you mean frame_id?"),
        ({"fact": "battery(R, voltage.x)"}, "float has no field x"),
        (
            {"fact": "battery(R, header)"},
            "header is a std_msgs/Header; name a field of it: header.stamp, header.frame_id",
        ),
        (
            {"fact": "battery(R, cell_voltage)"},
            r"cell_voltage is a list \(sequence<float>\); name a field of one value",
        ),
        ({"types": ("int",)}, "argument 2 of 'battery' is a int, and the field voltage a float"),
        ({"fact": "battery(R, 1, present)", "types": ("int", "float")}, "argument 3 of 'battery' is a float"),
    ],
)
def test_what_cannot_be_read_is_named_with_its_place_and_what_there_is(given, why):
    with pytest.raises(TopicFactError, match=r"^facts\.2: .*" + why):
        FactTopics(Node(), [reading(**given)], len)


def test_one_mistake_of_six_robots_is_one_line():
    wrong = [reading("battery(R, voltag)", robot=robot, topic=f"/r{robot}/battery") for robot in range(6)]
    with pytest.raises(TopicFactError) as raised:
        FactTopics(Node(), wrong, len)
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("battery(R, V)", "an argument is a field of the message, such as voltage"),
        ("battery(R, 1..5)", "an argument is a field"),
        ("battery(R)", r"holds nothing of the message: name a field of it"),
        ("battery(voltage)", "the first argument is the owner"),
        ("battery", r"expected '\('"),
    ],
)
def test_a_fact_names_its_owner_and_a_field(text, why):
    with pytest.raises(TermError, match=why):
        parse_topic_fact(text)


@pytest.mark.parametrize(
    ("value", "kind", "found"),
    [
        (0.5, "float", 0.5),
        (3, "float", 3.0),
        (3, "int", 3),
        (0.5, "int", None),
        (math.nan, "float", None),
        (math.inf, "open", None),
        (True, "bool", True),
        (True, "int", None),
        (1, "bool", None),
        ("dock", "symbol", Symbol("dock")),
        ("Dock 1", "symbol", None),
        ("Dock 1", "string", "Dock 1"),
        (4, "robot", Robot(4)),
        (70_000, "robot", None),
        (2**64, "int", None),
        ("x", "list", None),
    ],
)
def test_an_argument_takes_only_what_is_of_its_type(value, kind, found):
    assert taken(value, kind) == found
    assert type(taken(value, kind)) is type(found)


def test_the_newest_message_is_read_every_so_often_and_told_again_each_second():
    node = Node(battery="sensor_msgs/msg/BatteryState")
    topics = FactTopics(node, [reading('battery(R, voltage, "main")', ("float", "string"))], len)
    topics.look(0)
    for k, voltage in enumerate((12.0, 11.0, 10.0)):
        node.taking["/r4/battery"](Battery(voltage))
        topics.step(k * milliseconds(300))
        told = topics.told(4, k * milliseconds(300))
        assert told == ((("battery", (12.0, "main")),) if k == 0 else None)
    topics.step(NS_PER_S)
    assert topics.told(4, NS_PER_S) == (("battery", (10.0, "main")),)
    assert topics.told(4, NS_PER_S + 1) is None
    assert topics.told(4, 2 * NS_PER_S) == (("battery", (10.0, "main")),)
    assert topics.told(5, 2 * NS_PER_S) is None


def test_a_topic_without_a_publisher_or_of_another_type_is_named_once(caplog):
    caplog.set_level(logging.WARNING, "rmr")
    node = Node(wrong="std_msgs/msg/String")
    topics = FactTopics(node, [reading(), reading(topic="/r4/wrong")], len)
    for second in range(12):
        topics.look(second * NS_PER_S)
    assert [each.message for each in caplog.records] == [
        "robot 4: /r4/wrong has the type std_msgs/msg/String, and the lab says sensor_msgs/msg/BatteryState",
        "robot 4: nobody publishes /r4/battery (sensor_msgs/msg/BatteryState): no battery comes from there",
    ]
    node.types["/r4/battery"] = "sensor_msgs/msg/BatteryState"
    topics.look(20 * NS_PER_S)
    node.taking["/r4/battery"](Battery())
    topics.step(20 * NS_PER_S)
    assert topics.told(4, 20 * NS_PER_S) == (("battery", (12.0,)),)


def test_a_value_that_an_argument_does_not_take_leaves_the_fact_and_is_named_once(caplog):
    node = Node(battery="sensor_msgs/msg/BatteryState")
    topics = FactTopics(node, [reading()], len)
    topics.look(0)
    for second, voltage in enumerate((12.0, math.nan, math.nan)):
        node.taking["/r4/battery"](Battery(voltage))
        topics.step(second * NS_PER_S)
    assert topics.told(4, 3 * NS_PER_S) == (("battery", (12.0,)),)
    assert [each.message for each in caplog.records] == [
        "robot 4: /r4/battery has a value that 'battery' does not take"
    ]
