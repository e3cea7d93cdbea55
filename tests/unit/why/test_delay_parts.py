"""Parts of explained delays: behind whom a robot waits, the time of a delivery, intervals cut and merged."""

from rmr.base.time import NEVER, milliseconds, seconds
from rmr.bytecode.program import Program
from rmr.coord.events import ScheduleChanged
from rmr.why.delay import Interval, TimeOwner, cut_at, merged, without
from rmr.why.mind_index import MindIndex
from rmr.why.past_items import PastDelivery, TurnGate
from rmr.why.radio_time import Attempt, radio_time
from rmr.why.robot_history import PassageSpan, RobotHistory
from rmr.why.turn_order import NOT_ASKED, NOT_HEARD, NOT_NAMED, ONLY_PASSED, OWN_SLOT, waits_behind

PROGRAM = Program(())
GROUP = b"exit"
GATES = (TurnGate(0, GROUP, True),)


def histories(order=(2, 3, 1), **entered):
    """Return robots 1 to 3, of which 1 heard the schedule at 1 s; `r2=(4, 6)`: robot 2 was inside from 4 s to 6 s."""
    robots = {robot: RobotHistory(robot, [MindIndex(robot, 0, PROGRAM)]) for robot in (1, 2, 3)}
    if order:
        knows(robots[1], 1, 2, order)
    for name, (begin, end) in entered.items():
        robots[int(name[1:])].passages.append(PassageSpan(GROUP, seconds(begin), seconds(end)))
    return robots


def knows(history, at_s, leader, order):
    history.minds[0].schedule_log.append((seconds(at_s), ScheduleChanged(GROUP, leader, 1, order, 0)))


def waits(robots, begin, end, gates=GATES):
    found = waits_behind(robots, 1, gates, seconds(begin), seconds(end))
    return [(each.begin / 1e9, each.end / 1e9, each.whom, each.detail) for each in found]


def test_wait_for_a_turn_has_an_interval_for_each_robot_ahead_in_their_order():
    assert waits(histories(r2=(4, 6), r3=(5, 8)), 0, 8) == [
        (0, 1, (), "nobody had a schedule yet; robot 2 made the first one"),
        (1, 4, (2,), "yet to enter"),
        (4, 5, (2,), "inside"),
        (5, 8, (3,), "inside"),
    ]


def test_wait_between_two_passages_is_behind_the_robot_that_is_yet_to_enter():
    assert waits(histories(r2=(2, 3), r3=(6, 7)), 2, 7) == [
        (2, 3, (2,), "inside"),
        (3, 6, (3,), "yet to enter"),
        (6, 7, (3,), "inside"),
    ]


def test_first_robot_of_a_schedule_waits_for_its_own_slot():
    assert waits(histories(order=(1, 2, 3)), 2, 4) == [(2, 4, (), OWN_SLOT)]


def test_robot_outside_of_the_schedule_waits_behind_those_that_have_slots():
    assert waits(histories(order=(2, 3), r3=(3, 4), r2=(5, 6)), 2, 8) == [
        (2, 3, (2, 3), NOT_NAMED),
        (3, 4, (3,), "inside"),
        (4, 5, (2,), NOT_NAMED),
        (5, 6, (2,), "inside"),
        (6, 8, (), ONLY_PASSED),
    ]


def test_robot_that_has_heard_of_no_schedule_waits_by_those_that_others_have():
    robots = histories(order=())
    assert waits(robots, 0, 2) == [(0, 2, (), "nobody had a schedule yet; none was made")]
    knows(robots[2], 1, 3, (3,))
    knows(robots[2], 4, 3, (3, 1))
    assert waits(robots, 0, 6) == [
        (0, 1, (), "nobody had a schedule yet; robot 3 made the first one"),
        (1, 4, (3,), NOT_NAMED),
        (4, 6, (), NOT_HEARD),
    ]


def test_robot_that_asks_at_one_resource_after_the_other_waits_at_each_behind_those_of_its_group():
    robots = histories(order=(2, 1), r2=(3, 9))
    robots[3].passages.append(PassageSpan(b"north", 0, seconds(20)))
    gates = (TurnGate(0, b"north", False), TurnGate(seconds(1), b"north", True), TurnGate(seconds(4), GROUP, True))
    assert waits(robots, 2, 12, gates) == [(2, 4, (3,), "inside"), (4, 9, (2,), "inside"), (9, 12, (), OWN_SLOT)]
    robots[3].passages.clear()
    assert waits(robots, 0, 1, gates) == [(0, 1, (), NOT_ASKED)]


