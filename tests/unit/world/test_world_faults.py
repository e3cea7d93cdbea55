"""What the lab file says goes wrong with robots, the mistakes one can make in it, and how it is told again."""

from math import inf

import pytest
from world_labs import ROOM, complaints, lab_of

from rmr.base.time import NS_PER_MS, NS_PER_S
from rmr.bus import record_checks
from rmr.radio.links import Disturbance, muted, partition
from rmr_world.faults import fault_entries, fault_entry, fault_line, fault_lines, process_run_faults
from rmr_world.lab import Outage, Slow

S = NS_PER_S
TWO = ROOM + "  - {id: 2, pose: [1.0, 0.2, 0]}\n"


def test_a_slow_robot_and_an_outage_are_kept_as_values_of_one_robot_each(tmp_path):
    text = TWO + "faults: [{from: 1s, to: 3s, slow: 2, every: 100ms}, {from: 2s, to: 4s, outage: all}]\n"
    slow, *outages = lab_of(tmp_path, text).faults
    assert slow == Slow(S, 3 * S, 2, 100 * NS_PER_MS)
    assert outages == [Outage(2 * S, 4 * S, 1), Outage(2 * S, 4 * S, 2)]


def test_fault_without_an_end_has_no_to_and_lasts_to_the_end_of_the_run(tmp_path):
    endless = fault_entry(partition([[1], [2]], 2 * S))
    assert fault_line(endless) == "{from: 2.0, link: [1, 2], cut: true}"
    record_checks.report({"faults": [endless]})
    (fault,) = process_run_faults(lab_of(tmp_path, TWO), [endless], 7.5)
    assert list(fault.items())[:2] == [("from", 2.0), ("to", 7.5)]


def test_an_outage_may_name_some_robots(tmp_path):
    lab = lab_of(tmp_path, TWO + "faults: [{from: 2s, to: 4s, outage: [2]}]\n")
    assert lab.faults == (Outage(2 * S, 4 * S, 2),)
    assert lab.with_robots(1).faults == ()


@pytest.mark.parametrize(
    ("faults", "complaint"),
    [
        ("{from: 1s, to: 2s, slow: 1}", "slow and every belong together"),
        ("{from: 1s, to: 2s, stall: 1, every: 1s}", "slow and every belong together"),
        ("{from: 1s, to: 2s, slow: 1, every: 16ms}", "every should be longer than a tick"),
        (
            "{from: 1s, to: 2s, outage: every}",
            "outage: 'every' is no id and no range of ids; write ids such as 4, 2-3 or 0-5,9, or all",
        ),
        ("{from: 1s, to: 2s, outage: [7]}", "outage: robot 7 is not in this lab"),
        ("{at: 1s, outage: all}", "all others need from and to"),
        ("{at: 1s, mute: 1}", "all others need from and to"),
        ("{from: 1s, to: 2s, mute: 7}", "robot 7 is not in this lab"),
        ("{from: 1s, to: 2s, deaf: [1, 2]}", "deaf"),
        ("{from: 1s, to: 2s, deaf: 1, mute: 2}", "should have exactly one of"),
        ("{from: 1s, to: 2s, mute: 1, one_way: true}", "one_way needs link or partition"),
        ("{at: 3s, restart: 1}", "robot 1 lives at 3 s: kill it before it is started again"),
        ("{at: 3s, kill: 1}, {at: 2s, restart: 1}", "robot 1 lives at 2 s"),
        ("{at: 3s, kill: 1}, {at: 4s, kill: 1}", "robot 1 is dead at 4 s: start it again before it is killed"),
    ],
)
def test_mistake_in_faults_is_reported(tmp_path, faults, complaint):
    found = complaints(tmp_path, TWO + f"faults: [{faults}]\n")
    assert len(found) == 1
    assert complaint in found[0]


def test_a_kill_that_is_misspelt_brings_no_complaint_about_the_restart(tmp_path):
    found = complaints(tmp_path, TWO + "faults: [{at: 1s, kil: 1}, {at: 2s, restart: 1}]\n")
    assert [line for line in found if "lives" in line] == []
    assert any("unknown key; did you mean 'kill'" in line for line in found)


def test_a_robot_may_die_again_after_it_was_started_again(tmp_path):
    lives = "{at: 1s, kill: 1}, {at: 2s, restart: 1}, {at: 3s, kill: 1}, {at: 4s, restart: 1}"
    assert len(lab_of(tmp_path, TWO + f"faults: [{lives}]\n").faults) == 4


EVERY_KIND = """\
- {from: 0.5, to: 1.25, stall: 1}
- {at: 1.0, kill: 2}
- {from: 1.0, to: 2.0, slow: 1, every: 0.1}
- {from: 1.5, to: 2.0, outage: 1}
- {from: 1.5, to: 2.5, loss: 0.25}
- {from: 1.6, to: 2.5, cut: true}
- {from: 1.7, to: 2.5, link: [1, 2], loss: 0.5}
- {from: 1.8, to: 2.5, link: [2, 1], one_way: true, cut: true}
- {from: 1.9, to: 2.5, link: [1, 2], attenuation_db: 20.0}
- {at: 2.0, restart: 2}
- {from: 3.0, to: 4.0, partition: [[1, 3], [2]]}
- {from: 3.5, to: 4.0, mute: 3}
- {from: 3.6, to: 4.0, deaf: 1}
- {from: 4.0, to: 5.0, partition: [[2], [3], [1]], one_way: true}
"""


def test_faults_are_listed_as_in_the_lab_file_in_order_of_start(tmp_path):
    lab = lab_of(tmp_path, TWO + "  - {id: 3, pose: [1.6, 0.2, 0]}\nfaults:\n" + EVERY_KIND)
    assert "".join(f"{line}\n" for line in fault_lines(lab)) == EVERY_KIND
    assert fault_entries(lab)[1] == {"at": 1.0, "kill": 2}


def test_a_mute_robot_is_a_one_way_cut_to_all_others_and_a_deaf_one_from_them(tmp_path):
    three = TWO + "  - {id: 3, pose: [1.6, 0.2, 0]}\n"
    lab = lab_of(tmp_path, three + "faults: [{from: 1s, to: 2s, mute: 3}, {from: 1s, to: 2s, deaf: 2}]\n")
    mute, deaf = lab.disturbances
    assert mute == Disturbance(S, 2 * S, ((3,), (1, 2)), one_way=True, attenuation_db=inf)
    assert deaf == Disturbance(S, 2 * S, ((1, 3), (2,)), one_way=True, attenuation_db=inf)


def test_a_lone_robot_that_is_mute_disturbs_no_link(tmp_path):
    assert lab_of(tmp_path, ROOM + "faults: [{from: 1s, to: 2s, mute: 1}]\n").disturbances == ()


def test_a_mute_robot_without_the_roster_is_listed_as_a_one_way_partition():
    assert fault_line(fault_entry(muted(3, (1, 2, 3), S, 2 * S))) == (
        "{from: 1.0, to: 2.0, partition: [[3], [1, 2]], one_way: true}"
    )


def test_permanent_radio_disturbances_are_not_listed_among_the_faults(tmp_path):
    assert fault_entries(lab_of(tmp_path, TWO + "radio: {links: [{link: [1, 2], loss: 0.5}]}\n")) == []
