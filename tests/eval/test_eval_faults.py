"""Actions that take times of their own or fail, and robots that are killed and started again, in `rmr eval`."""

import pytest
from eval_command import actions, facts

CHARGE = """
type action charge(R: robot, N: int) -o charged(R, N) else flat(R, N).
type action wait(robot, float).
type charged(robot, int).
type flat(robot, int).
low(R).
low(R) -o charge(R, 1).
charged(R, N), N < 3 -o charge(R, N + 1).
"""
PING = """
type ping(robot, int).
type sensor neighbor(robot, robot).
type !id(robot, int).
met(R).
$met(R), neighbor(R, B) -o seen(R, B).
send(R), id(R, N) -o ping(@2, N).
"""


# -- how long actions take


@pytest.mark.parametrize(
    ("arguments", "end_s"),
    [
        ([], 5.0),
        (["--action-time", "1s"], 5.0),
        (["--action-time", "wait=2s"], 2.0),
        (["--action-time", "7s", "--action-time", "wait=500ms"], 0.5),
    ],
)
def test_wait_takes_the_seconds_of_its_argument_unless_a_time_is_given_for_it(bench, arguments, end_s):
    report = bench.run("type action wait(robot, float). go(R). go(R) -o wait(R, 5.0) then done(R).", *arguments)
    assert (facts(report), report["time_s"], report["quiescent"]) == (["done(@1)"], end_s, True)


def test_wait_of_no_time_at_all_takes_a_millisecond_as_on_a_robot(bench):
    report = bench.run("type action wait(robot, float). go(R). go(R) -o wait(R, 3) then wait(R, 0) then done(R).")
    assert report["time_s"] == 3.001


def test_wait_of_a_negative_time_fails_with_its_reason(bench):
    text = "type action wait(R: robot, T: float) -o done(R) else no(R). go(R). go(R) -o wait(R, -1.0)."
    assert facts(bench.run(text)) == ["no(@1)"]


def test_each_action_takes_the_time_given_for_its_name(bench):
    text = "type action a(R: robot) -o x(R). type action b(R: robot) -o y(R). go(R). go(R) -o a(R) then b(R)."
    report = bench.run(text, "--action-time", "1s", "--action-time", "b=3s")
    assert (actions(report), report["time_s"]) == ([[0.0, "a(@1)"], [1.0, "b(@1)"]], 4.0)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (["chrge=2s"], "--action-time: the program has no action 'chrge'; did you mean `charge`?"),
        (["low=2s"], "the program has no action 'low'"),
        (["1s", "2s"], "'2s' is the second time for all actions; write NAME=2s for one"),
        (["charge=1s", "charge=2s"], "the time of charge is given twice"),
        (["charge=soon"], "'soon' is no duration"),
        (["=2s"], "the program has no action ''"),
    ],
)
def test_a_wrong_action_time_is_refused(bench, times, message):
    assert message in bench.refused(CHARGE, *[word for time in times for word in ("--action-time", time)])


# -- actions that fail


@pytest.mark.parametrize(
    ("fail", "flat"),
    [
        ("charge", {1: 1, 2: 1}),
        ("charge(@2, _)", {2: 1}),
        ("charge(@2,_)@3", {2: 3}),
        ("charge(R, 2)", {1: 2, 2: 2}),
        ("charge@2", {2: 1}),
        ("charge(_, 2)@2", {2: 2}),
        ("charge(R, R)", {}),
    ],
)
def test_the_actions_that_match_fail(bench, fail, flat):
    report = bench.run(CHARGE, "--robots", "2", "--action-time", "1s", "--fail", fail)
    expected = {
        robot: [f"flat(@{robot}, {flat[robot]})" if robot in flat else f"charged(@{robot}, 3)"] for robot in (1, 2)
    }
    assert {robot: facts(report, robot) for robot in (1, 2)} == expected


def test_what_fails_takes_its_time_and_drops_the_steps_behind_it(bench):
    text = "type action a(R: robot) -o x(R) else y(R). go(R). go(R) -o a(R) then done(R)."
    report = bench.run(text, "--action-time", "2s", "--fail", "a")
    assert (facts(report), report["time_s"]) == (["y(@1)"], 2.0)
    noted = bench.notes(text, "--fail", "a(_)@1")
    assert [note["failure"] for note in noted if note["what"] == "action_ended"] == ["--fail a(_)@1"]


@pytest.mark.parametrize(
    ("fail", "begun"), [("charge(@1, 9)", "none began"), ("charge@9", "3 began"), ("charge(@1, 1)@2", "one began")]
)
def test_a_failure_that_no_action_has_met_is_told(bench, fail, begun):
    assert f"--fail '{fail}' failed no action: of those that match {begun}" in bench.told(CHARGE, "--fail", fail)


