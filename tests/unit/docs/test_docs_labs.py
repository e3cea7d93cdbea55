"""docs/labs.md says what the code says: keys and defaults, options, the report, and an example that runs."""

import contextlib
import io
import re

import pytest
import yaml
from doc_pages import ROOT, blocks, codes, listed, page, section, table

from rmr.base.time import NS_PER_MS
from rmr.base.values import ROBOT_ID_MAX
from rmr.bus.endpoint import DEFAULT_ENDPOINT, ENDPOINT
from rmr.bus.wire import Disturbances
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import RobotHandle
from rmr.radio.links import DISTURBANCES_MAX, Disturbance
from rmr_agent.main import main as agent
from rmr_deploy import launch
from rmr_deploy.disturb import record
from rmr_deploy.fault import command as fault
from rmr_deploy.lab_run import make_report
from rmr_deploy.preparation import RunPlan
from rmr_deploy.run_options import RunOptions
from rmr_deploy.run_outcome import RunOutcome
from rmr_deploy.up import command
from rmr_lab.main import command as lab
from rmr_sim.main import main as sim
from rmr_sim.run_setup import prepare, report_of
from rmr_sim.violation import Violation
from rmr_world.disturbances import LEAD
from rmr_world.lab_file import load_lab
from rmr_world.main import main as world
from rmr_world.schema import CELLS_MAX, LabFile, json_schema
from rmr_world.units import ROBOTS_MAX

PAGE = page("labs")
TEXT = " ".join(PAGE.split())
LAB_KEYS = (ROOT / "world" / "rmr_world" / "lab_keys.md").read_text("utf-8")
KEYS = [(codes(key)[0], codes(default), text) for key, default, text in table(LAB_KEYS, "key", "default", "meaning")]


# -- the lab file


