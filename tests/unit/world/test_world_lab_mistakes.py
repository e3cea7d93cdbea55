"""The lab file: every mistake with its line and column, all at once."""

import pytest
from world_labs import ROOM, complaints, lab_of, problems_of

from rmr.radio.links import DISTURBANCES_MAX
from rmr_world.finding import LabError
from rmr_world.lab import ros_name
from rmr_world.lab_file import load_lab

TWO = ROOM.replace("  - {id: 1", "  - {id: 2, pose: [1, 1, 0]}\n  - {id: 1")

# Mistakes

MISTAKES = [
    ("colour: red", "6:1: colour: unknown key; known are "),
    ("robt: {radius: 0.07}", "6:1: robt: unknown key; did you mean 'robot'?"),
    ("robot: {radios: 0.07}", "6:9: robot.radios: unknown key; did you mean 'radius'?"),
    ("robot: {view: {depht: 1}}", "6:16: robot.view.depht: unknown key; did you mean 'depth'?"),
    ("seed: 7\nseed: 8", "7:1: seed: repeated key; it stands in line 6 already"),
    ("lab: twice", "6:1: lab: repeated key; it stands in line 1 already"),
    ("seed: seven", "6:7: seed: should be a valid integer, not 'seven'"),
    ("seed: 1.5", "6:7: seed: should be a valid integer, not 1.5"),
    ("seed: -7", "6:7: seed: should be greater than or equal to 0"),
    ("seed: 1000000000000000000", "6:7: seed: should be a valid integer, not 1e+18"),
    ("seed: true", "6:7: seed: should be a valid integer, not True"),
    ("duration: 120 m", "6:11: duration: should be a duration such as 120s, 500ms or 1.5min, not '120 m'"),
    ("duration: -3", "6:11: duration: should be a duration"),
    ("duration: 0s", "6:11: duration: should be greater than 0"),
    ("duration: 1e99", "6:11: duration: should be at most 1000000 s"),
    ("robot: {turn: 180 degrees}", "6:15: robot.turn: should be an angle such as 90deg, or a number of radians"),
    ("robot: {turn: 0}", "6:8: robot: turn should be above 0"),
    ("robot: {radius: '0.07'}", "6:17: robot.radius: should be a valid number, not '0.07'"),
    ("robot: {radius: .inf}", "6:17: robot.radius: should be a valid number, not '.inf'"),
    ("robot: {speed: 0}", "6:16: robot.speed: should be greater than 0"),
    ("robot: {view: {angle: 400deg}}", "6:15: robot.view: angle should be above 0 and at most 360deg"),
    ("robot: 3", "6:8: robot: should be a mapping with the keys radius, speed, turn, view, not 3"),
    ("areas: 3", "6:8: areas: should be a mapping, not 3"),
    ("areas: {a: {at: 3}}", "6:17: areas.a.at: should be a list of 2, not 3"),
    ("facts: due(@1)", "6:8: facts: should be a list, not 'due(@1)'"),
    ("radio: {loss: 1.5}", "6:15: radio.loss: should be less than or equal to 1"),
    ("radio: {interference: capture}", "6:23: radio.interference: should be 'capture_3db' or 'awgn', not 'capture'"),
    ("radio: {seed: x}", "6:15: radio.seed: should be a valid integer"),
    ("localisation: {beacons: [[0, 0], [9, 0]]}", "6:34: localisation.beacons.1: is out of the arena, 3 m x 1.5 m"),
    ("localisation: {rate: 0}", "6:22: localisation.rate: should be greater than 0"),
    ("bodies: real", "6:9: bodies: should be simulated, or a list: [{robots: 4-6, ros2: {namespace: '/robot_{id}'}}]"),
    ("bodies: [{robots: 1}]", "6:10: bodies.0.ros2: is missing"),
    ("bodies: [{robots: 1, ros2: {}}]", "6:28: bodies.0.ros2.namespace: is missing"),
    (
        "bodies: [{ros2: {namespace: tb3_4}}]",
        "6:29: bodies.0.ros2.namespace: should be a namespace of ROS 2 such as /robot_{id}: a / before each name of "
        "letters, digits and _, not 'tb3_4'",
    ),
    ("bodies: [{ros2: {namespace: /a-b}}]", "6:29: bodies.0.ros2.namespace: should be a namespace of ROS 2"),
    ("bodies: [{ros2: {namespace: /a/}}]", "6:29: bodies.0.ros2.namespace: should be a namespace of ROS 2"),
    (
        "bodies: [{ros2: {namespace: /a, odom: 4x}}]",
        "6:39: bodies.0.ros2.odom: should be a topic of ROS 2",
    ),
    ("bodies: [{ros2: {namespace: /a, odm: x}}]", "6:33: bodies.0.ros2.odm: unknown key; did you mean 'odom'?"),
    ("bodies: [{ros2: {namespace: /a, sigma: 0}}]", "6:40: bodies.0.ros2.sigma: should be greater than 0"),
    ("bodies: [{ros2: {namespace: /a, pose: odom}}]", "6:10: bodies.0: robot 1 has the topic /a/odom twice"),
    ("bodies: [{ros2: {namespace: /a, scan: odom}}]", "6:10: bodies.0: robot 1 has the topic /a/odom twice"),
    ("bodies: [{ros2: {namespace: /a, scan_at: [0, 0]}}]", "6:42: bodies.0.ros2.scan_at.2: is missing"),
    ("bodies: [{robots: 4, ros2: {namespace: /a}}]", "6:19: bodies.0.robots: robot 4 is not in this lab"),
    (
        "bodies: [{ros2: {namespace: /a}}, {robots: 1, ros2: {namespace: /b}}]",
        "6:35: bodies.1: robot 1 has a body already",
    ),
    ("facts: [{topic: b, fact: 'b(R, v)'}]", "6:9: facts.0.type: is missing"),
    (
        "facts: [{topic: b, type: Battery, fact: 'b(R, v)'}]",
        "6:26: facts.0.type: should be a type of messages such as sensor_msgs/BatteryState, not 'Battery'",
    ),
    ("facts: [{topic: 4x, type: a/B, fact: 'b(R, v)'}]", "6:17: facts.0.topic: should be a topic of ROS 2"),
    (
        "facts: [{topic: b, type: a/B, fact: 'b(R, v)', evry: 1s}]",
        "6:48: facts.0.evry: unknown key; did you mean 'every'?",
    ),
    ("facts: [{topic: b, type: a/B, fact: 'b(R, v)', every: 0s}]", "6:55: facts.0.every: should be greater than 0"),
    ("facts: [{topic: b, type: a/B, fact: 'b(R, V)'}]", "6:37: facts.0.fact: an argument is a field of the message"),
    ("facts: [{topic: b, type: a/B, fact: 'b(@9, v)'}]", "6:37: facts.0.fact: robot 9 is not in this lab"),
    ("actions: act.rb", "6:10: actions: should be a Python file, FILE.py, not 'act.rb'"),
    ("actions: [act.py]", "6:10: actions: there is no file "),
    ("actions: [{action: b, type: a/B}]", "6:11: actions.0: should have exactly one of topic, service"),
    (
        "actions: [{action: b, type: a/B, topic: c, service: d}]",
        "6:11: actions.0: should have exactly one of topic, service, not topic and service",
    ),
    ("actions: [{action: b, topic: c}]", "6:11: actions.0.type: is missing"),
    (
        "actions: [{action: b, topic: c, type: a/B, feilds: {}}]",
        "6:44: actions.0.feilds: unknown key; did you mean 'fields'?",
    ),
    (
        "actions: [{action: 'b(R, 4)', topic: c, type: a/B}]",
        "6:20: actions.0.action: an argument is the field that gets it",
    ),
    ("actions: [{action: 'b(@9)', topic: c, type: a/B}]", "6:20: actions.0.action: robot 9 is not in this lab"),
    (
        "actions: [{action: b, topic: c, type: a/B}, {action: b(@1), service: d, type: a/B}]",
        "6:54: actions.1.action: 'b' of the same robot stands in actions.0, too",
    ),
    ("actions: [{action: b, service: c, type: a/B, within: 0s}]", "6:54: actions.0.within: should be greater than 0"),
    ("facts: ['due(@1, a.b)']", "6:9: facts.0: expected a value, found 'a.b'"),
    ("facts: [4]", "6:9: facts.0: should be a valid string, not 4; a fact is text"),
    ("obstacles: [{box: [1, 1, 0, 2]}]", "6:13: obstacles.0: box should be [x0, y0, x1, y1] with x0 < x1"),
    ("obstacles: [{box: [0, 0, 1]}]", "6:19: obstacles.0.box.3: is missing"),
    ("obstacles: [{}]", "6:13: obstacles.0: should have exactly one of box, circle, polygon"),
    ("obstacles: [{circle: [1, 1, 0]}]", "6:29: obstacles.0.circle.2: should be greater than 0"),
    ("obstacles: [{circle: [9, 9, 0.1]}]", "6:13: obstacles.0: lies outside the arena"),
    ("obstacles: [{polygon: [[0,0],[1,1],[1,0],[0,1]]}]", "6:13: obstacles.0: polygon crosses or touches itself"),
    ("obstacles: [{polygon: [[0,0],[1,0]]}]", "6:23: obstacles.0.polygon: should have at least 3 items"),
    ("obstacles: [{box: [0.4, 0.5, 0.6, 1]}]", "5:5: robots.0: robot 1 starts inside an obstacle"),
    ("areas: {a: {at: [4, 1]}}", "6:17: areas.a.at: (4, 1) is out of the arena, 3 m x 1.5 m"),
    ("areas: {a: {at: [0.01, 1]}}", "6:17: areas.a.at: a robot of radius 0.07 m does not fit at (0.01, 1)"),
    ("areas: {A: {at: [1, 1]}}", "6:9: areas.A: should be letters, digits and _, a small letter first, not 'A'"),
    ("areas: {a: {}}", "6:12: areas.a: should have exactly one of at, slots, line, box"),
    (
        "areas: {a: {at: [1, 1], box: [0, 0, 1, 1]}}",
        "6:12: areas.a: should have exactly one of at, slots",
    ),
    ("areas: {a: {slots: [[1, 1], [1, 9]]}}", "6:29: areas.a.slots.1: it is out of the arena"),
    ("areas: {a: {slots: [[1, 1], [1, 1.1]]}}", "6:20: areas.a.slots: places 0 and 1 are closer than two robots"),
    ("areas: {a: {slots: []}}", "6:20: areas.a.slots: should have at least 1 item"),
    ("areas: {a: {box: [0, 0, 9, 1]}}", "6:18: areas.a.box: it is out of the arena"),
    ("areas: {a: {line: {from: [1, 1], to: [2, 1], count: 1}}}", "6:53: areas.a.line.count: should be greater than"),
    ("areas: {a: {line: {from: [1, 1], to: [1.5, 1], count: 9}}}", "6:19: areas.a.line: places 0 and 1 are closer"),
    (
        "areas: {a: {at: [1, 1], queue: {path: [[1, 1], [9, 1]], spacing: 0.2}}}",
        "6:32: areas.a.queue: (3.2, 1) is out of the arena",
    ),
    (
        "areas: {a: {at: [1, 1], queue: {path: [[1, 1], [2, 1]], spacing: 0.1}}}",
        "6:66: areas.a.queue.spacing: places 0 and 1 are closer than two robots",
    ),
    ("areas: {a: {at: [1, 1], queue: {path: [[1, 1], [2, 1]], spacing: 0}}}", "6:66: areas.a.queue.spacing: should be"),
    ("areas: {a: {at: [1, 1], queue: {path: [[1, 1], [2, 1]], spacing: 1e-9}}}", "6:12: areas.a: queue has more than"),
    ("bottleneck: entri\nareas: {entry: {at: [1, 1]}}", "6:13: bottleneck: area 'entri' is not defined; did you mean"),
    (
        "bottleneck: {mouths: [entry]}\nareas: {entry: {at: [1, 1]}}",
        "6:13: bottleneck: mouths should name two areas; for one entry write its name alone: entry",
    ),
    ("bottleneck: {mouths: []}", "6:22: bottleneck.mouths: should have at least 1 item"),
    ("facts: ['due(@1, 5)', 'due(@2, 5)']", "6:23: facts.1: robot 2 is not in this lab"),
    ("facts: ['due(@1, 5']", "6:9: facts.0: expected ',' or ')', found the end"),
    ("robot: {radius: 1e-9}", "6:17: robot.radius: should be greater than or equal to 0.001, not 1e-09"),
    ("robot: {speed: 1e300}", "6:16: robot.speed: should be less than or equal to 10, not 1e+300"),
    ("robot: {turn: 1e300}", "6:15: robot.turn: should be at most 1000 rad, not 1e+300"),
    ("facts: [3]", "6:9: facts.0: should be a valid string, not 3"),
    ("finish: at(@1, exit)", "6:9: finish: every robot must hold it, so its owner is a variable: at(R, ...)"),
    ("finish: at(R, exit)", "6:9: finish: area 'exit' is not defined"),
    ("finish: at(R)", "6:9: finish: at has two arguments"),
    ("faults: [{at: 5s, kill: 4}]", "6:10: faults.0: robot 4 is not in this lab"),
    ("faults: [{kill: 1}]", "6:10: faults.0: kill and restart need at; all others need from and to"),
    ("faults: [{from: 5s, to: 4s, loss: 0.5}]", "6:10: faults.0: should begin before it ends"),
    ("faults: [{at: 5s, from: 1s, kill: 1}]", "6:10: faults.0: kill and restart need at"),
    ("faults: [{at: 5s, explode: 1}]", "6:19: faults.0.explode: unknown key"),
    ("faults: [{from: 1s, to: 2s, partition: [[1], [1]]}]", "6:40: faults.0.partition: robot 1 is named twice"),
    ("faults: [{from: 1s, to: 2s, partition: [[1], [2]]}]", "6:40: faults.0.partition: robot 2 is not in this lab"),
    ("faults: [{from: 1s, to: 2s, partition: [[1]]}]", "6:40: faults.0.partition: should have at least 2 items"),
    ("faults: [{from: 1s, to: 2s, partition: [[1], []]}]", "6:46: faults.0.partition.1: should be ids such as 2-3"),
    ("faults: [{from: 1s, to: 1s, cut: true}]", "6:10: faults.0: should begin before it ends"),
    ("faults: [{from: 1s, to: 2s, loss: 1.5}]", "6:35: faults.0.loss: should be less than or equal to 1"),
    ("faults: [{from: 1s, to: 2s, loss: 1, cut: true}]", "6:10: faults.0: should have exactly one of kill, restart"),
    ("faults: [{from: 1s, to: 2s, link: [1, 1]}]", "6:10: faults.0: should have exactly one of kill, restart"),
    ("faults: [{from: 1s, to: 2s, link: [1, 2], stall: 1}]", "6:10: faults.0: link goes with loss, attenuation_db or"),
    ("faults: [{from: 1s, to: 2s, one_way: true, loss: 1}]", "6:10: faults.0: one_way needs link"),
    ("faults: [{from: 1s, to: 2s, link: [1, 2], loss: 1}]", "6:35: faults.0.link: robot 2 is not in this lab"),
    ("faults: [{from: 1s, to: 2s, link: [1], loss: 1}]", "6:35: faults.0.link.1: is missing"),
    ("radio: {shadowing_db: 31}", "6:23: radio.shadowing_db: should be less than or equal to 30"),
    ("radio: {bursts: {good: 2s}}", "6:17: radio.bursts.bad: is missing"),
    ("radio: {bursts: {good: 2s, bad: 0s}}", "6:17: radio.bursts: the mean lengths of good and bad times lie between"),
    ("radio: {bursts: {good: 2s, bad: 1s, loss: 2}}", "6:43: radio.bursts.loss: should be less than or equal to 1"),
    ("radio: {links: [{link: [1, 1], loss: 1}]}", "6:24: radio.links.0.link: robot 1 is named twice"),
    ("radio: {links: [{link: [1, 9], loss: 1}]}", "6:24: radio.links.0.link: robot 9 is not in this lab"),
    ("radio: {links: [{link: [1, 9]}]}", "6:17: radio.links.0: should have exactly one of loss, attenuation_db, cut"),
    ("radio: {links: [{loss: 1}]}", "6:17: radio.links.0.link: is missing"),
    ("radio: {links: [{link: [1, 9], cut: false}]}", "6:37: radio.links.0.cut: should be true; a link that is not to"),
    ("radio: {links: [{link: [1, 9], attenuation_db: -1}]}", "6:48: radio.links.0.attenuation_db: should be greater"),
    ("radio: {links: [{link: [1, 9], lost: 1}]}", "6:32: radio.links.0.lost: unknown key; did you mean 'loss'?"),
    ("radio: {partition: [[1], 1]}", "6:20: radio.partition: robot 1 is named twice"),
]


