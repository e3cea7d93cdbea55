"""Turns as intervals: kinds, claims, lost slots, faults, deadlines, leaders and schedules from entries of the trace."""

from pathlib import Path

import pytest

from rmr.node.trace import EVENTS
from rmr_sim.run_setup import Options, load
from rmr_view.turn_intervals import CLAIM_S, TurnIntervals


def entry(t, robot, what, **fields):
    return {"t": t, "robot": robot, "what": what, **fields}


EVENT = "crossing(exit)"


def slotted(t, robot, start_s, rank=1, event=EVENT):
    return entry(t, robot, "slotted", event=event, rank=rank, start_s=start_s, end_s=start_s + 4.0)


def kinds(lane):
    return [(each["kind"], each["begin_s"], each["end_s"]) for each in lane["intervals"]]


def timeline(entries, end_s, robots=(), faults=()):
    """Return the timeline of a run from the entries of its trace and its faults, both in any order."""
    turns = TurnIntervals(robots)
    dated = [(float(each["t"]), 1, each) for each in entries]
    dated += [(float(fault.get("at", fault.get("from", 0.0))), 0, fault) for fault in faults]
    for _, is_entry, each in sorted(dated, key=lambda one: one[:2]):
        (turns.add if is_entry else turns.add_fault)(each)
    return turns.timeline(end_s)


def lane_of(entries, end_s=20.0, robot=1, faults=()):
    return next(lane for lane in timeline(entries, end_s, faults=faults)["lanes"] if lane["robot"] == robot)


PASSAGE = [
    entry(0.5, 1, "asks", event=EVENT, approach_s=1.0, inside_s=4.0, after_s=1.0, way=0),
    slotted(1.0, 1, 6.0),
    entry(6.0, 1, "entered", event=EVENT, cautious=False),
    entry(10.0, 1, "left", event=EVENT),
]


def test_passage_is_asking_waiting_claiming_inside_without_gap_and_bears_its_event():
    lane = lane_of(PASSAGE)
    claim = 6.0 - CLAIM_S
    assert kinds(lane) == [
        ("asking", 0.5, 1.0),
        ("waiting", 1.0, claim),
        ("claiming", claim, 6.0),
        ("inside", 6.0, 10.0),
    ]
    assert {each["event"] for each in lane["intervals"]} == {EVENT}


def test_actions_are_from_their_begin_to_their_end_or_death_or_the_instant_asked_for():
    entries = [
        entry(1.0, 1, "action", action="moveto(@1, a)"),
        entry(2.0, 1, "action", action="say(@1)"),
        entry(3.0, 1, "action_ended", action="moveto(@1, a)", failure="no way"),
        entry(4.0, 1, "action", action="moveto(@1, a)"),
    ]
    lane = lane_of(entries, 6.0)
    assert [(each["action"], each["begin_s"], each["end_s"], each["failure"]) for each in lane["actions"]] == [
        ("moveto(@1, a)", 1.0, 3.0, "no way"),
        ("say(@1)", 2.0, 6.0, None),
        ("moveto(@1, a)", 4.0, 6.0, None),
    ]
    lane = lane_of(entries, 6.0, faults=[{"at": 5.0, "kill": 1}])
    assert [each["end_s"] for each in lane["actions"]] == [3.0, 5.0, 5.0]


@pytest.mark.parametrize(
    ("until", "last"), [(0.7, ("asking", 0.5, 0.7)), (2.0, ("waiting", 1.0, 2.0)), (8.0, ("inside", 6.0, 8.0))]
)
def test_open_interval_ends_at_the_instant_asked_for(until, last):
    assert kinds(lane_of([each for each in PASSAGE if each["t"] <= until], until))[-1] == last


def test_slot_that_moves_during_the_claim_begins_a_new_wait_and_a_new_rank_alone_does_not():
    moved = [PASSAGE[0], slotted(1.0, 1, 2.0), slotted(1.6, 1, 2.0, rank=2), slotted(1.8, 1, 6.0)]
    assert kinds(lane_of(moved, 5.0)) == [
        ("asking", 0.5, 1.0),
        ("waiting", 1.0, 1.45),
        ("claiming", 1.45, 1.8),
        ("waiting", 1.8, 5.0),
    ]


