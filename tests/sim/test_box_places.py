"""Places of a box area: taken with a pose alone, disputed only while the robot drives to them."""

import json

import pytest
from lab_maker import small_lab, traced

from rmr.base.time import seconds
from rmr.node import payloads
from rmr.node.payloads import Hello
from rmr.node.ports import Received
from rmr_sim.main import main
from rmr_sim.run_setup import prepare
from rmr_sim.simulation import Simulation

pytestmark = pytest.mark.medium

BOX = """
lab: box
program: box.rmr
duration: 40s
finish: at(R, spot)
arena: {size: [3.0, 2.0]}
areas:
  spot: {box: [2.0, 0.5, 2.9, 1.5]}
robots: [{ids: 1-6, grid: {from: [0.3, 0.3], step: [0.35, 0.4], columns: 3}}]
faults: FAULTS
"""
TO_THE_BOX = "type action moveto(R: robot, A: area).\nstart(R).\nstart(R) -o moveto(R, spot).\n"
RESTARTED = "[{at: 2.5s, kill: 2}, {at: 4s, restart: 2}, {at: 5s, kill: 5}, {at: 5.1s, restart: 5}]"


def box_lab(folder, faults="[]"):
    (folder / "lab.yaml").write_text(BOX.replace("FAULTS", faults))
    (folder / "box.rmr").write_text(TO_THE_BOX)
    return folder


@pytest.mark.parametrize("faults", ["[]", RESTARTED], ids=["whole", "restarted"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_robots_that_set_out_before_they_have_a_pose_share_a_box(tmp_path, faults, seed):
    simulation = prepare(box_lab(tmp_path, faults), seed=seed)
    assert simulation.run()
    places = [robot.node.driver.place for robot in simulation.robots]
    assert None not in places
    assert len(set(places)) == len(places)
    assert not simulation.violations


def test_robots_under_chaos_share_a_box(tmp_path):
    simulation = prepare(box_lab(tmp_path), seed=4, chaos=True)
    assert simulation.run()


def test_an_action_that_has_the_wheels_after_a_moveto_keeps_them_when_the_place_is_disputed(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action moveto(R: robot, A: area) -o came(R).
        type action face(R: robot, D: float) -o faced(R).
        go(@1).
        go(R) -o moveto(R, box).
        came(R) -o face(R, 180.0).
        """,
        robots=2,
        finish="",
        duration="20s",
    )
    node, goals = simulation.robots[0].node, []

    def dispute(now):
        driving = node.actions.driving
        if driving is not None and driving.name == "face":
            x, y = node.driver.place
            hello = Hello(x, y, 0.0, 0.0, True, 0, None, node.state.digest, False)
            node.messenger.receive(now, Received(payloads.encode_hello(hello), 2, False, -50.0, 255, now))
            goals.append(node.driver.navigator.goal)

    simulation.checkers.append(dispute)
    simulation.run()
    assert goals
    assert set(goals) == {None}
    assert [entry["failure"] for entry in traced(simulation, "action_ended")] == [None, None]
    assert abs(node.services.percept().pose.theta) > 3.0


def test_the_trace_of_a_run_that_breaks_down_holds_what_was_noted_until_then(tmp_path, capsys, monkeypatch):
    folder = box_lab(tmp_path)

    tick = Simulation._tick

    def breaks(self, now, index):
        tick(self, now, index)
        assert now < seconds(1), "broken on purpose"

    monkeypatch.setattr(Simulation, "_tick", breaks)
    trace = tmp_path / "trace.jsonl"
    assert main([str(folder), "--run", str(tmp_path / "run"), "--trace", str(trace)]) == 1
    assert "broken on purpose" in capsys.readouterr().err
    whats = {json.loads(line)["what"] for line in trace.read_text().splitlines()}
    assert {"fired", "action"} <= whats
