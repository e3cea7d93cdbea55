"""Events of one's own in the simulator: subclass, override the callback, schedule (paper V.A)."""

import re

import pytest
from lab_maker import small_lab

from rmr.base.time import NS_PER_S, seconds, tick_start
from rmr_sim.event import Event, EventError
from rmr_sim.main import main
from rmr_sim.run_setup import prepare
from rmr_world.lab_program import ProgramError

PROGRAM = """
type parcel(robot, int).
type kept(robot, int).
parcel(R, N) -o kept(R, N).
"""


class Note(Event):
    """Writes down that it happened."""

    def __init__(self, at, log, name):
        super().__init__(at)
        self.log = log
        self.name = name

    def callback(self, simulation):
        self.log.append((simulation.now, self.name))


def test_events_happen_at_their_instants_those_of_one_instant_in_the_order_scheduled(tmp_path):
    log = []
    events = [Note(seconds(0.5), log, "c"), Note(seconds(0.1), log, "a"), Note(seconds(0.1), log, "b")]
    small_lab(tmp_path, PROGRAM, duration="1s", events=events).run()
    assert log == [(seconds(0.1), "a"), (seconds(0.1), "b"), (seconds(0.5), "c")]


def test_an_event_that_is_over_already_happens_at_once(tmp_path):
    log = []

    class Late(Event):
        def callback(self, simulation):
            simulation.schedule(Note(0, log, "late"))

    small_lab(tmp_path, PROGRAM, duration="1s", events=[Late(seconds(0.5))]).run()
    assert log == [(seconds(0.5), "late")]


def test_an_event_may_insert_a_fact_which_the_robot_looks_at_at_once(tmp_path):
    class Parcel(Event):
        def callback(self, simulation):
            simulation.insert(1, "parcel", 7)

    simulation = small_lab(tmp_path, PROGRAM, duration="1s", events=[Parcel(seconds(0.3333))])
    holds = {}
    simulation.observers.append(lambda now: holds.__setitem__(now, simulation.robots[0].node.machine.facts()))
    simulation.run()
    assert holds[tick_start(19)] == []
    assert holds[tick_start(20)] == ["kept(@1, 7)"]


def test_a_dead_robot_holds_no_fact_and_a_stalled_one_looks_at_it_later(tmp_path):
    class Parcel(Event):
        def callback(self, simulation):
            for robot in (1, 2):
                simulation.insert(robot, "parcel", 7)

    faults = "[{at: 0.1s, kill: 1}, {from: 0.1s, to: 0.5s, stall: 2}]"
    simulation = small_lab(tmp_path, PROGRAM, robots=2, duration="1s", faults=faults, events=[Parcel(seconds(0.3))])
    held = {}
    simulation.observers.append(
        lambda now: held.__setitem__(now, [robot.node.machine.facts() for robot in simulation.robots])
    )
    simulation.run()
    assert held[tick_start(27)][1] == ["parcel(@2, 7)"]
    assert held[tick_start(59)] == [[], ["kept(@2, 7)"]]


def test_observers_are_called_at_every_tick(tmp_path):
    simulation = small_lab(tmp_path, PROGRAM, duration="1s")
    ticks = []
    simulation.observers.append(ticks.append)
    simulation.run()
    assert ticks == [tick_start(index) for index in range(61)]
    assert ticks[-1] == NS_PER_S


def test_failing_event_is_reported_with_its_place(tmp_path):
    class Broken(Event):
        def callback(self, simulation):
            simulation.kill(9)

    with pytest.raises(EventError, match=r"event Broken at 0\.250 s: LookupError: .* robot 9 .*\(.*events\.py:\d+\)"):
        small_lab(tmp_path, PROGRAM, duration="1s", events=[Broken(seconds(0.25))]).run()


def test_an_event_without_a_callback_says_what_to_do(tmp_path):
    with pytest.raises(EventError, match="override callback in Event"):
        small_lab(tmp_path, PROGRAM, duration="1s", events=[Event(seconds(0.25))]).run()