def test_lost_slot_leads_back_to_asking():
    lost = [*PASSAGE[:2], entry(6.4, 1, "slot_lost", event=EVENT, missed=True)]
    assert [kind for kind, _, _ in kinds(lane_of(lost))] == ["asking", "waiting", "claiming", "asking"]


def test_wait_ends_when_the_request_is_withdrawn():
    withdrawn = [*PASSAGE[:2], entry(3.0, 1, "withdrawn", event=EVENT)]
    assert kinds(lane_of(withdrawn))[-1] == ("waiting", 1.0, 3.0)


def test_turns_of_one_robot_overlap():
    """It has its place in a station, and takes its turn at a door on the way there."""
    lane = lane_of(
        [
            *PASSAGE[:3],
            entry(7.0, 1, "asks", event="door"),
            slotted(7.5, 1, 8.0, event="door"),
            entry(8.0, 1, "entered", event="door", cautious=False),
            entry(9.0, 1, "left", event="door"),
            PASSAGE[3],
        ]
    )
    inside = [(each["event"], each["begin_s"], each["end_s"]) for each in lane["intervals"] if each["kind"] == "inside"]
    assert inside == [(EVENT, 6.0, 10.0), ("door", 8.0, 9.0)]


def test_requests_without_an_event_as_in_older_recordings_are_those_of_the_next_entry():
    older = [{key: value for key, value in each.items() if key != "event"} for each in PASSAGE[:2]]
    assert kinds(lane_of([*older, *PASSAGE[2:]])) == kinds(lane_of(PASSAGE))


def test_killed_robot_is_dead_until_its_restart_and_nothing_of_its_turn_goes_on():
    faults = [{"at": 2.0, "kill": 1}, {"at": 5.0, "restart": 1}, {"from": 7.0, "to": 30.0, "stall": 1}]
    lane = lane_of(PASSAGE[:2], faults=faults)
    assert kinds(lane) == [("asking", 0.5, 1.0), ("waiting", 1.0, 2.0), ("dead", 2.0, 5.0), ("stalled", 7.0, 20.0)]
    as_traced = [entry(2.0, 1, "fault", fault="killed"), entry(5.0, 1, "fault", fault="restarted")]
    assert kinds(lane_of([*PASSAGE[:2], *as_traced])) == kinds(lane)[:3]


def test_robot_that_was_stopped_is_no_dead_one_and_one_that_died_by_itself_is():
    faults = [{"at": 2.0, "stop": 1}, {"at": 5.0, "restart": 1}, {"at": 7.0, "die": 1}]
    gone = [("asking", 0.5, 1.0), ("waiting", 1.0, 2.0), ("stopped", 2.0, 5.0), ("dead", 7.0, 20.0)]
    assert kinds(lane_of(PASSAGE[:2], faults=faults)) == gone
    assert kinds(lane_of([*PASSAGE[:2], entry(2.0, 1, "fault", fault="stopped")]))[-1] == ("stopped", 2.0, 20.0)


def test_last_words_of_a_process_that_come_after_its_end_as_its_launcher_dates_it_do_not_revive_it():
    late = [entry(2.1, 1, "slot_lost", event=EVENT), entry(2.2, 1, "asks", event=EVENT)]
    assert kinds(lane_of([*PASSAGE[:2], *late], faults=[{"at": 2.0, "stop": 1}]))[-1] == ("stopped", 2.0, 20.0)
    back = entry(4.0, 1, "asks", event=EVENT)  # of a process that was started by hand, of which no launcher tells
    assert kinds(lane_of([*PASSAGE[:2], back], faults=[{"at": 2.0, "stop": 1}]))[-1] == ("asking", 4.0, 20.0)


