"""What befalls a simulated robot: its process dies, starts again, stands still or is slow; it hears no beacons."""

import pytest
from lab_maker import small_lab, traced

from rmr.base.time import NS_PER_MS, NS_PER_S, seconds
from rmr_sim.run_setup import report_of

DRIVE = """
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
go(R).
go(R) -o moveto(R, spot).
"""
COUNT = """
type action wait(R: robot, T: float) -o pause(R).
type pause(robot).
type count(robot, int).
count(R, 0).
pause(R).
pause(R), count(R, N) -o count(R, N + 1), wait(R, 0.1).
"""
TELL = """
type action goto(robot, float, float).  // a robot that may drive has a body, and says hello
type action wait(R: robot, T: float) -o due(R).
type due(robot).
type told(robot).
!other(@1, @2).
go(R).
go(R), !other(R, S) -o wait(R, 1.0).
due(R), !other(R, S) -o told(S).
"""


def ran(simulation):
    """Run and return the simulation with its report."""
    return simulation, report_of(simulation, simulation.run())


def speeds(simulation):
    """Return the list to which each tick will add how far robot 1 has gone in it, metres."""
    ways, last = [], [0.0]

    def observe(_now):
        ways.append(simulation.world.distance_m(1) - last[0])
        last[0] += ways[-1]

    simulation.observers.append(observe)
    return ways


def test_a_killed_robot_stays_where_it_is_after_a_few_centimetres(tmp_path):
    simulation = small_lab(tmp_path, DRIVE, finish="at(R, spot)", duration="6s", faults="[{at: 3s, kill: 1}]")
    ways = speeds(simulation)
    _, report = ran(simulation)
    assert report["finished"] is False
    assert report["robots"]["1"]["restarts"] == 0
    assert 0.02 < sum(ways[180:]) < 0.05
    assert sum(ways[210:]) == 0.0


def test_killed_robot_neither_sends_nor_receives(tmp_path):
    simulation = small_lab(tmp_path, TELL, robots=2, duration="3s", faults="[{at: 0.5s, kill: 2}]")
    sent_by = []
    simulation.ether.on_air = lambda frame: sent_by.append((frame.source, frame.start))
    _, report = ran(simulation)
    assert max(start for source, start in sent_by if source == 2) <= 0.5 * NS_PER_S + NS_PER_MS
    assert report["robots"]["1"]["frames"]["no_ack"] > 0
    assert "told(@2)" not in report["robots"]["2"]["facts"]


def test_a_robot_that_starts_again_begins_anew_where_it_stands_and_finishes(tmp_path):
    faults = "[{at: 3s, kill: 1}, {at: 4s, restart: 1}]"
    simulation, report = ran(small_lab(tmp_path, DRIVE, finish="at(R, spot)", duration="30s", faults=faults))
    part = report["robots"]["1"]
    assert report["finished"] is True
    assert part["restarts"] == 1
    assert [action for _, action in part["actions"]] == ["moveto(@1, spot)"] * 2
    assert [at for at, _ in part["actions"]] == [0.0, 4.0]
    assert simulation.robots[0].node.config.epoch == 1
    assert [entry["fault"] for entry in traced(simulation, "fault")] == ["killed", "restarted"]
    assert len(traced(simulation, "action")) == 2


def test_restart_clears_all_state_except_counters(tmp_path):
    faults = "[{at: 1s, kill: 1}, {at: 2s, restart: 1}]"
    _, report = ran(small_lab(tmp_path, COUNT, duration="2.5s", faults=faults))
    part = report["robots"]["1"]
    assert part["facts"] in (["count(@1, 5)"], ["count(@1, 6)"])
    assert len(part["actions"]) in (15, 16, 17)


def test_the_deadline_of_an_earlier_life_stays_undecided_and_could_not_have_been_met(tmp_path):
    program = DRIVE + "crossing: assert(go(R), at(R, spot), 20, stop(R)).\ntype action stop(robot).\n"
    faults = "[{at: 3s, kill: 1}, {at: 4s, restart: 1}]"
    _, report = ran(small_lab(tmp_path, program, finish="at(R, spot)", duration="30s", faults=faults))
    jobs = report["robots"]["1"]["assertions"]
    told = [(job["met"], job["deadline_s"], job["cause"]) for job in jobs]
    assert told == [(None, 20.0, "died"), (True, 24.0, None)]
    assert report["deadlines"] == {"met": 1, "missed": 0, "best_possible": 1}


