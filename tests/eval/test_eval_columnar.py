"""`rmr eval --engine columnar`: the same octets as from machines, or from machines after all, and then why."""

import json
import subprocess
import sys

import pytest

from rmr.eval import column_run, ensemble

pytestmark = pytest.mark.medium

WALK = """
type at(robot, int).  type tired(robot, int).  type lamp(robot, light).  type !east(robot).  type !west(robot).
at(R, 0).  tired(R, 40).  lamp(R, off).
?lamp(@2, on).  ?lamp(@5, broken).
at(R, X), tired(R, T), T > 0 -o at(R, X + 1), tired(R, T - 1).
at(R, X), tired(R, T), T > 0 -o at(R, X - 1), tired(R, T - 1).
$at(R, X), X > 3 -o !east(R).
$at(R, X), X < -3 -o !west(R).
lamp(R, off) -o lamp(R, broken).
lamp(R, off) -o lamp(R, warm).
lamp(R, warm) -o lamp(R, on).
"""
ENDLESS = "type s(robot, side). s(R, a). s(R, a) -o s(R, b). s(R, a) -o s(R, c). s(R, _) -o s(R, a)."
FAILING = "type n(robot, int). n(R, 9223372036854775800). n(R, X) -o n(R, X + 1). $n(R, X), 1 / 0 > X -o !m(R)."
FIVE_HUNDRED = "type n(robot, int). n(R, 0). n(R, X), X < 500 -o n(R, X + 1)."
GIVEN = "type at(robot, int). type !id(robot, int). ?at(R, _). at(R, X), id(R, N), X < 20 -o at(R, X + N)."

RUNS = {
    "figure 3": (
        "location(R, s). ?location(R, middle). location(R, s) -o location(R, middle). "
        "location(R, s) -o location(R, t). location(R, middle) -o location(R, t).",
        (),
    ),
    "chance": (WALK, ("--seed", "7")),
    "the order of the text": (WALK, ("--strategy", "textual")),
    "listed robots": (WALK, ("--robots", "2,4-9")),
    "no end": (ENDLESS, ("--until", "200ms")),
    "no end, drawn": (ENDLESS, ("--until", "50ms", "--strategy", "random")),
    "expressions without value": (FAILING, ()),
    "a budget that is just used up": (FIVE_HUNDRED, ()),
    "no time to notice quiescence": (FIVE_HUNDRED, ("--until", "16ms")),
    "no rules": ("p(R).", ()),
    "loss, latency and a topology that nobody notices": (
        WALK,
        ("--loss", "0.5", "--latency", "1s", "--topology", "line"),
    ),
}


def both(bench, text, *arguments):
    """Run a program with both engines; return exit code, report and what is said beside, of each."""
    file = bench.file("p.rmr", text)
    results = [bench.call(file, "--robots", "6", *arguments, "--engine", each) for each in ("interpreter", "columnar")]
    return [(each.exit_code, each.stdout, each.stderr) for each in results]


@pytest.mark.parametrize("name", RUNS)
def test_the_report_is_that_of_machines_to_the_octet(bench, name):
    text, arguments = RUNS[name]
    machines, columns = both(bench, text, *arguments)
    assert columns == machines
    assert json.loads(columns[1])["firings"] > 0 or name == "no rules"


def test_given_facts_come_after_the_stated_goals(bench):
    facts = bench.file("f.rmr", "at(@1, 7). at(@2, 0). at(@3, 1).")
    machines, columns = both(bench, GIVEN, "--facts", facts)
    assert columns == machines
    assert json.loads(columns[1])["robots"]["1"]["goals"]["achieved"] == [["at(@1, _)", 0.0]]


@pytest.mark.parametrize("firings_max", [4000, 4500, 5999, 6000, 8123])
def test_a_run_that_fires_without_end_ends_at_the_same_firing_of_the_same_robot(bench, monkeypatch, firings_max):
    monkeypatch.setattr(ensemble, "FIRINGS_MAX", firings_max)
    monkeypatch.setattr(column_run, "FIRINGS_MAX", firings_max)
    machines, columns = both(bench, ENDLESS)
    assert columns == machines
    assert "without an end in sight" in columns[2]
    assert "the last at" in columns[2]


REFUSED = {
    "a program that does not suit": ("p(R). p(R). p(R) -o 1.", (), "p.rmr:1: a robot may hold several facts `p`"),
    "--edges": (
        "type !near(robot, robot). p(R). p(R), near(R, B) -o 1.",
        ("--edges", "near"),
        "--edges gives a robot several facts",
    ),
    "--insert": ("p(R). p(R) -o 1.", ("--insert", "1s: p(@1)"), "--insert brings facts from outside"),
    "given facts": ("p(R). p(R) -o 1.", ("--facts", "f.rmr"), "a robot may hold several facts `p`: it is given more"),
    "--trace": ("p(R). p(R) -o 1.", ("--trace", "t.jsonl"), "--trace tells of every firing by itself"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_does_not_suit_columns_is_run_by_machines_and_it_is_said_why(bench, monkeypatch, name):
    text, arguments, why = REFUSED[name]
    bench.file("f.rmr", "p(@3).")
    monkeypatch.chdir(bench.folder)
    machines, columns = both(bench, text, *arguments)
    assert columns[:2] == machines[:2]
    [line] = [each for each in columns[2].splitlines() if each not in machines[2].splitlines()]
    assert line.startswith("rmr eval: each robot by itself instead of columns: ")
    assert why in line


def test_ctrl_c_ends_columns_after_a_frame(bench):
    program = bench.file("p.rmr", ENDLESS)
    given = columnar_run(program)
    given.stop()
    assert not given.run(10**9)
    assert (given.now, given.firings, given.quiescent) == (0, 0, False)


def columnar_run(program):
    """A run of a file's program on two robots."""
    from pathlib import Path

    from rmr.eval.ensemble import Conditions
    from rmr.eval.given import Wanted, read_given
    from rmr.eval.topology import read

    given, robots = read_given(Wanted(Path(program))), dict.fromkeys((1, 2))
    return column_run.ColumnRun(given.program, given, Conditions(robots, read("complete", robots)))


@pytest.mark.parametrize("words", [["check", "--explain", "p.rmr"], ["eval", "p.rmr", "--json"]])
def test_who_does_not_ask_for_columns_does_not_load_numpy(bench, words):
    bench.file("p.rmr", "p(R). p(R) -o 1.")
    code = f"""
import sys
from rmr.commands.subcommands import command as main
try:
    main.main({words})
except SystemExit:
    pass
finally:
    print("numpy" in sys.modules)
"""
    answer = subprocess.run([sys.executable, "-c", code], cwd=bench.folder, capture_output=True, text=True, check=True)
    assert answer.stdout.splitlines()[-1] == "False"


def test_an_engine_that_there_is_not_is_refused_with_those_that_there_are(bench):
    said = bench.refused("p(R).", "--engine", "clips")
    assert all(each in said for each in ("interpreter", "generated", "columnar"))
