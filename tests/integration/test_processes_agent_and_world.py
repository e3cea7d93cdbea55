"""Robot and world as real processes on loopback: by hand, in any order, and through every mishap."""

import json
import os
import signal

import pytest
from process_tools import Stage, failing_program, idle_program

from rmr.base.time import NS_PER_S
from rmr.bus.keys import WORLD
from rmr.bus.wire import WORLD_ID


@pytest.fixture
def stage(tmp_path):
    stage = Stage(tmp_path)
    yield stage
    stage.end()
    assert not any("Traceback" in started.said() for started in stage.started)


def in_state(robot, state):
    return lambda newest: robot in newest and newest[robot].state == state


# --- in any order -------------------------------------------------------------------------------------------


def test_robot_started_first_reports_that_it_waits_and_runs_once_the_world_is_up(stage):
    robot = stage.agent(1)
    robot.wait_for(f"waiting for the world at {stage.endpoint}")
    world = stage.world()
    robot.wait_for("robot 1 is in lab bench")
    newest = stage.statuses(in_state(1, "finished"))
    assert newest[1].report["facts"] == ("!due(@1, 25.0)",)
    for process in (robot, world):
        process.send(signal.SIGINT)
        assert process.exit_code() == 0


def test_lab_time_stands_at_zero_until_all_robots_are_ready(stage):
    stage.world("--when-ready")
    stage.agent(1)
    newest = stage.statuses(lambda newest: in_state(1, "ready")(newest) and in_state(WORLD_ID, "ready")(newest))
    assert (newest[1].stamp, newest[WORLD_ID].stamp) == (0, 0)
    stage.agent(2)
    stage.statuses(lambda newest: in_state(1, "finished")(newest) and in_state(2, "running")(newest))


def test_one_of_several_robots_in_a_process_leaves_without_stopping_the_others(stage):
    stage.world("--when-ready")
    crew = stage.agent("1-2")
    stage.statuses(lambda newest: in_state(1, "finished")(newest) and in_state(2, "running")(newest))
    newest = stage.statuses(lambda newest: 1 in newest and newest[1].final, ask_to_stop=[1])
    after = newest[1].stamp
    newest = stage.statuses(lambda newest: 2 in newest and newest[2].stamp > after)
    assert newest[2].state == "running"
    stage.statuses(lambda newest: 2 in newest and newest[2].final, ask_to_stop=[2])
    assert crew.exit_code() == 0
    assert "ended (enough)" in crew.said()


def test_robot_and_world_publish_a_final_status_on_a_stop_request_and_leave(stage):
    world, robot = stage.world(), stage.agent(1)
    stage.statuses(in_state(1, "finished"))
    newest = stage.statuses(lambda newest: 1 in newest and newest[1].final, ask_to_stop=[1])
    assert (newest[1].state, newest[1].finished) == ("stopped", True)
    assert "assertions" in newest[1].report
    stage.statuses(lambda newest: WORLD_ID in newest and newest[WORLD_ID].final, ask_to_stop=[WORLD])
    assert (robot.exit_code(), world.exit_code()) == (0, 0)
    assert "ended (enough)" in robot.said()


@pytest.mark.slow
def test_robots_and_world_may_be_clients_of_another_router(stage):
    stage.world("--robots", "1")  # its router serves a second lab
    other = stage.folder / "other.yaml"
    other.write_text((stage.folder / "lab.yaml").read_text().replace("lab: bench", "lab: other"))
    stage.start("rmr_world.main", "--config", other, "--connect", stage.endpoint).wait_for("lab time runs")
    lost = stage.agent(1)
    assert lost.exit_code() == 2
    assert f"several labs run at {stage.endpoint}: bench, other; choose with --lab" in lost.said()
    stage.agent(1, "--lab", "other").wait_for("robot 1 is in lab other")
    stage.agent(1, "--lab", "bench").wait_for("robot 1 is in lab bench")


def test_a_second_world_of_the_same_lab_at_one_router_is_refused(stage):
    first = stage.world()
    first.wait_for("lab time runs")
    second = stage.world("--connect", stage.endpoint)
    assert second.exit_code() == 1
    assert f"lab bench has a world at {stage.endpoint} already" in second.said()
    assert first.process.poll() is None


def test_robot_names_the_lab_it_waits_for_while_another_lab_runs_at_the_router(stage):
    stage.world()
    robot = stage.agent(1, "--lab", "other")
    robot.wait_for(f"waiting for lab other's world at {stage.endpoint}: a zenoh router answers there, but no such")


