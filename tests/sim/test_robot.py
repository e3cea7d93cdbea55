"""What one robot and a few do in the simulator: provided actions, users' actions, facts between robots, deadlines."""

from itertools import pairwise
from pathlib import Path

import pytest
from lab_maker import small_lab, traced

from rmr.base.geometry import distance
from rmr.base.time import seconds
from rmr.node.payloads import Hello, encode_ack, encode_hello
from rmr.node.ports import Confirmed, Received
from rmr_sim.run_setup import prepare
from rmr_world.lab_program import ProgramError

LABS = Path(__file__).parents[2] / "deploy" / "labs"


def pose(simulation, robot=1):
    return simulation.world.pose(robot)


def test_moveto_drives_to_an_area_and_the_robot_senses_that_it_is_there(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action moveto(robot, area).
        go(R).
        go(R) -o moveto(R, spot).
        at(R, spot) -o arrived(R).
        """,
        finish="arrived(R)",
    )
    assert simulation.run()
    assert distance(*pose(simulation)[:2], 1.0, 0.5) < 0.08


def test_goto_face_wait_and_stop_do_as_they_say_one_after_another(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action goto(robot, float, float).
        type action face(R: robot, D: float) -o turned(R).
        go(R).
        go(R) -o goto(R, 0.7, 0.6), face(R, 90).
        """,
        finish="turned(R)",
    )
    assert simulation.run()
    x, y, theta = pose(simulation)
    assert distance(x, y, 0.7, 0.6) < 0.05
    assert theta == pytest.approx(1.5708, abs=0.15)


def test_wait_takes_its_time(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action wait(R: robot, T: float) -o waited(R).
        go(R).
        go(R) -o wait(R, 1500ms).
        """,
        finish="waited(R)",
    )
    assert simulation.run()
    assert simulation.time_s == pytest.approx(1.5, abs=0.05)


def test_stop_interrupts_a_drive_and_its_else_effect_stands(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action goto(R: robot, X: float, Y: float) -o there(R) else halted(R).
        type action wait(R: robot, T: float) -o waited(R).
        type action stop(robot).
        go(R).
        go(R) -o goto(R, 1.3, 1.3), wait(R, 2).
        waited(R) -o stop(R).
        """,
        finish="halted(R)",
    )
    assert simulation.run()
    assert simulation.time_s < 2.2
    assert distance(*pose(simulation)[:2], 1.3, 1.3) > 0.5


def test_a_users_action_runs_in_virtual_time_and_inserts_facts(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action blink(R: robot, N: int) -o blinked(R, N).
        type action fail(R: robot) -o good(R) else bad(R).
        type flash(robot, int).
        go(R).
        go(R) -o blink(R, 3), fail(R).
        blinked(R, N), bad(R), flash(R, 1), flash(R, 2), flash(R, 3) -o done(R, N).
        """,
        actions="""
        from rmr import ActionFailed, action

        @action("blink")
        async def blink(robot, n):
            for k in range(n):
                await robot.sleep(0.5)
                robot.insert("flash", k + 1)

        @action("fail")
        async def fail(robot):
            raise ActionFailed("no lamp")
        """,
        finish="done(R, 3)",
    )
    assert simulation.run()
    assert simulation.time_s == pytest.approx(1.5, abs=0.05)


def test_a_users_action_may_drive_and_sense(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action creep(R: robot) -o crept(R).
        go(R).
        go(R) -o creep(R).
        """,
        actions="""
        from rmr import action

        @action("creep", wheels=True)
        async def creep(robot):
            await robot.until(lambda: robot.sense().pose is not None)
            start = robot.sense().pose.x
            robot.drive(0.1, 0.0)
            await robot.until(lambda: robot.sense().pose.x > start + 0.3)
        """,
        finish="crept(R)",
    )
    assert simulation.run()
    assert pose(simulation).x == pytest.approx(0.5, abs=0.05)