@pytest.mark.parametrize(("line", "complaint"), MISTAKES, ids=[line[:40] for line, _ in MISTAKES])
def test_a_mistake_is_named_with_its_line_column_and_path(tmp_path, line, complaint):
    found = complaints(tmp_path, ROOM + line + "\n")
    assert [text[: len(complaint)] for text in found] == [complaint]


def test_two_robots_with_the_same_topics_are_told_to_have_their_id_in_the_namespace(tmp_path):
    (found,) = complaints(tmp_path, TWO + "bodies: [{ros2: {namespace: /tb3}}]\n")
    assert found.endswith("robots 1 and 2 have the same topic /tb3/odom: put {id} into the namespace")


def test_bodies_in_ros_2_have_the_topics_of_their_robot(tmp_path):
    entry = "bodies: [{robots: 2, ros2: {namespace: '/tb3_{id}', pose: '/mocap/r{id}', origin: [1, -2, 90deg]}}]\n"
    lab = lab_of(tmp_path, TWO + entry)
    assert [(body.robot, body.odom, body.cmd_vel, body.pose) for body in lab.bodies] == [
        (2, "/tb3_2/odom", "/tb3_2/cmd_vel", "/mocap/r2")
    ]
    assert tuple(lab.bodies[0].origin) == pytest.approx((1.0, -2.0, 1.5708), abs=1e-4)
    assert lab.with_robots(1).bodies == lab.bodies  # robot 2 is the first in the file
    assert lab_of(tmp_path, TWO + "bodies: simulated\n").bodies == ()
    at_root = lab_of(tmp_path, ROOM + "bodies: [{ros2: {namespace: /}}]\n")
    assert at_root.bodies[0].odom == "/odom"


