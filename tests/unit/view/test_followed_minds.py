"""What the page shows of a robot at an instant is what its mind held then, also after a program was loaded."""

import pytest
from unit.mind.mind_runs import AFTER_TOKENS, LABS, TOKENS, MindRun

from rmr.base.time import NS_PER_S
from rmr.mind.mind_replay import MindReplay
from rmr_view.followed_minds import LISTED_MAX, FollowedMind, sensed_facts

pytestmark = pytest.mark.medium

LAB = """
lab: loaded
program: old.rmr
duration: 8s
arena: {size: [3.0, 3.0]}
robots: [{ids: 1-2, grid: {from: [0.4, 0.4], step: [0.5, 0], columns: 2}}]
loads: [{at: 2s, program: new.rmr}]
"""


@pytest.fixture(scope="module", params=["corridor", "loaded"])
def run(request, tmp_path_factory):
    if request.param == "corridor":
        return MindRun(LABS / "corridor", 7)
    folder = tmp_path_factory.mktemp("loaded")
    for name, text in {"lab.yaml": LAB, "old.rmr": TOKENS, "new.rmr": AFTER_TOKENS}.items():
        (folder / name).write_text(text)
    return MindRun(folder)


def followed(log, program):
    mind = FollowedMind(program, log[0])
    for batch in log[1:]:
        mind.feed(batch)
    mind.go_on()
    assert mind.problem is None
    return mind


def test_facts_and_goals_at_each_instant_are_those_of_the_mind(run):
    changes = 0
    for log in run.logs.values():
        mind = followed(log, run.program)
        replay = MindReplay(log, run.program)
        shown = None
        while replay.step():
            if replay.next_call == replay.now:
                continue  # the page shows what held after all that happened at an instant
            machine = replay.node.machine
            before, shown = shown, mind.state(replay.now)
            assert shown["facts"] == machine.facts()
            assert shown["sensed"] == sensed_facts(machine)
            assert shown["goals"]["open"] == machine.goals()["open"]
            changes += shown != before
    assert changes > 30


def test_firings_actions_and_achieved_goals_are_those_of_the_trace(run):
    trace = run.simulation.trace()
    for (robot, _), log in run.logs.items():
        mind = followed(log, run.program)
        own = [entry for entry in trace if entry["robot"] == robot]
        for at in (0.5, 1.5, 2.5, 3.5, 20.0):
            shown = mind.state(round(at * NS_PER_S))
            past = [entry for entry in own if entry["t"] <= at]
            fired = [{"t": e["t"], "rule": e["rule"]} for e in past if e["what"] == "fired"]
            begun = [(e["t"], e["action"]) for e in past if e["what"] == "action"]
            assert shown["fired"] == fired[-LISTED_MAX:]
            assert shown["goals"]["achieved"] == [[e["goal"], e["t"]] for e in past if e["what"] == "achieved"]
            assert [(e["begin_s"], e["action"]) for e in shown["actions"]] == begun
            ended = [e["t"] for e in past if e["what"] == "action_ended"]
            assert [e["end_s"] for e in shown["actions"] if e["end_s"] is not None] == ended
