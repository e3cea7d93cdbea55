"""The report: complete, rounded, equal bytes for equal runs."""

import json
import math
import os
import re
import subprocess
import sys

import pytest
from world_labs import LABS

from rmr_world.lab_file import load_lab
from rmr_world.run_report import COLUMNS, assemble, rows, summary, table_rows, table_text, to_json, write


def part(robot, finish, deadline):
    met = finish is not None and finish <= deadline
    job = {
        "name": "crossing", "job": f"at(@{robot}, exit)", "start_s": 0.0, "finish_s": finish, "deadline_s": deadline,
        "met": met, "cause": None if met else "local",
    }  # fmt: skip
    return {"finish_s": finish, "assertions": [job], "facts": ["at(@1, exit)"], "frames": {"sent": 3}}


def report_of(**changes):
    lab = load_lab(LABS / "corridor").with_robots(2)
    arguments = {
        "mode": "simulated", "seed": 7, "finished": True, "time_s": 18.123456, "wall_s": None,
        "robots": {2: part(2, 14.21666, 26.0), 1: part(1, None, 32.0)},
        "truth": {"collisions": 0, "min_gap_m": 0.0212345678, "distance_m": {1: 1.61234567, 2: 0.5}},
        "bus_lost": 0,
    }  # fmt: skip
    return assemble(lab, **{**arguments, **changes})


def test_the_report_has_the_keys_of_the_contract():
    report = report_of()
    assert sorted(report) == [
        "bound_s", "bus", "collisions", "dead", "deadlines", "finish", "finished", "lab", "min_gap_m", "mode",
        "quorum", "robots", "schedule", "seed", "time_s", "version", "wall_s",
    ]  # fmt: skip
    assert report["deadlines"] == {"met": 1, "missed": 1, "best_possible": 2}
    assert sorted(report["robots"]["1"]) == [
        "assertions", "distance_m", "estimates_dropped", "expression_failures", "facts", "finish_s", "frames", "goals",
        "late_samples", "left_out", "lost_in_restart", "off_m", "restarts", "samples_refused",
        "tasks_skipped", "ticks", "ticks_late", "undelivered",
    ]  # fmt: skip


def test_floats_are_rounded_and_what_json_lacks_is_null():
    report = report_of(truth={"collisions": 0, "min_gap_m": math.inf, "distance_m": {1: 1.61234567}})
    assert report["time_s"] == 18.123
    assert report["robots"]["1"]["distance_m"] == 1.6123
    assert report["min_gap_m"] is None
    json.dumps(report, allow_nan=False)


def test_silent_robot_stands_in_the_report():
    report = report_of(robots={})
    assert report["robots"]["2"]["assertions"] == []
    assert report["robots"]["2"]["finish_s"] is None


def test_the_world_s_distance_counts_not_the_robot_s_own():
    report = report_of(robots={1: {"distance_m": 99.0}})
    assert report["robots"]["1"]["distance_m"] == 1.6123


def test_report_holds_the_newest_schedule_of_each_term_from_any_robot():
    def schedule(leader, term, order, formed_s=1.0):
        return {"event": "crossing(exit)", "leader": leader, "term": term, "order": order, "formed_s": formed_s}

    robots = {
        1: {"schedules": [schedule(1, 1, [1])]},
        2: {"schedules": [schedule(2, 3, [2, 1])]},
        3: {"schedules": [schedule(2, 3, [2, 1, 3], 2.0)]},
    }
    report = report_of(robots=robots)
    assert report["schedule"] == [schedule(1, 1, [1]), schedule(2, 3, [2, 1, 3], 2.0)]
    assert "schedules" not in report["robots"]["1"]


def test_the_file_is_sorted_complete_and_replaces_an_older_one(tmp_path):
    folder = tmp_path / "runs" / "one"
    write(report_of(seed=1), folder)
    path = write(report_of(), folder)
    assert [item.name for item in folder.iterdir()] == ["report.json"]
    assert path.read_text() == to_json(report_of())
    assert json.loads(path.read_text()) == report_of()


@pytest.mark.medium
def test_the_bytes_do_not_depend_on_hash_randomisation():
    code = "from test_world_report import *; print(to_json(report_of()))"
    texts = []
    for hash_seed in ("0", "1"):
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        ran = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        texts.append(ran.stdout)
    assert texts[0] == texts[1]


