"""`rmr fault` without a world: what it asks for, what it refuses, where it looks, what it shows."""

import json
import os
from math import inf

import pytest
from command_runner import invoke

from rmr.base.time import NEVER, NS_PER_MS, NS_PER_S
from rmr.bus import wire
from rmr.bus.endpoint import DEFAULT_ENDPOINT
from rmr.bus.secret import SECRET_FILE, make_secret
from rmr.radio.links import Disturbance, muted, partition
from rmr_deploy import disturb
from rmr_deploy.active_runs import PROCESSES_FILE, REGISTER_VARIABLE, endpoint_of, write_processes
from rmr_deploy.fault import command
from rmr_deploy.run_choice import FleetError
from rmr_world.run_report import REPORT_FILE

S, MS = NS_PER_S, NS_PER_MS
NOBODY = "tcp/127.0.0.1:9"
GONE = (1 << 22) + 1
"""No process has this id: Linux counts to 2^22 at most."""


def run(*words):
    return invoke(command(), words, name="rmr fault")


@pytest.fixture
def asked(monkeypatch):
    """What would be put to the world, wish by wish."""
    options = []

    async def answer(place, keys, question):
        options.append(question)
        return wire.Disturbances("x", 0, (), 0, "")

    monkeypatch.setattr(disturb, "_ask", answer)
    return options


# --- options -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "added"),
    [
        ("radio --loss 0.5 --for 5s", Disturbance(0, 5 * S, loss=0.5)),
        ("radio --loss 0.5 --for 0.25", Disturbance(0, 250 * MS, loss=0.5)),
        ("radio --cut", Disturbance(attenuation_db=inf)),
        ("partition 1,2,3/4,5,6", partition([[1, 2, 3], [4, 5, 6]])),
        ("partition 3/1,2 --one-way", muted(3, (1, 2, 3))),
        ("partition 1-3/4-6/9 --for 1.5min", partition([[1, 2, 3], [4, 5, 6], [9]], 0, 90 * S)),
        ("link 1,2 --loss 0.3", Disturbance(groups=((1,), (2,)), loss=0.3)),
        ("link 2,1 --one-way --attenuation 20", Disturbance(0, NEVER, ((2,), (1,)), True, attenuation_db=20.0)),
        ("link 1,2 --cut --for 500ms", partition([[1], [2]], 0, 500 * MS)),
    ],
)
def test_command_line_words_become_a_disturbance(asked, words, added):
    assert run(*words.split()).exit_code == 0
    assert asked == [wire.AskDisturbances("add", added)]


@pytest.mark.parametrize("wish", ["clear", "list"])
def test_clear_and_list_ask_for_nothing_more(asked, wish):
    assert run(wish).exit_code == 0
    assert asked == [wire.AskDisturbances(wish, None)]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("radio", "exactly one of --loss, --attenuation and --cut"),
        ("radio --loss 0.1 --cut", "exactly one of --loss, --attenuation and --cut"),
        ("radio --loss 1.5", "--loss: a number from 0 to 1, not '1.5'"),
        ("radio --loss nan", "a number from 0 to 1, not 'nan'"),
        ("radio --attenuation -3", "--attenuation: a number from 0, not '-3'"),
        ("radio --loss 1 --for soon", "should be a duration such as 120s"),
        ("radio --loss 1 --for 0s", "should be longer than nothing"),
        ("link 1 --cut", "should be two robots, such as 1,2"),
        ("link 1,1 --cut", "robot 1 is listed twice"),
        ("link 1,x --cut", "'x' is no id and no range of ids; write ids such as 4, 2-3 or 0-5,9"),
        ("link 1,65534 --cut", "there is no robot 65534: ids are 0 to 65533"),
        ("partition 1,2", "two groups of robots or more, such as 1-3/4-6"),
        ("partition 1,2/2,3", "a robot is in two groups"),
        ("partition 1//2", "'' is no id and no range of ids; write ids such as 4, 2-3"),
        ("partition 2/3-1", "the range 3-1 ends before it begins; write 1-3"),
        ("list --connect here", "'here' is no endpoint"),
        ("list --connect tcp/127.0.0.1:9 --run x", "say --connect or --run, not both"),
        ("list --run nowhere", "there is no nowhere; rmr ls shows what runs"),
        ("list --lab a/b", "'a/b' cannot name a lab"),
        ("stal 3", "unknown command 'stal'; did you mean 'stall'?"),
        ("stall 3 --for never", "--for: should be a duration"),
        ("slow 3", "missing: --every"),
        ("kill", "missing: ROBOT"),
        ("outage x", "ROBOT"),
    ],
)
def test_invalid_fault_arguments_are_wrong_usage(words, said):
    answer = run(*words.split())
    assert answer.exit_code == 2
    assert said in answer.stderr
    assert answer.stdout == ""


def test_fault_command_fails_without_a_listener():
    answer = run("list", "--connect", NOBODY)
    assert (answer.exit_code, answer.stderr) == (1, f"rmr fault: nobody listens at {NOBODY}\n")


# --- what it shows ------------------------------------------------------------------------------------------------

TOLD = wire.Disturbances(
    "x",
    6 * S,
    (
        Disturbance(groups=((1,), (2,)), loss=0.3),
        Disturbance(0, 6 * S, loss=0.9),
        Disturbance(0, 9 * S, ((1,), (2,)), True, 0.0, 20.0),
        partition([[1, 2], [3]], 7 * S, 8 * S),
    ),
    3,
    "",
)


