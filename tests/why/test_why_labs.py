"""Explanations of recorded labs with random faults: every item of every robot, by replay of the recording."""

from pathlib import Path

import pytest
from provenance_trees import unexplained

from rmr.record.recording import open_recording
from rmr.why.past import Past
from rmr.why.replayed_histories import ReplayedHistories
from rmr_sim.main import main as simulate

ROOT = Path(__file__).parents[2]
LABS = [
    *[ROOT / "deploy/labs" / name for name in ("corridor", "twoway", "testbed", "formation")],
    *[ROOT / "docs/examples/labs" / name for name in ("aisles", "charging", "crossing")],
]


def explained(lab, folder, *options):
    """Return how many items of the run there are, and those whose tree ends in anything but a given or sensed fact."""
    simulate([str(lab), "--chaos", "--run", str(folder / "run"), *options])
    with open_recording(folder / "run") as recording:
        histories = ReplayedHistories(recording)
        past = Past(histories)
        items = [(mind, item) for robot in past.robots for mind in past.minds(robot) for item in mind.items]
        wrong = [each for mind, item in items for each in unexplained(past, mind, item)]
        assert histories.problems == []
        return len(items), wrong


@pytest.mark.medium
def test_trees_of_a_corridor_with_faults_end_in_given_and_sensed_facts(tmp_path):
    count, wrong = explained(LABS[0], tmp_path, "--robots", "3", "--seed", "5")
    assert count > 20
    assert wrong == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", ["3", "11"])
@pytest.mark.parametrize("lab", LABS, ids=lambda lab: lab.name)
def test_trees_of_a_lab_with_faults_end_in_given_and_sensed_facts(lab, seed, tmp_path):
    count, wrong = explained(lab, tmp_path, "--seed", seed)
    assert count > 0
    assert wrong == []