@pytest.mark.medium
@pytest.mark.parametrize(
    ("code", "complaint"),
    [
        ("simulation.schedule(3)", "TypeError: 3 is no Event"),
        ("simulation.schedule(Event(0.5))", "TypeError: 0.5 is no instant: a whole number of nanoseconds"),
        ("simulation.stall(1, 2.5)", "TypeError: 2.5 is no instant"),
        ("simulation.slow(1, seconds(1), 0)", "ValueError: a slow robot is called less often than once a tick"),
        ("simulation.schedule(self)", "200000 events in one tick: let it schedule the next one for later"),
        ("simulation.schedule(Wrong(simulation.now + 1))", "200000 events in one tick"),
        ("exit(3)", "SystemExit: 3 (<string>:2)"),
        ("(_ for _ in ()).throw(GeneratorExit)", "GeneratorExit (<string>:2)"),
        ("simulation.robots.remove(simulation.robots[0])", "AttributeError: 'tuple' object has no attribute 'remove'"),
    ],
)
def test_event_with_an_impossible_or_endless_request_is_reported(tmp_path, code, complaint):
    names = {"Event": Event, "seconds": seconds}
    exec(f"class Wrong(Event):\n    callback = lambda self, simulation: {code}", names)
    with pytest.raises(EventError, match=re.escape(complaint)):
        small_lab(tmp_path, PROGRAM, duration="1s", events=[names["Wrong"](seconds(0.25))]).run()


EVENTS = """
from rmr.base.time import seconds
from rmr_sim.event import Event

class Parcel(Event):
    def callback(self, simulation):
        simulation.insert(1, "parcel", simulation.seed)

def events(lab, seed):
    assert seed == 5 and lab.roster == (1,)
    yield Parcel(seconds(0.5))
"""


SOON = "from rmr_sim.event import Event\ndef events(lab, seed):\n    return [Event('soon')]\n"
PUT_OFF = """
from rmr_sim.event import Event

class Later(Event):
    {}def callback(self, simulation):
        {}

def events(lab, seed):
    return [Later(0)]
"""
NEVER_INITIALISED = """
from rmr_sim.event import Event

class Mine(Event):
    def __init__(self):
        pass

def events(lab, seed):
    return [Mine()]
"""


def with_file(tmp_path, text):
    """Return the simulation with a file of events."""
    (tmp_path / "events.py").write_text(text)
    return small_lab(tmp_path, PROGRAM, duration="1s", seed=5, events=[]), tmp_path / "events.py"


def test_a_file_of_events_is_asked_for_those_of_the_run(tmp_path):
    _, file = with_file(tmp_path, EVENTS)
    simulation = prepare(tmp_path, seed=5, event_file=file)
    simulation.run()
    assert simulation.robots[0].node.machine.facts() == ["kept(@1, 5)"]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "has no function events(lab, seed) that returns the run's events"),
        ("events = 3\n", "has no function events(lab, seed)"),
        ("import nothing_like_it\n", "ModuleNotFoundError"),
        ("def events(lab, seed):\n    return [3]\n", "TypeError: 3 is no Event"),
        ("def events(lab):\n    return []\n", "TypeError: events() takes 1 positional argument but 2 were given"),
        ("def events(lab, seed):\n    return None\n", "TypeError: 'NoneType' object is not iterable"),
        ("raise SystemExit(0)\n", "calls exit(0) while it is loaded"),
        ("def events(lab, seed):\n    raise SystemExit(0)\n", "SystemExit: 0"),
        (SOON, "TypeError: 'soon' is no instant"),
        (PUT_OFF.format("async ", "pass"), "TypeError: callback of Later would not run when it is called: no async"),
        (PUT_OFF.format("", "yield"), "TypeError: callback of Later would not run"),
        (NEVER_INITIALISED, "TypeError: Mine has no instant: its __init__ must call super().__init__(at)"),
    ],
)
def test_unusable_events_file_is_reported(tmp_path, text, complaint):
    _, file = with_file(tmp_path, text)
    with pytest.raises(ProgramError, match=re.escape(complaint)):
        prepare(tmp_path, seed=5, event_file=file)


