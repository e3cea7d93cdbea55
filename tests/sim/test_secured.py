"""Link security end to end in the simulator: runs finish, and whoever has another key is not there."""

import json

import pytest
from greeting_program import PROGRAM

from rmr.radio.frame import decode
from rmr.radio.security import Level, Security
from rmr_sim.main import main
from rmr_sim.run_setup import prepare, report_of
from rmr_sim.simulation import Simulation

KEY = "00112233445566778899aabbccddeeff"
LAB = """
lab: small
program: small.rmr
duration: 8s
finish: greeted(R, @1)
arena: {size: [2.0, 2.0]}
robots:
  - {ids: 1-3, grid: {from: [0.5, 0.5], step: [0.4, 0.4], columns: 2}}
"""


@pytest.fixture
def lab(tmp_path):
    """Return a function that writes a lab in which robot 1 tells each other something longer than a frame."""

    def make(radio):
        (tmp_path / "lab.key").write_text(KEY)
        (tmp_path / "lab.yaml").write_text(f"{LAB}radio: {radio}\n")
        (tmp_path / "small.rmr").write_text(PROGRAM)
        return tmp_path

    return make


def refused(report, robot):
    counters = report["robots"][robot]["frames"]
    return {name: counters[name] for name in ("forged", "replayed", "unsecured", "malformed")}


NOTHING = {"forged": 0, "replayed": 0, "unsecured": 0, "malformed": 0}


@pytest.mark.parametrize("level", ["enc-mic-32", "enc-mic-64", "enc-mic-128"])
def test_robots_with_one_key_finish_and_every_data_frame_on_the_air_is_secured(lab, level):
    simulation = prepare(lab(f"{{key_file: lab.key, security: {level}}}"))
    on_air = []
    simulation.ether.on_air = lambda announcement: on_air.append(announcement.psdu)
    assert simulation.run()
    report = report_of(simulation, True)
    assert [refused(report, robot) for robot in "123"] == [NOTHING] * 3
    data = [frame for psdu in on_air if len(psdu) > 5 for frame in [decode(psdu)]]
    assert len(data) >= 8, "four parts each"
    assert all(frame.secured and b"word" not in frame.payload for frame in data)
    assert max(len(psdu) for psdu in on_air) == 127, "what is longer than a frame fills frames"


class Strange(Simulation):
    """Robot 3 has another key than the lab's."""

    def security(self, robot, life):
        return Security(Level.ENC_MIC_64, bytes(16), robot) if robot == 3 else super().security(robot, life)


def test_robot_with_another_key_neither_receives_nor_is_received(lab, monkeypatch):
    monkeypatch.setattr("rmr_sim.run_setup.Simulation", Strange)
    simulation = prepare(lab("{key_file: lab.key}"))
    assert not simulation.run()
    report = report_of(simulation, False)
    assert [report["robots"][robot]["finish_s"] is not None for robot in "123"] == [True, True, False]
    assert report["robots"]["3"]["frames"]["received"] == 0
    assert all(refused(report, robot)["forged"] > 0 for robot in "123")
    assert 3 not in simulation.robots[0].node.peers.known
    assert 2 in simulation.robots[0].node.peers.known


def test_robot_without_security_neither_receives_nor_is_received_in_a_secured_lab(lab, monkeypatch):
    class Open(Simulation):
        def security(self, robot, life):
            return None if robot == 3 else super().security(robot, life)

    monkeypatch.setattr("rmr_sim.run_setup.Simulation", Open)
    simulation = prepare(lab("{key_file: lab.key}"))
    simulation.run()
    report = report_of(simulation, False)
    assert report["robots"]["3"]["frames"]["received"] == 0
    assert all(refused(report, robot)["unsecured"] > 0 for robot in "123")
    assert 3 not in simulation.robots[0].node.peers.known


def test_the_same_seed_gives_the_same_report_and_another_key_no_other_outcome(lab, capsys):
    folder, reports = lab("{key_file: lab.key}"), []
    for run, key in enumerate((KEY, KEY, KEY[::-1])):
        (folder / "lab.key").write_text(key)
        assert main([str(folder), "--json", "--run", str(folder / f"run{run}")]) == 0
        reports.append(json.loads(capsys.readouterr().out))
    assert reports[0] == reports[1] == reports[2]


def test_a_lab_without_its_key_does_not_run_and_says_how_to_make_one(lab, capsys):
    folder = lab("{key_file: other.key}")
    assert main([str(folder), "--run", str(folder / "run")]) == 3
    assert "radio.key_file: " in (message := capsys.readouterr().err)
    assert "No such file or directory; to make a key: openssl rand -hex 16 > other.key" in message
    assert not (folder / "run").exists()