def test_facts_of_topics_are_apart_from_those_of_the_start_which_keep_their_place(tmp_path):
    entry = "{topic: battery, type: sensor_msgs/BatteryState, fact: 'battery(R, voltage)', every: 500ms}"
    lab = lab_of(tmp_path, TWO + f"facts:\n  - {entry}\n  - due(@1, 20..60)\n  - {entry.replace('R,', '@2,')}\n")
    assert (lab.facts, lab.fact_items) == (("due(@1, 20..60)",), (1,))
    assert lab.given == ["due", "battery", "battery"]
    assert not lab.is_closed
    first, second = lab.topic_facts
    assert (first.item, first.every, first.fact.owner, second.item, second.fact.owner) == (0, 500_000_000, None, 2, 2)
    assert ros_name(first.topic, 2, "/tb3_2") == "/tb3_2/battery"
    assert ros_name("/fleet/r{id}", 2, "/tb3_2") == "/fleet/r2"
    assert lab.with_robots(1).topic_facts == lab.topic_facts  # robot 2 is the first in the file
    spare = lab_of(tmp_path, TWO.replace("id: 2", "id: 3") + f"facts: [{entry.replace('R,', '@1,')}]\n")
    assert spare.with_robots(1).topic_facts == ()


def test_actions_of_ros_2_stand_beside_the_file_of_the_programs_own(tmp_path):
    (tmp_path / "acts.py").write_text("")
    entry = "{action: 'grip(R, data)', service: grip, type: std_srvs/SetBool, fields: {a.b: 1}, within: 2s}"
    lab = lab_of(tmp_path, TWO + f"actions:\n  - acts.py\n  - {entry}\n  - {entry.replace('grip(R,', 'g(@1,')}\n")
    assert lab.actions.name == "acts.py"
    first, second = lab.ros_actions
    assert (first.name, first.owner, first.args, first.fields) == ("grip", None, ("data",), (("a.b", 1),))
    assert (first.service, first.topic, first.within, second.item, second.owner) == ("grip", "", 2 * 10**9, 2, 1)
    assert lab.performs == ("grip", "g")
    assert lab.with_robots(1).performs == ("grip",), "robot 2 is the first in the file"
    alone = lab_of(tmp_path, TWO + "actions: acts.py\n")
    assert (alone.actions.name, alone.performs) == ("acts.py", ())
    (found,) = complaints(tmp_path, ROOM + "actions: [acts.py, b.py]\n")
    assert "names two files, acts.py and b.py" in found


