"""On the page what a robot has heard of its neighbours' shared facts stands among what it senses, in words."""

from rmr.base.streams import Choices
from rmr.base.values import Robot
from rmr.lang.compiler import compile_source
from rmr.vm.engines import new_machine
from rmr_view.followed_minds import sensed_facts
from rmr_view.simulated_source import robot_at

PROGRAM = """
type shared hops(robot, int).
hops(@1, 7).
hops(R, H), N = min(X, neighbor(R, B), hops(B, X)), N < H -o hops(R, N).
"""


def test_sensed_facts_of_a_machine():
    program = compile_source(PROGRAM).program
    machine = new_machine(program, 1, Choices("x"))
    machine.start(0)
    machine.insert(0, program.index("heard__1"), (Robot(2), 5))
    machine.insert(0, program.index("neighbor"), (Robot(2),))
    assert sensed_facts(machine) == ["hops(@2, 5), as @1 has heard", "neighbor(@1, @2)"]
    assert machine.facts() == ["hops(@1, 7)"]


def test_facts_of_a_trace():
    texts = ["hops(@1, 7)", "hops(@2, 5), as @1 has heard", "neighbor(@1, @2)", 'note(@1, "as @1 has heard")']
    entries = [{"t": 1.0, "robot": 1, "what": "inserted", "fact": text} for text in texts]
    shown = robot_at(entries, 1, 2.0, {"neighbor", "heard__1"})
    assert shown["facts"] == [texts[0], texts[3]]
    assert shown["sensed"] == [texts[1], texts[2]]