# --- mishaps ----------------------------------------------------------------------------------------------------


def damaged(octets):
    return {
        "missing": None,
        "empty": b"",
        "truncated": octets[:-3],
        "flipped": octets[:10] + bytes([octets[10] ^ 1]) + octets[11:],
        "another version": octets[:4] + bytes([octets[4] + 1]) + octets[5:],
        "source": b"start(R).\n",
    }


@pytest.mark.parametrize("how", damaged(bytes(20)))
def test_robot_with_invalid_byte_code_fails_before_connecting(stage, how):
    octets = damaged(idle_program())[how]
    if octets is not None:
        (stage.folder / "bad.rbc").write_bytes(octets)
    robot = stage.agent(1, program="bad.rbc")
    assert robot.exit_code() == (2 if octets is None else 3)
    assert len(robot.said().splitlines()) == 1
    assert "bad.rbc: " in robot.said()


def test_an_action_without_handler_is_named_before_the_robot_starts_and_a_file_can_give_it(stage):
    (stage.folder / "acts.rbc").write_bytes(idle_program("blink", "moveto", "dance"))
    stage.world()  # which may carry out actions itself
    robot = stage.agent(1, program="acts.rbc")
    assert robot.exit_code() == 3
    assert "no handler for action blink; dance" in robot.said()
    actions = stage.folder / "acts.py"
    actions.write_text(
        "from rmr import action\nfor name in ('blink', 'dance'):\n    action(name)(lambda robot: None)\n"
    )
    stage.agent(1, "--actions", actions, program="acts.rbc").wait_for("robot 1 is in lab bench")


def test_wrong_actions_file_is_reported_in_one_line(stage):
    (stage.folder / "acts.py").write_text("1 / 0\n")
    robot = stage.agent(1, "--actions", stage.folder / "acts.py")
    assert robot.exit_code() == 3
    assert "ZeroDivisionError" in robot.said()
    assert len(robot.said().splitlines()) == 1


def test_failed_action_is_reported_with_its_reason_and_the_robot_continues(stage):
    (stage.folder / "acts.rbc").write_bytes(failing_program())
    (stage.folder / "acts.py").write_text(
        "from rmr import action\n@action('blink')\nasync def blink(robot):\n    raise ValueError('no lamp')\n"
    )
    stage.world()
    robot = stage.agent(1, "--actions", stage.folder / "acts.py", program="acts.rbc")
    robot.wait_for("action blink(@1) failed: ValueError: no lamp")
    stage.statuses(in_state(1, "finished"))


def test_actions_file_that_exits_the_process_is_reported_as_its_mistake(stage):
    (stage.folder / "acts.py").write_text("raise SystemExit(7)\n")
    robot = stage.agent(1, "--actions", stage.folder / "acts.py")
    assert robot.exit_code() == 3
    assert "acts.py: calls exit(7) while it is loaded" in robot.said()


def test_an_interrupt_while_the_robot_loads_ends_it_without_a_traceback(stage):
    (stage.folder / "acts.py").write_text("import time\nprint('loading', flush=True)\ntime.sleep(60)\n")
    robot = stage.agent(1, "--actions", stage.folder / "acts.py")
    robot.wait_for("loading")
    robot.send(signal.SIGINT)
    assert robot.exit_code() == 0
    assert robot.said() == "loading\nrmr-agent 1: ended (SIGINT)\n"


@pytest.mark.slow
def test_an_id_that_is_taken_is_refused_and_free_again_when_its_bearer_is_killed(stage):
    stage.world()
    first = stage.agent(1)
    first.wait_for("robot 1 is in lab bench")
    second = stage.agent(1)
    assert second.exit_code() == 1
    assert "robot 1 of lab bench is taken" in second.said()
    first.process.kill()
    stage.agent(1).wait_for("robot 1 is in lab bench")
    newest = stage.statuses(in_state(1, "finished"))
    assert newest[1].report["restarts"] == 1


def test_unknown_robot_id_is_refused_with_the_ids_of_the_lab(stage):
    stage.world()
    robot = stage.agent(7)
    assert robot.exit_code() == 2
    assert "lab bench has no robot 7; its robots are 1, 2" in robot.said()


def test_port_in_use_is_reported_and_ends_only_the_second_world(stage):
    first = stage.world()
    first.wait_for("lab time runs")
    second = stage.world()
    assert second.exit_code() == 1
    assert f"{stage.endpoint} is in use: the world of lab bench runs there" in second.said()
    assert first.process.poll() is None