ROBOT_MISTAKES = [
    ("{id: 1, pose: [1, 1, 0]}", "robots.1: robot 1 is there already"),
    ("{id: 2, pose: [0.6, 0.75, 0]}", "robots.1: robot 2 starts inside robot 1"),
    ("{id: 2, pose: [0.05, 0.75, 0]}", "robots.1: robot 2 starts inside a wall"),
    ("{id: 2, pose: [5, 0.75, 0]}", "robots.1: robot 2 starts out of the arena, 3 m x 1.5 m"),
    ("{id: 65534, pose: [1, 1, 0]}", "robots.1.id: should be less than or equal to 65533"),
    ("{id: -1, pose: [1, 1, 0]}", "robots.1.id: should be greater than or equal to 0"),
    ("{id: '2', pose: [1, 1, 0]}", "robots.1.id: should be a valid integer"),
    ("{id: 2}", "robots.1: should have id and pose, or ids and grid"),
    ("{id: 2, pose: [1, 1]}", "robots.1.pose.2: is missing"),
    ("{id: 2, pose: [1, 1, 0], colour: red}", "robots.1.colour: unknown key; known are id, pose, ids, grid"),
    (
        "{ids: 3-2, grid: {from: [1, 1], step: [1, 0], columns: 2}}",
        "robots.1.ids: the range 3-2 ends before it begins; write 2-3",
    ),
    (
        "{ids: 2-9999, grid: {from: [1, 1], step: [1, 0], columns: 2}}",
        "robots.1.ids: should be at most 1000 robots, not 9998",
    ),
    (
        "{ids: two, grid: {from: [1, 1], step: [1, 0], columns: 2}}",
        "robots.1.ids: 'two' is no id and no range of ids; write ids such as 4, 2-3 or 0-5,9",
    ),
    ("{ids: 2-3, grid: {from: [1, 1], step: [0.01, 0], columns: 2}}", "robots.1: robot 3 starts inside robot 2"),
]


