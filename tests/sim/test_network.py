"""A lab whose robots have a network: runs finish without a radio, and what has no meaning then is refused."""

import pytest
from greeting_program import PROGRAM

from rmr_sim.main import main
from rmr_sim.run_setup import prepare, report_of
from rmr_world.finding import LabError
from rmr_world.lab_file import load_lab

LAB = """
lab: small
program: small.rmr
duration: 8s
finish: greeted(R, @1)
arena: {size: [%s, 2.0]}
robots:
  - {ids: 1-3, grid: {from: [0.5, 0.5], step: [%s, 0.4], columns: 3}}
"""


@pytest.fixture
def lab(tmp_path):
    """Return a function that writes a lab in which robot 1 tells each other something longer than a frame."""

    def make(more, wide=2.0):
        (tmp_path / "lab.yaml").write_text(LAB % (wide, (wide - 1) / 2) + more)
        (tmp_path / "small.rmr").write_text(PROGRAM)
        return tmp_path

    return make


def test_robots_with_a_network_finish_where_no_radio_reaches(lab):
    """Robots 45 m from each other: the radio of the same lab reaches 19 m."""
    frames = []
    simulation = prepare(lab("radio: {mode: network}\n", wide=91.0))
    simulation.ether.on_air = frames.append
    report = report_of(simulation, simulation.run())
    assert report["finished"]
    assert frames
    assert {each.end - each.start for each in frames} == {0}
    counters = [robot["frames"] for robot in report["robots"].values()]
    assert sum(each["collided"] + each["deaf"] + each["dropped"] + each["no_ack"] for each in counters) == 0
    radio = prepare(lab("", wide=91.0))
    assert not radio.run()


def test_a_robot_that_is_killed_and_one_that_is_cut_off_are_heard_again(lab):
    faults = "faults: [{kill: 2, at: 500ms}, {restart: 2, at: 2s}, {mute: 3, from: 100ms, to: 3s}]\n"
    simulation = prepare(lab(f"radio: {{mode: network}}\n{faults}"))
    simulation.run()
    assert {robot.station.counters.received > 0 for robot in simulation.robots} == {True}


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("radio: {mode: network, loss: 0.1}\n", "radio.loss: loss is of the emulated radio, and means nothing"),
        ("radio: {mode: network, exponent: 2.0}\n", "radio.exponent: exponent is of the emulated radio"),
        ("radio: {mode: network, bursts: null}\n", "radio.bursts: bursts is of the emulated radio"),
        ("radio: {mode: network, seed: 3}\n", "radio.seed: seed is of the emulated radio"),
        ("radio: {mode: network, partition: [[1], [2]]}\n", "radio.partition: partition is of the emulated radio"),
        (
            "radio: {mode: network, security: none}\n",
            "with mode: network the bus does that, by `bus: {security: mtls}`",
        ),
        ("radio: {mode: wifi}\n", "radio.mode"),
        (
            "radio: {mode: network}\nfaults: [{attenuation_db: 3.0, link: [1, 2], from: 1s, to: 2s}]\n",
            "a radio of mode network has no power that could be attenuated; write cut, or loss",
        ),
    ],
)
def test_what_means_nothing_together_with_a_network_is_refused_with_what_to_do(lab, more, said):
    with pytest.raises(LabError) as refused:
        load_lab(lab(more) / "lab.yaml")
    assert said in str(refused.value)


def test_a_loss_of_the_command_line_is_refused(lab, capsys):
    assert main([str(lab("radio: {mode: network}\n")), "--loss", "0.1"]) == 3
    assert "--loss is of the emulated radio, and this lab has mode: network" in capsys.readouterr().err
