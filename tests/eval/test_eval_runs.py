"""How a run goes: delivery over a lossy ether, quiescence and what keeps it off, turns, and runs without an end."""

from itertools import pairwise

import pytest
from eval_command import actions, facts

from rmr.eval import ensemble
from rmr.eval.eval_ether import HOPS_AT_ONCE_MAX

COUNTERS = """
type send(robot, int).  type tick(robot, int).  type counted(robot, int).
send(@1, 200).  send(@2, 200).  counted(R, 0).
send(A, N), N > 0, B = @3 -o tick(B, N), send(A, N - 1).
tick(B, N), counted(B, K) -o counted(B, K + 1).
"""
HELD = """
type wish(robot).  type done(robot).  type action pass(R: robot) -o done(R).
wish(R).  ready(R).
ready(R) -o pass(R).
crossing: assert(wish(R), done(R), 20, broadcast(R)).
"""
BALL = """
type ball(robot, int).
ball(@1, 0).
ball(A, N), A = @1 -o ball(@2, N + 1).
ball(A, N), A = @2 -o ball(@1, N + 1).
"""
SPIN = "a(R).\na(R) -o a(R).\n"


# -- messages


@pytest.mark.parametrize("loss", ["0", "0.3", "0.4"])
def test_every_fact_arrives_exactly_once_whatever_is_lost(bench, loss):
    report = bench.run(COUNTERS, "--robots", "3", "--loss", loss, "--seed", "4", "--until", "5min")
    assert facts(report, 3) == ["counted(@3, 400)"]
    messages = report["messages"]
    assert report["quiescent"]
    assert messages["sent"] == messages["delivered"] + messages["lost"]
    assert (messages["repeated"] > 0) == (messages["lost"] > 0) == (loss != "0")
    assert messages["sent"] - messages["repeated"] == 400


def test_the_share_of_frames_lost_is_the_one_asked_for(bench):
    messages = bench.run(COUNTERS, "--robots", "3", "--loss", "0.3")["messages"]
    assert 0.2 < messages["lost"] / messages["sent"] < 0.4


def test_a_fact_takes_the_latency(bench):
    text = "tell(@1). tell(A) -o told(@2, A). told(B, A) -o heard(B, now())."
    assert facts(bench.run(text, "--robots", "2", "--latency", "120ms"), 2) == ["heard(@2, 0.12)"]
    assert facts(bench.run(text, "--robots", "2"), 2) == ["heard(@2, 0.005)"]


def test_a_fact_for_a_robot_out_of_range_is_retried_for_45_s_and_reported(bench):
    text = "tell(@1). tell(A) -o told(@3, A)."
    arguments = ("--robots", "3", "--topology", "line")
    report = bench.run(text, *arguments)
    assert report["quiescent"]
    assert 45 <= report["time_s"] < 46
    assert [report["robots"][robot]["undelivered"] for robot in "123"] == [1, 0, 0]
    assert report["messages"]["sent"] == report["messages"]["lost"] == report["messages"]["repeated"] + 1 > 10
    said = bench.told(text, *arguments)
    assert said.count("`told` of robot 1 did not reach robot 3: it is out of range") == 1


def test_a_program_that_declares_it_learns_what_did_not_arrive(bench):
    text = "type undelivered(robot, robot, name). tell(@1). tell(A) -o told(@2, A)."
    assert facts(bench.run(text, "--robots", "2", "--loss", "1")) == ["undelivered(@1, @2, told)"]


def test_a_fact_larger_than_a_frame_travels_in_pieces(bench):
    text = f'tell(@1). tell(A) -o told(@2, "{"x" * 400}").'
    report = bench.run(text, "--robots", "2", "--loss", "0.2")
    assert facts(report, 2) == [f'told(@2, "{"x" * 400}")']
    assert report["messages"]["sent"] - report["messages"]["repeated"] == 4