@pytest.mark.parametrize(("item", "complaint"), ROBOT_MISTAKES, ids=[item[:40] for item, _ in ROBOT_MISTAKES])
def test_robot_at_an_impossible_place_is_named(tmp_path, item, complaint):
    found = complaints(tmp_path, ROOM + f"  - {item}\n")
    assert len(found) == 1
    assert found[0].startswith("6:")
    assert found[0].split(": ", 1)[1].startswith(complaint)


def test_all_mistakes_are_reported_at_once_in_the_order_of_the_file(tmp_path):
    text = """\
lab: room
program: room.rmr
arena: {size: [3.0, 1.5]}
finish: at(R, exti)
areas:
  exit: {at: [9, 9]}
  gate: {at: [1, 1], colour: red}
robots:
  - {id: 1, pose: [0.5, 0.75, north]}
  - {id: 2, pose: [0.01, 0.75, 0]}
  - {id: 2, pose: [1.5, 0.75, 0]}
facts: ["due(@1 25)"]
radio: {loss: half}
"""
    assert complaints(tmp_path, text) == [
        "4:9: finish: area 'exti' is not defined; did you mean 'exit'?",
        "6:14: areas.exit.at: (9, 9) is out of the arena, 3 m x 1.5 m",
        "7:22: areas.gate.colour: unknown key; known are at, slots, line, box, queue",
        "9:31: robots.0.pose.2: should be an angle such as 90deg, or a number of radians, not 'north'",
        "10:5: robots.1: robot 2 starts inside a wall",
        "11:5: robots.2: robot 2 is there already",
        "12:9: facts.0: expected ',' or ')', found '25)'",
        "13:15: radio.loss: should be a valid number, not 'half'",
    ]


