"""Each checker of a simulated run is silent while its rule holds, and speaks when somebody breaks it."""

import re
from dataclasses import replace
from pathlib import Path
from textwrap import dedent

import pytest
from lab_maker import small_lab, traced

from rmr.base.direction import EXCLUSIVE
from rmr.base.time import milliseconds, seconds
from rmr.coord import planner
from rmr.coord.context import OwnJob
from rmr.coord.events import Entered, EntryMissed, JobRequest, LeadershipBegan, SlotAssigned
from rmr.coord.messages import Entry, Phase, Sched, encode
from rmr.coord.term import NOBODY, Term
from rmr.coord.timing import Timing
from rmr.node.actions.drives import BarredDrive
from rmr.node.logic.exchange import Exchange
from rmr.node.logic.inbound import Inbound
from rmr.node.ports import Spoken
from rmr.radio.links import Disturbance
from rmr.vm import assertions
from rmr.vm.assertions import Assertions
from rmr.vm.machine import Machine
from rmr_sim.checkers.progress_checker import STILL
from rmr_sim.run_setup import Options, load, prepare

pytestmark = pytest.mark.medium

EVENT = b"charge"
TIMING = Timing()

IDLE = "idle(R).\nidle(R), never(R) -o done(R).\n"
CHARGE = """
type action charge(R: robot) -o done(R).
start(R).
start(R) -o need(R).
charging: assert(need(R), done(R), 60, say(R, "late")).
need(R) -o charge(R).
"""
CHARGER = """
from rmr import action

@action("charge")
async def charge(robot):
    await robot.sleep(0.5)
"""
GREETING = "type hello(robot, int).\nstart(@1).\nstart(R) -o hello(@2, 1).\nhello(R, 1) -o done(R).\n"
OVERDUE = """
type action wait(R: robot, T: float) -o done(R).
late: watch(go(R), done(R), 0.5, say(R, "late")).
go(R).
$go(R) -o wait(R, 2).
"""
LABS = Path(__file__).parents[2] / "deploy" / "labs"


def found(simulation):
    """Return what checkers have found: check, robots and words."""
    return [(violation.check, violation.robots, violation.words) for violation in simulation.violations]


def idle(folder, robots=2):
    """Return a simulation that nobody runs, to be told of what never happened in it."""
    return small_lab(folder, IDLE, robots=robots)


# -- bodies ----------------------------------------------------------------------------------------------------------


def test_wall_contact_is_reported_with_its_place(tmp_path):
    ram = """
    from rmr import action

    @action("ram", wheels=True)
    async def ram(robot):
        robot.drive(-0.2, 0.0)
        await robot.sleep(2.0)
    """
    simulation = small_lab(tmp_path, "type action ram(robot).\ngo(R).\ngo(R) -o ram(R).", actions=ram, duration="2s")
    simulation.run()
    assert found(simulation) == [("contact", (1,), "robot 1 touched an obstacle or a wall at (0.00, 0.20)")]
    assert simulation.world.collisions == 1


# -- passages --------------------------------------------------------------------------------------------------------


class Passage:
    """One robot's job, as the checker is told of it."""

    def __init__(self, simulation, robot, *, direction=EXCLUSIVE, trigger=0, term=1, leader=9, slot_s=10.0):
        self.simulation, self.robot = simulation, robot
        request = JobRequest(EVENT, trigger, 0, seconds(3), seconds(60), milliseconds(1000), direction)
        self.job = OwnJob(request, trigger)
        self.job.lease = seconds(1000)
        start = seconds(slot_s)
        slot = SlotAssigned(
            group_id=EVENT,
            trigger=trigger,
            rank=1,
            place=1,
            start=start,
            end=start + seconds(3),
            leader=leader,
            term=term,
        )
        simulation.tell(robot, 0, slot)

    def enters(self, at_s, *, cautious=False):
        core = self.simulation.robots[self.robot - 1].node.core
        core.job = lambda _event: self.job
        at = seconds(at_s)
        self.simulation.tell(self.robot, at, Entered(EVENT, at, at + seconds(3), cautious))

    def leaves(self):
        """End the job within a tick, before the checkers look at the robots again."""
        self.simulation.robots[self.robot - 1].node.core.job = lambda _event: None


def test_entry_in_its_window_under_its_lease_is_no_violation(tmp_path):
    simulation = idle(tmp_path)
    Passage(simulation, 1).enters(10.25)
    assert found(simulation) == []