def schema_keys(schema, node, path):
    """Yield the path of every key of the JSON Schema: NAME stands for a key of the author's, [] for each item."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rsplit("/", 1)[1]]
    for option in node.get("anyOf", []):
        yield from schema_keys(schema, option, path)
    for key, inner in node.get("properties", {}).items():
        here = f"{path}.{key}" if path else key
        yield here
        yield from schema_keys(schema, inner, here)
    if isinstance(node.get("items"), dict):
        yield from schema_keys(schema, node["items"], f"{path}[]")
    for inner in (node.get("additionalProperties"), *node.get("patternProperties", {}).values()):
        if isinstance(inner, dict):
            yield from schema_keys(schema, inner, f"{path}.NAME")


def test_every_key_of_the_lab_file_is_documented_and_no_other():
    schema = json_schema()
    assert sorted(key for key, _, _ in KEYS) == sorted(set(schema_keys(schema, schema, "")))


def test_the_schema_has_the_words_of_the_page_without_links():
    schema = json_schema()
    assert schema["properties"]["finish"]["description"].startswith("a fact that every robot holds in the end")
    described = [
        node["description"] for each in schema["$defs"].values() for node in each.get("properties", {}).values()
    ]
    assert len(described) > 70
    assert not [text for text in described if "](" in text]


def minimal():
    return {
        "lab": "x",
        "program": "x.rmr",
        "arena": {"size": [1.0, 1.0]},
        "robots": [{"ids": [1], "grid": {"from": [0.5, 0.5], "step": [0.1, 0.1], "columns": 1}}],
    }


def put(data, path, value):
    *way, last = re.sub(r"\[\]", ".0", path).split(".")
    for part in way:
        data = data[int(part)] if isinstance(data, list) else data.setdefault(part, {})
    data[last] = value


@pytest.mark.parametrize(("key", "default"), [(key, default[0]) for key, default, _ in KEYS if default])
def test_writing_down_a_documented_default_changes_nothing(key, default):
    data = minimal()
    put(data, key, yaml.safe_load(default))
    assert LabFile.model_validate(data) == LabFile.model_validate(minimal())


def test_every_key_with_a_default_has_it_documented():
    def defaults(model, path):
        for name, field in model.model_fields.items():
            if not field.is_required() and field.default is not None:
                yield f"{path}{name}"

    documented = {key for key, default, _ in KEYS if default}
    lab = LabFile.model_validate(minimal())
    models = {
        "": lab,
        "robot.": lab.robot,
        "robot.view.": lab.robot.view,
        "radio.": lab.radio,
        "localisation.": lab.localisation,
    }
    expected = {key for path, model in models.items() for key in defaults(type(model), path)}
    assert expected <= documented


def test_the_required_keys_are_those_named():
    assert [name for name, field in LabFile.model_fields.items() if field.is_required()] == [
        "lab",
        "program",
        "arena",
        "robots",
    ]
    assert "`lab`, `program`, `arena` and `robots` are required" in PAGE


def test_the_limits_are_those_of_the_code():
    assert f"{CELLS_MAX:,} cells".replace(",", " ") in LAB_KEYS
    assert f"takes them; {ROBOTS_MAX} at most" in LAB_KEYS
    assert f"0 to {ROBOT_ID_MAX} ..." in LAB_KEYS
    assert f"At most {DISTURBANCES_MAX} disturbances hold at a time" in TEXT


def test_the_example_of_disturbances_is_a_lab_files():
    text = section(PAGE, "Disturbances of the radio")
    lab = LabFile.model_validate(minimal() | yaml.safe_load(blocks(text, "yaml")[0]))
    assert (len(lab.radio.links), len(lab.faults)) == (3, 4)


def test_every_lab_of_the_repository_is_named():
    labs = sorted(path.parent.relative_to(ROOT).as_posix() for path in ROOT.glob("deploy/labs/*/lab.yaml"))
    assert [codes(row[0])[0] for row in table(PAGE, "lab", "shows")] == labs


# -- commands


def up(arguments):
    command().main(arguments, "rmr up")


def help_of(main):
    out = io.StringIO()
    with contextlib.redirect_stdout(out), pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code in (0, None)
    return out.getvalue()


def offered(text):
    return set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", re.sub(r"rmr-\w+", "", text)))


@pytest.mark.parametrize(
    ("title", "main"),
    [("rmr sim LAB", sim), ("rmr-world", world), ("rmr-agent PROG.rbc", agent)],
)
def test_an_option_that_a_section_names_is_one_of_the_command(title, main):
    text = re.sub(r"^    .*$", "", section(PAGE, title), flags=re.MULTILINE)
    named = {name for code in codes(text) for name in offered(code)}
    assert named
    assert named <= offered(help_of(main))


def test_what_the_page_says_of_options_names_those_of_the_launcher():
    text = section(PAGE, "rmr up LAB").partition("####")[0]
    named = {name for code in codes(text) for name in offered(code)}
    assert {"--timeout", "--processes", "--keep-going"} <= named <= offered(help_of(up))


def test_the_commands_of_rmr_fault_are_documented_and_no_others():
    rows = table(section(PAGE, "rmr fault"), "command", "does")
    subcommands = [code.split()[2] for row in rows for code in codes(row[0])]
    assert sorted(subcommands) == sorted(fault().commands)


def test_the_commands_of_rmr_lab_are_documented_and_no_others():
    text = section(PAGE, "rmr lab")
    assert {f"rmr lab {name}" for name in lab.commands} == set(re.findall(r"`(rmr lab [a-z]+)", text))


def test_what_rmr_fault_shows_of_a_disturbance_is_documented():
    told = Disturbances("x", 0, (Disturbance(loss=0.5),), 0, "")
    shown = record(told)["disturbances"][0]
    rows = table(PAGE, "of a disturbance", "meaning")
    assert [key for row in rows for key in codes(row[0])] == list(shown)
    assert f"begins {LEAD // NS_PER_MS} ms of lab time later" in TEXT
    assert f"a {DISTURBANCES_MAX + 1}th disturbance" in TEXT


def test_the_endpoint_is_the_one_that_commands_default_to():
    assert TEXT.count(f"default `{DEFAULT_ENDPOINT}`") == 3, "of rmr-world, rmr-agent and rmr router"
    protocols = re.findall(r"`(\w+)`", re.search(r"the protocol one of (.*?)\. `--listen`", PAGE, re.DOTALL)[1])
    assert protocols == ENDPOINT.pattern.split(")")[0].lstrip("(").split("|")


def test_the_default_timeout_is_the_launchers():
    assert (launch.READY_S_MAX, launch.SILENCE_S_MAX) == (30.0, 10.0)
    assert "default: 30 s for the start, the lab's duration and 10 s" in PAGE


# -- the report


def fields(value, path=""):
    """Yield the path of every field of a report; ID stands for a robot's id, [] for each item."""
    if isinstance(value, dict):
        for key, inner in value.items():
            here = f"{path}.{'ID' if path == 'robots' else key}" if path else key
            if path != "robots":
                yield here
            yield from fields(inner, here)
    elif isinstance(value, list):
        for inner in value:
            yield from fields(inner, f"{path}[]")


