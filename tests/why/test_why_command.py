"""`rmr why` on a recorded run: forms of the answer, and what it says to wrong questions."""

import json
import re
from pathlib import Path

import pytest
from command_runner import invoke

from rmr_deploy.why_program import why_command
from rmr_sim.main import main as simulate

pytestmark = pytest.mark.medium


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("why") / "run"
    simulate(["corridor", "--robots", "2", "--seed", "7", "--run", str(folder)])
    return folder


def why(*words):
    return invoke(why_command(), [str(word) for word in words], name="rmr why")


def told(*words):
    """Return what a question that cannot be asked is answered, with its exit code."""
    result = why(*words)
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert lines[0].startswith("rmr why: ")
    return lines[0].removeprefix("rmr why: "), result.exit_code


def test_tree_of_a_sensed_fact_leads_through_action_and_rules_to_given_facts(run):
    lines = why(run, "at(@2, exit)").stdout.splitlines()
    assert [line.split("  ")[0] for line in lines] == [
        "at(@2, exit)",
        "└─ action moveto(@2, exit)",
        "",
        "",
        "",
    ] or len(lines) == 5
    assert "by rule corridor.rmr:19" in lines[1]
    assert "crossing(@2, 26.0)  0.000 s  by rule corridor.rmr:15 (consumed)" in lines[2]
    assert lines[3].endswith("start(@2)  0.000 s  given by the program (consumed)")
    assert lines[4].endswith("!due(@2, 26.0)  0.000 s  given by the lab")


def test_depth_cuts_the_tree_and_more_goes_on_at_its_number(run):
    cut = why(run, "at(@2, exit)", "--depth", "1").stdout.splitlines()
    assert len(cut) == 2
    number = cut[1].rpartition("... ")[2]
    rest = why(run, "at(@2, exit)", "--more", number).stdout.splitlines()
    assert [line.lstrip("├└│─ ").split("  ")[0] for line in rest] == [
        "action moveto(@2, exit)",
        "crossing(@2, 26.0)",
        "start(@2)",
        "!due(@2, 26.0)",
    ]


def test_variables_match_several_facts_newest_first(run):
    data = json.loads(why(run, "at(R, exit)", "--json").stdout)
    assert [answer["text"] for answer in data["answers"]] == sorted(
        ["at(@1, exit)", "at(@2, exit)"],
        key=lambda text: -next(a["at_s"] for a in data["answers"] if a["text"] == text),
    )
    times = [answer["at_s"] for answer in data["answers"]]
    assert times == sorted(times, reverse=True)


def test_json_has_places_instants_and_the_instant_up_to_which_the_run_is_known(run):
    data = json.loads(why(run, "crossing(@1, _)", "--json").stdout)
    [answer] = data["answers"]
    assert answer["rule"]["file"].endswith("corridor.rmr")
    assert (answer["rule"]["line"], answer["rule"]["firing"]) == (15, 1)
    assert answer["rule"]["bindings"] == {"R": "@1", "D": "32.0"}
    assert [child["role"] for child in answer["children"]] == ["consumed", "read"]
    assert data["known_until_s"] > 5
    assert data["problems"] == []
    assert data["notes"] == ["crossing(@1, 32.0) held until 0.000 s: consumed by firing 2, rule corridor.rmr:19"]


def test_dot_has_a_node_for_each_item_and_an_arrow_for_each_premise(run):
    text = why(run, "at(@2, exit)", "--dot").stdout
    assert text.startswith("digraph why {\n")
    assert text.endswith("}\n")
    assert text.count("[shape=") == 5
    assert text.count(" -> ") == 4


def test_fact_that_has_not_held_yet_says_so_and_names_the_option_not(run):
    text = why(run, "at(@2, exit)", "--at", "1s").stdout
    assert text.startswith("at(@2, exit) never held up to 1.000 s; ask with --not")


def test_not_names_the_action_that_waits_for_its_turn_or_drives(run):
    text = why(run, "--not", "at(@2, exit)", "--at", "1s").stdout
    assert text.startswith("at(@2, exit) does not hold at 1.000 s: it never did\n")
    assert "it is the effect of action moveto(@2, exit): " in text
    data = json.loads(why(run, "--not", "at(@2, exit)", "--at", "1s", "--json").stdout)
    assert data["absent"][0]["kind"] == "absent"
    assert why(run, "--not", "at(@2, exit)", "--at", "1s", "--dot").stdout.startswith("digraph why {")


