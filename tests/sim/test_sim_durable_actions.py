"""Actions, deadlines and records of durable robots that are killed at chosen instants."""

from pathlib import Path

import pytest
from lab_maker import small_lab, traced

from rmr.base.time import in_seconds, seconds
from rmr.mind.journal import JournalError, read_journal
from rmr.node.crossing.phases import Inside
from rmr_sim.disk import Disk, durable_node
from rmr_sim.event import Event
from rmr_sim.main import main
from rmr_sim.run_setup import prepare

pytestmark = pytest.mark.medium

LABS = Path(__file__).parents[2] / "deploy" / "labs"
HANDLERS = """
from rmr import action, ActionFailed

CALLS = []

@action("count")
async def count(robot, n):
    robot.say(f"begun {n}")
    await robot.sleep(1.0)
    robot.insert("half", n)
    await robot.sleep(1.0)
    robot.say(f"over {n}")

@action("pair")
async def pair(robot):
    await robot.wait(0.5)
    robot.say("waited")
    await robot.wait(2.0)
"""
ELSE = """
    type action count(R: robot, N: int) -o counted(R, N) else spoilt(R, N).
    type half(robot, int).
    go(R).
    go(R) -o count(R, 7).
"""
AGAIN = ELSE.replace(" else spoilt(R, N)", "")


class At(Event):
    """Calls a function with the simulation."""

    def __init__(self, at_s, call):
        super().__init__(seconds(at_s))
        self.call = call

    def happen(self, simulation):
        self.call(simulation)


def killed(simulation, at_s, back_s, robot=1):
    """Kill a robot at one instant and restart it at another."""
    simulation.schedule(At(at_s, lambda run: run.kill(robot)))
    simulation.schedule(At(back_s, lambda run: run.restart(robot)))
    return simulation


def held(simulation, robot=1):
    return simulation.robot_parts()[robot]["facts"]


def said(simulation):
    return [entry["text"] for entry in traced(simulation, "said")]


def test_an_action_under_way_fails_where_the_program_declares_what_then_holds(tmp_path):
    simulation = killed(small_lab(tmp_path, ELSE, actions=HANDLERS, duration="6s", durable=True), 1.5, 2.0)
    simulation.run()
    assert held(simulation) == ["half(@1, 7)", "spoilt(@1, 7)"]
    assert said(simulation) == ["begun 7"]
    [ended] = traced(simulation, "action_ended")
    assert ended["failure"] == "interrupted: the robot was started again"
    assert ended["t"] == pytest.approx(2.0, abs=0.1)


def test_an_action_under_way_is_called_again_where_no_failure_is_declared(tmp_path):
    simulation = killed(small_lab(tmp_path, AGAIN, actions=HANDLERS, duration="6s", durable=True), 0.5, 1.0)
    simulation.run()
    assert held(simulation) == ["counted(@1, 7)", "half(@1, 7)"]
    assert said(simulation) == ["begun 7", "begun 7", "over 7"]


@pytest.mark.parametrize("program", [ELSE, AGAIN])
def test_an_action_interrupted_several_times_comes_out_the_same_at_each_restart(tmp_path, program):
    simulation = small_lab(tmp_path, program, actions=HANDLERS, duration="8s", durable=True)
    for at_s in (0.5, 1.2, 1.9, 2.6, 4.0):
        killed(simulation, at_s, at_s + 0.3)
    simulation.run()
    assert simulation.robots[0].restarts == 5
    assert simulation.robots[0].node.resumed == 5
    ends = [entry["failure"] for entry in traced(simulation, "action_ended")]
    assert len(ends) == 1
    assert ("spoilt(@1, 7)" in held(simulation)) == (program == ELSE)
    assert ("counted(@1, 7)" in held(simulation)) == (program == AGAIN)


def test_a_handler_that_awaits_a_provided_action_is_interrupted_with_it(tmp_path):
    program = "type action pair(R: robot) -o paired(R).\ngo(R).\ngo(R) -o pair(R).\n"
    simulation = small_lab(tmp_path, program, actions=HANDLERS, duration="9s", durable=True)
    killed(killed(simulation, 1.5, 1.8), 3.0, 3.3).run()
    assert held(simulation) == ["paired(@1)"]
    assert said(simulation) == ["waited", "waited", "waited"]


def test_a_robot_that_dies_inside_a_handler_knows_that_the_handler_was_called(tmp_path):
    """The begin is on disk before the call, though the call of the node never came to its end."""
    simulation = small_lab(tmp_path, ELSE, actions=HANDLERS, duration="6s", durable=True)
    robot = simulation.robots[0]
    disk = robot._disk
    commit = robot.node.commit
    found = []
    robot.node._durable._commit = lambda: (commit(), found.append(b"".join([disk.data, *disk._chunks])))
    robot.node.start(0)
    robot.node.tick(0)
    [at_call] = found
    assert len(b"".join([disk.data, *disk._chunks])) > len(at_call), "the rest of the call is recorded when it is over"
    for restart in (1, 2):  # the second time the journal says that the process has died inside the call before
        robot.kill()
        if restart == 1:
            disk.data = at_call
        robot.restart()
        robot.node.tick(1000 * restart)
        assert robot.node.resumed == restart
        assert held(simulation) == ["spoilt(@1, 7)"]


