"""`import rmr`: compile and evaluate from Python, and what is raised for a mistake."""

import json
import pickle

import numpy as np
import pytest
from command_runner import invoke

import rmr
from rmr.commands.subcommands import command as main

CHARGE = """
type action charge(R: robot, N: int) -o charged(R, N) else flat(R, N).
low(R).
low(R) -o charge(R, 1).
charged(R, N), N < 3 -o charge(R, N + 1).
"""
NAMES = [
    "Compiled",
    "CompileError",
    "Error",
    "Evaluation",
    "EventError",
    "LabError",
    "ProgramError",
    "Run",
    "UsageError",
]


def printed(tmp_path, text, *arguments):
    """Return what a command prints for a program: (stdout, stderr)."""
    (tmp_path / "p.rmr").write_text(text)
    result = invoke(main, [arguments[0], str(tmp_path / "p.rmr"), *arguments[1:]], name="rmr")
    return result.stdout, result.stderr


def test_every_name_of_the_api_is_in_dir_and_loads():
    names = [*NAMES, "ActionFailed", "RobotHandle", "action", "compile", "evaluate", "simulate"]
    assert set(names) <= set(dir(rmr))
    assert {name for name in dir(rmr) if not name.startswith("__")} == set(rmr.__all__)
    assert "__version__" in dir(rmr)
    assert set(names) <= set(rmr.__all__)
    assert all(getattr(rmr, name).__name__ == name for name in rmr.__all__)
    with pytest.raises(AttributeError, match="module 'rmr' has no attribute 'simulat'"):
        rmr.simulat  # noqa: B018


@pytest.mark.parametrize("strip", [False, True])
def test_compile_gives_the_octets_that_the_command_writes(tmp_path, strip):
    printed(tmp_path, CHARGE, "compile", *(["--strip"] if strip else []))
    octets = (tmp_path / "p.rbc").read_bytes()
    assert rmr.compile(tmp_path / "p.rmr", strip=strip).octets == octets
    assert rmr.compile(str(tmp_path / "p.rmr"), strip=strip).octets == octets


def test_compile_takes_text_and_lists_warnings_as_data():
    compiled = rmr.compile("seen(R). never(R) -o seen(R).")
    (warning,) = compiled.diagnostics
    assert (warning["severity"], warning["code"], warning["line"], warning["column"]) == ("warning", "W102", 1, 10)


def test_a_program_with_errors_raises_what_check_prints(tmp_path):
    text = "p(R).\np(R) -o q(R, X).\n"
    said = printed(tmp_path, text, "check")[1]
    with pytest.raises(rmr.CompileError) as caught:
        rmr.compile(tmp_path / "p.rmr")
    assert str(caught.value) in said
    assert caught.value.diagnostics == json.loads(printed(tmp_path, text, "check", "--json")[0])["diagnostics"]
    assert pickle.loads(pickle.dumps(caught.value)).diagnostics == caught.value.diagnostics


def test_evaluate_gives_the_report_trace_and_messages_of_the_command(tmp_path):
    options = ["--robots", "3", "--action-time", "1s", "--action-time", "charge=2s", "--fail", "charge(@2,_)@2"]
    options += ["--kill", "3s: @3", "--insert", "4s: low(@3)", "--seed", "5", "--trace", str(tmp_path / "t.jsonl")]
    stdout, stderr = printed(tmp_path, CHARGE, "eval", *options)
    found = rmr.evaluate(
        tmp_path / "p.rmr",
        robots=[1, 2, 3],
        action_time=1,
        action_times={"charge": "2s"},
        fail=["charge(@2,_)@2"],
        kill="3s: @3",
        insert=["4s: low(@3)"],
        seed=5,
        trace=True,
    )
    assert {"version": 1, **found.report} == json.loads(stdout)
    assert found.trace == [json.loads(line) for line in (tmp_path / "t.jsonl").read_text().splitlines()]
    assert [f"rmr eval: warning: {text}" for text in found.messages] == stderr.splitlines()
    assert found.quiescent
    assert found.facts(2) == ["flat(@2, 2)"]


def test_evaluate_takes_a_compiled_program_and_every_engine():
    compiled = rmr.compile("coin(R). coin(R) -o side(R, heads). coin(R) -o side(R, tails).")
    reports = [
        rmr.evaluate(compiled, robots="0-5,9", seed=3, engine=engine).report
        for engine in ("generated", "interpreter", "columnar")
    ]
    assert reports[0] == reports[1] == reports[2]
    assert list(reports[0]["robots"]) == ["0", "1", "2", "3", "4", "5", "9"]
    assert list(rmr.evaluate(compiled, robots=[7]).report["robots"]) == ["7"]


