"""The campaign of drawn labs: rows as they come, failures with their commands, resumed where it ended."""

import json

import pytest
import score_campaign
from score_campaign import campaign, kept_rows, summary, symptoms

pytestmark = pytest.mark.medium

ROW = {"seed": 1, "finished": True, "contacts": 0, "violations": {}, "wrong": [], "time_s": 3.0}


@pytest.mark.parametrize(
    ("changed", "found"),
    [
        ({}, []),
        ({"refused": ["too small"]}, []),
        ({"finished": False, "wrong": ["not finished"]}, ["not finished"]),
        ({"contacts": 2, "violations": {"stands still": 1}, "wrong": ["2 contacts"]}, ["contact", "stands still"]),
        ({"wrong": ["actions that failed without an `else`: 2"]}, ["action failed"]),
        ({"time_s": None, "wrong": ["KeyError: 3"]}, ["broke down"]),
    ],
)
def test_symptoms_are_told_in_the_same_words(changed, found):
    assert symptoms({**ROW, **changed}) == found


def test_a_campaign_that_is_resumed_runs_only_what_is_left(tmp_path, capsys):
    rows = campaign(range(3, 5), tmp_path, 1, chaos=False, resume=False)
    assert [row["seed"] for row in rows] == [3, 4]
    kept = [{**row, "time_s": 99.0} for row in rows[:1]]
    (tmp_path / score_campaign.ROWS).write_text("".join(f"{json.dumps(row)}\n" for row in kept) + '{"seed": 4')
    resumed = campaign(range(3, 5), tmp_path, 1, chaos=False, resume=True)
    assert [row["seed"] for row in resumed] == [3, 4]
    assert resumed[0]["time_s"] == 99.0
    assert sorted(row["seed"] for row in kept_rows(tmp_path)) == [3, 4]
    assert summary(resumed)[0] == "drawn labs    2"