def test_goals_and_actions_travel_like_facts(bench):
    text = "type action go(R: robot) -o there(R). tell(@1). tell(A) -o go(@2), ?there(@2)."
    report = bench.run(text, "--robots", "2", "--loss", "0.4", "--seed", "2")
    [[_, action]] = actions(report, 2)
    assert action == "go(@2)"
    assert [text for text, _ in report["robots"]["2"]["goals"]["achieved"]] == ["there(@2)"]


# -- quiescence


@pytest.mark.parametrize(
    ("text", "arguments", "ends_s", "reason"),
    [
        ("a(R). a(R) -o b(R).", [], 0.0, None),
        ("", [], 0.0, None),
        ("p(R) -o q(R).", ["--insert", "7s: p(@1)"], 7.0, "--insert '7s: p(@1)' yet to come"),
        (
            "type action go(robot). a(R). a(R) -o go(R).",
            ["--action-time", "7s"],
            7.0,
            "robot 1: action go(@1) is under way",
        ),
        (
            "type a(robot). type b(robot). a(R). x: watch(a(R), b(R), 7, stop(R)).",
            [],
            7.0,
            "robot 1: the deadline of x, b(@1), is at 7 s",
        ),
        ("t(@1). t(A) -o u(@2, A).", ["--robots", "2", "--latency", "7s"], 7.0, "a fact for another robot"),
    ],
)
def test_a_run_ends_when_nothing_is_outstanding_and_not_before(bench, text, arguments, ends_s, reason):
    report = bench.run(text, *arguments)
    assert (report["quiescent"], report["time_s"]) == (True, ends_s)
    if reason is not None:
        assert not bench.run(text, *arguments, "--until", "6.9s")["quiescent"]
        said = bench.told(text, *arguments, "--until", "6.9s")
        assert "rmr eval: not quiescent at 6.9 s:" in said
        assert reason in said


def test_what_happens_at_the_very_end_still_happens(bench):
    report = bench.run("p(R) -o q(R).", "--insert", "2s: p(@1)", "--until", "2s")
    assert (report["quiescent"], facts(report)) == (True, ["q(@1)"])


def test_a_deadline_that_has_passed_is_not_outstanding(bench):
    text = "type a(robot). type b(robot). a(R). x: watch(a(R), b(R), 2, stop(R))."
    assert bench.run(text)["time_s"] == 2.0


def test_a_run_of_many_reasons_names_some_and_counts_the_rest(bench):
    said = bench.told("type action go(robot). a(R). a(R) -o go(R).", "--robots", "40", "--action-time", "90s")
    assert said.count("is under way") == 8
    assert "and 32 more robots are not idle" in said


# -- turns


def test_actions_that_serve_a_job_go_one_by_one_a_slot_apart(bench):
    report = bench.run(HELD, "--robots", "3", "--action-time", "1s")
    started = sorted(at for robot in "123" for at, _ in report["robots"][robot]["actions"])
    assert all(later - earlier >= 1.0 for earlier, later in pairwise(started))
    assert started[-1] < 6
    assert all(report["robots"][robot]["assertions"][0]["met"] for robot in "123")
    assert report["quiescent"]
    assert report["messages"]["sent"] > 0


def test_a_lossy_ether_does_not_keep_robots_from_their_turns(bench):
    report = bench.run(HELD, "--robots", "3", "--action-time", "1s", "--loss", "0.2")
    assert [report["robots"][robot]["assertions"][0]["met"] for robot in "123"] == [True] * 3


def test_a_watched_job_waits_for_no_turn(bench):
    report = bench.run(HELD.replace("assert(", "watch("), "--robots", "3", "--action-time", "1s")
    assert [report["robots"][robot]["actions"] for robot in "123"] == [[[0.0, f"pass(@{robot})"]] for robot in "123"]
    assert report["messages"]["sent"] == 0


def test_a_missed_deadline_is_broadcast_to_those_in_range(bench):
    text = """
    type wish(robot).  type done(robot).  wish(@1).
    x: watch(wish(R), done(R), 2, broadcast(R)).
    failed(R, B, E) -o knows(R, B, E, now()).
    """
    report = bench.run(text, "--robots", "3", "--topology", "line")
    assert facts(report, 2) == ["knows(@2, @1, x, 2.005)"]
    assert facts(report, 3) == []