@pytest.fixture(scope="module")
def simulated():
    simulation = prepare(ROOT / "deploy" / "labs" / "testbed", robots=2)
    simulation.violations.append(Violation(0, "contact", (1, 2), "an example: no rule is broken in such a run"))
    return report_of(simulation, simulation.run())


def of_processes(folder):
    lab = load_lab(ROOT / "deploy" / "labs" / "testbed")
    plan = RunPlan(RunOptions(lab=lab.path, durable=True), lab, None, folder)
    return make_report(plan, RunOutcome(reason="interrupted"), None)


def test_every_field_of_the_report_is_documented_and_no_other(simulated, tmp_path):
    assert simulated["finished"]
    found = set(fields(simulated)) | set(fields(of_processes(tmp_path)))
    documented = [field for names, _ in listed(section(PAGE, "report.json")) for field in names]
    counters = table(section(page("radio"), "What is counted"), "counter", "counts")
    documented += [f"robots.ID.frames.{codes(row[0])[0]}" for row in counters]
    assert sorted(set(documented) - {"robots.ID"}) == sorted(found)
    assert len(set(documented)) == len(documented)


def test_the_fields_of_processes_alone_are_marked(simulated, tmp_path):
    alone = set(fields(of_processes(tmp_path))) - set(fields(simulated))
    rows = listed(section(PAGE, "report.json"))
    marked = {field for names, meaning in rows if meaning.startswith("`rmr up`:") for field in names}
    assert marked == alone


# -- actions of one's own


def test_every_provided_action_is_named():
    assert set(PROVIDED) == set(re.findall(r"`(\w+)\(R", section(PAGE, "Your own actions")))


def test_everything_that_a_robot_offers_to_an_action_is_documented():
    offered = {name for name in vars(RobotHandle) if not name.startswith("_")}
    rows = listed(section(PAGE, "Your own actions").partition("The `robot` has:")[2])
    assert {re.search(r"(\w+)(\(|$)", name)[1] for names, _ in rows for name in names} == offered


def test_the_example_runs_and_does_what_the_page_says(tmp_path):
    text = section(PAGE, "Your own actions")
    for name, language in (("probe.rmr", "rmr"), ("scout.py", "python")):
        assert f"`{name}`" in text
        (tmp_path / name).write_text(blocks(text, language)[0])
    # robot 2 looks at the wall behind it
    robots = [{"id": 1, "pose": [0.3, 0.3, "0deg"]}, {"id": 2, "pose": [0.2, 0.7, "180deg"]}]
    lab = {"lab": "probe", "program": "probe.rmr", "arena": {"size": [1.5, 1.0]}, "finish": "done(R, _)"}
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump({**lab, "robots": robots}))
    warnings = []
    simulation = prepare(tmp_path, actions=tmp_path / "scout.py", warn=warnings.append)
    assert simulation.run()
    assert warnings == []
    robots = report_of(simulation, finished=True)["robots"]
    facts = {number: robot["facts"] for number, robot in robots.items()}
    assert facts == {"1": ["done(@1, 0.3)"], "2": ["done(@2, 0.0)"]}
    for said in (fact for held in facts.values() for fact in held):
        assert f"`{said}`" in text
