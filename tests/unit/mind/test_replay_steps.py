"""`rmr replay --step`: what holds at a stop is what the mind held then, and its text is the same from both sides."""

from pathlib import Path

import pytest
from command_runner import invoke
from mind_runs import AFTER_TOKENS, LABS, TOKENS, MindRun
from test_replay_command import written

from rmr.commands.replay_command import command
from rmr.mind import mind_versions
from rmr.mind.mind_replay import MindReplay
from rmr.mind.recorded_minds import minds
from rmr.record.recording import open_recording
from rmr.vm.engines import Engine
from rmr.vm.provenance import FiringRecord, ProvenanceLog
from rmr.why.stop_text import fact_texts, stop_lines
from rmr.why.stops import StopKind, Stops, choices
from rmr_view.followed_minds import FollowedMind, sensed_facts

pytestmark = pytest.mark.medium

DOORS = """
type at(robot, int).
type !door(robot, int, int).
type bell(robot, int).
at(R, 1).
door(R, 1, 2).  door(R, 2, 3).  door(R, 3, 5).  door(R, 1, 4).  door(R, 4, 5).
bell(R, 1).
?at(R, 5).

at(R, A), door(R, A, B) -o at(R, B).
bell(R, N), N < 900 -o bell(R, N + 1).
"""
ORDERED = """
type action wait(R: robot, S: float).
type done(robot).
asked(@1).
asked(R) -o wait(@2, 7.0) then done(R).
"""
LAB = """
lab: small
program: first.rmr
duration: 14s
arena: {size: [3.0, 3.0]}
robots: [{ids: 1-2, grid: {from: [0.4, 0.4], step: [0.5, 0], columns: 2}}]
"""


def small(folder: Path, program: str, more: str = "", after: str = AFTER_TOKENS) -> MindRun:
    for name, text in {"lab.yaml": LAB + more, "first.rmr": program, "after.rmr": after}.items():
        (folder / name).write_text(text)
    return MindRun(folder)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Returns a run by its name, with its recording; each is made once."""
    known = {}

    def make(name: str) -> tuple[MindRun, Path]:
        if name not in known:
            folder = tmp_path_factory.mktemp(name)
            run = {
                "corridor": lambda: MindRun(LABS / "corridor", 7),
                "faulty": lambda: MindRun(LABS / "testbed", 4, chaos=True),
                "loaded": lambda: small(folder, TOKENS, "loads: [{at: 2s, program: after.rmr}]\n"),
                "doors": lambda: small(folder, DOORS),
                "ordered": lambda: small(
                    folder, ORDERED, "loads: [{at: 2s, program: after.rmr}]\n", f"{ORDERED}type extra(robot).\n"
                ),
            }[name]()
            known[name] = run, written(folder / "run.mcap", run)
        return known[name]

    return make


def stops_of(path, robot, program):
    stops = Stops(robot)
    with open_recording(path) as recording:
        for mind in minds(recording):
            if mind.robot == robot:
                for _ in stops.replay(mind, program):
                    pass
    assert stops.problems == []
    return stops


def stepped(path, text, *words):
    return invoke(command, [str(path), "--step", *words], name="rmr replay", text=text)


class Watched(list):
    """The records of a log; at each firing what its machine holds just before is noted."""

    def __init__(self) -> None:
        super().__init__()
        self.replay = None
        self.before = []

    def append(self, record) -> None:
        super().append(record)
        if isinstance(record, FiringRecord):
            machine = self.replay.node.machine
            self.before.append((record.number, machine.facts(), sensed_facts(machine), machine.goals()["open"]))


@pytest.mark.parametrize("name", ["corridor", "loaded", "doors", "faulty"])
def test_facts_and_goals_just_before_each_firing_are_those_of_the_machine(made, name):
    from rmr.why.stop_text import goal_texts

    run, path = made(name)
    for robot in sorted({robot for robot, _ in run.logs})[:3]:
        stops = stops_of(path, robot, run.program)
        before = []
        for key in sorted(key for key in run.logs if key[0] == robot):
            log = ProvenanceLog()
            log.records = records = Watched()
            records.replay = replay = MindReplay(run.logs[key], run.program, provenance=log)
            while replay.step():
                pass
            before += records.before
        firings = [index for index, stop in enumerate(stops.all) if stop.kind is StopKind.FIRING]
        assert len(firings) == len(before) > 0
        for index, (number, facts, sensed, goals) in zip(firings, before, strict=True):
            assert stops.all[index].firing.number == number
            assert fact_texts(stops, index - 1) == (facts, sensed)
            assert sorted(text.removeprefix("?") for text in goal_texts(stops, index - 1)) == sorted(goals)


@pytest.mark.parametrize("name", ["corridor", "loaded", "doors"])
def test_facts_at_the_last_stop_of_each_instant_are_those_that_the_page_shows(made, name):
    run, path = made(name)
    stops = stops_of(path, 1, run.program)
    mind = FollowedMind(run.program, run.logs[1, 0][0])
    for batch in run.logs[1, 0][1:]:
        mind.feed(batch)
    mind.go_on()
    for index in [stops.last_at(stop.at) for stop in stops.all]:
        shown = mind.state(stops.all[index].at)
        assert fact_texts(stops, index) == (shown["facts"], shown["sensed"])


@pytest.mark.parametrize("name", ["corridor", "loaded", "doors", "faulty"])
def test_the_agenda_names_the_rule_that_fires_next_and_its_match(made, name):
    run, path = made(name)
    stops = stops_of(path, 1, run.program)
    chosen = 0
    for index, stop in enumerate(stops.all[:-1]):
        agenda = stops.agenda(index)
        following = stops.all[index + 1]
        if following.kind is StopKind.FIRING and following.run == stop.run:
            assert agenda.firing is following.firing
            assert agenda.inputs == 0
            held = {fact.serial for fact in stops.held(index)}
            for choice in choices(agenda.firing):
                assert choice.matched
                assert set(choice.matched) <= held
            chosen += 1
        elif following.run != stop.run:
            assert agenda.firing is None
    assert chosen > 0
    assert stops.agenda(len(stops.all) - 1).firing is None


def test_every_stop_has_the_same_text_whichever_way_it_is_reached(made):
    run, path = made("faulty")
    count = len(stops_of(path, 1, run.program).all) - 1
    assert count > 10
    forth = stepped(path, "step\nfacts\ngoals\nagenda\n" * count + "quit\n", "--robot", "1")
    back = stepped(path, f"step {count + 1}\n" + "back step\nfacts\ngoals\nagenda\n" * count + "quit\n", "--robot", "1")
    assert (forth.exit_code, back.exit_code) == (0, 0)
    assert forth.stderr == back.stderr == ""

    def blocks(output, command):
        """Return the answers after each `command`, without the prompts, whose instants are the stops'."""
        found = output.split(f"> {command}\n")[1:]
        return [[line.rpartition("s> ")[2] for line in part.splitlines()[:-1]] for part in found]

    there = blocks(forth.stdout, "step")
    assert len(there) == count
    assert there == blocks(back.stdout, "back step")[::-1]


