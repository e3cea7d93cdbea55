"""`rmr radio` on the command line."""

import json
from pathlib import Path

import pytest
from command_runner import invoke

from rmr.commands import subcommands
from rmr.commands.radio_command import NAMES

FILES = Path(__file__).parents[1] / "validation" / "reference"

BRIEF = {
    "contention": "--senders 3 --offered-fps 60 --seconds 2 --seeds 2",
    "hidden": "--seconds 2 --seeds 2",
    "storm": "--members 4 --jitter-ms 5 --seeds 3",
    "overlap": "--sir 0 --interference awgn --frames 10",
    "latency": "--frames 10",
    "link": "--distance 20 --frames 10",
}
"""Each subcommand, as briefly as can be."""


def radio(line):
    return invoke(subcommands.command, ["radio", *line.split()])


@pytest.mark.parametrize("name", BRIEF)
def test_json_is_one_document_on_stdout_and_the_same_each_time(name):
    first, second = (radio(f"{name} {BRIEF[name]} --json") for _ in range(2))
    assert first.exit_code == 0, first.output
    assert first.stdout == second.stdout
    assert first.stderr == ""
    assert isinstance(json.loads(first.stdout), dict)


@pytest.mark.parametrize(
    ("line", "file"), [("contention", "contention"), ("hidden", "hidden_terminal"), ("storm", "reply_storm")]
)
def test_the_fields_of_the_json_are_those_of_the_reference(line, file):
    row = json.loads(radio(f"{line} {BRIEF[line]} --json").stdout)
    reference = json.loads((FILES / f"{file}.json").read_text())["series"][0]
    assert list(row) == ["version", *(name for name in reference if name != "events_per_rep")]


@pytest.mark.parametrize("name", BRIEF)
def test_the_table_has_a_line_with_a_unit_for_each_finding(name):
    row = json.loads(radio(f"{name} {BRIEF[name]} --json").stdout)
    title, empty, *lines = radio(f"{name} {BRIEF[name]}").stdout.splitlines()
    assert title.endswith(("1 run", "2 runs", "3 runs"))
    assert empty == ""
    for field in row:
        if field in NAMES:
            words, unit = NAMES[field]
            assert any(line.startswith(words) and unit in line for line in lines), field


def test_a_time_that_nothing_took_is_no_time_of_zero():
    lines = radio("storm --members 3 --loss 1 --seeds 2").output.splitlines()
    times = [line for line in lines if "the last reply" in line or "half of the replies" in line]
    assert [line.split()[-1] for line in times] == ["-", "-"]


def test_another_seed_has_other_chances():
    first, second = (radio(f"contention {BRIEF['contention']} --json --seed {seed}").stdout for seed in (0, 5))
    assert first != second


@pytest.mark.medium
def test_the_output_is_the_same_however_many_processes_share_the_work():
    one, two = (radio(f"storm {BRIEF['storm']} --json --jobs {jobs}") for jobs in (1, 2))
    assert two.exit_code == 0, two.output
    assert one.stdout == two.stdout


def test_the_radio_is_that_of_the_options():
    near = "link --distance 30 --json"
    default, sensitive, loud, open_air, lossy = (
        json.loads(radio(f"{near} {options}").stdout)["success"]
        for options in ("", "--sensitivity -101", "--tx-power 10", "--exponent 2", "--sensitivity -101 --loss 0.5")
    )
    assert default < 0.01
    assert sensitive > 0.99
    assert loud > 0.99
    assert open_air > 0.99
    assert lossy == pytest.approx(sensitive / 2)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("contention --senders 0", "0 senders: write 1 to 1000"),
        ("contention --offered-fps -5", "-5 frames/s offered"),
        ("contention --payload 117", "a frame carries 0 to 116"),
        ("contention --seconds 0", "0 s: write more than 0"),
        ("contention --seeds 0", "--seeds"),
        ("contention --interference none", "capture_3db"),
        ("hidden --tx-power -60", "less than a metre"),
        ("storm --members ten", "--members: a whole number"),
        ("storm --jitter-ms nan", "--jitter-ms: a number, not 'nan'"),
        ("overlap --psdu 128", "11 to 127"),
        ("latency --frames 0", "0 frames: write 1 to"),
        ("link", "missing: --distance"),
        ("link --distance -1", "a distance of -1 m"),
        ("link --distance 1 --sensitivity nan", "--sensitivity: a number from -130 to -40, not 'nan'"),
        ("link --distance 1 --loss 1.5", "--loss"),
        ("lnik", "unknown command 'lnik'; did you mean 'link'?"),
    ],
)
def test_wrong_usage_is_told_with_the_limit_and_no_traceback(line, said):
    result = radio(line)
    assert result.exit_code == 2
    assert said in result.stderr
    assert result.stdout == ""


@pytest.mark.parametrize("name", BRIEF)
def test_each_subcommand_explains_its_options(name):
    result = radio(f"{name} --help")
    assert result.exit_code == 0
    for option in ("--sensitivity", "--interference", "--seed", "--json"):
        assert option in result.stdout
