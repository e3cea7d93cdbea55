"""`rmr keys`: what people type, what they are told, and the page that says so."""

import json
import re
from pathlib import Path

import pytest
from command_runner import invoke

from rmr.bus.authority import CA_DAYS, LEAF_DAYS
from rmr.bus.certificates import read_certificate
from rmr_deploy.keys_program import command

PAGE = (Path(__file__).parents[3] / "docs" / "keys.md").read_text()


@pytest.fixture
def keys(tmp_path):
    """Return a function that carries out a subcommand on a CA that is there."""

    def call(verb, *words):
        return invoke(command(), [verb, tmp_path / "ca", *words], name="rmr keys", catch_exceptions=False)

    assert call("init").exit_code == 0
    return call


def test_a_lab_is_given_its_keys_and_each_process_its_folder(keys, tmp_path):
    issued = keys(
        "issue", "--robot", "1", "--robot", "2-3", "--world", "--router", "a", "--operator", "ann", "--viewer", "v"
    )
    assert issued.exit_code == 0, issued.output
    for number, who in enumerate(("robot/1", "robot/2-3", "world", "router/a", "operator/ann", "viewer/v")):
        assert keys("bundle", who, "-o", tmp_path / str(number)).exit_code == 0
        assert str(read_certificate(tmp_path / str(number)).holder) == who


def test_the_list_shows_how_each_certificate_stands(keys):
    for words in (["issue", "--robot", "1"], ["revoke", "robot/1"], *(["issue", "--robot", "1"],) * 2):
        assert keys(*words).exit_code == 0
    listed = json.loads(keys("list", "--json").stdout)["issued"]
    assert [one["state"] for one in listed] == ["revoked", "replaced, still valid", "valid"]
    rows = keys("list").stdout.splitlines()
    assert [re.split("  +", row)[::2] for row in rows[1:]] == [["robot/1", one["state"]] for one in listed]
    assert [row.split()[-1] for row in rows[1:]] == [one["serial"] for one in listed]


def test_issuing_again_says_that_the_one_before_is_still_valid(keys):
    keys("issue", "--world")
    assert "the one before is valid, too, until it expires" in keys("issue", "--world").stdout


def test_issuing_to_somebody_new_says_which_bundles_have_to_name_them(keys):
    hint = "may do nothing yet: write the bundles of router/a, world anew, and restart whichever of them listens"
    assert "may do nothing yet" not in keys("issue", "--world", "--router", "a", "--robot", "1").stdout
    assert f"operator/ann, robot/2 {hint}" in keys("issue", "--robot", "1", "--robot", "2", "--operator", "ann").stdout
    assert "may do nothing yet" not in keys("issue", "--robot", "2").stdout


def test_revoking_an_operator_says_that_robots_need_the_list_too(keys):
    keys("issue", "--operator", "ann", "--robot", "1")
    assert (
        "each robot: until then it takes programs that operator/ann has signed" in keys("revoke", "operator/ann").stdout
    )
    assert "each robot" not in keys("revoke", "robot/1").stdout


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "say for whom: --robot N, --world, --router HOST, --operator NAME or --viewer NAME"),
        (["--robot", "99999"], "there is no robot 99999: ids are 0 to 65533"),
        (["--robot", "-1"], "'-1' is no id and no range of ids"),
        (["--robot", "1", "--robot", "1"], "robot/1 is named twice"),
        (["--router", "a", "--router", "A"], "router/a is named twice"),
        (["--router", "a b"], "'a b' is no name or address of a host"),
        (["--operator", "a/b"], "'a/b' cannot be a name"),
        (["--viewer", ""], "'' cannot be a name"),
        (["--world", "--host", "a;b"], "'a;b' is no name or address of a host"),
        (["--robot", "1", "--host", "a"], "--host goes with one --world or one --router"),
        (["--world", "--router", "a", "--host", "b"], "--host goes with one --world or one --router"),
        (["--world", "--days", "0"], "--days: a whole number from 1 to 36500"),
    ],
)
def test_wrong_words_are_told_and_nothing_is_issued(keys, words, says):
    answer = keys("issue", *words)
    assert (answer.exit_code, answer.stdout) == (2, "")
    assert says in answer.stderr.splitlines()[0]
    assert json.loads(keys("list", "--json").stdout)["issued"] == []


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["init"], 3, "the folder has a CA already; name a new one"),
        (["bundle", "robot/7", "-o", "/nowhere/x"], 3, "robot/7 has no certificate; issue one with rmr keys issue"),
        (["bundle", "world", "-o", "/nowhere/x"], 2, "/nowhere/x: No such file or directory"),
        (["bundle", "router/../x", "-o", "y"], 2, "'../x' is no name or address of a host"),
        (["revoke", "robot/7"], 3, "robot/7 has no certificate"),
        (["revoke", "robott/7"], 2, "'robott/7' names nobody"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(keys, words, code, says):
    keys("issue", "--world")
    answer = keys(*words)
    assert (answer.exit_code, answer.stdout) == (code, "")
    assert says in answer.stderr.splitlines()[0]


def test_an_unknown_folder_is_told_with_what_makes_it(tmp_path):
    answer = invoke(command(), ["list", tmp_path / "x"], name="rmr keys")
    assert (answer.exit_code, answer.stdout) == (3, "")
    assert (
        answer.stderr
        == f"rmr keys: {tmp_path / 'x'}: no folder of a CA; make one with rmr keys init {tmp_path / 'x'}\n"
    )


def test_the_numbers_of_the_help_are_those_of_the_ca():
    for verb, days in (("init", CA_DAYS), ("issue", LEAF_DAYS)):
        assert f"(default: {days})" in invoke(command(), [verb, "--help"]).stdout
        assert "to 36500" in invoke(command(), [verb, "x", "--days", "0"]).stderr
    assert f"{LEAF_DAYS} days, that of the CA for {CA_DAYS}" in PAGE


def test_every_subcommand_is_on_the_page_and_no_other():
    assert set(re.findall(r"`rmr keys (\w+)[^`]*`", PAGE)) == set(command().commands)
