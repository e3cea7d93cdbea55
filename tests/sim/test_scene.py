"""What checkers know of a robot that was stopped, slow or dead."""

import pytest
from lab_maker import small_lab

from rmr.base.time import NEVER, seconds
from rmr_sim.checkers.run_view import RunView
from rmr_sim.event import FaultRecord

IDLE = "idle(R).\nidle(R), never(R) -o done(R).\n"


def held_up(folder, since, until, *befallen):
    """Return until when robot 1 is held up, in seconds; a fault is (when, word, until)."""
    simulation = small_lab(folder, IDLE)
    for at, fault, end in befallen:
        simulation.fault_records.append(FaultRecord(seconds(at), NEVER if end is None else seconds(end), 1, fault))
    found = RunView(simulation).held_up(1, seconds(since), seconds(until))
    return found if found == NEVER else found / 1e9


@pytest.mark.parametrize(("since", "until", "end"), [(0, 1, 0), (1, 2, 5), (3, 3, 5), (5, 6, 5), (5.1, 9, 0)], ids=str)
def test_a_robot_is_held_up_from_the_fault_until_its_end(tmp_path, since, until, end):
    assert held_up(tmp_path, since, until, (2, "stalled", 5)) == end


def test_stops_that_run_into_each_other_are_one(tmp_path):
    stops = [(2, "stalled", 5), (4, "stalled", 7), (6, "slowed", 8), (8.5, "stalled", 9)]
    assert held_up(tmp_path, 3, 3, *stops) == 8
    assert held_up(tmp_path, 3, 8.5, *stops) == 9


def test_killed_robot_is_held_up_forever(tmp_path):
    assert held_up(tmp_path, 3, 3, (2, "killed", None)) == NEVER


def test_restarted_robot_is_not_held_up_by_earlier_faults(tmp_path):
    life = [(1, "stalled", 9), (2, "killed", None), (4, "restarted", None)]
    assert held_up(tmp_path, 3, 3, *life) == 4
    assert held_up(tmp_path, 5, 6, *life) == 0