def test_passage_of_another_group_is_nobody_ahead():
    robots = histories(order=(1,))
    robots[2].passages.append(PassageSpan(b"dock", seconds(1), seconds(9)))
    assert waits(robots, 2, 4) == [(2, 4, (), OWN_SLOT)]


def delivery(*handed_ms):
    return PastDelivery(begun=0, transmissions=[(milliseconds(at), handle) for handle, at in enumerate(handed_ms, 1)])


def radio(sent, end_ms, attempts):
    made = {key: [Attempt(milliseconds(a), milliseconds(b)) for a, b in tries] for key, tries in attempts.items()}
    return [(part.begin / 1e6, part.owner) for part in radio_time(1, sent, milliseconds(end_ms), made)]


def test_delivery_at_the_first_attempt_is_channel_access_until_it_is_read():
    assert radio(delivery(0), 20, {(1, 1): [(3, 5)]}) == [
        (0, TimeOwner.RADIO_QUEUE),
        (0, TimeOwner.CHANNEL_ACCESS),
        (5, TimeOwner.LATE_TICK),
    ]


def test_frames_of_the_sender_that_go_first_are_radio_queue():
    parts = radio(delivery(0), 12, {(1, 1): [(9, 12)], (1, 5): [(2, 7)], (3, 9): [(7, 8)]})
    assert parts == [(0, TimeOwner.RADIO_QUEUE), (7, TimeOwner.CHANNEL_ACCESS)]


def test_retransmissions_of_medium_access_and_exchange_are_repeats():
    parts = radio(delivery(0, 150), 170, {(1, 1): [(3, 5), (8, 10)], (1, 2): [(160, 170)]})
    assert parts == [(0, TimeOwner.RADIO_QUEUE), (0, TimeOwner.CHANNEL_ACCESS), (5, TimeOwner.REPEATS)]


def test_without_recorded_frames_the_instants_of_the_sender_must_do():
    assert radio(delivery(2, 150), 170, {}) == [
        (0, TimeOwner.RADIO_QUEUE),
        (2, TimeOwner.CHANNEL_ACCESS),
        (150, TimeOwner.REPEATS),
    ]


def standing(begin, end, rule, whom=(4,)):
    return Interval(begin, end, TimeOwner.STANDING, 1, whom, rule)


def test_neighbours_that_stand_for_one_robot_by_several_rules_are_one_interval():
    found = merged([standing(0, 2, "ways"), standing(2, 3, "shield"), standing(3, 5, "ways")])
    assert found == (standing(0, 5, "ways, shield"),)


def test_neighbours_that_stand_for_different_robots_stay_apart():
    intervals = (standing(0, 2, "ways"), standing(2, 3, "ways", (5,)))
    assert merged(intervals) == intervals


def test_interval_is_cut_at_the_deadline():
    assert cut_at((standing(0, 5, "ways"), standing(5, 9, "shield")), 3) == (
        standing(0, 3, "ways"),
        standing(3, 5, "ways"),
        standing(5, 9, "shield"),
    )


def test_time_in_which_the_robot_was_called_late_goes_to_that_owner():
    parts = without([standing(0, 10, "ways")], [(2, 4), (8, 12)], TimeOwner.LATE_TICK, 1, "late")
    late = [Interval(2, 4, TimeOwner.LATE_TICK, 1, (), "late"), Interval(8, 10, TimeOwner.LATE_TICK, 1, (), "late")]
    assert parts == [standing(0, 2, "ways"), late[0], standing(4, 8, "ways"), late[1]]


def lived(*lives):
    history = RobotHistory(1)
    for epoch, (begins, died) in enumerate(lives):
        history.minds.append(MindIndex(1, epoch, PROGRAM, begins))
        history.minds[-1].died = died
    return history


def test_robot_is_dead_between_its_lives_and_after_the_last():
    assert lived((0, 5), (7, 9), (12, NEVER)).absences(stopped=False) == [(5, 7), (9, 12)]
    assert lived((0, 5)).absences(stopped=False) == [(5, NEVER)]


def test_robot_that_was_stopped_in_order_is_not_dead():
    history = lived((0, 5), (7, 9), (12, NEVER))
    history.minds[0].stopped = True
    assert history.absences(stopped=True) == [(5, 7)]
    assert history.absences(stopped=False) == [(9, 12)]