def test_what_goes_on_at_the_end_stands_in_the_messages():
    found = rmr.evaluate("a(R). a(R) -o a(R).", until="100ms")
    assert not found.quiescent
    assert found.messages[-1].startswith("robot 1: rules are still satisfied after")
    assert found.trace == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"robots": 0}, "1 to 65533 robots, not '0'"),
        ({"robots": []}, "is no id"),
        ({"robots": [1, 1]}, "robot 1 is listed twice"),
        ({"topology": "rng"}, "did you mean `ring`?"),
        ({"edges": "No"}, "--edges: 'No' is no name of a predicate"),
        ({"insert": ["1s: lwo(@1)"]}, "the program knows no fact `lwo`; did you mean `low`?"),
        ({"kill": ["1s: @9"]}, "--kill '1s: @9': robot 9 is not among the robots"),
        ({"fail": ["chrge"]}, "did you mean `charge`?"),
        ({"action_times": {"chrge": 1}}, "did you mean `charge`?"),
        ({"action_time": -1}, "'-1.0' is no duration"),
        ({"until": "soon"}, "'soon' is no duration"),
        ({"loss": 2}, "a share from 0 to 1, not '2'"),
        ({"seed": -1}, "seed: a whole number from 0, not -1"),
        ({"engine": "fast"}, "engine: 'fast' is none of interpreter, generated, columnar"),
        ({"strategy": "clever"}, "strategy: 'clever' is none of random, textual"),
        ({"until": "soon"}, "until: 'soon' is no duration"),
        ({"until": None}, "until: seconds, or a duration such as '500ms', not None"),
        ({"latency": [1]}, "latency: seconds, or a duration such as '500ms', not [1]"),
        ({"loss": "x"}, "loss: a share from 0 to 1, not 'x'"),
        ({"loss": None}, "loss: a share from 0 to 1, not None"),
        ({"seed": "x"}, "seed: a whole number from 0, not 'x'"),
        ({"seed": 1.5}, "seed: a whole number from 0, not 1.5"),
        ({"seed": True}, "seed: a whole number from 0, not True"),
        ({"robots": 1.5}, "robots: a number, ids, or text such as 0-5,9, not 1.5"),
        ({"insert": [3]}, "insert: a list of texts, as `--insert` takes them, not 3"),
        ({"kill": 3}, "kill: a list of texts, as `--kill` takes them, not 3"),
        ({"restart": [3]}, "restart: a list of texts, as `--restart` takes them, not 3"),
        ({"fail": [None]}, "fail: a list of texts, as `--fail` takes them, not None"),
        ({"action_times": 3}, 'action_times: a dict of times by action, such as {"moveto": 2.0}, not 3'),
        (
            {"action_times": {"charge": None}},
            "action_times['charge']: seconds, or a duration such as '500ms', not None",
        ),
        ({"topology": 3}, "topology: the name of a topology, not 3"),
        ({"edges": 3}, "edges: the name of a predicate, not 3"),
        ({"facts": 3}, "facts: the path of a file, not 3"),
    ],
)
def test_an_argument_that_cannot_be_used_is_a_usage_error(options, message):
    with pytest.raises(rmr.UsageError) as caught:
        rmr.evaluate(CHARGE, **options)
    assert message in str(caught.value)
    assert isinstance(caught.value, rmr.Error | ValueError)


@pytest.mark.parametrize("call", [rmr.compile, rmr.evaluate])
def test_program_of_a_wrong_type_is_a_usage_error(call):
    with pytest.raises(rmr.UsageError, match=r"program: a path, a text, or what `rmr\.compile` has returned, not 3"):
        call(3)


def test_facts_of_a_robot_that_is_not_there_name_the_robots_that_are():
    found = rmr.evaluate("p(R).", robots="0-2,7")
    for robot in (9, "x", None):
        with pytest.raises(rmr.UsageError, match=f"robot: one of 0-2,7, not {robot!r}"):
            found.facts(robot)


def test_numbers_of_numpy_are_numbers():
    found = rmr.evaluate("p(R).", robots=np.int64(2), seed=np.int64(3), loss=np.float32(0.0), until=np.float32(1.0))
    assert found.report == rmr.evaluate("p(R).", robots=2, seed=3, until=1.0).report


def test_files_that_are_not_there_or_damaged_are_told_as_by_the_commands(tmp_path):
    with pytest.raises(rmr.CompileError, match="no such file"):
        rmr.evaluate(tmp_path / "none.rmr")
    (tmp_path / "bad.rbc").write_bytes(b"RMR\x1a????")
    with pytest.raises(rmr.ProgramError, match="this is no valid byte-code"):
        rmr.evaluate(tmp_path / "bad.rbc")
    with pytest.raises(rmr.CompileError, match="no such file"):
        rmr.evaluate("p(R).", facts=tmp_path / "none.rmr")
    with pytest.raises(TypeError, match="unexpected keyword argument 'robot'"):
        rmr.evaluate("p(R).", robot=3)
