"""What the lab file says of links, bursts and faults of the radio is what the simulated robots live with."""

import pytest

from rmr_sim.run_setup import prepare

PROGRAM = """
tell(@1, @2).
tell(@2, @1).
tell(A, B) -o told(B).
"""

LAB = """
lab: pair
program: pair.rmr
seed: 1
duration: 8s
finish: told(R)
arena: {size: [1.0, 1.0]}
robots: [{id: 1, pose: [0.2, 0.2, 0]}, {id: 2, pose: [0.8, 0.8, 0]}]
"""


def told_s(folder, *lines):
    """Return when each of two robots that tell each other has been told; None: never."""
    (folder / "pair.rmr").write_text(PROGRAM)
    (folder / "lab.yaml").write_text("\n".join([LAB, *lines]))
    simulation = prepare(folder)
    simulation.run()
    return [part["finish_s"] for part in simulation.robot_parts().values()]


def test_broadcasts_arrive_at_once_without_disturbances(tmp_path):
    assert max(told_s(tmp_path)) < 1.0


@pytest.mark.parametrize(
    "fault",
    [
        "partition: [[1], [2]]",
        "link: [1, 2], cut: true",
        "link: [1, 2], loss: 1.0",
        "loss: 1.0",
        "attenuation_db: 200.0",
    ],
)
def test_a_fault_of_the_radio_holds_until_its_end_and_not_beyond(tmp_path, fault):
    assert all(2.0 < at < 6.0 for at in told_s(tmp_path, f"faults: [{{from: 0s, to: 2s, {fault}}}]"))


@pytest.mark.parametrize(
    "radio",
    ["partition: [[1], [2]]", "links: [{link: [1, 2], cut: true}]", "bursts: {good: 1ms, bad: 1min}, seed: 2"],
)
def test_radio_section_disturbances_hold_for_the_whole_run(tmp_path, radio):
    assert told_s(tmp_path, f"radio: {{{radio}}}") == [None, None]


def test_one_way_cut_affects_only_acknowledgements_in_the_other_direction(tmp_path):
    one_way = "radio: {links: [{link: [1, 2], one_way: true, cut: true}]}"
    first, second = told_s(tmp_path, one_way)
    assert first < 1.0  # robot 2 gets through, though it never hears so
    assert second is None