def test_a_lab_file_with_mistakes_is_refused_with_all_of_them(stage):
    (stage.folder / "lab.yaml").write_text("lab: bench\nprogram: idle.rbc\ncolour: red\nrobots: []\n")
    world = stage.world()
    assert world.exit_code() == 3
    assert "colour" in world.said()
    assert "arena" in world.said()


def test_a_fact_of_the_lab_that_the_program_does_not_know_stops_the_robot_with_a_message(stage):
    lab = stage.folder / "lab.yaml"
    lab.write_text(lab.read_text().replace('"due(@1, 25)"', '"due(@1, 25)", "late(@1, 3)"'))
    stage.world()
    robot = stage.agent(1)
    assert robot.exit_code() == 3
    assert "late(...) means nothing to the program" in robot.said()


def test_world_option_checks_the_facts_against_a_program(stage):
    lab = stage.folder / "lab.yaml"
    lab.write_text(lab.read_text().replace('"due(@1, 25)"', '"late(@1, 3)", "due(@1)"'))
    world = stage.world("--program", stage.folder / "idle.rbc")
    assert world.exit_code() == 3
    assert "facts.0: the program knows no fact 'late'" in world.said()
    assert "facts.1: 'due' has 2 arguments in the program, here 1" in world.said()


@pytest.mark.parametrize("option", [("--id", "x"), ("--connect", "here"), ("--lab", "a/b"), ("--speed", "9")])
def test_wrong_usage_of_a_robot_ends_with_exit_code_2(stage, option):
    assert stage.agent(1, *option).exit_code() == 2


# --- the world dies and returns -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_robot_outlives_its_world_and_starts_anew_in_the_next_one(stage):
    world, robot = stage.world(), stage.agent(1)
    stage.statuses(in_state(1, "finished"))
    world.process.kill()
    robot.wait_for("lost lab bench's world")
    stage.world("--when-ready")
    robot.wait_for("another run has begun; robot 1 starts anew")
    newest = stage.statuses(in_state(1, "ready"))
    assert newest[1].stamp == 0
    assert newest[1].report["bus"]["lost"] == 0
    stage.agent(2)
    stage.statuses(in_state(1, "finished"))


@pytest.mark.slow
def test_a_world_that_was_stopped_for_a_while_goes_on_with_the_same_robots(stage):
    world, robot = stage.world(), stage.agent(1)
    stage.statuses(in_state(1, "finished"))
    world.send(signal.SIGSTOP)
    robot.wait_for("lost lab bench's world")
    world.send(signal.SIGCONT)
    robot.wait_for("the world is back; robot 1 goes on")
    world.wait_for("lab time is set back")
    newest = stage.statuses(lambda newest: in_state(1, "finished")(newest) and WORLD_ID in newest)
    assert newest[1].stamp - newest[WORLD_ID].stamp < 1.5 * NS_PER_S  # the world was stopped for three seconds
    assert "starts anew" not in robot.said()


@pytest.mark.slow
def test_a_robot_leaves_within_two_seconds_even_while_its_world_is_stopped(stage):
    world, robot = stage.world(), stage.agent(1)
    stage.statuses(in_state(1, "finished"))
    world.send(signal.SIGSTOP)
    robot.wait_for("lost lab bench's world")
    robot.send(signal.SIGTERM)
    assert robot.process.wait(2.0) == 0


# --- the launcher dies -----------------------------------------------------------------------------------------------


def test_robot_and_world_end_at_once_when_the_launchers_end_of_the_lifeline_closes(stage):
    read, write = os.pipe()
    world, robot = stage.world(lifeline=read), stage.agent(1, lifeline=read)
    waiting = stage.start(
        "rmr_agent.main", "--id", 2, stage.folder / "idle.rbc", "--connect", "tcp/127.0.0.1:9", lifeline=read
    )
    os.close(read)
    stage.statuses(in_state(1, "finished"))
    waiting.wait_for("waiting for the world")
    os.close(write)
    assert [process.process.wait(2.0) for process in (world, robot, waiting)] == [1, 1, 1]


# --- logs ------------------------------------------------------------------------------------------------


def test_the_log_is_json_lines_with_what_the_robot_did(stage):
    stage.world()
    log = stage.folder / "logs" / "1.jsonl"
    robot = stage.agent(1, "--log", log)
    stage.statuses(in_state(1, "finished"))
    robot.send(signal.SIGTERM)
    assert robot.exit_code() == 0
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert all({"time", "level", "who", "message"} <= line.keys() for line in lines)
    assert "robot 1 is in lab bench" in [line["message"] for line in lines]
    assert "finished" in [line["message"] for line in lines]