def test_mistakes_of_links_and_faults_are_reported_at_once(tmp_path):
    text = ROOM + (
        "radio:\n  partition: [[1], [8]]\n  links:\n    - {link: [1, 7], cut: true}\n"
        "faults:\n  - {from: 2s, to: 1s, loss: 1}\n  - {from: 1s, to: 2s, partition: [[1], [1, 6]]}\n"
    )
    assert complaints(tmp_path, text) == [
        "7:14: radio.partition: robot 8 is not in this lab",
        "9:14: radio.links.0.link: robot 7 is not in this lab",
        "11:5: faults.0: should begin before it ends",
        "12:35: faults.1.partition: robot 1 is named twice",
        "12:35: faults.1.partition: robot 6 is not in this lab",
    ]


def test_a_lab_has_a_bounded_number_of_disturbances(tmp_path):
    links = ", ".join(["{link: [1, 2], loss: 0.1}"] * DISTURBANCES_MAX)
    text = TWO + f"radio: {{links: [{links}]}}\n"
    assert len(lab_of(tmp_path, text).disturbances) == DISTURBANCES_MAX
    found = complaints(tmp_path, text + "faults: [{from: 1s, to: 2s, loss: 0.5}]\n")
    assert found == ["8:9: faults: the radio is disturbed in 257 ways; at most 256 are possible"]