def test_entry_before_or_after_its_window_is_reported(tmp_path):
    simulation = idle(tmp_path)
    early, late = Passage(simulation, 1, direction=1), Passage(simulation, 2, direction=1, slot_s=20.0)
    early.enters(9.99)
    late.enters(20.26)
    assert [check for check, _, _ in found(simulation)] == ["entry", "entry"]
    assert "out of its window, at 260 ms of its slot" in found(simulation)[1][2]


def test_entry_without_a_slot_or_after_a_wasted_slot_is_reported(tmp_path):
    simulation = idle(tmp_path)
    passage = Passage(simulation, 1)
    simulation.tell(1, seconds(10), EntryMissed(EVENT))
    passage.enters(10.1)
    assert found(simulation) == [("entry", (1,), "robot 1 entered without a slot")]


def test_entry_under_an_expired_lease_is_reported(tmp_path):
    simulation = idle(tmp_path)
    passage = Passage(simulation, 1)
    passage.job.lease = seconds(10)
    passage.enters(10)
    assert found(simulation) == [("entry", (1,), "robot 1 entered when its lease had run out")]


def test_two_entries_for_one_job_are_reported(tmp_path):
    simulation = idle(tmp_path)
    Passage(simulation, 1).enters(10)
    Passage(simulation, 1).enters(10)
    assert found(simulation) == [("entry", (1,), "robot 1 entered twice for one job")]


def test_opposed_passages_inside_under_one_term_are_reported_despite_any_loss(tmp_path):
    simulation = idle(tmp_path)
    simulation.disturb(Disturbance(attenuation_db=float("inf")))
    one, other = Passage(simulation, 1, direction=0), Passage(simulation, 2, direction=1)
    one.enters(10)
    other.enters(10.1)
    assert found(simulation) == [("overlap", (1, 2), "robot 2 entered while robot 1 was inside another way")]


def test_one_behind_the_other_is_no_overlap(tmp_path):
    simulation = idle(tmp_path)
    one, other = Passage(simulation, 1, direction=0), Passage(simulation, 2, direction=1)
    one.enters(10)
    one.leaves()
    other.enters(10.1)
    assert found(simulation) == []


@pytest.mark.parametrize("excuse", ["", "cut", "stalled", "cautious"])
def test_passages_inside_under_two_terms_are_reported_only_where_avoidable(tmp_path, excuse):
    simulation = idle(tmp_path)
    if excuse == "cut":
        simulation.disturb(Disturbance(seconds(9.8), seconds(9.9), attenuation_db=float("inf")))
    if excuse == "stalled":
        simulation.kernel.now = seconds(9.8)
        simulation.stall(2, seconds(9.9))
    one, other = Passage(simulation, 1, direction=0, leader=1), Passage(simulation, 2, direction=1, leader=2)
    one.enters(10)
    other.enters(10.1, cautious=excuse == "cautious")
    assert [check for check, _, _ in found(simulation)] == ([] if excuse else ["overlap"])


def test_headway_violation_is_reported(tmp_path):
    simulation = idle(tmp_path, robots=3)
    passages = [Passage(simulation, robot, direction=0) for robot in (1, 2, 3)]
    passages[1].job.request = replace(passages[1].job.request, headway=milliseconds(300))
    passages[0].enters(10)
    passages[1].enters(10.1)  # its headway of 300 ms may lack the window of 250 ms
    passages[2].enters(10.25)
    ((check, robots, words),) = found(simulation)
    assert (check, robots) == ("spacing", (1, 3))
    assert "entered 250 ms behind robot 1" in words


def test_leader_that_assigns_one_slot_to_all_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(planner, "place", lambda order, standing, rules: [rules.floor + milliseconds(500)] * len(order))
    monkeypatch.setattr("rmr.coord.fence.Fence._conflict", lambda *_: False)
    simulation = small_lab(tmp_path, CHARGE, robots=3, actions=CHARGER, finish="done(R)")
    simulation.run()
    assert "overlap" in {check for check, _, _ in found(simulation)}


def test_robots_that_keep_the_rules_cause_no_violation(tmp_path):
    simulation = small_lab(tmp_path, CHARGE, robots=3, actions=CHARGER, finish="done(R)", loss=0.2)
    assert simulation.run()
    assert found(simulation) == []


# -- leaders and schedules -------------------------------------------------------------------------------------------