# -- without an end


def test_a_program_that_never_becomes_quiet_runs_to_the_end_and_is_named(bench):
    report = bench.run(SPIN, "--until", "500ms")
    assert (report["quiescent"], report["time_s"]) == (False, 0.5)
    assert report["firings"] == 31 * 500
    said = bench.told(SPIN, "--until", "500ms")
    assert "not quiescent at 0.5 s:" in said
    assert "robot 1: rules are still satisfied after 15500 firings, the last at" in said
    assert "p.rmr:2" in said


def test_firings_and_messages_of_a_run_are_bounded(bench, monkeypatch):
    monkeypatch.setattr(ensemble, "FIRINGS_MAX", 5000)
    report = bench.run(SPIN)
    assert (report["quiescent"], report["firings"]) == (False, 5500)
    assert report["time_s"] < 1
    assert "after 5500 firings and 0 frames without an end in sight" in bench.told(SPIN)
    monkeypatch.setattr(ensemble, "FRAMES_MAX", 50)
    assert bench.run(BALL, "--robots", "2")["messages"]["sent"] == 51


def test_robots_that_pass_a_ball_in_no_time_do_not_stop_the_clock(bench):
    report = bench.run(BALL, "--robots", "2", "--latency", "0", "--until", "1s")
    assert (report["quiescent"], report["time_s"]) == (False, 1.0)
    assert report["firings"] == HOPS_AT_ONCE_MAX + 201
    said = bench.told(BALL, "--robots", "2", "--latency", "0", "--until", "1s")
    assert "robots answer each other without end; from 0 s on every frame takes 5 ms" in said


def test_a_long_way_in_no_time_takes_no_time(bench):
    text = "wet(@1). wet(A) -o seen(A), {B | next(A, B) | wet(B)}.\n"
    text += "".join(f"!next(@{robot}, @{robot + 1}).\n" for robot in range(1, 100))
    report = bench.run(text, "--robots", "100", "--latency", "0")
    assert (report["time_s"], facts(report, 100)) == (0.0, ["seen(@100)"])


# -- across robots


ACROSS = """
type asked(robot, robot).  type answered(robot).
asked(@1, @2).
answer: watch(asked(A, B), answered(B), 5, broadcast(A)).
"""


@pytest.mark.parametrize(
    ("arguments", "finish_s", "met", "cause"),
    [
        (["--insert", "4s: answered(@2)"], 4.0, True, None),
        (["--insert", "4s: answered(@2)", "--latency", "2s"], 4.0, False, "network"),
        (["--insert", "6s: answered(@2)"], 6.0, False, "local"),
        ([], None, False, "local"),
    ],
)
def test_a_miss_is_the_networks_if_only_the_news_was_late(bench, arguments, finish_s, met, cause):
    report = bench.run(ACROSS, "--robots", "2", *arguments)
    [job] = report["robots"]["1"]["assertions"]
    assert report["robots"]["2"]["assertions"] == []
    assert (job["job"], job["finish_s"], job["met"], job["cause"]) == ("answered(@2)", finish_s, met, cause)
    assert [text for _, text in actions(report)] == ([] if met else ["broadcast(@1)"])


@pytest.mark.parametrize("loss", ["0", "0.4"])
def test_a_step_waits_for_the_end_of_another_robots_action(bench, loss):
    text = """
    type action fetch(R: robot) -o fetched(R).  type action lift(R: robot) -o lifted(R).
    go(@1).
    go(A) -o fetch(@2) then lift(A) then fin(A).
    """
    report = bench.run(text, "--robots", "2", "--action-time", "1s", "--loss", loss)
    assert (facts(report, 1), facts(report, 2)) == (["fin(@1)", "lifted(@1)"], ["fetched(@2)"])
    [[fetch_s, _]], [[lift_s, _]] = actions(report, 2), actions(report, 1)
    assert lift_s >= fetch_s + 1.005
    assert report["quiescent"]
