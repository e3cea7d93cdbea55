"""Actions: the wheels are used by one at a time, turns hold actions back, failures become else effects."""

import asyncio
from pathlib import Path

import pytest

from rmr.base.mistake import expect_ctrl_c
from rmr.base.time import seconds
from rmr.node.actions.built_in import wait
from rmr.node.actions.dispatcher import (
    STOPPED,
    TAKEN_OVER,
    ActionFailed,
    Dispatcher,
    Handler,
    Pause,
    RobotHandle,
    RunningAction,
)


class Permit:
    open = False

    def released(self, now: int) -> bool:
        return self.open


class FakeNode:
    """Hosts a dispatcher and keeps what it is told."""

    def __init__(self, **handlers: Handler) -> None:
        self.now = 0
        self.robot = 4
        self.ended: list[tuple[str, str | None]] = []
        self.halts = 0
        self.log: list[str] = []
        self.state: dict[str, object] = {}
        self.dispatcher = Dispatcher(self)
        self.handlers = handlers
        self.serial = 0

    def action_ended(self, now, running, failure):
        self.ended.append((running.name, failure))

    def handle(self, running):
        return RobotHandle(lambda: self.now, self, running)

    def halt(self):
        self.halts += 1

    def derive(self, name: str, *args, permit=None) -> None:
        self.serial += 1
        handler = self.handlers[name]
        self.running = RunningAction(self.serial, name, args, handler, permit)
        self.dispatcher.derive(self.now, self.running)

    def step(self, at_s: float) -> None:
        self.now = seconds(at_s)
        self.dispatcher.step(self.now)


def place_of(function, below: int) -> str:
    """Return the place of the line that is so many lines below the head of `function`."""
    return f"{Path(__file__).name}:{function.__code__.co_firstlineno + below}"


async def drive(robot, duration_s):
    await robot.sleep(duration_s)


def wheels(name: str) -> Handler:
    return Handler(name, drive, wheels=True)


def test_a_second_driving_action_waits_until_the_wheels_are_free():
    node = FakeNode(a=wheels("a"), b=wheels("b"))
    node.derive("a", 2.0)
    node.derive("b", 1.0)
    node.step(1.0)
    assert node.ended == []
    node.step(2.0)
    assert node.ended == [("a", None)]
    node.step(3.0)
    assert node.ended == [("a", None), ("b", None)]


def test_stop_does_not_wait_and_fails_what_was_driving():
    async def stop(robot):
        pass

    node = FakeNode(a=wheels("a"), stop=Handler("stop", stop, at_once=True))
    node.derive("a", 100.0)
    node.derive("stop")
    assert node.ended == [("a", "stopped"), ("stop", None)]
    assert node.halts >= 1


@pytest.mark.parametrize("place", ["running", "queue", "held"])
def test_a_cancelled_action_ends_wherever_it_waits(place):
    node = FakeNode(a=wheels("a"), b=wheels("b"))
    if place == "queue":
        node.derive("b", 1.0)
    node.derive("a", 100.0, permit=Permit() if place == "held" else None)
    assert node.running in getattr(node.dispatcher, place)
    node.dispatcher.cancel(node.now, node.running.serial)
    node.dispatcher.cancel(node.now, node.running.serial)
    assert node.ended == [("a", "cancelled")]
    node.step(1.0)
    assert node.dispatcher.idle


def test_an_action_waits_for_its_turn_without_keeping_others_from_the_wheels():
    node = FakeNode(a=wheels("a"), b=wheels("b"))
    permit = Permit()
    node.derive("a", 1.0, permit=permit)
    node.derive("b", 1.0)
    node.step(1.0)
    assert node.ended == [("b", None)]
    permit.open = True
    node.step(1.5)
    node.step(2.5)
    assert node.ended == [("b", None), ("a", None)]


def test_a_failed_action_ends_with_its_reason():
    async def fail(robot):
        raise ActionFailed("the door is shut")

    node = FakeNode(fail=Handler("fail", fail))
    node.derive("fail")
    assert node.ended == [("fail", "the door is shut")]