def test_the_table_is_in_order_of_deadline():
    assert COLUMNS == ("robot", "deadline", "finish", "lateness", "met")
    assert table_rows(report_of()) == [
        ("@2", "26.00 s", "14.22 s", "-11.78 s", "yes"),
        ("@1", "32.00 s", "-", "-", "no"),
    ]


def test_a_robot_that_was_stopped_is_told_apart_from_one_that_died():
    lost = report_of(dead=[1, 2, 3, 5]) | {"stopped": [5]}
    assert summary(lost).endswith("; robots 1-3 died, robot 5 was stopped")
    unfinished = report_of(robots={1: part(1, None, 32.0), 2: part(2, None, 26.0)}, dead=[1, 2]) | {"stopped": [1]}
    assert [row[2] for row in table_rows(unfinished)] == ["died", "stopped"]
    assert summary(unfinished | {"stopped": [1, 2]}).endswith("; robots 1-2 were stopped")


def test_a_robot_without_a_deadline_has_a_line_too():
    line = rows(report_of(robots={1: {"finish_s": 3.0}}))[0]
    assert line.cells() == ("@1", "-", "3.00 s", "-", "-")


def test_the_summary_says_how_near_the_bound_the_run_was():
    text = summary(report_of())
    assert (
        text == "corridor: finished after 18.12 s (1.44 x bound), deadlines met 1 of 2, contacts 0, smallest gap 21 mm"
    )
    assert table_text(report_of()).splitlines()[-1] == text


def test_the_table_names_the_jobs_where_a_robot_had_several():
    several = part(1, 20.0, 32.0)
    again = {**several["assertions"][0], "job": "at(@1, entry)", "deadline_s": 40.0}
    several["assertions"].append(again)
    lines = table_text(report_of(robots={1: several, 2: part(2, 14.21666, 26.0)})).splitlines()
    assert lines[0].split() == [*COLUMNS, "job"]
    assert [line.rpartition("  ")[2] for line in lines[1:-1]] == ["at(@2, exit)", "at(@1, exit)", "at(@1, entry)"]


def test_on_a_terminal_the_table_has_colours_and_the_same_texts():
    plain = table_text(report_of(), "host b; lab ")
    coloured = table_text(report_of(), "host b; lab ", color=True)
    assert coloured.startswith("\x1b[1mrobot  deadline ")
    assert "\x1b[32myes\x1b[0m\n" in coloured
    assert "\x1b[1;31m no\x1b[0m\n" in coloured
    assert re.sub(r"\x1b\[[\d;]*m", "", coloured) == plain
    assert plain.splitlines()[-1].startswith("host b; lab corridor: finished after ")


def step(text, due, end, late, behind=(), **times):
    return {
        "action": text, "begin_ns": 0, "begun_ns": 0, "end_ns": end, "due_ns": due, "late_ns": late,
        "behind": list(behind), "time_ns": times,
    }  # fmt: skip


def test_the_table_has_the_steps_of_a_missed_job_with_several_turns():
    late = part(1, 34.5, 32.0)
    late["assertions"][0]["met"] = False
    steps = [
        step("press(@1)", 30 * 10**9, 28 * 10**9, -2 * 10**9, rule=10**9, action=2 * 10**9),
        step("rest(@1)", None, 29 * 10**9, None, action=10**9),
        step("paint(@1)", 32 * 10**9, 34 * 10**9, None, (2, 3), turn=5 * 10**9),
    ]
    late["assertions"][0]["steps"] = steps
    lines = table_text(report_of(robots={1: late})).splitlines()
    assert lines[1:4] == [
        "   @1   32.00 s  34.50 s   +2.50 s   no",
        " step   30.00 s  28.00 s   -2.00 s       press(@1): action 2.00 s, rule 1.00 s",
        " step   32.00 s        -         -       paint(@1): turn behind robots 2, 3 5.00 s",
    ]
    late["assertions"][0]["steps"] = steps[:2]
    assert "step" not in table_text(report_of(robots={1: late})), "one turn is that of the job"


def test_the_summary_leaves_out_a_bound_that_is_not_known():
    lab_less = report_of() | {"bound_s": 0.0}
    assert summary(lab_less).startswith("corridor: finished after 18.12 s, deadlines met 1 of 2")


def test_a_folder_that_cannot_be_written_is_the_caller_s_to_report(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        write(report_of(), tmp_path / "file")
