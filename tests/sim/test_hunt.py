"""The hunt: lineage of a run, fault lists from it, the search for one that breaks a property, and its reduction."""

import io
import json
import sys
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from PIL import Image
from test_command import code_of, tiny

from rmr_sim import sim_command
from rmr_sim.arguments import parse
from rmr_sim.hunt.candidates import METHODS, attacked
from rmr_sim.hunt.harm import Harm, HarmKind, possible, with_harms
from rmr_sim.hunt.hunt_command import lab_text
from rmr_sim.hunt.hunt_names import METHODS as METHOD_NAMES
from rmr_sim.hunt.hunt_search import HuntFinding, HuntSearch, Quarry, shrunk
from rmr_sim.hunt.hunt_trial import Broken, Trial, tried
from rmr_sim.hunt.lineage import LineageObserver, Support
from rmr_sim.main import main
from rmr_sim.run_setup import Options, load, report_of
from rmr_world.faults import fault_line, fault_lines
from rmr_world.lab_file import files_of, load_lab

LABS = Path(__file__).parents[2] / "deploy" / "labs"
MUTE = Harm(HarmKind.MUTE, (3,), 2_000, 9_000)
CRASH = Harm(HarmKind.CRASH, (2,), 1_000, 4_000)
ALL_KINDS = (
    Harm(HarmKind.LINK, (1, 2), 1_000, 2_000),
    MUTE,
    Harm(HarmKind.DEAF, (4,), 1_500, 2_100),
    Harm(HarmKind.PARTITION, (1, 5), 100, 30_100),
    Harm(HarmKind.LOSS, (), 3_000, 4_500, 0.6),
    Harm(HarmKind.STALL, (6,), 0, 12_300),
    Harm(HarmKind.SLOW, (1,), 5_000, 6_000, 400.0),
    CRASH,
    Harm(HarmKind.OUTAGE, (2,), 500, 5_000),
)


# -- lineage and candidates


def test_observing_the_lineage_leaves_a_run_as_it_is():
    loaded = load(LABS / "testbed", Options())
    alone = loaded.simulation(5)
    assert alone.run()
    observed = loaded.simulation(5)
    lineage = LineageObserver(observed)
    assert observed.run()
    assert observed.trace() == alone.trace()
    assert observed.robot_parts() == alone.robot_parts()
    grounds = {support.ground for support in lineage.supports()}
    assert {"near", "slot", "entry", "inside", "leads"} <= grounds


def test_supports_name_the_closest_calls_first_and_when_the_other_was_last_heard():
    simulation = load(LABS / "corridor", Options()).simulation(7)
    lineage = LineageObserver(simulation)
    simulation.run()
    supports = lineage.supports()
    margins = [support.margin_m for support in supports]
    assert margins == sorted(margins)
    assert min(one.margin_m for one in supports if one.ground == "near") == lineage.closest_m > 0.0
    assert all(one.heard_ms <= one.at_ms for one in supports)
    rules = {one.ground for one in supports} & {"ways", "right_of_way", "queue", "shield"}
    assert rules, "in the corridor a robot brakes for another"


@pytest.mark.parametrize("method", METHOD_NAMES)
def test_each_method_makes_faults_that_a_lab_can_have_and_that_are_there_when_they_matter(method):
    lab = load_lab(LABS / "corridor")
    support = Support(12_345, 2, 5, "near", 0.1, 12_210)
    for seed in range(40):
        harms = attacked([support], lab.roster, [method], Random(seed))
        assert possible(harms, lab)
        assert min(harm.since_ms for harm in harms) <= support.at_ms
        assert max(harm.until_ms for harm in harms) > support.heard_ms - 100
        assert with_harms(lab, harms).duration == lab.duration + 10**6 * max(harm.until_ms for harm in harms)


def test_methods_have_the_names_of_the_option():
    assert tuple(METHODS) == METHOD_NAMES


def test_a_robot_is_not_killed_while_it_is_dead():
    lab = load_lab(LABS / "corridor")
    again = CRASH._replace(since_ms=3_500, until_ms=6_000)
    assert not possible((CRASH, again), lab)
    assert possible((CRASH, again._replace(since_ms=4_001)), lab)
    assert possible((CRASH, again._replace(robots=(3,))), lab)