def test_lives_and_programs_follow_each_other(made):
    _, path = made("faulty")
    shown = stepped(path, "end\nback until restarted(@1, _)\n", "--robot", "1").stdout
    assert " in 2 lives: " in shown.splitlines()[0]
    text = stepped(path, "step 400\n" * 40, "--robot", "1").stdout
    assert "firing" in text
    run, path = made("loaded")
    stops = stops_of(path, 1, run.program)
    changes = [stop for stop in stops.all if stop.life]
    assert len(changes) == len(stops.parts) == 2
    shown = stepped(
        path, "until extra(@1, fresh)\nfacts extra\nback until door(@1, _)\nbreak after.rmr:6\n", "--robot", "1"
    )
    assert shown.exit_code == 0
    assert "!extra(@1, fresh)" in shown.stdout
    assert "+ door(@1, left)" in shown.stdout
    assert "breakpoint on rule after.rmr:6, which fires " in shown.stdout


def test_the_engine_says_what_it_passed_over_with_the_ranks(made):
    _, path = made("doors")
    shown = stepped(path, "agenda\nnext\npassed\ngoals\nnext\ngoals\nto 3s\nagenda\n", "--robot", "1").stdout
    assert "1. rule first.rmr:10: at(@1, 1), !door(@1, 1, 4)  rank 1  <- fires next" in shown
    assert "2. rule first.rmr:11: bell(@1, 1)\n" in shown
    assert (
        "rule first.rmr:11: bell(@1, 1)\n   passed over: the other one leads to an open goal (at(@1, 5); rank 1)"
        in shown
    )
    assert (
        "rule first.rmr:10, another match: at(@1, 1), !door(@1, 1, 2)\n   passed over: rank 2 over the facts" in shown
    )
    assert shown.count("> goals\n?at(@1, 5)\n") == 1
    assert shown.count("> goals\nno goal is open\n") == 1
    assert shown.endswith("no rule is satisfied\n")


def test_a_budget_that_is_used_up_is_told(made):
    run, path = made("doors")
    stops = stops_of(path, 1, run.program)
    resumed = [index for index in range(len(stops.all)) if stops.agenda(index).resumes]
    assert [stops.all[index].firing.number for index in resumed if stops.all[index].firing] == [500]


def test_a_session_goes_to_instants_facts_and_breakpoints(made):
    _, path = made("corridor")
    script = """
# a comment
until at(@3, exit)
back until moveto(@3, exit)
break corridor.rmr:21
continue
back continue
to 1.5s
delete 21
start
"""
    shown = stepped(path, script, "--robot", "3")
    assert (shown.exit_code, shown.stderr) == (1, "")  # no firing of that rule comes before the first
    blocks = [part.splitlines() for part in shown.stdout.split("\n@3 ")[1:]]
    assert "   + at(@3, exit)" in blocks[0]
    assert "   + action moveto(@3, exit)" in blocks[1]
    assert blocks[3][1].endswith("rule corridor.rmr:21")
    assert blocks[4][1] == "there is no firing of a rule with a breakpoint before this stop"
    assert blocks[6][1] == "no breakpoint on rule corridor.rmr:21 any more"
    assert blocks[7][1] == "before the first input"
    assert stepped(path, "show\n", "--robot", "3", "--from", "1s").stdout.count("lineup(@3, ") == 1