def test_an_action_without_handler_does_not_start_and_is_named(tmp_path):
    with pytest.raises(ProgramError, match="juggle"):
        small_lab(tmp_path, "type action juggle(robot).\ngo(R).\ngo(R) -o juggle(R).\n")


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_facts_for_other_robots_arrive_exactly_once(tmp_path, loss):
    simulation = small_lab(
        tmp_path,
        """
        type !edge(robot, robot).
        type heard(robot, robot).
        go(@1).
        go(A) -o {B | peer(A, B) | heard(B, A)}.
        """,
        robots=4,
        loss=loss,
        duration="6s",
    )
    simulation.run()
    facts = {robot.robot: robot.node.machine.facts() for robot in simulation.robots}
    assert facts[1] == []
    assert {robot: facts[robot] for robot in (2, 3, 4)} == {robot: [f"heard(@{robot}, @1)"] for robot in (2, 3, 4)}


def test_a_fact_too_large_for_one_frame_travels_in_fragments(tmp_path):
    text = "x" * 300
    simulation = small_lab(
        tmp_path,
        f'go(@1).\ngo(A) -o {{B | peer(A, B) | note(B, "{text}")}}.\n',
        robots=2,
        loss=0.2,
        duration="6s",
    )
    simulation.run()
    assert simulation.robots[1].node.machine.facts() == [f'note(@2, "{text}")']


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_steps_follow_each_other_across_robots_over_the_radio(tmp_path, loss):
    simulation = small_lab(
        tmp_path,
        """
        type action wait(robot, float).
        type action light(robot, colour).
        relay(@1, @2).
        relay(A, B) -o wait(B, 1.0) then light(A, green) then light(B, red) then passed(A).
        """,
        robots=2,
        loss=loss,
        duration="8s",
    )
    simulation.run()
    assert simulation.robots[0].node.machine.facts() == ["passed(@1)"]
    shown = [(entry["robot"], entry["colour"]) for entry in traced(simulation, "light")]
    assert shown == [(1, "green"), (2, "red")]
    assert traced(simulation, "light")[0]["t"] > 1.0


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_time_assertion_ends_with_another_robots_fact_over_the_radio(tmp_path, loss):
    simulation = small_lab(
        tmp_path,
        """
        type action wait(X: robot, T: float) -o rested(X).
        type action say(robot, string).
        rest: watch(asked(A, B), rested(B), 3, say(A, "late")).
        asked(@1, @2).
        rested(R) -o 1.
        $asked(A, B), not sent(A) -o sent(A), wait(B, 1.0).
        """,
        robots=2,
        loss=loss,
        duration="8s",
    )
    simulation.run()
    (job,) = simulation.robots[0].node.machine.jobs
    (ended,) = traced(simulation, "action_ended")
    assert job.finish / 1e9 == pytest.approx(ended["t"], abs=1e-6)
    assert job.cause is None


def test_missed_deadline_is_broadcast_on_time_and_received(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        late: assert(begun(R), ended(R), 2, broadcast(R)).
        begun(@1).
        failed(R, B, late) -o knows(R, B).
        begun(R), ended(R) -o 1.
        """,
        robots=3,
        duration="4s",
    )
    simulation.run()
    (missed,) = traced(simulation, "deadline_missed")
    assert missed["t"] == pytest.approx(2.0, abs=0.02)
    assert [robot.node.machine.facts() for robot in simulation.robots[1:]] == [
        ["knows(@2, @1)"],
        ["knows(@3, @1)"],
    ]


def test_robots_find_themselves_in_spite_of_dropouts(tmp_path):
    simulation = small_lab(
        tmp_path,
        "type action moveto(robot, area).\ngo(R).\ngo(R) -o moveto(R, spot).\nat(R, spot) -o arrived(R).\n",
        finish="arrived(R)",
        dropout=0.5,
    )
    assert simulation.run()
    assert distance(*pose(simulation)[:2], 1.0, 0.5) < 0.1


def test_two_robots_that_meet_face_to_face_get_past_each_other(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action goto(R: robot, X: float, Y: float) -o there(R).
        go(@1, 1.3). go(@2, 0.2).
        go(R, X) -o goto(R, X, 0.2).
        """,
        robots=2,
        finish="there(R)",
        duration="60s",
    )
    assert simulation.run()
    assert simulation.world.collisions == 0