@pytest.mark.parametrize(
    ("fail", "message"),
    [
        ("chrge", "the program has no action `chrge`; did you mean `charge`?"),
        ("low(@1)", "the program has no action `low`"),
        ("charge(@1)", "`charge` has 2 arguments, not 1; it is `type action charge(robot, int).`"),
        ("charge(@1, x)", "an argument of `charge` is int, not symbol"),
        ("charge(3, 1)", "is robot, not int"),
        ("!charge(@1, 1)", "is an action: write it without a mark"),
        ("charge(@1, 1)@0", "actions are counted from 1"),
        ("charge(@1, 1)@x", "write an action such as"),
        ("", "write an action such as"),
    ],
)
def test_a_wrong_failure_is_refused(bench, fail, message):
    assert message in bench.refused(CHARGE, "--fail", fail)


# -- robots that die


def test_a_killed_robot_does_nothing_more_and_the_report_says_so(bench):
    report = bench.run(CHARGE, "--robots", "2", "--action-time", "2s", "--kill", "3s: @2")
    assert (facts(report, 1), facts(report, 2)) == (["charged(@1, 3)"], [])
    assert actions(report, 2) == [[0.0, "charge(@2, 1)"], [2.0, "charge(@2, 2)"]]
    assert (report["robots"]["2"]["restarts"], report["robots"]["2"]["alive"]) == (0, False)
    assert (report["quiescent"], report["time_s"]) == (True, 6.0)
    assert "alive" not in report["robots"]["1"]


def test_a_restarted_robot_begins_anew_and_the_report_holds_all_its_lives(bench):
    report = bench.run(CHARGE, "--robots", "2", "--action-time", "2s", "--kill", "3s: @2", "--restart", "10s: @2")
    assert facts(report, 2) == ["charged(@2, 3)"]
    assert [at for at, _ in actions(report, 2)] == [0.0, 2.0, 10.0, 12.0, 14.0]
    assert (report["robots"]["2"]["restarts"], report["robots"]["2"]["alive"]) == (1, True)
    assert (report["quiescent"], report["time_s"]) == (True, 16.0)


def test_a_job_that_its_robots_death_leaves_undecided_says_so(bench):
    text = "type wish(robot). type done(robot). type never(robot). wish(R). never(R) -o done(R).\n"
    text += "finish: watch(wish(R), done(R), 30, broadcast(R)). type action broadcast(robot)."
    report = bench.run(text, "--kill", "1s: @1", "--restart", "2s: @1", "--kill", "3s: @1")
    told = [(job["start_s"], job["met"], job["cause"]) for job in report["robots"]["1"]["assertions"]]
    assert told == [(0.0, None, "died"), (2.0, None, "died")]
    assert (report["quiescent"], report["time_s"]) == (True, 3.0)


def test_what_is_sent_to_a_dead_robot_is_repeated_until_it_lives_again(bench):
    arguments = ["--robots", "2", "--kill", "1s: @2", "--restart", "4s: @2", "--insert", "2s: send(@1)"]
    report = bench.run(PING, *arguments)
    assert "ping(@2, 1)" in facts(report, 2)
    # The new life refuses the frame that is meant for the earlier one, and takes the next.
    assert (report["messages"]["delivered"], report["robots"]["1"]["undelivered"]) == (2, 0)
    assert report["messages"]["lost"] == report["messages"]["sent"] - 2 > 0


def test_a_frame_under_way_to_a_robot_that_dies_is_lost(bench):
    report = bench.run(PING, "--robots", "2", "--latency", "1s", "--kill", "2.5s: @2", "--insert", "2s: send(@1)")
    assert report["messages"]["delivered"] == 0
    assert report["messages"]["lost"] == report["messages"]["sent"]
    assert report["robots"]["1"]["undelivered"] == 1
    assert report["quiescent"]


def test_a_dead_robot_is_no_neighbor_and_is_one_again_when_it_lives(bench):
    arguments = ["--robots", "3", "--kill", "1s: @2", "--restart", "2s: @2"]
    assert facts(bench.run(PING, *arguments), 1) == ["met(@1)", "seen(@1, @2)", "seen(@1, @2)", "seen(@1, @3)"]
    assert facts(bench.run(PING, *arguments[:4]), 1) == ["met(@1)", "seen(@1, @2)", "seen(@1, @3)"]