def test_term_that_begins_a_second_time_is_reported(tmp_path):
    simulation = idle(tmp_path)
    simulation.tell(1, 0, LeadershipBegan(EVENT, 3))
    simulation.tell(2, 0, LeadershipBegan(EVENT, 3))  # another leader: another term
    assert found(simulation) == []
    simulation.tell(1, 0, LeadershipBegan(EVENT, 3))
    assert found(simulation) == [("term", (1,), "robot 1 began term 3 a second time")]


@pytest.mark.parametrize("heals_s", [0, 4])
def test_two_concurrent_leaders_are_reported_some_time_after_healing(tmp_path, heals_s):
    simulation = idle(tmp_path)
    if heals_s:
        simulation.disturb(Disturbance(0, seconds(heals_s), attenuation_db=float("inf")))
    simulation.tell(1, 0, LeadershipBegan(EVENT, 1))
    simulation.tell(2, 0, LeadershipBegan(EVENT, 2))
    told = []
    for at_s in range(20):
        for observe in simulation.checkers:
            observe(seconds(at_s))
        told += [at_s] * (len(simulation.violations) > len(told))
    assert told == [5 + heals_s]
    assert found(simulation) == [("leaders", (1, 2), "robots 1 and 2 lead one event though all is well")]


def schedule(issued_s, start_s, *, opens=0):
    entry = Entry(2, 0, seconds(start_s), seconds(3), 1, Phase.WAITING)
    return Spoken(encode(Sched(EVENT, seconds(issued_s), Term(1, 1), False, NOBODY, opens, 0, 0, 1, (entry,))))


def test_a_slot_that_stands_must_not_move(tmp_path):
    simulation = idle(tmp_path)
    simulation.tell(1, seconds(5), schedule(5.0, 8.0))
    simulation.tell(1, seconds(6), schedule(6.0, 7.0))  # it was far enough ahead
    assert found(simulation) == []
    simulation.tell(1, seconds(6.2), schedule(6.2, 9.0))
    assert found(simulation) == [("frozen slot", (1, 2), "leader 1 moved the slot of robot 2, which stood already")]


def test_a_schedule_that_was_overtaken_on_its_way_moves_nothing(tmp_path):
    simulation = idle(tmp_path)
    simulation.tell(1, seconds(6), schedule(6.0, 7.0))
    simulation.tell(1, seconds(6), schedule(5.9, 8.0))
    assert found(simulation) == []


def test_slot_wasted_by_its_owner_may_move(tmp_path):
    simulation = idle(tmp_path)
    simulation.tell(1, seconds(6), schedule(6.0, 7.0))
    simulation.tell(2, seconds(7.2), EntryMissed(EVENT))
    simulation.tell(1, seconds(7.3), schedule(7.3, 9.0))
    assert found(simulation) == []


def test_relayed_schedule_that_differs_from_the_original_is_reported(tmp_path):
    simulation = idle(tmp_path)
    simulation.tell(1, seconds(5), schedule(5.0, 8.0))
    simulation.tell(2, seconds(5.1), schedule(5.0, 8.0))
    assert found(simulation) == []
    simulation.tell(2, seconds(5.1), schedule(5.0, 8.0, opens=milliseconds(20)))
    assert [(check, robots) for check, robots, _ in found(simulation)] == [("schedule", (2, 1))]


def test_frame_too_large_for_the_radio_is_reported(tmp_path):
    simulation = idle(tmp_path)
    simulation.tell(1, 0, Spoken(bytes(117)))
    assert found(simulation) == [("frame", (1,), "robot 1 sent 117 octets where 116 fit")]


# -- deadlines -------------------------------------------------------------------------------------------------------


def test_a_deadline_missed_as_it_should_be_is_no_violation(tmp_path):
    simulation = small_lab(tmp_path, OVERDUE, duration="1s")
    simulation.run()
    assert simulation.robots[0].node.machine.jobs[0].missed
    assert found(simulation) == []


def late_by_s(monkeypatch, late_s):
    """Let machines take deadlines for later than they are."""
    push = assertions.heappush

    def push_late(queue, entry):
        push(queue, (entry[0] + seconds(late_s), *entry[1:]))

    monkeypatch.setattr(assertions, "heappush", push_late)


