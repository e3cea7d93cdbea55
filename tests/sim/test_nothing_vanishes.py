"""What a run loses or leaves out stands in its report and is said on standard error, though the run finishes."""

import json

import pytest
from lab_maker import small_lab

from rmr.node.actions.action_log import ACTIONS_MAX
from rmr_sim.main import main
from rmr_sim.run_setup import report_of

pytestmark = pytest.mark.medium

BIG = """
lab: big
program: big.rmr
duration: 5s
finish: done(R)
arena: {size: [1.5, 1.0]}
facts: ["big(@1, TEXT)"]
robots: [{id: 1, pose: [0.3, 0.3, 0deg]}, {id: 2, pose: [0.9, 0.3, 0deg]}]
"""
SENDS = """
type big(robot, string).
type got(robot, string).
type undelivered(robot, robot, name).
done(R).
big(R, S) -o got(@2, S).
got(R, S) -o have(R).
"""


def big_fact(folder, octets):
    (folder / "lab.yaml").write_text(BIG.replace("TEXT", '\\"' + "x" * octets + '\\"'))
    (folder / "big.rmr").write_text(
        SENDS.replace("done(R).", "go(R).\ngo(R) -o wait(R, 2.0).", 1).replace(
            "type big", "type action wait(R: robot, T: float) -o done(R).\ntype big", 1
        )
    )
    return folder


def run_of(lab, folder, capsys):
    code = main([str(lab), "--json", "--run", str(folder / "run")])
    out, err = capsys.readouterr()
    return code, json.loads(out)["robots"], err


def test_fact_too_large_to_send_is_reported_and_counted(tmp_path, capsys):
    code, robots, err = run_of(big_fact(tmp_path, 7000), tmp_path, capsys)
    assert code == 1
    assert robots["1"]["undelivered"] == 1
    at_s, fact, why = robots["1"]["first_undelivered"]
    assert at_s == 0.0
    assert fact.startswith("got(@2, ")
    assert why == "a fact of 7007 octets is too large: at most 6912 octets"
    assert "undelivered(@1, @2, got)" in robots["1"]["facts"]
    assert "1 of the facts, goals and actions for other robots not delivered" in err
    assert why in err


def test_a_fact_that_just_fits_arrives(tmp_path, capsys):
    code, robots, err = run_of(big_fact(tmp_path, 6905), tmp_path, capsys)
    assert code == 0
    assert robots["1"]["undelivered"] == 0
    assert "have(@2)" in robots["2"]["facts"]
    assert "delivered" not in err


FAILS = """
from rmr import action

@action("try")
async def attempt(robot, n):
    return 1 / (n - 2)
"""


@pytest.mark.parametrize("killed", ["[]", "[{at: 1s, kill: 1}, {at: 2s, restart: 1}]"], ids=["once", "restarted"])
def test_failed_actions_are_counted_over_all_lives_of_a_robot_with_the_first_reason(tmp_path, killed):
    simulation = small_lab(
        tmp_path,
        """
        type action try(R: robot, N: int) -o tried(R) else no(R).
        go(R).
        go(R) -o try(R, 1), try(R, 2), try(R, 2).
        """,
        actions=FAILS,
        duration="4s",
        faults=killed,
    )
    part = report_of(simulation, simulation.run())["robots"]["1"]
    lives = 1 + part["restarts"]
    assert (part["actions_failed"], len(part["actions"])) == (2 * lives, 3 * lives)
    at_s, action, why = part["first_failure"]
    assert (at_s, action) == (0.0, "try(@1, 2)")
    assert why == "ZeroDivisionError: division by zero (actions.py:6)"


def test_the_summary_says_that_actions_failed_though_the_run_finishes(tmp_path, capsys):
    simulation = small_lab(
        tmp_path,
        "type action try(R: robot, N: int) -o done(R) else done(R).\ngo(R).\ngo(R) -o try(R, 2).\n",
        actions=FAILS,
        finish="done(R)",
    )
    del simulation
    arguments = [str(tmp_path), "--actions", str(tmp_path / "actions.py"), "--run", str(tmp_path / "run")]
    assert main(arguments) == 0
    err = capsys.readouterr().err
    assert "1 action failed, of 1 started; the first: robot 1 at 0.000 s: try(@1, 2): ZeroDivisionError" in err
    assert "(actions.py:6)" in err


@pytest.mark.parametrize(("otherwise", "code"), [("", 1), (" else done(R)", 0)])
def test_an_action_of_ones_own_that_fails_without_an_else_fails_the_run(tmp_path, capsys, otherwise, code):
    program = f"""
    type action try(R: robot, N: int) -o tried(R){otherwise}.
    type action wait(R: robot, S: float) -o waited(R).
    go(R).
    go(R) -o try(R, 2), wait(R, -1.0), done(R).
    """
    small_lab(tmp_path, program, actions=FAILS, finish="done(R)")
    arguments = [str(tmp_path), "--actions", str(tmp_path / "actions.py")]
    assert main([*arguments, "--run", str(tmp_path / "run")]) == code
    told = "1 of the failed actions have no `else` in the program, so the run has failed"
    assert (told in capsys.readouterr().err) == (code == 1)
    assert main([*arguments, "--seeds", "1-2", "--jobs", "1", "--run", str(tmp_path / "sweep")]) == code
    assert ("actions that failed without an `else`: 1" in capsys.readouterr().out) == (code == 1)


def test_the_report_says_how_many_actions_goals_and_jobs_it_leaves_out(tmp_path):
    count = ACTIONS_MAX + 300
    simulation = small_lab(
        tmp_path,
        f"""
        type action say(R: robot, T: string) -o said(R).
        type left(robot, int).
        type done(robot, int).
        job: watch(left(R, N), done(R, N), 1, say(R, "late")).
        left(R, {count}).
        said(R) -o 1.
        left(R, N), N > 0 -o say(R, "x"), done(R, N), left(R, N - 1), ?done(R, N).
        done(R, N) -o 1.
        """,
        duration="10s",
    )
    simulation.run()
    part = report_of(simulation, True)["robots"]["1"]
    assert len(part["actions"]) == ACTIONS_MAX
    assert part["actions_omitted"] == 301, "the last job is missed and says so"
    assert part["assertions_omitted"] + len(part["assertions"]) == count + 1
    assert part["goals_omitted"] + len(part["goals"]["achieved"]) == count