@pytest.mark.parametrize(
    ("fact", "words"),
    [
        ("att(@2, exit)", "the program knows no fact `att`; did you mean `at`?"),
        ("crosing(@2, 1)", "did you mean `crossing`?"),
        ("at(@2)", "`at` has 2 arguments, not 1; it is `type sensor at(robot, area).`"),
        ("at", "'at' is a name: write its robot and arguments, `_` for any: 'at(_, _)'"),
        ("?at", "'?at(_, _)'"),
        ("at(@9, exit)", "robot 9 is not in this run; it has robots 1-2"),
        ("at(@2, exit", ""),
        ("at(@2, 3.5)", "an argument of `at` is area, not float"),
        ("at(exit, exit)", "the first argument is a robot"),
        ("", "there is nothing in it"),
        ("at(@2, exit). at(@1, exit)", "this is not a fact"),
        ("?moveto(@2, exit)", "`moveto` is an action: write it without a mark"),
        ("!crossing(@2, _)", "`crossing` is a temporary fact, not a persistent one"),
        ("a -o b", ""),
        ("\x1b[31m", ""),
        ("at(@2, exit)" * 5000, ""),
    ],
)
def test_wrong_question_is_answered_in_one_sentence(run, fact, words):
    sentence, code = told(run, fact)
    assert words in sentence
    assert code == 2
    assert "\x1b" not in sentence
    assert len(sentence) < 400


@pytest.mark.parametrize("more", ["99999", "x", "7.1", "", "-1", "1.2.3"])
def test_more_with_an_unknown_number_is_told(run, more):
    sentence, code = told(run, "at(@2, exit)", f"--more={more}")
    assert "--more" in sentence
    assert code == 2


def test_missing_run_and_missing_lab_that_runs_are_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sentence, code = told("nowhere", "at(@2, exit)")
    assert "there is no run at 'nowhere'" in sentence
    assert code == 2
    for words in (["at(@2, exit)"], ["at(@2, exit)", "--not"]):
        sentence, code = told(*words)
        assert sentence == (
            "RUN is missing, the run folder, which each run names at its end: rmr why RUN 'at(@2, exit)'"
        )
        assert code == 2
    for words, again in (([], "FACT"), (["--missed"], "--missed")):
        sentence, code = told(*words)
        assert sentence == f"RUN is missing, the run folder, which each run names at its end: rmr why RUN {again}"
        assert code == 2
    sentence, code = told("4", "at(@4, exit)")
    assert "robot 4: no lab runs on this machine" in sentence
    assert code == 2


def test_run_without_recording_and_broken_recordings_are_invalid(run, tmp_path):
    assert told(tmp_path, "at(@2, exit)")[1] == 3
    (tmp_path / "run.mcap").write_bytes(b"")
    assert told(tmp_path, "at(@2, exit)")[1] == 3
    (tmp_path / "run.mcap").write_bytes(b"no recording at all")
    assert told(tmp_path, "at(@2, exit)")[1] == 3
    whole = (run / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(whole[: len(whole) // 2])
    result = why(tmp_path, "crossing(@1, _)")
    assert result.exit_code in (0, 3)
    assert "Traceback" not in result.output


def test_two_forms_of_one_answer_are_refused(run):
    assert "--json and --dot" in told(run, "at(@2, exit)", "--json", "--dot")[0]
    assert "--more" in told(run, "at(@2, exit)", "--not", "--more", "3")[0]


def test_every_option_of_rmr_why_is_documented():
    pages = "".join(page.read_text("utf-8") for page in (Path(__file__).parents[2] / "docs").glob("*.md"))
    offered = {name for name in why_command().parser("rmr why").names if name.startswith("--")} - {
        "--help",
        "--version",
    }
    assert [name for name in sorted(offered) if name not in pages] == []


def test_the_turn_of_a_passage_has_its_name(tmp_path):
    simulate(["warehouse", "--run", str(tmp_path / "run")])
    turns = set(re.findall(r"waited for its turn of ([^,]+)", why(tmp_path / "run", "delivered(@1)").stdout))
    assert turns
    assert turns <= {"north", "south"}, turns