def test_unnoticed_missed_deadline_is_reported(tmp_path, monkeypatch):
    late_by_s(monkeypatch, 10)
    simulation = small_lab(tmp_path, OVERDUE, duration="1s")
    simulation.run()
    assert found(simulation) == [("deadline", (1,), "robot 1 has not noticed that done(@1) is overdue")]


def test_missed_deadline_noticed_late_is_reported(tmp_path, monkeypatch):
    late_by_s(monkeypatch, 0.1)
    simulation = small_lab(tmp_path, OVERDUE, duration="1s")
    simulation.run()
    assert "noticed 0.1" in found(simulation)[-1][2]


def test_a_stalled_robot_may_notice_when_it_goes_on(tmp_path):
    simulation = small_lab(tmp_path, OVERDUE, duration="2s")
    simulation.stall(1, seconds(1))
    simulation.run()
    assert simulation.robots[0].node.machine.jobs[0].missed
    assert found(simulation) == []


def test_deadline_missed_twice_is_reported(tmp_path, monkeypatch):
    once = Assertions.overdue
    monkeypatch.setattr(Assertions, "overdue", lambda self, until: [j for job in once(self, until) for j in (job, job)])
    simulation = small_lab(tmp_path, OVERDUE, duration="1s")
    simulation.run()
    assert found(simulation)[0] == ("deadline", (1,), "robot 1 missed the deadline of done(@1) a second time")


def test_violation_action_derived_never_or_twice_is_reported(tmp_path, monkeypatch):
    act = Machine._act
    monkeypatch.setattr(Machine, "_act", lambda *_: None)
    silent = small_lab(tmp_path, OVERDUE.replace("$go(R) -o wait(R, 2).", ""), duration="1s")
    silent.run()
    assert found(silent) == [("deadline", (1,), "robot 1 derived no action when done(@1) was overdue")]
    monkeypatch.setattr(Machine, "_act", lambda *args: (act(*args), act(*args)))
    twice = small_lab(tmp_path, OVERDUE.replace("$go(R) -o wait(R, 2).", ""), duration="1s")
    twice.run()
    assert found(twice) == [("deadline", (1,), "robot 1 derived the action of a missed deadline twice")]


# -- deliveries ------------------------------------------------------------------------------------------------------


def greeting(folder, duration="1s"):
    return small_lab(folder, GREETING, robots=2, duration=duration)


def test_a_fact_accepted_once_is_no_violation_however_often_it_was_sent(tmp_path, monkeypatch):
    deaf_until_s(monkeypatch, 0.5)
    simulation = greeting(tmp_path)
    simulation.run()
    assert simulation.robots[0].node.messenger.exchange.repeated
    assert "done(@2)" in simulation.robots[1].node.machine.facts()
    assert found(simulation) == []


def deaf_until_s(monkeypatch, until_s):
    """Let robots hear no acknowledgement for a while."""
    hear = Exchange.acknowledged
    monkeypatch.setattr(
        Exchange, "acknowledged", lambda self, now, *rest: hear(self, now, *rest) if now > seconds(until_s) else None
    )


def test_fact_accepted_twice_is_reported(tmp_path, monkeypatch):
    deaf_until_s(monkeypatch, 0.5)
    monkeypatch.setattr(Inbound, "has", lambda *_: False)
    monkeypatch.setattr(Inbound, "passed", lambda *_: False)
    simulation = greeting(tmp_path)
    simulation.run()
    assert ("delivery", (1, 2), "robot 2 accepted the same message of robot 1 twice") in found(simulation)


def test_fact_accepted_by_two_lives_of_a_robot_is_reported(tmp_path, monkeypatch):
    deaf_until_s(monkeypatch, 5)
    faults = "[{at: 0.4s, kill: 2}, {at: 1s, restart: 2}]"
    simulation = small_lab(tmp_path, GREETING, robots=2, duration="4s", faults=faults)
    monkeypatch.setattr(Exchange, "_is_meant", lambda *_: True)
    simulation.run()
    assert found(simulation) == [("delivery", (1, 2), "two lives of robot 2 accepted the same message of robot 1")]


def test_fact_acknowledged_but_not_accepted_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(Exchange, "tell", property(lambda self: self.told, keep_all_but_accepted), raising=False)
    simulation = greeting(tmp_path)
    simulation.run()
    words = "what robot 1 sent robot 2 was acknowledged but never accepted"
    assert found(simulation) == [("delivery", (1, 2), words)]


