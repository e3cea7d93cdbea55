"""Faults of robots in a lab file as `rmr up` performs them: when they are due, as requests to the launcher."""

from types import SimpleNamespace

import pytest

from rmr.base.time import NS_PER_MS, NS_PER_S, seconds
from rmr_deploy.process_faults import FaultSchedule, ask_outage
from rmr_world.lab import Kill, Outage, Restart, Slow, Stall

S = NS_PER_S
FAULTS = (
    Restart(5 * S, 3),
    Kill(2 * S, 3),
    Stall(3 * S, 5 * S, 2),
    Slow(2 * S, 6 * S, 1, 100 * NS_PER_MS),
    Outage(1 * S, 3 * S, 4),
)


def test_faults_are_performed_in_order_once_their_time_has_come_and_last_to_their_end():
    asked = []
    schedule = FaultSchedule(FAULTS, lambda request: asked.append(request) or "")
    assert schedule.perform_due(seconds(0.9)) == []
    told = schedule.perform_due(seconds(2.5))
    assert asked == [
        {"do": "outage", "robot": 4, "for_s": 0.5},
        {"do": "crash", "robot": 3},
        {"do": "slow", "robot": 1, "for_s": 3.5, "every_s": 0.1},
    ]
    assert told[1][0] == "the lab file: {at: 2.0, kill: 3}"
    assert told[1][1] == {"at": 2.0, "kill": 3}
    assert schedule.will_restart(3)
    assert not schedule.will_restart(2)
    asked.clear()
    schedule.perform_due(seconds(9.0))
    assert [request["do"] for request in asked] == ["stall", "start"]
    assert asked[0]["for_s"] == pytest.approx(0.001), "it would be over already"
    assert not schedule.will_restart(3)
    assert schedule.perform_due(seconds(99.0)) == []


def test_refusal_is_told_with_the_fault():
    schedule = FaultSchedule([Kill(0, 1)], lambda _: "robot 1 is dead already")
    assert schedule.perform_due(0)[0][0] == "the lab file: {at: 0.0, kill: 1}: robot 1 is dead already"


class Monitor(SimpleNamespace):
    """A monitor that keeps what the world is asked for."""

    def running(self, _roster):
        return self.now > 0

    def silence(self, robot, until):
        self.asked.append((robot, until))


def test_outage_is_asked_of_the_world_and_noted():
    monitor = Monitor(now=2 * S, now_s=2.0, asked=[])
    entries = []
    assert ask_outage(monitor, (1, 2), {"do": "outage", "robot": 2, "for_s": 1.5}, entries) == ""
    assert monitor.asked == [(2, seconds(3.5))]
    assert entries == [{"from": 2.0, "to": 3.5, "outage": 2}]


@pytest.mark.parametrize(
    ("request_", "now", "why"),
    [
        ({"robot": 9, "for_s": 1.0}, 1, "there is no such robot in this run"),
        ({"robot": "2", "for_s": 1.0}, 1, "there is no such robot in this run"),
        ({"robot": 2}, 1, "an outage lasts up to 86400 s"),
        ({"robot": 2, "for_s": float("inf")}, 1, "an outage lasts up to 86400 s"),
        ({"robot": 2, "for_s": 1.0}, 0, "lab time does not run yet"),
    ],
)
def test_outage_that_cannot_be_is_refused(request_, now, why):
    assert ask_outage(Monitor(now=now, now_s=0.0, asked=[]), (1, 2), request_, []) == why