def test_a_robot_that_ran_the_generated_engine_is_stepped_through_by_the_interpreter(made):
    _, path = made("corridor")
    with open_recording(path) as recording:
        assert minds(recording)[1].header.config.engine is not Engine.INTERPRETER
    shown = [stepped(path, "step\nfacts\n" * 11, "--robot", "2", *words) for words in ((), ("--engine", "interpreter"))]
    assert shown[0] == shown[1]
    assert shown[0].exit_code == 0


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("foo", 2, "unknown command 'foo'; 'help' lists them"),
        ("agend", 0, "fires next"),
        ("agnda", 2, "did you mean 'agenda'?"),
        ("b", 2, "'b' may be back or break: write more of it"),
        ("next 0", 2, "N is a whole number from 1"),
        ("next 999", 1, "firings after this stop (it is known until "),
        ("back", 1, "there is no firing before this stop"),
        ("back up", 2, "unknown command 'up'"),
        ("back facts", 2, "'back facts' is no way back"),
        ("until", 2, "'until' needs a fact, such as "),
        ("until at(@3", 2, "'at(@3': "),
        ("until nothing(@3)", 2, "'nothing(@3)': "),
        ("until at(@4, exit)", 2, "is a fact of robot 4, not of robot 3"),
        ("until at(@3, nowhere)", 1, "there is no stop where it begins to hold after this stop"),
        ("continue", 2, "no breakpoint is set: set one with 'break FILE:LINE'"),
        ("break 99", 2, "no rule begins at '99'; rules: corridor.rmr:15, corridor.rmr:19, corridor.rmr:21"),
        ("delete", 2, "there is no breakpoint"),
        ("to soon", 2, "write an instant of lab time as 12.3s"),
        ("to 900s", 0, "the robot is known until "),
        ("passed", 2, "this stop is no firing"),
        ("facts nothing(@3)", 2, "'nothing(@3)': "),
        ("facts ?at(@3, exit)", 2, "is no fact"),
        ("why", 2, "'why' needs a fact"),
        ("why at(@3, exit)", 2, "nothing has happened yet"),
        ("goals all", 2, "'goals' stands alone"),
        ("\x1b[2J", 2, "unknown command"),
    ],
)
def test_what_a_person_gets_wrong_is_told_in_one_line(made, line, code, said):
    _, path = made("corridor")
    shown = stepped(path, f"{line}\nquit\nfoo\n", "--robot", "3")
    assert said in shown.stdout
    assert shown.exit_code == code
    assert shown.stdout.endswith("quit\n")
    assert "Traceback" not in shown.output


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ((), 2, "--step follows one robot of 1-6: give --robot 1"),
        (("--robot", "1-3"), 2, "--step follows one robot: give --robot one number"),
        (("--robot", "77"), 2, "the run has no robot 77; its robots are 1-6"),
        (("--robot", "3", "--json"), 2, "--json does not go with it"),
        (("--robot", "3", "--trace", "x"), 2, "--trace does not go with it"),
        (("--robot", "3", "--engine", "generated"), 2, "leave --engine out"),
    ],
)
def test_wrong_options_are_told(made, words, code, said):
    shown = stepped(made("corridor")[1], "next\n", *words)
    assert (shown.exit_code, shown.stdout) == (code, "")
    assert said in shown.stderr


def test_a_damaged_log_is_stepped_through_as_far_as_it_goes(made, tmp_path):
    run, _ = made("corridor")
    log = run.logs[3, 0]
    path = written(tmp_path / "lost.mcap", run, {(3, 0): log[:3] + log[4:]})
    shown = stepped(path, "end\n")
    assert shown.exit_code == 0
    assert "warning: robot 3 is known until " in shown.stderr
    assert "batch 3 of its log is missing" in shown.stderr
    path = written(tmp_path / "begin.mcap", run, {(3, 0): log[1:]})
    shown = stepped(path, "end\n")
    assert (shown.exit_code, shown.stdout) == (3, "")
    assert "robot 3 cannot be replayed: its beginning is missing" in shown.stderr


def test_a_recording_of_another_version_needs_anyway(made, monkeypatch):
    _, path = made("corridor")
    versions = {**mind_versions.versions(), "python": "CPython 9.1"}
    monkeypatch.setattr(mind_versions, "versions", lambda: versions)
    shown = stepped(path, "next\n", "--robot", "3")
    assert (shown.exit_code, shown.stdout) == (3, "")
    assert "see with --anyway what this version does otherwise" in shown.stderr
    assert stepped(path, "next\n", "--robot", "3", "--anyway").exit_code == 0


def test_an_action_of_another_robot_that_began_under_the_program_before_ends_with_a_text(made):
    run, path = made("ordered")
    stops = stops_of(path, 1, run.program)
    texts = [line for index in range(len(stops.all)) for line in stop_lines(stops, index, ())]
    assert any("an action that the program before began completed" in each for each in texts)
    assert any("done(@1)" in each for each in texts)
