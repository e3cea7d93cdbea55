"""Phase 2, fit of references: files, robots and areas that facts, `finish` and faults name are in the lab.

Each check takes the draft of the lab and yields the errors of one rule.
"""

from collections.abc import Iterator
from pathlib import Path

from rmr.base.time import in_seconds
from rmr.base.values import Symbol
from rmr.bytecode.program import Constant
from rmr.radio.links import DISTURBANCES_MAX, Disturbance
from rmr.radio.phy import NETWORK
from rmr_world.finding import Finding, near_miss
from rmr_world.hosts import host_errors
from rmr_world.lab import PROGRAM_SUFFIXES, Kill, Restart
from rmr_world.quorum import ALL
from rmr_world.validate.lab_draft import LabDraft


def program_suffix(draft: LabDraft) -> Iterator[Finding]:
    """The program is source or byte-code, by the end of its name."""
    program = draft.spec.program
    if Path(program).suffix not in PROGRAM_SUFFIXES:
        yield draft.error(("program",), f"should be a .rmr or .rbc file, not '{program}'")


def user_files_exist(draft: LabDraft) -> Iterator[Finding]:
    """The files of actions and of events are there, one of each at most."""
    for key, names in (("actions", draft.action_files), ("events", [draft.spec.events])):
        name = names[0] if names else None
        if name is None:
            continue
        if len(names) > 1:
            yield draft.error((key,), f"names two files, {name} and {names[1]}: put all handlers into one")
        file = draft.path.parent / name
        if not file.is_file():
            beside = sorted(each.name for each in file.parent.glob("*.py"))
            yield draft.error((key,), f"there is no file {file}{near_miss(file.name, beside)}")


def fact_owners_known(draft: LabDraft) -> Iterator[Finding]:
    """The owner of each fact is a robot of the lab."""
    for i, fact in draft.facts:
        if fact.owner is not None and draft.robot_is_unknown(fact.owner):
            yield draft.error(("facts", i), f"robot {fact.owner} is not in this lab")
    for each in draft.topic_facts:
        if each.fact.owner is not None and draft.robot_is_unknown(each.fact.owner):
            yield draft.error(("facts", each.item, "fact"), f"robot {each.fact.owner} is not in this lab")


def ros_actions_apart(draft: LabDraft) -> Iterator[Finding]:
    """The robot of an action that ROS 2 carries out is in the lab, and has one such action of this name."""
    for k, each in enumerate(draft.ros_actions):
        path = ("actions", each.item, "action")
        if each.owner is not None and draft.robot_is_unknown(each.owner):
            yield draft.error(path, f"robot {each.owner} is not in this lab")
        for other in draft.ros_actions[:k]:
            if other.name == each.name and (other.owner == each.owner or None in (other.owner, each.owner)):
                yield draft.error(path, f"'{each.name}' of the same robot stands in actions.{other.item}, too")
                break


def finish_area_fits(draft: LabDraft) -> Iterator[Finding]:
    """``finish: at(R, area)`` names an area of the lab in which all robots can be at a time."""
    if draft.finish is None or draft.finish.name != "at":
        return
    patterns = draft.finish.patterns
    if len(patterns) != 1:
        yield draft.error(("finish",), "at has two arguments: at(R, area)")
        return
    pattern = patterns[0]
    if not isinstance(pattern, Constant) or not isinstance(pattern.value, Symbol):
        return
    name = str(pattern.value)
    robots = len(draft.robots)
    area = draft.arena.area(name)
    if name not in draft.area_names:
        # With another case only, the area's own name is wrong, which is an error of the schema already.
        if name.lower() not in map(str.lower, draft.area_names):
            yield draft.error(("finish",), draft.undefined_area(name))
    elif area is not None and area.slotted and len(area.places) < robots:
        yield draft.error(("finish",), f"area '{name}' has {len(area.places)} slots for {robots} robots")
    elif area is not None and not area.slotted and area.box is None and robots > 1:
        message = f"area '{name}' is one point for {robots} robots; give it slots, or a box"
        yield draft.error(("finish",), message)


def quorum_fits(draft: LabDraft) -> Iterator[Finding]:
    """`quorum` goes with `finish`, and asks for no more robots than there are."""
    quorum = draft.spec.quorum
    if quorum == ALL or "robots" in draft.cut:
        return
    if not draft.spec.finish:
        if "finish" not in draft.cut:
            yield draft.error(("quorum",), "says how many robots hold the finish fact: add finish, or leave it out")
    elif isinstance(quorum, int) and quorum > len(draft.robots):
        robots = len(draft.robots)
        there = "is 1 robot" if robots == 1 else f"are {robots} robots"
        yield draft.error(("quorum",), f"{quorum} robots cannot finish: there {there} in this lab")


