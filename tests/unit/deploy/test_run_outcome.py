"""What is told of a robot that is not there: its process died or was stopped, or it never came."""

import pytest

from rmr_deploy.lab_run import _excess
from rmr_deploy.run_end import who_came_back, who_ended
from rmr_deploy.run_outcome import RunOutcome
from rmr_world.quorum import absence


@pytest.mark.parametrize(
    ("code", "asked", "fate"),
    [
        (0, True, "stopped"),
        (0, False, "stopped"),  # somebody has sent it SIGTERM
        (-9, True, "stopped"),  # it did not stop in time
        (1, False, "died"),
        (-9, False, "died"),
    ],
)
def test_a_process_that_was_asked_to_stop_or_ended_in_good_order_was_stopped_and_others_have_died(code, asked, fate):
    outcome = RunOutcome()
    outcome.note_end("robot-3", code, asked=asked)
    assert outcome.fate("robot-3") == fate
    assert outcome.died == ({"robot-3": code} if fate == "died" else {})


def test_sentences_about_processes_tell_the_dead_from_the_stopped():
    fates = {"robot-1": "stopped", "robot-2": "died", "robot-3": "stopped"}
    assert who_ended(fates) == "robot-2 died, robot-1, robot-3 were stopped"
    assert who_came_back(fates) == (
        "; robot-2 died on the way and came back; robot-1, robot-3 were stopped on the way and came back"
    )
    assert who_came_back({}) == ""
    assert absence({1: "stopped", 2: "never came", 3: "died", 4: "never came"}) == (
        "robot 3 died, robot 1 was stopped, robots 2,4 never came"
    )


def test_what_all_receivers_have_dropped_beyond_the_rate_of_a_sender_is_added_up():
    buses = [{"excess": [(4, 10), (2, 1)]}, {}, {"lost": 3, "excess": [(4, 5)]}]
    assert _excess(buses) == [[2, 1], [4, 15]]