def test_robots_sense_their_peers_neighbors_and_numbers(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        peer(R, B) -o sawpeer(R, B).
        neighbor(R, B) -o near(R, B).
        id(R, N) -o number(R, N).
        """,
        robots=2,
        duration="2s",
    )
    simulation.run()
    assert simulation.robots[0].node.machine.facts() == ["near(@1, @2)", "number(@1, 1)", "sawpeer(@1, @2)"]


@pytest.mark.parametrize("takes_s", [0.8, 2.5])
def test_turns_at_something_that_is_no_passage_exclude_each_other_and_go_by_deadline(tmp_path, takes_s):
    simulation = small_lab(
        tmp_path,
        """
        type action charge(R: robot) -o charged(R).
        type !due(robot, float).
        start(R).
        start(R), due(R, D) -o need(R, D).
        charging: assert(need(R, D), charged(R), D, say(R, "late")).
        need(R, _) -o charge(R).
        """,
        actions=f"""
        from rmr import action

        @action("charge")
        async def charge(robot):
            await robot.sleep({takes_s})
        """,
        robots=3,
        facts="['due(@1, 60)', 'due(@2, 40)', 'due(@3, 50)']",
        finish="charged(R)",
        duration="60s",
    )
    assert simulation.run()
    starts = {robot.robot: robot.node.services.action_log[0][0] for robot in simulation.robots}
    order = sorted(starts, key=starts.get)
    assert order[0] == 2
    if takes_s < 1.0:  # as long as a turn of unknown length is expected to last; one that overruns delays the next
        assert order == [2, 3, 1]
    assert all(starts[later] - starts[earlier] >= takes_s for earlier, later in pairwise(order))
    assert simulation.time_s < 3 * takes_s + 6


@pytest.mark.slow
def test_a_robot_that_is_stopped_inside_the_bottleneck_is_not_reported_clear(tmp_path):
    (tmp_path / "lab.yaml").write_text(
        (LABS / "testbed" / "lab.yaml").read_text().replace("testbed.rmr", "halting.rmr")
    )
    program = (LABS / "testbed" / "testbed.rmr").read_text()
    (tmp_path / "halting.rmr").write_text(
        program
        + "type action stop(robot).\ntype action wait(R: robot, T: float) -o rested(R).\n"
        + "begin(@3). begin(R) -o wait(R, 3.8). rested(R) -o stop(R).\n"
    )
    simulation = prepare(tmp_path, seed=1)
    simulation.kernel.at(0, 0, lambda now: None)
    simulation.run()
    x, y, _ = simulation.world.pose(3)
    assert 0.5 < x < 1.0, "it was stopped on its way through"
    assert 0.6 < y < 0.9
    assert not [entry for entry in traced(simulation, "left") if entry["robot"] == 3]
    assert simulation.world.collisions == 0, "nobody drives into it"


@pytest.mark.parametrize(
    ("handler", "why"),
    [
        ("async def act(robot, too, many): pass", "positional argument"),
        ("def act(robot): pass", "its handler is no `async def`"),
        ("async def act(robot): await asyncio.get_running_loop().create_future()", "awaits robot.sleep"),
        ("async def act(robot): await other()", "awaits robot.sleep"),
    ],
)
def test_a_handler_that_is_wrong_fails_its_action_and_not_the_robot(tmp_path, handler, why):
    simulation = small_lab(
        tmp_path,
        """
        type action act(R: robot) -o good(R) else bad(R).
        go(R).
        go(R) -o act(R).
        """,
        actions="import asyncio\nfrom types import coroutine\nfrom rmr import action\n\n"
        "@coroutine\ndef other():\n    yield 1\n\n"
        f'@action("act")\n{handler}\n',
        finish="bad(R)",
    )
    assert simulation.run()
    (ended,) = traced(simulation, "action_ended")
    assert why in ended["failure"]


def test_ranges_come_from_signal_strength_by_the_law_that_the_radio_follows(tmp_path):
    simulation = small_lab(tmp_path, "range(R, B, D) -o far(R, B, D).\n", robots=8, duration="3s", size=(3.0, 1.5))
    simulation.run()
    facts = simulation.robots[0].node.machine.facts()
    assert "far(@1, @7, 1.8)" in facts, "6 places of 0.3 m"
    assert "far(@1, @8, 2.1)" in facts


def test_a_robot_that_runs_another_program_is_noticed(tmp_path):
    simulation = small_lab(tmp_path, "idle(R).\ntype action goto(robot, float, float).\n", robots=3, duration="3s")
    simulation.robots[1].node.state.digest ^= 1
    simulation.run()
    noticed = {(entry["robot"], entry["source"]) for entry in traced(simulation, "other_program")}
    assert noticed == {(1, 2), (2, 1), (2, 3), (3, 2)}


def test_program_that_never_quiesces_is_reported_and_its_robot_stays_responsive(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action goto(R: robot, X: float, Y: float) -o there(R).
        spin(R).
        spin(R) -o spin(R).
        go(R).
        go(R) -o goto(R, 0.8, 0.2).
        """,
        finish="there(R)",
    )
    assert simulation.run()
    assert simulation.time_s < 8.0
    (told,) = traced(simulation, "restless")
    assert told["firings"] > 1000