def test_listing_shows_current_and_future_disturbances_and_omits_past_ones():
    assert list(disturb.lines(TOLD)) == [
        "lab x, 6.0 s:",
        "  lab file   0.0 s to the end: between 1 and 2, loss 0.3",
        "  lab file   0.0 s to 9.0 s: from 1 to 2, attenuation 20 dB",
        "  rmr fault  7.0 s to 8.0 s: between 1,2 and 3, cut",
    ]
    assert list(disturb.lines(TOLD._replace(held=(), given=0))) == ["lab x, 6.0 s: nothing disturbs the radio"]


def test_json_output_is_one_document(monkeypatch):
    async def answer(*_question):
        return TOLD

    monkeypatch.setattr(disturb, "_ask", answer)
    told = json.loads(run("list", "--json").stdout)
    assert (told["lab"], told["time_s"]) == ("x", 6.0)
    assert [(one["by"], one["until_s"], one["cut"]) for one in told["disturbances"]] == [
        ("lab file", None, False),
        ("lab file", 9.0, False),
        ("rmr fault", 8.0, True),
    ]


def test_a_refusal_of_the_world_is_wrong_usage_and_shows_nothing_else(monkeypatch):
    async def answer(*_question):
        return TOLD._replace(refused="no")

    monkeypatch.setattr(disturb, "_ask", answer)
    answered = run("clear", "--json")
    assert (answered.exit_code, answered.stdout, answered.stderr) == (2, "", "rmr fault: no\n")


# --- where it looks -------------------------------------------------------------------------------------------------


def run_folder(runs, name, port, age_s, launcher=None):
    folder = runs / name
    folder.mkdir(parents=True)
    write_processes(folder, f"tcp/127.0.0.1:{port}", {}, {})
    path = folder / PROCESSES_FILE
    if launcher is not None:
        path.write_text(path.read_text().replace(str(os.getpid()), str(launcher)))
    os.utime(path, ns=(0, (1000 - age_s) * S))
    return folder


@pytest.fixture(autouse=True)
def _own_register(tmp_path, monkeypatch):
    monkeypatch.setenv(REGISTER_VARIABLE, str(tmp_path / "register"))


def test_run_is_that_of_all_verbs(tmp_path, monkeypatch):
    """By the register or ./runs, whose records are checked against what lives; by name where several run."""
    monkeypatch.chdir(tmp_path)
    runs = tmp_path / "runs"
    run_folder(runs, "killed", 4, 20, launcher=GONE)
    run_folder(runs, "strange", 5, 10, launcher='"x"')
    (runs / "damaged").mkdir()
    (runs / "damaged" / PROCESSES_FILE).write_text("{")
    run_folder(tmp_path / "elsewhere", "hall", 2, 0)
    assert disturb.find(None, None, None, None).endpoint == "tcp/127.0.0.1:2"
    run_folder(runs, "yard", 3, 0)
    run_folder(tmp_path / "elsewhere", "dock", 6, 0)
    with pytest.raises(FleetError, match=r"several labs run: dock .*, yard .*; choose with --run DIR or --lab NAME"):
        disturb.find(None, None, None, None)
    assert disturb.find(None, None, None, "dock").endpoint == "tcp/127.0.0.1:6"
    assert disturb.find(None, runs / "yard", None, None).endpoint == "tcp/127.0.0.1:3"


def test_without_a_run_it_is_the_default_endpoint(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert disturb.find(None, None, None, None) == (DEFAULT_ENDPOINT, None)
    run_folder(tmp_path / "runs", "one", 7, 0)
    assert disturb.find(None, None, None, None) == ("tcp/127.0.0.1:7", None)
    assert disturb.find(NOBODY, None, None, None) == (NOBODY, None)


def test_a_run_folder_says_where_even_if_its_run_is_not_in_runs(tmp_path):
    folder = run_folder(tmp_path, "here", 8, 0)
    assert disturb.find(None, folder, None, None) == ("tcp/127.0.0.1:8", None)
    assert endpoint_of(tmp_path) is None


@pytest.mark.parametrize("words", [["list"], ["clear"], ["radio", "--cut"]])
def test_run_that_is_over_is_not_asked_even_if_another_listens_at_its_endpoint(tmp_path, asked, words):
    folder = run_folder(tmp_path, "here", 8, 0)
    (folder / REPORT_FILE).write_text("{}")
    answer = run(*words, "--run", str(folder))
    assert (answer.exit_code, answer.stderr) == (1, f"rmr fault: the run in {folder} is over\n")
    assert asked == []


def test_secret_is_that_of_the_run_folder_unless_another_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder, other = run_folder(tmp_path / "runs", "one", 7, 0), tmp_path / "other"
    make_secret(folder / SECRET_FILE)
    found = folder / SECRET_FILE
    assert disturb.find(None, None, None, None) == ("tcp/127.0.0.1:7", found)
    assert disturb.find(None, folder, None, None) == ("tcp/127.0.0.1:7", folder / SECRET_FILE)
    assert disturb.find(None, folder, other, None) == ("tcp/127.0.0.1:7", other)
    assert disturb.find(NOBODY, None, other, None) == (NOBODY, other)


def test_secret_file_that_is_missing_or_cannot_be_used_has_its_exit_code(tmp_path):
    answer = run("list", "--connect", NOBODY, "--secret", str(tmp_path / "none"))
    assert (answer.exit_code, answer.stderr) == (2, f"rmr fault: {tmp_path / 'none'}: No such file or directory\n")
