"""docs/architecture.md says what the code says: imports, ports, tasks, payloads, bus, streams."""

import importlib
import inspect
import re

import pytest
from doc_pages import ROOT, codes, page, table

from rmr.base.time import NS_PER_MS, NS_PER_S
from rmr.bus import wire
from rmr.bus.keys import Keys
from rmr.node import ports
from rmr.node.payloads import DeliveryRole, PayloadKind
from rmr.radio.station import GRACE_MARGIN
from rmr_agent.bus_ports import RADIO_GRACE
from rmr_agent.clock import AHEAD_MAX
from rmr_sim.run_setup import prepare
from rmr_sim.simulation import IDLE_SAMPLE_TICKS
from rmr_world import server

PAGE = page("architecture")


@pytest.fixture
def rules(monkeypatch):
    """The import rules as the architecture tests hold them."""
    monkeypatch.syspath_prepend(ROOT / "tests" / "architecture")
    return importlib.import_module("test_import_rules")


def test_a_part_imports_only_parts_in_rows_above_it_and_the_libraries_beside_it(rules):
    rows = table(PAGE, "part", "is", "libraries")
    parts = [codes(row[0])[0] for row in rows]
    assert set(parts) == set(rules.MAY_IMPORT) - {"rmr"}
    for i, part in enumerate(parts):
        assert rules.MAY_IMPORT[part] <= set(parts[:i]), part
    assert {codes(row[0])[0]: set(row[2].split(", ")) for row in rows if row[2]} == rules.LIBRARIES


def test_the_ports_are_documented_with_their_calls():
    documented = {(codes(row[0])[0], codes(row[1])[0]) for row in table(PAGE, "port", "call", "means")}
    protocols = {name: getattr(ports, name) for name in ("RadioPort", "BodyPort")}
    expected = {("Ports", "spent()"), ("Ports", "neighbors()")}
    for name, protocol in protocols.items():
        for method, function in inspect.getmembers(protocol, inspect.isfunction):
            if not method.startswith("_"):
                args = list(inspect.signature(function).parameters)[1:]
                expected.add((name, f"{method}({', '.join(args)})"))
    assert documented == expected


def test_the_kinds_of_payload_are_documented():
    rows = table(PAGE, "first octet of a payload", "code", "goes to")
    assert [row[:2] for row in rows] == [
        ("coordination", "0x01 to 0x0F"),
        *((kind.name, f"0x{kind:02X}") for kind in PayloadKind),
    ]


def test_the_roles_of_deliveries_are_documented():
    rows = table(PAGE, "delivery", "what it does there")
    assert [role for row in rows for role in codes(row[0])] == [role.name for role in DeliveryRole]


def test_the_executives_tasks_are_documented_in_order_of_priority():
    simulation = prepare(ROOT / "deploy" / "labs" / "testbed", robots=1)
    tasks = simulation.robots[0].node.executive.tasks
    rows = table(PAGE, "task", "every call", "does")
    assert [row[:2] for row in rows] == [(task.name, "no" if task.periodic else "yes") for task in tasks]


def bus_keys():
    keys = Keys("LAB")
    return {
        keys.radio(0, 0).replace("/0/0", "/CX/CY"),
        keys.call("ID"),
        keys.sense(0).replace("/0/", "/ID/"),
        keys.act(0).replace("/0/", "/ID/"),
        keys.clock,
        keys.map("ID"),
        keys.disturbances,
        keys.silence,
        keys.truth,
        keys.status("WHO"),
        keys.stop("WHO"),
        keys.host("HOST"),
        keys.order("HOST"),
        keys.look("HOST"),
        keys.load("ID"),
        keys.answers("ID"),
        keys.alive("ROLE", "ID"),
        keys.echo("ROLE", "ID", "TOKEN"),
    }


def test_every_key_of_the_bus_is_documented():
    rows = table(PAGE, "key", "from", "to", "carries")
    assert {codes(row[0])[0] for row in rows} == bus_keys()
    wild_cards = {"acts", "statuses"}
    one_of_them = {"world_alive"}
    methods = {name for name in vars(Keys) if not name.startswith("_")} - {"lab"} - wild_cards - one_of_them
    assert len(methods) == len(rows)


def test_every_message_on_the_bus_is_documented_with_the_keys_that_carry_it():
    rows = table(PAGE, "key", "from", "to", "carries")
    carried = " ".join(row[3] for row in rows)
    assert [row.kind.__name__ for row in wire.TABLE if not re.search(rf"\b{row.kind.__name__}\b", carried)] == []


def test_every_stream_of_chance_is_documented():
    """Each place where a stream is opened ends with one of the purposes named, and each purpose is used."""
    named = [code for row in table(PAGE, "stream", "of") for code in codes(row[0])]
    documented = {name.rsplit("/", 1)[1] for name in named if name.startswith("SEED/")}
    opened = set()
    for folder in ("rmr", "agents", "world"):
        for path in (ROOT / folder).rglob("*.py"):
            # `Scene.chance` is handed the purpose, which stands where it is called.
            text = path.read_text().replace('stream(f"{self._seed}/{name}")', "")
            for name in re.findall(r"(?:stream|Choices|chance)\(f?\"([^\"]+)\"\)", text):
                opened.add(re.sub(r"/\{(config\.epoch|epoch|index)\}$", "", name).rsplit("/", 1)[-1])
    assert opened == documented


def test_the_figures_are_those_of_the_code():
    text = " ".join(PAGE.split())
    assert RADIO_GRACE == 4 * NS_PER_MS
    radio = " ".join(page("radio").split())
    assert f"{RADIO_GRACE // NS_PER_MS} ms after the frame's end (the grace)" in radio
    assert f"waited for {(2 * RADIO_GRACE + GRACE_MARGIN) // NS_PER_MS} ms longer" in radio
    assert IDLE_SAMPLE_TICKS == 6
    assert "at every sixth tick" in text
    assert f"60 a second while it moves, {60 // server.STANDING_EVERY} while it stands" in text
    assert f"Truth, {60 // server.TRUTH_EVERY} a second" in text
    assert f"by {AHEAD_MAX / NS_PER_S:g} s at most" in text
    assert server.BEHIND_MAX == 60  # ticks: "more than a second"
    assert f"{wire.WORLD_ID} the world, {wire.OPERATOR_ID} an operator" in text