def keep_all_but_accepted(exchange, tell):
    exchange.told = lambda progress: None if progress.stage.value == "accepted" else tell(progress)


def test_fact_lost_in_transit_without_a_record_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(Exchange, "_transmit", lambda self, now, peer, outgoing: None)
    simulation = greeting(tmp_path, duration="91s")
    simulation.run()
    words = "what robot 1 sent robot 2 is neither delivered nor reported undelivered"
    assert found(simulation) == [("delivery", (1, 2), words)]


# -- getting on ------------------------------------------------------------------------------------------------------


def test_robots_that_have_nothing_to_do_and_do_not_finish_stand_still(tmp_path):
    simulation = small_lab(tmp_path, IDLE, robots=2, finish="done(R)", duration="35s")
    assert not simulation.run()
    assert found(simulation) == [("stands still", (1, 2), "no robot has got on for 30 s; not finished: 1, 2")]


def test_a_robot_that_drives_but_does_not_move_stands_still(tmp_path):
    sit = """
    from rmr import action

    @action("sit", wheels=True)
    async def sit(robot):
        await robot.until(lambda: False)
    """
    program = "type action sit(R: robot) -o done(R).\ngo(R).\ngo(R) -o sit(R)."
    simulation = small_lab(tmp_path, program, actions=sit, finish="done(R)", duration="32s")
    assert not simulation.run()
    assert found(simulation) == [("stands still", (1,), "robot 1 has stood still for 30 s")]


def test_standstill_report_names_the_blocking_robot_and_the_holder_of_the_turn(tmp_path):
    hold = """
    from rmr import action

    @action("hold", wheels=True)
    async def hold(robot):
        await robot.until(lambda: False)
    """
    program = """
    type action hold(R: robot) -o held(R).
    start(R).
    start(R) -o need(R).
    holding: assert(need(R), held(R), 60, say(R, "late")).
    need(R) -o hold(R).
    """
    simulation = small_lab(tmp_path, program, robots=2, actions=hold, finish="held(R)", duration="40s")
    lab = simulation.lab.path
    lab.write_text(lab.read_text().replace("pose: [0.5, 0.2", "pose: [0.35, 0.2"))
    simulation = prepare(tmp_path, seed=1, actions=tmp_path / "actions.py")
    assert not simulation.run()
    words = {robots: words for check, robots, words in found(simulation) if check == "stands still"}
    [inside] = {robots for robots, said in words.items() if "waits" not in said}
    [waiting] = {(1,), (2,)} - {inside}
    assert words[inside] == f"robot {inside[0]} has stood still for 30 s; robot {waiting[0]} stands in its way"
    assert words[waiting] == (
        f"robot {waiting[0]} has stood still for 30 s; it waits for its turn of holding, "
        f"held by robot {inside[0]}; robot {inside[0]} stands in its way"
    )


def test_a_robot_that_waits_for_a_time_to_come_does_not_stand_still(tmp_path):
    program = "type action wait(R: robot, T: float) -o done(R).\ngo(R).\ngo(R) -o wait(R, 40)."
    simulation = small_lab(tmp_path, program, finish="done(R)", duration="60s")
    assert simulation.run()
    assert found(simulation) == []


def test_an_action_that_sleeps_longer_than_the_limit_in_its_turn_is_no_standstill(tmp_path):
    slow = CHARGER.replace("0.5", "40.0")
    simulation = small_lab(tmp_path, CHARGE, actions=slow, robots=2, finish="done(R)", duration="120s")
    assert simulation.run()
    assert found(simulation) == []


def test_an_action_that_sleeps_with_the_wheels_is_no_standstill(tmp_path):
    parked = CHARGER.replace('"charge"', '"charge", wheels=True').replace("0.5", "40.0")
    simulation = small_lab(tmp_path, CHARGE, actions=parked, robots=2, finish="done(R)", duration="120s")
    assert simulation.run()
    assert found(simulation) == []


def test_robots_that_wait_for_a_long_turn_of_a_robot_that_drives_do_not_stand_still(tmp_path):
    laps = """
    from rmr import action

    @action("charge", wheels=True)
    async def charge(robot):
        robot.drive(0.0, 1.6)  # turn away from the other robot
        await robot.sleep(0.95)
        for _ in range(10):
            for v in (0.2, 0.2, -0.2, -0.2):
                robot.drive(v, 0.0)
                await robot.sleep(0.95)
    """
    simulation = small_lab(tmp_path, CHARGE, actions=laps, robots=2, finish="done(R)", duration="90s")
    assert simulation.run()
    assert found(simulation) == []


