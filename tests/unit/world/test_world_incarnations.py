"""One part of the report for all incarnations of a robot: what their ends have lost."""

from rmr_world.incarnations import merged_report
from rmr_world.run_warnings import run_warnings


def test_ends_of_earlier_incarnations_are_summed_and_the_present_one_has_lost_nothing_yet():
    whole = merged_report([{"unsaved": 2}, {"unsaved": 3}], {"unsaved": 7})
    assert whole["lost_in_restart"] == 5
    assert "unsaved" not in whole


def test_a_robot_that_was_never_restarted_has_no_such_count():
    assert merged_report([], {"unsaved": 7, "undelivered": 1}) == {"undelivered": 1}


def test_a_durable_robot_that_was_brought_back_has_lost_nothing():
    assert "lost_in_restart" not in merged_report([{"unsaved": 2}], {"unsaved": 7, "resumed": True})


def test_losses_in_restarts_are_warned_of_with_their_robots():
    robots = {"1": {"lost_in_restart": 0}, "2": {"lost_in_restart": 5}, "4": {"lost_in_restart": 1}}
    assert run_warnings({"robots": robots}) == [
        "lost with the memory of restarted robots (facts, actions, deliveries): 6 (robot 2: 5, robot 4: 1)"
    ]