def test_faults_of_a_hunt_can_be_written_into_a_lab_file_without_a_change(tmp_path):
    lab = load_lab(LABS / "corridor")
    harmed = with_harms(lab, ALL_KINDS)
    text = (LABS / "corridor" / "lab.yaml").read_text()
    (tmp_path / "lab.yaml").write_text(text + "faults:\n" + "".join(f"  {line}\n" for line in fault_lines(harmed)))
    written = load_lab(tmp_path)
    assert fault_lines(written) == fault_lines(harmed)
    assert sorted(map(str, written.faults)) == sorted(map(str, harmed.faults))
    assert sorted(written.disturbances) == sorted(harmed.disturbances)


# -- reduction


def first_breaking(breaks):
    """Return the function that the reduction asks, for a predicate on lists, and the lists that it was asked about."""
    asked = []

    def ask(candidates):
        for index, harms in enumerate(candidates):
            asked.append(harms)
            if breaks(harms):
                return index
        return None

    return ask, asked


def test_reduction_leaves_out_all_faults_that_are_not_needed():
    ask, asked = first_breaking(lambda harms: {h.kind for h in harms} >= {HarmKind.MUTE, HarmKind.CRASH})
    found = shrunk(ALL_KINDS, ask)
    assert {harm.kind for harm in found} == {HarmKind.MUTE, HarmKind.CRASH}
    assert len(asked) < 100


def test_reduction_shortens_a_window_from_both_ends_and_rounds_it():
    needed = range(14_300, 17_800)

    def covers(harms):
        return any(harm.since_ms <= needed[0] and harm.until_ms > needed[-1] for harm in harms)

    ask, _ = first_breaking(covers)
    (found,) = shrunk((Harm(HarmKind.MUTE, (3,), 1_700, 29_900),), ask)
    assert covers([found])
    assert found.length_ms < 2 * len(needed)
    assert found.since_ms % 500 == found.until_ms % 500 == 0


def test_reduction_ends_where_every_candidate_breaks_the_property():
    ask, asked = first_breaking(bool)
    (found,) = shrunk(ALL_KINDS, ask)
    assert found.length_ms <= 10_000
    assert len(asked) < 100


# -- the search: two robots whose ways cross, which keep apart by what they hear of each other alone

CROSS = """
lab: cross
program: cross.rmr
duration: 30s
finish: there(R)
arena: {size: [1.6, 1.6], cell: 0.05}
areas:
  east: {at: [1.4, 0.8]}
  north: {at: [0.8, 1.4]}
robots:
  - {id: 1, pose: [0.2, 0.8, 0deg]}
  - {id: 2, pose: [0.8, 0.2, 90deg]}
facts: ["goes(@1, east)", "goes(@2, north)"]
"""
GO = """
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
type goes(robot, area).
type there(robot).
goes(R, A) -o moveto(R, A).
at(R, A) -o there(R).
"""
PLANTED = frozenset({"silence", "overdue", "ways", "shield"})
"""Rules of motion without which a robot does not brake for what it sees, nor for one that it does not hear."""


def crossing(folder):
    """Write the lab; return its folder."""
    (folder / "lab.yaml").write_text(CROSS)
    (folder / "cross.rmr").write_text(GO)
    return folder


def search_of(loaded, runs, *, seed=1, properties=("contact",), methods=METHOD_NAMES):
    """Return a search that runs its trials in this process."""
    return HuntSearch(
        loaded.lab,
        Quarry(seed, properties, methods),
        lambda trials: (tried(loaded, trial) for trial in trials),
        lambda done: max(0, runs - done),
    )


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (3, 4))])
def test_hunt_finds_a_planted_defect_and_reduces_it_to_a_minimal_list(tmp_path, seed):
    loaded = load(crossing(tmp_path), Options(without=PLANTED))
    assert tried(loaded, Trial(seed, (), ("contact", "unfinished"))).broken is None
    finding = next(search_of(loaded, 40, seed=seed).findings())
    assert finding.broken.name == "contact"
    assert finding.broken.robots == (1, 2)
    assert finding.runs <= 40
    for left_out in range(len(finding.harms)):
        rest = (*finding.harms[:left_out], *finding.harms[left_out + 1 :])
        assert tried(loaded, Trial(seed, rest, ("contact",))).broken is None, "each fault of the list is needed"
    assert tried(loaded, Trial(seed, finding.harms, ("contact",))).broken == finding.broken