def test_the_command_ends_with_exit_code_1_where_an_event_fails_and_with_3_where_the_file_is_wrong(tmp_path, capsys):
    _, file = with_file(tmp_path, EVENTS.replace('"parcel"', '"package"'))
    arguments = [str(tmp_path), "--seed", "5", "--events", str(file)]
    assert main([*arguments, "--run", str(tmp_path / "a")]) == 1
    said = capsys.readouterr().err
    assert "rmr sim: event Parcel at 0.500 s: ValueError: the program knows no predicate package" in said
    assert "Traceback" not in said
    file.write_text("")
    assert main([*arguments, "--run", str(tmp_path / "b")]) == 3
    assert "has no function events" in capsys.readouterr().err


UNSPEAKABLE = """
class Unspeakable(Exception):
    def __str__(self):
        raise ValueError("no words")
"""

FAILING = """
from rmr.base.time import seconds
from rmr_sim.event import Event

def look(now):
    if now >= seconds(0.2):
        raise {error}

class Watch(Event):
    def callback(self, simulation):
        simulation.observers.append({observer})

def events(lab, seed):
    return [Watch(seconds(0.1))]
"""


@pytest.mark.parametrize(
    ("error", "observer", "complaint"),
    [
        ("LookupError('lost')", "look", "observer look at 0.200 s: LookupError: lost ({file}:7)"),
        ("SystemExit(3)", "look", "observer look at 0.200 s: SystemExit: 3 ({file}:7)"),
        ("BaseException", "look", "observer look at 0.200 s: BaseException ({file}:7)"),
        (
            "Unspeakable",
            "look",
            "observer look at 0.200 s: Unspeakable: (its text cannot be had: ValueError) ({file}:7)",
        ),
        ("KeyError", "lambda: 0", "takes 0 positional arguments but 1 was given ({file}:11)"),
        ("KeyError", "nobody", "event Watch at 0.100 s: NameError: name 'nobody' is not defined ({file}:11)"),
    ],
)
def test_failing_observer_is_reported_as_user_error_with_its_place(tmp_path, capsys, error, observer, complaint):
    _, file = with_file(tmp_path, FAILING.format(error=error, observer=observer) + UNSPEAKABLE)
    assert main([str(tmp_path), "--events", str(file), "--run", str(tmp_path / "run")]) == 1
    said = capsys.readouterr().err
    assert complaint.format(file=file) in said
    assert "broke down" not in said


def test_failing_events_file_is_reported_with_its_line(tmp_path):
    _, file = with_file(tmp_path, UNSPEAKABLE + "\ndef events(lab, seed):\n    raise Unspeakable\n")
    with pytest.raises(ProgramError, match=re.escape(f"{file}:7: Unspeakable: (its text cannot be had")):
        prepare(tmp_path, seed=5, event_file=file)
    file.write_text("\n\n1 / 0\n")
    with pytest.raises(ProgramError, match=re.escape(f"{file}:3: ZeroDivisionError: division by zero")):
        prepare(tmp_path, seed=5, event_file=file)


def test_a_drawn_restart_of_a_robot_that_a_user_has_started_again_does_nothing(tmp_path):
    class Revive(Event):
        def callback(self, simulation):
            simulation.restart(1)

    faults = "[{at: 0.1s, kill: 1}, {at: 0.3s, restart: 1}]"
    simulation = small_lab(tmp_path, PROGRAM, duration="1s", faults=faults, events=[Revive(seconds(0.2))])
    assert simulation.run()
    assert simulation.robots[0].restarts == 1


def test_restart_of_a_running_robot_by_a_user_is_reported(tmp_path):
    class Revive(Event):
        def callback(self, simulation):
            simulation.restart(1)

    with pytest.raises(EventError, match=r"ValueError: robot 1 lives: kill it before it is started again \(.*:\d+\)"):
        small_lab(tmp_path, PROGRAM, duration="1s", events=[Revive(seconds(0.2))]).run()