def test_robots_that_go_to_the_same_box_take_spots_of_their_own(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action moveto(robot, area).
        go(R).
        go(R) -o moveto(R, box).
        at(R, box) -o there(R).
        """,
        robots=3,
        finish="there(R)",
        duration="60s",
    )
    assert simulation.run()
    assert simulation.world.collisions == 0


@pytest.mark.medium
def test_a_robot_yields_its_place_to_one_that_goes_first_and_has_taken_it_too(tmp_path):
    simulation = prepare(LABS / "testbed", seed=3097, loss=0.2)
    assert simulation.run()
    assert len({robot.node.driver.place for robot in simulation.robots}) == 6


def test_a_program_that_neither_drives_nor_senses_runs_without_bodies(tmp_path):
    program = (
        "type action wait(R: robot, T: float) -o waited(R).\ntype waited(robot).\ngo(R).\ngo(R) -o wait(R, 1.0).\n"
    )
    simulation = small_lab(tmp_path, program, robots=3, finish="waited(R)")
    assert simulation.run()
    assert simulation.time_s == 1.0
    for robot in simulation.robots:
        assert robot.node.driver is None
        assert robot.report()["frames"]["sent"] == 0


def test_a_hello_of_a_known_robot_is_taken_in_as_it_arrives_and_what_needs_a_call_is_left(tmp_path):
    simulation = small_lab(tmp_path, "type action goto(robot, float, float).", robots=2, duration="2s")
    simulation.run()
    node, now = simulation.robots[0].node, simulation.now
    hello = Hello(0.7, 0.2, 0.0, 0.0, parked=True, rank=0, goal=None, digest=node.state.digest)

    def heard(payload: bytes, source: int = 2) -> bool:
        return node.overhear(now, Received(payload, source, False, -50.0, 255, now))

    assert heard(encode_hello(hello))
    assert node.peers.parked(now) == ((0.7, 0.2),)
    assert not heard(encode_hello(hello), source=3), "of a robot that is not known"
    assert not heard(encode_hello(hello._replace(digest=hello.digest ^ 1))), "of another program"
    assert not heard(encode_hello(hello)[:-1]), "malformed"
    assert not heard(encode_ack(0, 1)), "no hello"
    assert not heard(b"")


def test_node_awaits_confirmation_of_some_frames_and_not_of_beacons(tmp_path):
    simulation = prepare(LABS / "testbed", seed=1)
    told, awaited = list[int](), list[tuple]()

    def listen(robot, take):
        def taken(out):
            if isinstance(out, Confirmed):
                told.append(out.handle)
                awaited.extend([(robot, out.handle)] * robot.node.awaits(out))
            take(out)

        robot.station.take = taken

    for robot in simulation.robots:
        listen(robot, robot.station.take)
    simulation.observers.append(lambda now: simulation.stop() if now >= seconds(2.0) else None)
    simulation.run()
    assert 0 < len(awaited) < len(told)
    robot, handle = awaited[0]
    assert not robot.node.awaits(Confirmed(handle, "ok")), "told already"


def test_frames_are_not_overheard_where_the_program_senses_neighbors(tmp_path):
    program = "type seen(robot, robot). neighbor(R, B) -o seen(R, B)."
    simulation = small_lab(tmp_path, program, robots=2, duration="1s")
    simulation.run()
    node, now = simulation.robots[0].node, simulation.now
    hello = encode_hello(node.peers.known[2].hello)
    assert not node.overhear(now, Received(hello, 2, False, -50.0, 255, now))
