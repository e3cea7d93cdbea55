"""What `rmr eval` reports, to the letter."""

import json
import re

from eval_command import actions, facts

CROSSING = """
type start(robot).
type wish(robot, area).
type action pass(R: robot, A: area) -o inside(R, A).
type inside(robot, area).
start(R).
start(R) -o wish(R, gate), pass(R, gate).
crossing: watch(wish(R, A), inside(R, A), 10, broadcast(R)).
"""


def test_the_report_has_these_keys_and_no_others(bench):
    report = bench.run(CROSSING, "--robots", "2", "--action-time", "4s")
    assert list(report) == ["version", "quiescent", "time_s", "firings", "robots", "messages"]
    assert (report["quiescent"], report["time_s"], report["firings"]) == (True, 4.0, 2)
    assert list(report["robots"]) == ["1", "2"]
    assert report["robots"]["2"] == {
        "facts": ["inside(@2, gate)", "wish(@2, gate)"],
        "goals": {"achieved": [], "open": []},
        "actions": [[0.0, "pass(@2, gate)"]],
        "assertions": [
            {
                "name": "crossing",
                "job": "inside(@2, gate)",
                "start_s": 0.0,
                "finish_s": 4.0,
                "deadline_s": 10.0,
                "met": True,
                "cause": None,
            }
        ],
        "undelivered": 0,
        "expression_failures": 0,
    }
    assert report["messages"] == {"sent": 0, "delivered": 0, "lost": 0, "repeated": 0, "bytes": 0}


def test_the_report_alone_stands_on_standard_output_as_one_json_document(bench):
    result = bench.call(bench.file("p.rmr", "p(R). q(R) -o p(R)."))
    assert json.loads(result.stdout)["robots"]["1"]["facts"] == ["p(@1)"]
    assert "W102" in result.stderr
    one_line = bench.call(str(bench.folder / "p.rmr"), "--json").stdout
    assert one_line.count("\n") == 1
    assert json.loads(one_line) == json.loads(result.stdout)


def test_facts_stand_in_program_syntax_sorted_as_strings_and_those_provided_are_left_out(bench):
    text = """
    type !edge(robot, robot).  type at(robot, area).  type sensor seen(robot, area).
    type mixed(robot, float, int, string, bool, area, robot).
    !edge(@1, @12).  !edge(@1, @2).  p(@1).  p(@1).
    mixed(@1, 3, 3, "a \\"b\\" \\\\ c", true, gate, @2).  mixed(@1, 1e300, -1, "", false, gate, @2).
    !id(R, N), peer(R, B) -o has(R, N, B).
    """
    report = bench.run(text, "--robots", "2", "--insert", "1s: seen(@1, gate)")
    assert facts(report) == [
        "!edge(@1, @12)",
        "!edge(@1, @2)",
        "has(@1, 1, @2)",
        'mixed(@1, 1e+300, -1, "", false, gate, @2)',
        'mixed(@1, 3.0, 3, "a \\"b\\" \\\\ c", true, gate, @2)',
        "p(@1)",
        "p(@1)",
    ]
    assert facts(report) == sorted(facts(report))


def test_goals_are_those_achieved_with_their_times_and_those_still_open(bench):
    report = bench.run("?far(R, 3). ?near(R, X).\nnear(R, 1), go(R) -o far(R, 2).", "--insert", "1.5s: near(@1, 1)")
    assert report["robots"]["1"]["goals"] == {"achieved": [["near(@1, _)", 1.5]], "open": ["far(@1, 3)"]}


def test_a_missed_deadline_is_undecided_before_and_missed_after(bench):
    waits = "type wish(robot). type done(robot). watch(wish(R), done(R), 3, broadcast(R)). wish(R)."
    [job] = bench.run(waits, "--until", "2s")["robots"]["1"]["assertions"]
    assert (job["finish_s"], job["met"], job["cause"]) == (None, None, None)
    report = bench.run(waits)
    [job] = report["robots"]["1"]["assertions"]
    assert (job["name"], job["finish_s"], job["met"], job["cause"]) == ("done", None, False, "local")
    assert actions(report) == [[3.0, "broadcast(@1)"]]
    assert (report["quiescent"], report["time_s"]) == (True, 3.0)


def test_a_late_finish_fills_in_the_time_and_the_deadline_stays_missed(bench):
    waits = "type wish(robot). type done(robot). watch(wish(R), done(R), 3, broadcast(R)). wish(R)."
    [job] = bench.run(waits, "--insert", "5s: done(@1)")["robots"]["1"]["assertions"]
    assert (job["finish_s"], job["deadline_s"], job["met"]) == (5.0, 3.0, False)


def test_expressions_without_value_are_counted(bench):
    report = bench.run("p(R, 0). p(R, N) -o q(R, 1 / N).")
    assert report["robots"]["1"]["expression_failures"] == 1


def test_messages_are_counted_without_acknowledgements_and_bytes_are_theirs(bench):
    text = "tell(@1). tell(A) -o {B | edge(A, B) | told(B, A)}."
    report = bench.run(text, "--robots", "4", "--edges", "edge")
    messages = report["messages"]
    assert (messages["sent"], messages["delivered"], messages["lost"], messages["repeated"]) == (3, 3, 0, 0)
    assert 3 * 8 < messages["bytes"] < 3 * 20


def test_time_is_when_the_last_thing_happened(bench):
    text = "type ball(robot, int). ball(@1, 0). ball(A, N), A = @1 -o ball(@2, N + 1)."
    assert bench.run(text, "--robots", "2", "--latency", "40ms")["time_s"] == 0.04


def test_every_key_of_a_robot_is_its_id(bench):
    report = bench.run("p(R).", "--robots", "10,2,0-1")
    assert list(report["robots"]) == ["0", "1", "2", "10"]
    assert facts(report, 10) == ["p(@10)"]
    assert re.fullmatch(r"[\x20-\x7e\n]+", json.dumps(report))