def fault_robots_known(draft: LabDraft) -> Iterator[Finding]:
    """Each robot that a fault names is in the lab, and named once."""
    for path, fault in draft.faults:
        robots = [i for group in fault.groups for i in group] if isinstance(fault, Disturbance) else [fault.robot]
        for robot in dict.fromkeys(robots):
            if draft.robot_is_unknown(robot):
                yield draft.error(path, f"robot {robot} is not in this lab")
            if robots.count(robot) > 1:
                yield draft.error(path, f"robot {robot} is named twice")


def bodies_fit(draft: LabDraft) -> Iterator[Finding]:
    """Each robot has one body, and no two have the same topics."""
    seen: set[int] = set()
    owners: dict[str, int] = {}
    for i, body in draft.bodies:
        if draft.robot_is_unknown(body.robot):
            yield draft.error(("bodies", i, "robots"), f"robot {body.robot} is not in this lab")
        if body.robot in seen:
            yield draft.error(("bodies", i), f"robot {body.robot} has a body already")
            continue
        seen.add(body.robot)
        topics = [topic for topic in (body.odom, body.cmd_vel, body.pose, body.scan) if topic]
        for topic in topics:
            other = owners.setdefault(topic, body.robot)
            if other != body.robot:
                message = f"robots {other} and {body.robot} have the same topic {topic}: put {{id}} into the namespace"
                yield draft.error(("bodies", i), message)
                break
            if topics.count(topic) > 1:
                yield draft.error(("bodies", i), f"robot {body.robot} has the topic {topic} twice")
                break


def kills_and_restarts_alternate(draft: LabDraft) -> Iterator[Finding]:
    """A robot is killed while it lives, and restarted after it was killed."""
    if "faults" in draft.cut:
        return  # the missing half of a pair may be the entry that was removed
    dead: set[int] = set()
    found = [(path, fault) for path, fault in draft.faults if isinstance(fault, Kill | Restart)]
    for path, fault in sorted(found, key=lambda each: each[1].at):
        robot = fault.robot
        at = f"at {in_seconds(fault.at):g} s"
        if isinstance(fault, Restart):
            if robot not in dead:
                yield draft.error(path, f"robot {robot} lives {at}: kill it before it is started again")
            dead.discard(robot)
        elif robot in dead:
            yield draft.error(path, f"robot {robot} is dead {at}: start it again before it is killed once more")
        else:
            dead.add(robot)


def hosts_fit(draft: LabDraft) -> Iterator[Finding]:
    """The hosts of the file share out its robots, and one of them has the world."""
    if draft.spec.hosts and "hosts" not in draft.cut:
        roster = None if "robots" in draft.cut else draft.ids
        yield from host_errors(draft.document, draft.spec.hosts, roster, draft.spec.lab)


def disturbance_count(draft: LabDraft) -> Iterator[Finding]:
    """The radio can hold that many disturbances."""
    count = sum(isinstance(fault, Disturbance) for _, fault in draft.faults)
    if count > DISTURBANCES_MAX:
        message = f"the radio is disturbed in {count} ways; at most {DISTURBANCES_MAX} are possible"
        yield draft.error(("faults",), message)


def network_fits(draft: LabDraft) -> Iterator[Finding]:
    """A radio of mode network has no other setting, and no fault takes power from it."""
    radio = draft.spec.radio
    if radio.mode != NETWORK:
        return
    for name in (each for each in type(radio).model_fields if each != "mode" and each in radio.model_fields_set):
        if name in ("security", "key_file"):
            bus = "with mode: network the bus does that, by `bus: {security: mtls}`"
            message = f"{name} secures the emulated radio; {bus}"
        else:
            message = f"{name} is of the emulated radio, and means nothing with mode: network"
        yield draft.error(("radio", name), f"{message}; remove it, or mode")
    for i, fault in enumerate(draft.spec.faults):
        if fault.attenuation_db is not None:
            power = "a radio of mode network has no power that could be attenuated"
            yield draft.error(("faults", i, "attenuation_db"), f"{power}; write cut, or loss")


def loads_known(draft: LabDraft) -> Iterator[Finding]:
    """Each load names a program file that exists, and robots of the lab."""
    for i, load in enumerate(draft.spec.loads):
        path = draft.path.parent / load.program
        if path.suffix not in PROGRAM_SUFFIXES:
            yield draft.error(
                ("loads", i, "program"), f"a program is a file with the suffix .rmr or .rbc, not {path.name}"
            )
        elif not path.exists():
            yield draft.error(("loads", i, "program"), f"there is no file {path}")
        for robot in load.robots or ():
            if draft.robot_is_unknown(robot):
                yield draft.error(("loads", i, "robots"), f"robot {robot} is not in this lab")


CHECKS = (
    loads_known,
    program_suffix,
    user_files_exist,
    fact_owners_known,
    ros_actions_apart,
    finish_area_fits,
    quorum_fits,
    fault_robots_known,
    bodies_fit,
    hosts_fit,
    kills_and_restarts_alternate,
    disturbance_count,
    network_fits,
)
"""The rules of references."""