@pytest.mark.slow
def test_hunt_of_sound_robots_uses_its_runs_and_finds_no_contact(tmp_path):
    search = search_of(load(crossing(tmp_path), Options()), 40)
    assert list(search.findings()) == []
    assert search.runs == 40
    assert 0.0 < search.closest_m < 0.1


def test_lone_robot_is_hunted_without_links(tmp_path):
    search = search_of(load(tiny(tmp_path, "done(R).\n"), Options()), 20)
    assert list(search.findings()) == []
    assert search.runs == 20


def test_error_in_a_users_event_is_found_like_a_broken_property(tmp_path):
    (tmp_path / "bad.py").write_text("def events(lab, seed):\n    raise ValueError(seed)\n")
    loaded = load(tiny(tmp_path, "done(R).\n"), Options())
    wrong = load(tmp_path, Options(event_file=tmp_path / "bad.py"))
    assert tried(loaded, Trial(1, (), ())).broken is None
    assert tried(wrong, Trial(1, (), ())).broken.name == "error"


# -- the command


@pytest.fixture
def planted(monkeypatch):
    """Let `rmr sim` run robots with the planted defect."""
    given = sim_command.options_of
    monkeypatch.setattr(sim_command, "options_of", lambda arguments: replace(given(arguments), without=PLANTED))


def hunted(folder, *options, name="run"):
    """Hunt in the lab of two robots; return the exit code and the run folder."""
    run = folder / name
    words = [str(crossing(folder)), "--hunt", "--properties", "contact", "--run", str(run), *options]
    return main(words), run


@pytest.mark.usefixtures("planted")
def test_finding_is_printed_as_lines_of_a_lab_file_and_its_file_repeats_it_exactly(tmp_path, capsys):
    code, run = hunted(tmp_path, "--runs", "40", "--seed", "4", "--jobs", "1")
    assert code == 1
    out, err = capsys.readouterr()
    (found,) = json.loads((run / "hunt.json").read_text())["found"]
    first, second, *lines, last = out.splitlines()
    assert first == f"1. contact at {found['t_s']:.3f} s of seed 4: {found['words']}"
    assert f"found after {found['runs']} runs" in second
    assert lines == [
        f"duration: {found['duration_s']:g}s",
        "faults:",
        *(f"  - {fault_line(f)}" for f in found["faults"]),
    ]
    assert last == f"   to repeat it: rmr sim {run / 'found-1.yaml'} --strict"
    assert "hunting for 40 runs" in err
    assert "1 found" in err
    (tmp_path / "lab.yaml").write_text(CROSS.replace("duration: 30s\n", "seed: 4\n") + "\n".join(lines))
    for written in (tmp_path / "lab.yaml", run / "found-1.yaml"):
        again = load(written, Options(without=PLANTED)).simulation()
        again.run()
        report = report_of(again, False)
        violation = report["violations"][0]
        assert (violation["words"], round(violation["t_s"], 3)) == (found["words"], found["t_s"])
        assert report["faults"] == found["faults"]


@pytest.mark.slow
@pytest.mark.usefixtures("planted")
def test_hunt_is_the_same_for_its_seed_in_any_number_of_processes(tmp_path, capsys):
    code, alone = hunted(tmp_path, "--runs", "40", "--jobs", "1", "--json", name="alone")
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((alone / "hunt.json").read_text())
    assert (code, document["properties"], len(document["found"])) == (1, ["contact"], 1)
    code, shared = hunted(tmp_path, "--runs", "40", "--jobs", "2", name="shared")
    texts = [(run / "hunt.json").read_text().replace(run.name, "RUN") for run in (alone, shared)]
    assert (code, texts[0]) == (1, texts[1])


def test_hunt_that_finds_nothing_ends_with_0(tmp_path, capsys):
    code, run = hunted(tmp_path, "--runs", "5", "--jobs", "1")
    out, err = capsys.readouterr()
    assert (code, out) == (0, "")
    assert "5 runs in" in err
    assert "nothing found" in err
    assert json.loads((run / "hunt.json").read_text())["found"] == []


def test_hunt_ends_after_its_time_too(tmp_path, capsys):
    code, _ = hunted(tmp_path, "--budget", "0.001s", "--jobs", "1")
    assert code == 0
    assert "hunting for 0.001 s" in capsys.readouterr().err