def test_restart_of_a_running_robot_is_refused(tmp_path):
    simulation = small_lab(tmp_path, COUNT, duration="1s")
    with pytest.raises(ValueError, match="robot 1 lives: kill it before it is started again"):
        simulation.restart(1)


def test_a_stalled_robot_does_nothing_and_then_goes_on_with_what_it_was_about(tmp_path):
    simulation = small_lab(tmp_path, COUNT, duration="3s", faults="[{from: 1.0s, to: 2.0s, stall: 1}]")
    calls = []
    executive = simulation.robots[0].node.executive
    executive.tick, tick = lambda now: (calls.append(now), tick(now)), executive.tick
    _, report = ran(simulation)
    assert [at for at in calls if 1.0 * NS_PER_S < at < 2.0 * NS_PER_S] == []
    assert 2 * NS_PER_S in calls
    assert report["robots"]["1"]["facts"] == ["count(@1, 22)"]


def test_what_arrives_at_a_stalled_robot_waits_and_is_not_acknowledged_meanwhile(tmp_path):
    simulation = small_lab(tmp_path, TELL, robots=2, duration="4s", faults="[{from: 0.5s, to: 2.5s, stall: 2}]")
    _, report = ran(simulation)
    (received,) = [entry for entry in traced(simulation, "received") if entry["robot"] == 2]
    (delivered,) = [entry for entry in traced(simulation, "delivered") if entry["robot"] == 1]
    assert received["t"] == 2.5
    assert delivered["t"] > 2.5
    assert report["robots"]["2"]["frames"]["withheld"] > 0
    assert "told(@2)" in report["robots"]["2"]["facts"]


def test_a_slow_robot_is_called_only_so_often(tmp_path):
    faults = "[{from: 1.0s, to: 2.0s, slow: 1, every: 250ms}]"
    simulation = small_lab(tmp_path, COUNT, duration="2.5s", faults=faults)
    calls = []
    executive = simulation.robots[0].node.executive
    executive.tick, tick = lambda now: (calls.append(now), tick(now)), executive.tick
    simulation.run()
    assert [at for at in calls if 1.0 * NS_PER_S < at < 2.0 * NS_PER_S] == [seconds(1.25), seconds(1.5), seconds(1.75)]
    assert sum(at > 2 * NS_PER_S for at in calls) >= 4


def test_in_an_outage_no_beacon_is_heard_and_the_robot_drives_on_by_its_odometry(tmp_path):
    simulation = small_lab(
        tmp_path, DRIVE, finish="at(R, spot)", duration="20s", faults="[{from: 1.5s, to: 3s, outage: all}]"
    )
    robot = simulation.robots[0]
    sigmas = {}
    simulation.observers.append(lambda now: sigmas.__setitem__(now, robot.node.driver.localiser.sigma_m))
    ways = speeds(simulation)
    simulation.run()
    at = sorted(sigmas)
    before, within, after = (sigmas[at[index]] for index in (89, 178, 230))
    assert within > 2 * before
    assert after < within
    assert min(ways[100:200]) > 0.001


def test_a_fault_that_comes_after_the_end_changes_nothing(tmp_path):
    reports = []
    for faults in ("[]", "[{at: 19s, kill: 1}, {from: 19s, to: 19.5s, loss: 0.5}]"):
        simulation = small_lab(tmp_path, DRIVE, finish="at(R, spot)", faults=faults)
        reports.append(report_of(simulation, simulation.run()))
    calm, doomed = reports
    assert calm.pop("faults") == []
    assert len(doomed.pop("faults")) == 2
    assert calm == doomed


def test_links_that_nothing_disturbs_any_more_cost_nothing(tmp_path):
    faults = "[{from: 0.2s, to: 0.5s, link: [1, 2], cut: true}, {from: 0.2s, to: 0.6s, loss: 0.5}]"
    simulation = small_lab(tmp_path, COUNT, robots=2, duration="2s", faults=faults)
    assert (simulation.ether.links.fades, simulation.ether.links.loses) == (True, True)
    simulation.run()
    assert (simulation.ether.links.fades, simulation.ether.links.loses) == (False, False)


def test_a_secured_robot_that_starts_again_is_understood_by_the_others(tmp_path):
    (tmp_path / "lab.key").write_text("00112233445566778899aabbccddeeff\n")
    faults = "[{at: 0.2s, kill: 1}, {at: 0.4s, restart: 1}]"
    simulation = small_lab(tmp_path, TELL, robots=2, duration="4s", faults=faults, radio="key_file: lab.key")
    _, report = ran(simulation)
    assert "told(@2)" in report["robots"]["2"]["facts"]
    assert report["robots"]["2"]["frames"]["replayed"] == 0
