"""`robot.state` of durable robots: what handlers remember is kept over restarts."""

import pytest
from lab_maker import small_lab, traced
from test_sim_durable_actions import killed, said

pytestmark = pytest.mark.medium

HANDLERS = """
from rmr import action
from rmr.base.values import Symbol

class Own:
    pass

@action("count")
async def count(robot, n):
    state = robot.state
    state["begun"] = state.get("begun", 0) + 1
    state.setdefault("seen", []).append((n, Symbol("ring"), {"at": 0.5}))
    await robot.sleep(1.0)
    robot.say(f"{state['begun']} {state['seen']!r}")
    del state["seen"][:]
    await robot.sleep(1.0)

@action("spoil")
async def spoil(robot):
    robot.state["own"] = {"of": [Own()]}
    await robot.sleep(0.1)
"""
AGAIN = """
    type action count(R: robot, N: int) -o counted(R, N).
    go(R).
    go(R) -o count(R, 7).
"""


def test_what_handlers_remember_is_kept_over_restarts(tmp_path):
    simulation = small_lab(tmp_path, AGAIN, actions=HANDLERS, duration="9s", durable=True)
    for at_s in (0.5, 1.7, 3.8):
        killed(simulation, at_s, at_s + 0.3)
    simulation.run()
    once = "(7, ring, {'at': 0.5})"
    assert said(simulation) == [f"3 [{once}, {once}, {once}]", f"4 [{once}]"]
    node = simulation.robots[0].node
    assert node.resumed == 3
    assert node.services.state == {"begun": 4, "seen": []}


def test_a_value_that_cannot_be_kept_fails_the_action_and_says_where_it_is(tmp_path):
    program = "type action spoil(R: robot) -o spoilt(R) else refused(R).\ngo(R).\ngo(R) -o spoil(R).\n"
    simulation = small_lab(tmp_path, program, actions=HANDLERS, duration="2s", durable=True)
    simulation.run()
    [ended] = traced(simulation, "action_ended")
    assert ended["failure"].startswith("robot.state['own']['of'][0] holds a Own, which a durable robot cannot keep")
    assert simulation.robot_parts()[1]["facts"] == ["refused(@1)"]