CHAIN = """
type action laps(R: robot) -o lapped(R).
type action hold(R: robot) -o held(R).
start(R).
start(@1) -o outer(@1, 100), inner(@1, 150).
start(@2) -o inner(@2, 90).
start(@3) -o outer(@3, 200).
outwards: assert(outer(R, D), held(R), D, say(R, "late")).
inwards: assert(inner(R, D), lapped(R), D, say(R, "late")).
outer(R, _) -o hold(R).
inner(R, _) -o laps(R).
held(@1) -o done(@1).
lapped(@2) -o done(@2).
held(@3) -o done(@3).
"""
LAPS = """
from rmr import action

LAPPED = {3}

@action("laps", wheels=True)
async def laps(robot):
    robot.drive(0.0, 1.6)  # turn away from the other robots
    await robot.sleep(0.95)
    for _ in range(10 if robot.id == 2 and GOES_ON else 0):
        for v in (0.2, 0.2, -0.2, -0.2):
            robot.drive(v, 0.0)
            await robot.sleep(0.95)
    await robot.until(lambda: GOES_ON)
    LAPPED.add(robot.id)

@action("hold")
async def hold(robot):
    await robot.until(lambda: robot.id in LAPPED)
"""


@pytest.mark.parametrize(("goes_on", "stand_still"), [(True, set()), (False, {(1,), (2,), (3,)})])
def test_who_waits_for_one_that_waits_for_what_a_third_one_uses_does_not_stand_still(tmp_path, goes_on, stand_still):
    actions = LAPS.replace("GOES_ON", str(goes_on))
    simulation = small_lab(tmp_path, CHAIN, actions=actions, robots=3, finish="done(R)", duration="90s")
    simulation.run()
    assert {robots for check, robots, _ in found(simulation) if check == "stands still"} == stand_still


def test_a_robot_that_polls_with_short_sleeps_and_does_not_move_stands_still(tmp_path):
    poll = """
    from rmr import action

    @action("sit", wheels=True)
    async def sit(robot):
        while True:
            await robot.sleep(0.5)
    """
    program = "type action sit(R: robot) -o done(R).\ngo(R).\ngo(R) -o sit(R)."
    simulation = small_lab(tmp_path, program, actions=poll, finish="done(R)", duration="32s")
    assert not simulation.run()
    assert found(simulation) == [("stands still", (1,), "robot 1 has stood still for 30 s")]


def test_robots_that_wait_for_their_turn_while_others_pass_do_not_stand_still(tmp_path):
    text = (LABS / "testbed" / "lab.yaml").read_text("utf-8")
    corner = text.replace("entry: {at: [0.5, 0.75]}", "entry: {at: [0.4, 1.4]}")  # each is inside for long
    assert corner != text
    (tmp_path / "lab.yaml").write_text(corner, "utf-8")
    (tmp_path / "testbed.rmr").write_text((LABS / "testbed" / "testbed.rmr").read_text("utf-8"), "utf-8")
    simulation = load(tmp_path, Options()).simulation(7)
    assert simulation.run()
    assert simulation.time_s > 30.0
    assert found(simulation) == []


KEPT = """
type action goto(R: robot, X: float, Y: float) -o done(R).
go(@2).
go(R) -o goto(R, 0.2, 0.2).
"""


def test_a_robot_that_moves_to_and_fro_before_its_goal_gets_no_nearer(tmp_path, monkeypatch):
    monkeypatch.setattr(BarredDrive, "look", lambda *_, **__: None)  # nothing ends the drive
    without = frozenset({"goal"})  # else it stands
    simulation = small_lab(tmp_path, KEPT, robots=2, finish="done(R)", duration="200s", without=without)
    assert not simulation.run()
    words = next(words for check, robots, words in found(simulation) if check == "no nearer" and robots == (2,))
    assert re.match(r"robot 2 has come no nearer to the goal of goto\(@2, 0.2, 0.2\) for \d+ s and \d+\.\d m", words)


def test_a_robot_that_waits_for_a_goal_that_another_one_keeps_stands_still(tmp_path, monkeypatch):
    monkeypatch.setattr(BarredDrive, "look", lambda *_, **__: None)
    simulation = small_lab(tmp_path, KEPT, robots=2, finish="done(R)", duration="100s")
    assert not simulation.run()
    words = "robot 2 has stood still for 30 s; it waits for its goal, which robot 1 has first"
    assert ("stands still", (2,), words) in found(simulation)