def test_lab_that_does_not_finish_without_any_fault_is_found_as_that(tmp_path, capsys):
    lab = tiny(tmp_path, "idle(R).\nidle(R), done(R) -o 1.\n")
    assert main([str(lab), "--hunt", "--runs", "5", "--jobs", "1", "--run", str(tmp_path / "run")]) == 1
    assert "1. unfinished at 2.000 s of seed 0: not finished: robot 1" in capsys.readouterr().out
    assert load_lab(tmp_path / "run" / "found-1.yaml").faults == ()


def test_on_a_terminal_a_finding_stands_above_the_line_of_progress(tmp_path, monkeypatch):
    lab = tiny(tmp_path, "type done(robot).\n")
    shown = io.StringIO()
    shown.isatty = lambda: True
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stdout", shown)
    monkeypatch.setattr(sys, "stderr", shown)
    assert main([str(lab), "--hunt", "--runs", "5", "--jobs", "1", "--run", str(tmp_path / "run")]) == 1
    told = shown.getvalue()
    assert "\r\x1b[J1. unfinished at " in told
    assert told.index("\x1b[?25l") < told.index("1. unfinished at ") < told.index("\x1b[?25h")
    assert sys.stdout is sys.stderr is shown


def test_file_that_repeats_a_finding_keeps_the_faults_of_the_lab_and_finds_its_files(tmp_path):
    (tmp_path / "cross").mkdir()
    folder = crossing(tmp_path / "cross")
    (folder / "floor").mkdir()
    (folder / "floor" / "map.yaml").write_text("{image: floor.png, resolution: 0.05}")
    Image.new("L", (32, 32), 255).save(folder / "floor" / "floor.png")
    (folder / "next.rmr").write_text(GO)
    more = "faults: [{from: 1s, to: 2s, stall: 1}]\nmap: floor/map.yaml\nloads: [{at: 1s, program: next.rmr}]\n"
    (folder / "lab.yaml").write_text(CROSS + more)
    lab = load_lab(folder)
    broken = Broken("contact", 3.0, (1, 2), "robot 1 touched robot 2")
    finding = HuntFinding(5, (CRASH,), broken, 7, 2, (CRASH,))
    (tmp_path / "found-1.yaml").write_text(lab_text(lab, finding, tmp_path))
    written = load_lab(tmp_path / "found-1.yaml")
    harmed = with_harms(lab, (CRASH,))
    assert (written.faults, written.duration, written.seed) == (harmed.faults, harmed.duration, 5)
    named = [(place, file.resolve()) for place, file in files_of(written)]
    assert named == [(place, file.resolve()) for place, file in files_of(lab)]
    assert [place for place, _ in named] == [("program",), ("loads", 0, "program"), ("map",), ()]


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--runs", "5"], "--runs is about a hunt: ask for it with --hunt"),
        (["--methods", "mute"], "--methods is about a hunt"),
        (["--hunt", "--seeds", "1-3"], "--hunt draws the seeds of its runs from --seed: leave out --seeds"),
        (["--hunt", "--chaos"], "--hunt chooses the faults itself: leave out --chaos"),
        (["--hunt", "--hard-chaos"], "leave out --hard-chaos"),
        (["--hunt", "--trace", "t"], "leave out --trace"),
        (["--hunt", "--budget", "10"], "a time such as 90s, 10m or 2h, not '10'"),
        (["--hunt", "--budget", "0s"], "a time such as 90s"),
        (["--hunt", "--runs", "0"], "--runs"),
        (["--hunt", "--methods", "mutes"], "'mutes' is none of link, links"),
        (["--hunt", "--properties", "contact,speed"], "'speed' is none of contact, exclusion"),
    ],
)
def test_wrong_usage_of_a_hunt_is_told_in_a_sentence(tmp_path, capsys, words, complaint):
    assert code_of([str(tiny(tmp_path, "done(R).\n")), *words]) == 2
    assert complaint in capsys.readouterr().err


def test_budget_may_be_written_in_seconds_minutes_and_hours():
    times = [
        parse([str(LABS / "corridor"), "--hunt", "--budget", text]).budget for text in ("90s", "1.5m", "2min", "1h")
    ]
    assert times == [90 * 10**9, 90 * 10**9, 120 * 10**9, 3600 * 10**9]
