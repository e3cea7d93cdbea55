"""What is kept of a run: bounded, by time, and readable while it grows."""

import pytest

from rmr_view import run_history
from rmr_view.recorded_messages import fault_of, take
from rmr_view.run_history import EntryLog, RunHistory


@pytest.fixture
def history():
    return RunHistory([1, 2])


def both(x):
    return {1: (x, 0.0, 0.0), 2: (0.0, x, 0.0)}


def test_track_beyond_its_bound_is_thinned_in_its_older_half(history, monkeypatch):
    monkeypatch.setattr(run_history, "SAMPLES_MAX", 100)
    for i in range(1000):
        history.add_poses(float(i), both(i))
    times = history.poses(0, 1e9)["t"]
    assert len(times) <= 100
    assert times == sorted(times)
    assert times[-40:] == [float(i) for i in range(960, 1000)]
    assert history.poses(0, 1e9)["robots"]["2"]["y"][-1] == 999.0


def test_answer_beyond_its_bound_has_every_nth_sample(history, monkeypatch):
    monkeypatch.setattr(run_history, "POINTS_MAX", 200)
    for i in range(1000):
        history.add_poses(float(i), both(i))
    answer = history.poses(0, 1e9)
    assert (answer["step"], len(answer["t"])) == (10, 100)
    assert history.poses(500, 509)["step"] == 1


def test_late_sample_fills_a_gap_and_repeats_none(history):
    for t in (1.0, 1.1, 1.5):
        history.add_poses(t, both(t))
    for t in (1.11, 1.3, 1.48, 1.5, 1.0):
        history.add_poses(t, both(t))
    assert history.poses(0, 9)["t"] == [1.0, 1.1, 1.3, 1.5]
    assert history.pose(1, 1.35)[0] == (1.3, 0.0, 0.0)
    assert history.newest[0] == 1.5


def test_unknown_pose_is_null(history):
    history.add_poses(1.0, {1: (1.0, 2.0, 3.0)})
    assert history.poses(0, 9)["robots"]["2"] == {"x": [None], "y": [None], "heading": [None]}
    assert history.pose(2, 1.0) == (None, None)
    assert history.pose(1, 0.5) == (None, None)


def test_entries_are_numbered_so_that_a_reader_notices_what_was_dropped():
    log = EntryLog(100)
    log.add({"t": float(i)} for i in range(90))
    assert len(log.since(0)) == 90
    log.add({"t": float(i)} for i in range(90, 120))
    assert (log.count, log.dropped) == (120, 70)
    assert [entry["t"] for entry in log.since(115)] == [115.0, 116.0, 117.0, 118.0, 119.0]
    assert len(log.since(0)) == 50


def test_route_and_state_are_those_of_the_instant(history):
    take(history, "/routes", 1_000_000_000, {"robot": 1, "points": [[0, 0], [1, 1]]})
    take(history, "/routes", 3_000_000_000, {"robot": 1, "points": []})
    take(history, "/status", 2_000_000_000, {"robot": 1, "queue": 4})
    assert [history.route(1, t) for t in (0.5, 1.0, 2.9, 3.0)] == [None, [[0, 0], [1, 1]], [[0, 0], [1, 1]], None]
    assert [history.status(1, t).get("queue") for t in (1.9, 2.0, 9.0)] == [None, 4, 4]


def test_message_of_another_form_is_counted_and_left_out(history):
    for topic in ("/tf", "/trace", "/log", "/routes", "/status", "/faults"):
        take(history, topic, 0, {"nix": 1})
    take(history, "/elsewhere", 0, {})
    assert history.malformed == 6
    assert history.poses(0, 9)["t"] == []


def test_faults_of_a_simulated_robot_get_the_keys_of_a_lab_file():
    assert fault_of({"at": 2.0, "killed": 3}) == {"at": 2.0, "kill": 3}
    assert fault_of({"at": 2.0, "stalled": 3, "to": 4.0}) == {"from": 2.0, "to": 4.0, "stall": 3}
    assert fault_of({"from": 1.0, "loss": 0.5}) == {"from": 1.0, "loss": 0.5}