def test_failure_reason_is_one_bounded_line_without_terminal_escapes():
    async def fail(robot):
        raise ActionFailed("red \x1b[31m\n" + "x" * 10_000)

    node = FakeNode(fail=Handler("fail", fail))
    node.derive("fail")
    [(_, reason)] = node.ended
    assert reason.startswith("red ?[31m xxx")
    assert len(reason) == 500


def test_a_mistake_in_a_users_action_fails_the_action_and_not_the_robot():
    async def broken(robot):
        raise KeyError("nothing")

    node = FakeNode(broken=Handler("broken", broken))
    node.derive("broken")
    assert node.ended == [("broken", f"KeyError: 'nothing' ({place_of(broken, 1)})")]


def test_a_condition_is_looked_at_whenever_the_robot_runs():
    seen = []

    async def watch(robot):
        await Pause(condition=lambda: len(seen) > 1)

    node = FakeNode(watch=Handler("watch", watch))
    node.derive("watch")
    seen += [1, 2]
    node.step(0.1)
    assert node.ended == [("watch", None)]


def test_a_later_action_may_take_the_wheels_from_an_earlier_one_of_its_name_but_from_no_other():
    node = FakeNode(lineup=Handler("lineup", drive, wheels=True, takes_over=True), b=wheels("b"))
    node.derive("lineup", 9.0)
    node.derive("b", 1.0)
    node.derive("lineup", 2.0)
    assert node.ended == [("lineup", TAKEN_OVER)]
    node.step(2.0)
    assert node.ended[1:] == [("lineup", None)]
    node.derive("lineup", 1.0)
    node.step(3.0)
    assert node.ended[2:] == [("b", None)], "b had the wheels and was not disturbed"


def test_an_action_that_sleeps_for_nothing_again_and_again_lets_time_pass():
    rounds = []

    async def restless(robot):
        while True:
            await robot.sleep(0)
            rounds.append(robot.now())

    node = FakeNode(a=Handler("a", restless))
    node.derive("a")
    while node.dispatcher.next_wake <= seconds(0.01):
        node.now = node.dispatcher.next_wake
        node.dispatcher.step(node.now)
    assert rounds == pytest.approx([0.001 * n for n in range(1, 11)])


@pytest.mark.parametrize("duration_s", [-1.0, -1, float("nan"), float("inf")])
def test_sleep_of_a_time_that_is_none_fails_the_action_and_provided_wait_fails_with_a_reason(duration_s):
    why = f"cannot wait {duration_s} s; give a finite number of seconds, 0 or more"
    node = FakeNode(a=Handler("a", drive), wait=Handler("wait", wait))
    node.derive("a", duration_s)
    node.derive("wait", duration_s)
    (_, failure), (_, reason) = node.ended
    assert failure == f"ValueError: {why} ({place_of(drive, 1)})"
    assert reason == why


def broken(on_the_way_out):
    async def act(robot):
        try:
            await robot.sleep(9.0)
        finally:
            await on_the_way_out(robot)

    return act


async def raise_value_error(robot):
    raise ValueError("lamp")


async def sleep_on(robot):
    await robot.sleep(1.0)


@pytest.mark.parametrize(("way_out", "why"), [(raise_value_error, "ValueError: lamp"), (sleep_on, "RuntimeError")])
def test_an_action_that_goes_wrong_on_its_way_out_fails_and_no_more(way_out, why):
    async def stop(robot):
        pass

    node = FakeNode(a=Handler("a", broken(way_out), wheels=True), stop=Handler("stop", stop, at_once=True))
    node.derive("a")
    node.derive("stop")
    (_, failure), (_, done) = node.ended
    assert failure.startswith(STOPPED)
    assert why in failure
    assert done is None


def test_a_condition_that_raises_fails_its_action_and_not_the_robot():
    async def act(robot):
        await robot.until(lambda: robot.now() > 1.0 and 1 / 0)

    node = FakeNode(a=Handler("a", act))
    node.derive("a")
    node.step(0.5)
    assert node.ended == []
    node.step(1.5)
    assert node.ended == [("a", f"ZeroDivisionError: division by zero ({place_of(act, 1)})")]


def test_an_action_that_calls_exit_fails_and_the_robot_goes_on():
    async def act(robot):
        raise SystemExit(3)

    node = FakeNode(a=Handler("a", act))
    node.derive("a")
    assert node.ended == [("a", f"SystemExit: 3 ({place_of(act, 1)})")]