def test_robots_that_wait_for_a_goal_while_others_come_and_go_do_not_stand_still(tmp_path):
    visits = """
    type action goto(R: robot, X: float, Y: float) -o there(R, X).
    type action wait(R: robot, T: float) -o waited(R).
    type home(robot, float, float).
    home(@1, 0.2, 0.2).
    home(@2, 0.5, 0.2).
    home(@3, 0.8, 0.2).
    home(@4, 1.1, 0.2).
    home(R, X, Y) -o goto(R, 1.25, 1.25), back(R, X, Y).
    there(R, 1.25) -o wait(R, 14.0).
    waited(R), back(R, X, Y) -o goto(R, X, Y).
    there(R, X), X < 1.2 -o done(R).
    """
    simulation = small_lab(tmp_path, visits, robots=4, finish="done(R)", duration="200s")
    assert simulation.run()
    assert simulation.time_s > 3 * 14.0 + 30.0
    assert found(simulation) == []


def test_a_robot_whose_machine_reports_all_the_time_gets_no_nearer_all_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(BarredDrive, "look", lambda *_, **__: None)
    beats = """
    type action wait(R: robot, T: float) -o waited(R).
    type waited(robot).
    waited(@2).
    waited(R) -o wait(R, 1).
    """
    simulation = small_lab(tmp_path, KEPT + dedent(beats), robots=2, finish="done(R)", duration="200s")
    assert not simulation.run()
    assert ("no nearer", (2,)) in {(check, robots) for check, robots, _ in found(simulation)}


@pytest.mark.parametrize("goal", ["0.2, 0.2", "1.3, 1.3"])  # where robot 1 stands; behind a wall
def test_a_program_that_orders_each_failed_drive_anew_is_not_silent(tmp_path, goal):
    retries = f"""
    type action goto(R: robot, X: float, Y: float) -o done(R) else stuck(R).
    go(@2).
    go(R) -o goto(R, {goal}).
    stuck(R) -o goto(R, {goal}).
    """
    small_lab(tmp_path, retries, robots=2, finish="done(R)", duration="140s")
    text = (tmp_path / "lab.yaml").read_text("utf-8")
    (tmp_path / "lab.yaml").write_text(f"{text}obstacles: [{{box: [1.1, 0.0, 1.12, 1.5]}}]\n", "utf-8")
    simulation = load(tmp_path, Options()).simulation(1)
    assert not simulation.run()
    assert simulation.robot_parts()[2]["actions_failed"] > 2
    assert {(check, robots) for check, robots, _ in found(simulation)} == {("no nearer", (2,))}


def test_standstill_is_not_reported_before_all_faults_are_healed(tmp_path):
    simulation = small_lab(tmp_path, IDLE, robots=2, finish="done(R)", duration="35s")
    simulation.disturb(Disturbance(0, seconds(34), loss=0.9))
    assert not simulation.run()
    assert found(simulation) == []
    assert seconds(35) - seconds(34) < STILL


# -- all of them -----------------------------------------------------------------------------------------------------


def test_a_run_is_the_same_with_and_without_checkers(tmp_path):
    reports = []
    for checked in (True, False):
        simulation = small_lab(tmp_path, CHARGE, robots=3, actions=CHARGER, finish="done(R)", loss=0.2)
        if not checked:
            simulation.checkers.clear()
            simulation.subscribers.clear()
        assert simulation.run()
        reports.append((simulation.robot_parts(), simulation.trace()))
    assert reports[0] == reports[1]


def test_a_deadline_whose_violation_is_a_fact_of_another_robot_is_no_violation_of_a_rule(tmp_path):
    program = """
        type asked(robot, int).
        type answered(robot, int).
        asked(@1, 1).
        job: watch(asked(R, N), answered(R, N), 1, late(@2, R)).
        late(R, S) -o knows(R, S).
    """
    simulation = small_lab(tmp_path, program, robots=2, duration="3s")
    simulation.run()
    assert simulation.robots[1].node.machine.facts() == ["knows(@2, @1)"]
    (fired,) = traced(simulation, "fired")
    assert 1.0 < fired["t"] < 1.2
    assert simulation.violations == []