def test_deadlines_are_met_missed_or_undecided():
    jobs = [
        entry(0.0, 1, "job_started", job="a", deadline_s=5.0),
        entry(0.0, 1, "job_started", job="b", deadline_s=5.0),
        entry(1.0, 1, "job_started", job="c", deadline_s=50.0),
        entry(4.0, 1, "job_finished", job="a"),
        entry(5.0, 1, "deadline_missed", job="b"),
        entry(6.0, 1, "job_finished", job="b"),
    ]
    assert [(job["job"], job["finish_s"], job["met"]) for job in lane_of(jobs)["deadlines"]] == [
        ("a", 4.0, True),
        ("b", 6.0, False),
        ("c", None, None),
    ]


def test_leader_leads_until_it_hears_of_another_or_dies():
    entries = [
        *PASSAGE[:1],
        entry(1.0, 1, "leads", event=EVENT, term=1),
        entry(1.0, 1, "scheduled", event=EVENT, leader=1, term=1, order=[1, 2]),
        entry(1.1, 2, "scheduled", event=EVENT, leader=1, term=1, order=[1, 2]),
        entry(3.0, 2, "leads", event=EVENT, term=2),
        entry(3.0, 2, "scheduled", event=EVENT, leader=2, term=2, order=[2, 1]),
        entry(3.2, 1, "scheduled", event=EVENT, leader=2, term=2, order=[2, 1]),
        entry(4.0, 1, "entered", event=EVENT, cautious=False),
    ]
    found = timeline(entries, 9.0, faults=[{"at": 7.0, "kill": 2}])
    assert [(term["robot"], term["begin_s"], term["end_s"]) for term in found["leaders"]] == [
        (1, 1.0, 3.2),
        (2, 3.0, 7.0),
    ]
    assert [(each["t_s"], each["order"]) for each in found["schedules"]] == [(1.0, [1, 2]), (3.0, [2, 1])]
    assert found["leaders"][0]["event"] == found["schedules"][0]["event"] == EVENT


def test_timeline_may_be_read_while_entries_come():
    turns = TurnIntervals([1, 2])
    for each in PASSAGE:
        turns.add(each)
        turns.timeline(each["t"])
    assert turns.timeline(20.0) == timeline(PASSAGE, 20.0, [1, 2])
    assert turns.timeline(20.0)["lanes"][1] == {"robot": 2, "intervals": [], "actions": [], "deadlines": []}


@pytest.mark.medium
def test_timeline_of_a_simulated_corridor_agrees_with_its_report():
    simulation = load(Path(__file__).parents[3] / "deploy/labs/corridor", Options()).simulation(7)
    simulation.run()
    found = timeline(simulation.trace(), simulation.time_s, simulation.lab.roster)
    assert set(TurnIntervals._WORDS) - {"fault"} <= set(EVENTS)
    parts = simulation.robot_parts()
    for lane in found["lanes"]:
        assert [kind for kind, _, _ in kinds(lane)] == ["asking", "waiting", "claiming", "inside"]
        assert all(a["end_s"] == b["begin_s"] for a, b in zip(lane["intervals"], lane["intervals"][1:], strict=False))
        [job] = lane["deadlines"]
        [reported] = parts[lane["robot"]]["assertions"]
        assert (job["deadline_s"], job["met"]) == (reported["deadline_s"], reported["met"])
        assert job["finish_s"] == pytest.approx(reported["finish_s"], abs=0.05)


def test_cleared_faults_end_and_those_of_the_lab_stay():
    made = TurnIntervals([1, 2])
    for fault in (
        {"from": 0.0, "to": 9.0, "loss": 0.1},
        {"from": 2.0, "loss": 0.5},
        {"from": 3.0, "to": 9.0, "stall": 2},
    ):
        made.add_fault(fault)
    made.end_faults(4.0, 1)
    assert [fault.get("to") for fault in made.timeline(5.0)["faults"]] == [9.0, 4.0, 9.0]


def test_the_world_of_a_durable_run_dies_without_a_lane():
    faults = [{"at": 1.0, "die": "world"}, {"at": 1.0, "restart": "world"}]
    shown = timeline([slotted(0.5, 1, 5.0)], 20.0, faults=faults)
    assert [lane["robot"] for lane in shown["lanes"]] == [1]
    assert shown["faults"] == faults
