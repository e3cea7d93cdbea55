"""The loader of a robot: what it was loaded with over the bus it gives to others over the radio."""

from random import Random

from rmr.base.time import milliseconds, seconds
from rmr.bytecode import codec
from rmr.lang.compiler import compile_source
from rmr.load.load_coordinator import LoadCoordinator
from rmr.load.load_endpoint import OPERATOR
from rmr.load.load_pace import BUS
from rmr.load.program_loader import Preview, ProgramLoader, RunningProgram

RADIO_OCTETS = 116

FIRST, NEW = (codec.encode(compile_source(f'p(@1, "{name:x>900}").').program, debug=False) for name in ("a", "b"))


def loader(robot):
    running = RunningProgram(FIRST, codec.digest(FIRST))
    fit = lambda octets, _digest: codec.decode(octets)  # noqa: E731
    return ProgramLoader(robot, running, fit, lambda _: Preview(0, ()), Random(robot), RADIO_OCTETS)


def load_over_bus(robot):
    """Load `NEW` onto `robot`, as an operator does; return the instant of the switch."""
    coordinator = LoadCoordinator(NEW, codec.digest(NEW), (robot.robot,), BUS)
    now = seconds(1)
    coordinator.start(now)
    while coordinator.result is None:
        coordinator.wake(now)
        for out in coordinator.out:
            robot.received(now, out.message.encode(BUS.octets_max), OPERATOR)
        coordinator.out.clear()
        for out in robot.out:
            coordinator.received(now, out.message.encode(BUS.octets_max), robot.robot)
        robot.out.clear()
        now += milliseconds(20)
    assert coordinator.result.switched
    robot.take(robot.due)
    return now


def test_a_robot_that_was_away_gets_over_the_radio_what_another_was_loaded_with_over_the_bus():
    """The fragments of the bus are larger than a frame: the robot that sent such a one died of it."""
    has, away = loader(1), loader(2)
    now = load_over_bus(has)
    away.begin(now, away=True)
    for _ in range(500):
        for one, other in ((has, away), (away, has)):
            if now >= one.next_wake and one.due > now:
                one.wake(now)
            for out in one.out:
                other.received(now, out.message.encode(RADIO_OCTETS), one.robot)
            one.out.clear()
        now += milliseconds(20)
    assert away.due == has.version
    assert away.take(now).running.octets == NEW