def test_a_fact_for_a_dead_robot_is_dropped_with_a_warning(bench):
    arguments = ["--robots", "2", "--kill", "1s: @1,@2", "--restart", "3s: @1"]
    arguments += ["--insert", "2s: send(@2)", "--insert", "3s: send(@1)"]
    told = bench.told(PING, *arguments)
    assert "--insert '2s: send(@2)' came while robot 2 was dead; it is dropped" in told
    assert "3s: send" not in told


def test_a_robot_that_restarts_learns_who_is_dead_in_its_range(bench):
    """Robot 2 has never heard robot 3 in its new life; robot 4, out of its range, is not named; robot 1 comes back."""
    text = "type heard_of(robot, robot). silent(R, N), not heard_of(R, N) -o heard_of(R, N)."
    deaths = ["--kill", "1s: @1,@3,@4", "--kill", "2s: @2", "--restart", "3s: @2", "--restart", "9s: @1"]
    report = bench.run(text, "--robots", "5", "--topology", "line", *deaths)
    assert report["quiescent"]
    assert report["time_s"] == 18.0
    assert facts(report, 2) == ["heard_of(@2, @3)"]
    assert facts(report, 1) == []
    assert facts(report, 5) == ["heard_of(@5, @4)"]


def test_deaths_stand_in_the_trace(bench):
    noted = bench.notes(CHARGE, "--robots", "2", "--kill", "1s: @2", "--restart", "2s: @2")
    assert [note for note in noted if note["what"] == "fault"] == [
        {"t": 1.0, "robot": 2, "what": "fault", "fault": "killed"},
        {"t": 2.0, "robot": 2, "what": "fault", "fault": "restarted"},
    ]


def test_a_death_that_is_yet_to_come_is_outstanding(bench):
    assert "--kill '90s: @1' yet to come" in bench.told(CHARGE, "--kill", "90s: @1")


def test_columns_give_way_to_single_robots_that_may_die(bench):
    assert "--kill ends robots" in bench.told("p(R).", "--engine", "columnar", "--kill", "1s: @1")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--kill", "1s: @9"], "--kill '1s: @9': robot 9 is not among the robots"),
        (["--kill", "1s"], "'1s' is no time and robot; write '5s: @2'"),
        (["--kill", "1s: two"], "'two' is no id"),
        (["--kill", "soon: @1"], "'soon' is no duration"),
        (["--kill", "1s: @1,@1"], "robot 1 is listed twice"),
        (["--restart", "1s: @1"], "robot 1 lives at 1 s: kill it before it is started again"),
        (["--kill", "1s: @1", "--kill", "2s: @1"], "robot 1 is dead at 2 s: start it again first"),
        (["--kill", "2s: @1", "--restart", "1s: @1"], "robot 1 lives at 1 s"),
    ],
)
def test_a_death_that_cannot_be_is_refused(bench, arguments, message):
    assert message in bench.refused(CHARGE, "--robots", "2", *arguments)


def test_runs_with_deaths_are_the_same_every_time_with_loss_and_with_turns(bench):
    text = """
    type wish(robot). type done(robot). type action cross(R: robot) -o done(R). wish(R). start(R).
    start(R) -o cross(R). crossing: assert(wish(R), done(R), 60, broadcast(R)). type action broadcast(robot).
    """
    arguments = ["--robots", "4", "--loss", "0.1", "--action-time", "1s", "--kill", "2s: @2,@3", "--restart", "5s: @3"]
    first = bench.run(text, *arguments)
    assert first == bench.run(text, *arguments)
    assert [facts(first, robot) for robot in (1, 3, 4)] == [[f"done(@{r})", f"wish(@{r})"] for r in (1, 3, 4)]


TOO_LARGE = """type big(robot, list int). type list_of(robot, list int). n(@1, 1000). list_of(R, []).
n(R, N), list_of(R, L), N > 0 -o n(R, N - 1), list_of(R, L + [1234567890123]).
n(R, 0), list_of(R, L), peer(R, B) -o big(B, L). big(R, _) -o got(R)."""


def test_a_fact_that_is_too_large_to_be_sent_ends_the_command_with_1(bench):
    result = bench.call(bench.file("p.rmr", TOO_LARGE), "--robots", "2")
    assert result.exit_code == 1
    assert "`big` of robot 1 did not reach robot 2: a fact of 9007 octets is too large" in result.stderr
    nested = "[" * 10 + "1" + "]" * 10
    deep = f"type deep(robot, {'list ' * 10}int). a(@1). a(R), peer(R, B) -o deep(B, {nested}). deep(R, _) -o got(R)."
    result = bench.call(bench.file("deep.rmr", deep), "--robots", "2")
    assert (result.exit_code, "lists nested too deep" in result.stderr) == (1, True), result.stderr
    assert bench.run(TOO_LARGE.replace("1000", "10"), "--robots", "2")["quiescent"]