def test_a_deadline_is_the_same_instant_after_a_restart_and_missed_at_once_if_it_is_over(tmp_path):
    program = """
        type action wait(R: robot, T: float) -o done(R).
        type action broadcast(robot).
        type done(robot).
        type begun(robot, float).
        go(R).
        go(R) -o begun(R, 2.0), wait(R, 9.0).
        task: assert(begun(R, D), done(R), D, broadcast(R)).
    """
    for back_s, missed_s in ((1.0, 2.0), (3.0, 3.0)):
        simulation = small_lab(tmp_path, program, duration="5s", durable=True)
        killed(simulation, 0.5, back_s).run()
        [job] = simulation.robot_parts()[1]["assertions"]
        assert (job["start_s"], job["deadline_s"], job["met"]) == (0.0, 2.0, False)
        [entry] = traced(simulation, "deadline_missed")
        assert entry["t"] == pytest.approx(missed_s, abs=0.05)


RELAY = """
    type action wait(R: robot, T: float) -o rested(R).
    type ball(robot, int).
    type holds(robot, int).
    type rested(robot).
    ball(R, N) -o holds(R, N), wait(R, 0.2).
    rested(R), holds(R, N) -o ball(R, N + 1).
"""


def test_a_journal_cut_behind_any_record_brings_the_robot_back_as_it_was_there(tmp_path):
    simulation = small_lab(tmp_path, RELAY, facts='["ball(@1, 0)"]', duration="12s", durable=True)
    simulation.run()
    robot = simulation.robots[0]
    disk = robot._disk
    disk.crash(b"")
    records = read_journal(disk.data).records
    assert len(records) > 10
    seen = []
    whole = disk.data
    for cut in range(0, len(whole), 197):
        again = Disk(1, 1)
        again.data = whole[:cut]
        if not read_journal(again.data).records:
            continue
        node = durable_node(again, robot.node.config, robot.node.program, robot._ports, {}, robot.node.state.digest)
        seen.append(node.machine.facts())
    numbers = [int(fact.split(", ")[1][:-1]) for facts in seen for fact in facts if fact.startswith("holds")]
    assert numbers == sorted(numbers)
    assert numbers[-1] > 5


def test_records_that_do_not_come_out_again_are_refused_with_the_instant(tmp_path):
    simulation = small_lab(tmp_path, RELAY, facts='["ball(@1, 0)"]', duration="1s", durable=True)
    simulation.run()
    robot = simulation.robots[0]
    robot._disk.crash(b"")
    node = robot.node
    other = small_lab(tmp_path, RELAY.replace("0.2", "0.3"), duration="1s", durable=True).robots[0].node.program
    with pytest.raises(JournalError, match=r"what the robot did at \d\.\d+ s of lab time does not come out again"):
        durable_node(robot._disk, node.config, other, robot._ports, {}, node.state.digest)


def test_a_disk_keeps_what_was_written_and_at_a_loss_of_power_only_what_was_synced():
    disk = Disk(1, 1)
    disk.append(b"synced")
    disk.sync()
    disk.append(b"written")
    disk.crash(b"torn record")
    assert disk.data.startswith(b"syncedwritten")
    assert b"torn record".startswith(disk.data.removeprefix(b"syncedwritten"))
    assert len(disk.data) < len(b"syncedwrittentorn record")
    disk = Disk(1, 1)
    disk.append(b"synced")
    disk.sync()
    disk.append(b"written")
    disk.crash(b"", power=True)
    assert disk.data.startswith(b"synced")
    assert len(disk.data) < len(b"syncedwritten")


def test_a_robot_whose_records_are_synced_goes_on_after_a_loss_of_power(tmp_path):
    simulation = small_lab(tmp_path, RELAY, facts='["ball(@1, 0)"]', duration="1s", durable=True)
    robot = simulation.robots[0]
    node = robot.node

    def begin(disk):
        own = (node.config, node.program, robot._ports, {}, node.state.digest)
        return durable_node(disk, *own, synced=True)

    disk = Disk(3, 1)
    first = begin(disk)
    first.start(0)
    for tenth in range(60):
        first.tick(seconds(tenth / 10))
    first.commit()
    facts = first.machine.facts()
    disk.crash(first.next_record(), power=True)
    again = begin(disk)
    assert again.brought_back
    assert again.machine.facts() == facts != []


def test_the_command_that_repeats_a_durable_seed_says_that_it_is(tmp_path, capsys):
    small_lab(tmp_path, RELAY, duration="1s", finish="ball(R, 99)")
    assert main([str(tmp_path), "--durable", "--chaos", "--seeds", "1-1", "--run", str(tmp_path / "run")]) == 1
    out, err = capsys.readouterr()
    assert "--chaos --durable --seed 1" in out + err


def test_a_robot_that_dies_inside_the_corridor_knows_that_it_is_inside(tmp_path):
    simulation = prepare(LABS / "corridor", robots=3, seed=4, durable=True)
    found = []

    def look(now):
        for robot in simulation.robots:
            crossing = robot.node.crossings.current
            if not found and crossing is not None and isinstance(crossing.phase, Inside):
                found.append((robot.robot, crossing.job.serial))
                killed(simulation, in_seconds(now) + 0.5, in_seconds(now) + 1.5, robot.robot)
                simulation.schedule(At(in_seconds(now) + 1.501, check))

    def check(simulation):
        [(number, job)] = found
        robot = next(one for one in simulation.robots if one.robot == number)
        crossing = robot.node.crossings.current
        assert robot.restarts == 1
        assert isinstance(crossing.phase, Inside)
        assert crossing.job.serial == job
        found.append("known")

    simulation.observers.append(look)
    assert simulation.run()
    assert found[1:] == ["known"]
    assert simulation.violations == []
    assert all(len(part["assertions"]) == 1 for part in simulation.robot_parts().values())