def test_a_wrong_arena_hides_no_other_mistake_and_causes_none(tmp_path):
    text = ROOM.replace("[3.0, 1.5]", "[3.0]") + "  - {id: 1, pose: [9, 9, 0]}\n"
    assert complaints(tmp_path, text) == [
        "3:15: arena.size.1: is missing; write [width, height]",
        "6:5: robots.1: robot 1 is there already",
    ]


def test_missing_sections_are_named_each(tmp_path):
    found = complaints(tmp_path, "seed: 1\n")
    assert [text.split(": ", 1)[1] for text in found] == [
        "arena: is missing",
        "lab: is missing",
        "program: is missing",
        "robots: is missing",
    ]


def test_more_robots_than_exit_slots_can_never_finish(tmp_path):
    text = ROOM + "  - {id: 2, pose: [1, 1, 0]}\nfinish: at(R, out)\nareas: {out: {slots: [[2, 1]]}}\n"
    assert complaints(tmp_path, text) == ["7:9: finish: area 'out' has 1 slots for 2 robots"]
    point = text.replace("slots: [[2, 1]]", "at: [2, 1]")
    said = "area 'out' is one point for 2 robots; give it slots, or a box"
    assert complaints(tmp_path, point) == [f"7:9: finish: {said}"]
    lab_of(tmp_path, text.replace("slots: [[2, 1]]", "box: [2, 0.2, 2.5, 1]"))


