"""The ablation of the rules of motion, reduced to a few runs."""

import json
import sys

import ablation
import pytest
from ablation import RULES, Case, State, verdict
from runs import LABS

from rmr_sim.run_setup import Options, load, report_of


def report(lab: str, seed: int, without: frozenset[str] = frozenset()) -> tuple[dict, dict[str, int]]:
    simulation = load(LABS / lab, Options(chaos=True, without=without)).simulation(seed)
    return report_of(simulation, simulation.run()), simulation.firings


@pytest.mark.slow
@pytest.mark.parametrize(("lab", "seed"), [("testbed", 5), ("twoway", 3)])
def test_leaving_out_the_rules_that_did_not_fire_changes_nothing(lab: str, seed: int) -> None:
    whole, fired = report(lab, seed)
    assert {*fired} <= {*RULES}
    unfired = frozenset(RULES) - {*fired}
    assert len(unfired) >= 3
    assert report(lab, seed, unfired)[0] == whole


def test_a_rule_that_fired_is_left_out_and_others_count_as_equal(tmp_path, monkeypatch) -> None:
    state, out = tmp_path / "state.json", tmp_path / "out"
    out.mkdir()
    command = ["ablation.py", "--labs", "testbed", "--seeds", "5", "--rules", "gate,retreat", "--resume"]
    monkeypatch.setattr(sys, "argv", [*command, "--state", str(state), "--out", str(out)])
    ablation.main()
    assert [json.loads(line)[0] for line in state.read_text().splitlines()] == [
        "testbed/testbed/5/",
        "testbed/testbed/5/gate",
    ]
    gate, retreat = (json.loads(line) for line in (out / "ablation.jsonl").read_text().splitlines())
    assert (gate["fired"], gate["changed"]) == (1, 1)
    assert (retreat["fired"], retreat["changed"], retreat["verdict"]) == (0, 0, "never fires")
    assert "| `gate` | 1 of 1 | " in (out / "ablation.md").read_text()
    monkeypatch.setattr(ablation, "carried_out", lambda case: pytest.fail(f"{case} is known"))
    ablation.main()


def test_a_verdict_weighs_contacts_first() -> None:
    row = dict.fromkeys(("contacts_base", "unfinished_base", "violations_base", "unfinished", "violations"), 0)
    row |= {"fired": 9, "changed": 9, "contacts": 0, "ratio_delta": 0.1}
    assert verdict({**row, "contacts": 2}) == "needed: without it 2 contacts more"
    assert verdict({**row, "contacts_base": 1}) == "harms: without it 1 contacts fewer"
    assert verdict(row) == "saves time"
    assert verdict({**row, "ratio_delta": 0.0}) == "no gain measured"
    assert verdict({**row, "ratio_delta": 0.0, "changed": 0}) == "no effect"


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (["--rules", "retreet"], "no rule is called retreet"),
        (["--labs", "coridor"], "no lab of deploy/labs is called 'coridor'"),
        (["--seeds", "some"], "seeds are a range such as 1-25, not 'some'"),
    ],
)
def test_a_wrong_argument_is_named(asked, says, monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["ablation.py", *asked])
    with pytest.raises(SystemExit):
        ablation.main()
    assert says in capsys.readouterr().err


def test_an_interrupted_ablation_knows_what_it_has(tmp_path) -> None:
    case = Case("testbed", "testbed", 5)
    (tmp_path / "state").write_text(json.dumps([case.key, {"fired": {"gate": 3}}]) + "\n")
    state = State(tmp_path / "state", resume=True)
    assert state.missing([case, case._replace(seed=6)]) == [case._replace(seed=6)]
    assert [each.without for rule in ("gate", "retreat") for each in state.to_ablate(rule, [case])] == ["gate"]
