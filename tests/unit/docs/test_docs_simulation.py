"""docs/simulation.md says what the simulator does: its faults, what chaos draws, what events may do."""

import re

import yaml
from doc_pages import ROOT, blocks, codes, listed, page, section, table

from rmr_sim import chaos
from rmr_sim.event import Event
from rmr_sim.hunt import candidates, hunt_names, hunt_search
from rmr_sim.run_setup import prepare
from rmr_sim.simulated_robot import FRAMES_MAX, SAMPLES_MAX
from rmr_world.physics import WATCHDOG
from rmr_world.schema import FaultSpec

PAGE = page("simulation")
TEXT = " ".join(PAGE.split())


def test_every_fault_of_robots_is_explained_and_the_example_is_a_lab_files():
    named = [codes(row[0])[0] for row in table(PAGE, "fault", "node", "radio", "body")]
    faults = yaml.safe_load(blocks(section(PAGE, "Faults"), "yaml")[0])["faults"]
    specs = [FaultSpec.model_validate(fault) for fault in faults]
    assert [name for name in named if all(getattr(spec, name) is None for spec in specs)] == []
    assert len(named) == 5


def test_every_word_of_a_fault_in_the_trace_is_documented():
    source = (ROOT / "world" / "rmr_sim" / "simulation.py").read_text()
    used = re.findall(r"self\._note\(robot, \"(\w+)\"", source)
    assert codes(re.search(r"whose `fault` is (.+?)\.", TEXT)[1]) == used


def test_the_figures_are_those_of_the_code():
    assert f"up to {SAMPLES_MAX} samples and {FRAMES_MAX} frames" in TEXT
    assert f"the wheels brake {WATCHDOG / 1e9:g} s later" in TEXT
    assert "{} to {} s after its beginning".format(*(ms // 1000 for ms in chaos.HEAL_MS)) in TEXT
    assert f'"The robots" are {chaos.FAULTS_MAX} where there are more' in TEXT
    assert f"| bursts: all frames are lost | {chaos.BURSTS_MAX} |" in PAGE
    assert (chaos.USED, chaos.AGAIN) == (1 / 2, 1 / 4)
    assert "every one with probability 1/2" in TEXT
    assert "in a quarter of the cases followed by another" in TEXT


def test_every_kind_of_fault_at_random_has_a_line():
    assert len(table(PAGE, "kind", "greatest number", "length")) == len(chaos.ALONE + chaos.TOGETHER)


def test_what_an_event_may_use_is_there():
    simulation = prepare(ROOT / "deploy" / "labs" / "testbed", robots=1)
    rows = listed(section(PAGE, "Your own events").partition("The `simulation` has:")[2])
    names = [re.match(r"\w+", code)[0] for names, _ in rows for code in names]
    assert len(names) > 10
    assert [name for name in names if not hasattr(simulation, name)] == []
    (robots,) = [meaning for names, meaning in rows if names == ["robots"]]
    offered = [re.match(r"\w+", code)[0] for code in codes(robots)]
    assert [name for name in offered if not hasattr(simulation.robots[0], name)] == []
    assert [re.match(r"\w+", codes(row[0])[0])[0] for row in table(PAGE, "of `Event`", "")] == ["Event", "callback"]
    assert hasattr(Event, "callback")


def test_every_method_property_and_bound_of_the_hunt_is_documented():
    hunt = section(PAGE, "The hunt")
    methods = [code for row in table(hunt, "method", "faults") for code in codes(row[0])]
    assert sorted(methods) == sorted(hunt_names.METHODS)
    properties = [codes(row[0])[0] for row in table(hunt, "property", "is broken if")]
    assert tuple(properties) == hunt_names.PROPERTIES
    assert f"default: `{','.join(hunt_names.DEFAULT_PROPERTIES)}`" in hunt
    text = " ".join(hunt.split())
    assert f"Up to {hunt_search.ROUND_RUNS} *candidates*" in text
    assert f"A batch of up to {hunt_search.BATCH} runs" in text
    assert hunt_search.HARMS_MAX == 6  # "longer lists up to six faults"
    assert "last {:g} to {:g} s".format(*(ms / 1000 for ms in candidates.WINDOW_MS)) in text


def test_every_kind_of_hard_chaos_is_named_with_its_length():
    kinds = re.search(r"up to three times: (.+?)\.", TEXT)[1]
    radio = ("mute robots", "deaf robots", "partitions into two parts")
    assert len(("stalls", *radio)) == len(chaos.HARD_ALONE + chaos.HARD_TOGETHER)
    spans = (chaos.HARD_LENGTH_MS, chaos.HARD_RADIO_MS)
    lengths = ["{:g} to {:g} s".format(*(ms / 1000 for ms in span)) for span in spans]
    assert kinds == f"stalls of {lengths[0]}; {', '.join(radio)} of {lengths[1]}"
    assert (chaos.HARD_MAX, chaos.HARD_FROM_MS_MAX) == (3, 30_000)  # "up to three times", "the first 30 s"
