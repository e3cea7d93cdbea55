"""Deadlines of deliveries (earliest deadline first): urgent facts behind 300 routine ones on the emulated radio."""

import json

import pytest

from rmr_sim.main import main

pytestmark = pytest.mark.medium

LAB = """
lab: backlog
program: backlog.rmr
duration: 12s
finish: quiet(R)
arena: {size: [1.5, 1.0]}
robots: [{id: 1, pose: [0.3, 0.3, 0deg]}, {id: 2, pose: [0.9, 0.3, 0deg]}, {id: 3, pose: [1.2, 0.6, 0deg]}]
"""
BACKLOG = """
order textual.
type STATUS status(robot, int).
type URGENT urgent(robot).
type !served(robot).
type flood(robot, int).
type quiet(robot).
start(@1). start(R) -o wait(R, 1.0) then flood(R, 300).
type action wait(robot, float).
flood(R, N), N > 0 -o status(@BEHIND, N), flood(R, N - 1).
flood(R, 0) -o hurry(R).
hurry(R) -o urgent(@2).
urgent(R) -o served(R).
status(R, N) -o 1.
service: watch(hurry(R), served(@2), 0.5, say(R, "late")).
"""
FRAME_S = 0.02
"""A frame of a delivery with the interframe space, channel access at its longest, and its acknowledgements."""


def service(folder, status="", urgent="", behind=2):
    text = BACKLOG.replace("STATUS ", status).replace("URGENT ", urgent).replace("@BEHIND", f"@{behind}")
    (folder / "backlog.rmr").write_text(text)
    (folder / "lab.yaml").write_text(LAB)
    main([str(folder / "lab.yaml"), "--json", "--run", str(folder / "run")])
    return json.loads((folder / "run" / "report.json").read_text())["robots"]["1"]["assertions"][0]


@pytest.mark.parametrize(
    "case",
    [
        {"status": "unordered "},
        {"urgent": "unordered "},
        {"status": "unordered ", "urgent": "unordered "},
        {"status": "unordered ", "behind": 3},
        {"behind": 3},
    ],
    ids=str,
)
def test_an_urgent_fact_overtakes_a_backlog_of_300_within_three_frames(tmp_path, case):
    job = service(tmp_path, **case)
    assert job["met"]
    assert job["finish_s"] - 1.0 < 3 * FRAME_S + 0.05


def test_an_ordered_urgent_fact_behind_ordered_ones_is_late_for_the_queue(tmp_path):
    job = service(tmp_path)
    assert not job["met"]
    assert job["cause"] == "queue"