@pytest.mark.parametrize("name", ["corridor.rmr", "corridor.rbc"])
def test_program_in_place_of_a_lab_file_is_reported_with_the_remedy(tmp_path, name):
    with pytest.raises(LabError, match="is a program: name the lab file that it stands in, or its folder"):
        load_lab(tmp_path / name)


# What is no lab file at all


@pytest.mark.parametrize(
    ("data", "complaint"),
    [
        (b"", "1:1: is empty"),
        (b"# only a comment\n", "1:1: is empty"),
        (b"- 1\n- 2\n", "1:1: should be a mapping with the keys lab, program, arena and robots"),
        (b"lab: x\nname: \xff\xfe\n", "2:7: is not UTF-8"),
        (b"lab: [1, 2\nprogram: x\n", "2:8: not YAML: while parsing a flow sequence expected ',' or ']', but got ':'"),
        (b"lab: x\n\tprogram: y\n", "2:1: not YAML: while scanning for the next token found character '\\t'"),
        (b"lab: 'x\n", "2:1: not YAML: while scanning a quoted scalar found unexpected end of stream"),
        (b"lab: \x00\n", "1:6: character U+0000 is not allowed in YAML"),
        (b"[" * 500, "1:18: is nested too deeply"),
        (b"{a: " * 500, "1:69: is nested too deeply"),
    ],
)
def test_lab_file_that_is_no_yaml_mapping_is_refused_with_its_position(tmp_path, data, complaint):
    found = complaints(tmp_path, data)
    assert len(found) == 1
    assert found[0].startswith(complaint)


def test_a_byte_order_mark_does_no_harm(tmp_path):
    assert lab_of(tmp_path, "\ufeff" + ROOM).name == "room"


def test_a_missing_file_is_a_problem_without_a_position(tmp_path):
    with pytest.raises(LabError) as caught:
        load_lab(tmp_path / "nowhere.yaml")
    assert caught.value.render() == f"{tmp_path}/nowhere.yaml: cannot be read: No such file or directory"


def test_a_folder_without_a_lab_file_says_which_file_it_looked_for(tmp_path):
    with pytest.raises(LabError, match=r"lab\.yaml: cannot be read"):
        load_lab(tmp_path)


def test_a_huge_file_is_refused_before_it_is_parsed(tmp_path):
    found = problems_of(tmp_path, ROOM + "# " + "x" * 5_000_000)
    assert [problem.message for problem in found] == ["is larger than 256 KiB"]


def test_aliases_are_refused_so_that_a_small_file_cannot_become_a_huge_one(tmp_path):
    bomb = "x0: &x0 [lol, lol]\n" + "".join(f"x{k + 1}: &x{k + 1} [*x{k}, *x{k}]\n" for k in range(9))
    found = complaints(tmp_path, ROOM + bomb)
    assert any("aliases (*x0) are not allowed here" in text for text in found)


def test_tags_are_refused(tmp_path):
    found = complaints(tmp_path, ROOM + "seed: !!python/object/apply:os.system ['true']\n")
    assert found[0] == "6:7: seed: tags (tag:yaml.org,2002:python/object/apply:os.system) are not allowed here"


def test_a_second_document_is_refused(tmp_path):
    assert complaints(tmp_path, ROOM + "---\n" + ROOM) == ["6:1: holds a second document"]


def test_words_that_older_yaml_takes_for_other_types_stay_words(tmp_path):
    found = complaints(tmp_path, ROOM.replace("lab: room", "lab: no") + "seed: 1:30\n")
    assert found == ["6:7: seed: should be a valid integer, not '1:30'"]


def test_foreign_file_yields_a_bounded_number_of_mistakes(tmp_path):
    problems = problems_of(tmp_path, "".join(f"key{k}: 1\n" for k in range(3000)))
    assert len(problems) == 201
    assert str(problems[-1]) == f"{tmp_path}/lab.yaml: and 2804 more mistakes"