@pytest.mark.parametrize("v", [float("nan"), float("inf"), "fast"])
def test_what_is_no_finite_number_never_reaches_the_wheels(v):
    async def act(robot):
        robot.drive(v, 0.0)

    node = FakeNode(a=Handler("a", act, wheels=True))
    node.derive("a")
    ((_, failure),) = node.ended
    assert failure is not None
    assert "AttributeError" not in failure, "the navigator, which this host has not, is never asked"


@pytest.mark.parametrize("raised", [GeneratorExit("out"), type("Own", (BaseException,), {})("mine")])
def test_an_action_that_raises_what_is_no_exception_fails_and_the_robot_goes_on(raised):
    async def act(robot):
        raise raised

    node = FakeNode(a=Handler("a", act))
    node.derive("a")
    ((_, failure),) = node.ended
    assert failure == f"{type(raised).__name__}: {raised} ({place_of(act, 1)})"


def test_ctrl_c_is_not_the_actions():
    async def act(robot):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        FakeNode(a=Handler("a", act)).derive("a")


def test_keyboard_interrupt_that_ctrl_c_cannot_have_raised_fails_the_action():
    async def act(robot):
        raise KeyboardInterrupt

    expect_ctrl_c(raised=False)
    try:
        node = FakeNode(a=Handler("a", act))
        node.derive("a")
    finally:
        expect_ctrl_c(raised=True)
    ((_, failure),) = node.ended
    assert failure == f"KeyboardInterrupt ({place_of(act, 1)})"


class Ended:
    """An awaitable that tells whether it was touched after its end."""

    def __init__(self) -> None:
        self.touched = 0

    def __await__(self):
        return self

    def __next__(self):
        raise ActionFailed("at once")

    def close(self) -> None:
        self.touched += 1


def test_a_coroutine_that_has_ended_by_itself_is_not_closed():
    coroutine = Ended()
    node = FakeNode(a=Handler("a", lambda robot: coroutine))
    node.derive("a")
    assert node.ended == [("a", "at once")]
    assert coroutine.touched == 0


def test_a_coroutine_whose_condition_raises_is_closed():
    out = []

    async def act(robot):
        try:
            await Pause(condition=lambda: 1 / 0)
        finally:
            out.append("finally")

    node = FakeNode(a=Handler("a", act))
    node.derive("a")
    node.step(0.1)
    assert out == ["finally"]


def test_the_traceback_of_a_mistake_begins_in_the_handlers_file():
    def helper(number):
        return 1 / number

    async def act(robot):
        helper(0)

    node = FakeNode(a=Handler("a", act))
    node.derive("a")
    assert node.running.raised == (
        f"{place_of(act, 1)} in act: helper(0)",
        f"{place_of(helper, 1)} in helper: return 1 / number",
    )


async def sleeps_by_asyncio(robot):
    await asyncio.sleep(1.0)


async def yields_by_asyncio(robot):
    await asyncio.sleep(0)


@pytest.mark.parametrize("looped", [False, True], ids=["simulator", "process"])
@pytest.mark.parametrize("act", [sleeps_by_asyncio, yields_by_asyncio])
def test_awaiting_asyncio_fails_with_the_same_hint_with_and_without_an_event_loop(act, looped):
    node = FakeNode(a=Handler("a", act))

    async def host():
        node.derive("a")

    if looped:
        asyncio.run(host())
    else:
        node.derive("a")
    assert node.ended == [
        ("a", "an action awaits robot.sleep, robot.until and what else its robot offers, not asyncio")
    ]


def test_what_is_set_on_the_handle_is_refused_with_the_place_to_keep_it():
    async def act(robot):
        robot.level = 3

    node = FakeNode(a=Handler("a", act))
    node.derive("a")
    ((_, failure),) = node.ended
    assert failure.startswith('AttributeError: robot.level cannot be set: keep it in robot.state["level"]')


def test_what_an_action_keeps_in_its_robots_state_is_there_for_the_next_one():
    async def act(robot):
        robot.state["times"] = robot.state.get("times", 0) + 1

    node = FakeNode(a=Handler("a", act))
    node.derive("a")
    node.derive("a")
    assert node.state == {"times": 2}
