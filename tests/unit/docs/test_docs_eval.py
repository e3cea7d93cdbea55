"""docs/eval.md says what the code says: options and their defaults, topologies, the report, the bounds."""

import json
import re

from command_runner import invoke
from doc_pages import codes, page, table

from rmr.commands.eval_command import command
from rmr.commands.subcommands import command as main
from rmr.eval.ensemble import FIRINGS_MAX, FRAMES_MAX, RANGE_M
from rmr.eval.eval_ether import HOPS_AT_ONCE_MAX, LATENCY
from rmr.eval.given import EDGE_FACTS_MAX
from rmr.eval.topology import NAMES
from rmr.vm.machine import FIRING_BUDGET

PAGE = page("eval")


def test_an_option_that_the_page_names_is_one_of_the_command():
    offered = set(command.parser("rmr eval").names)
    named = {word for code in codes(PAGE) for word in re.findall(r"(?<![\w-])--[a-z][a-z-]*", code)}
    assert {"--topology", "--edges", "--action-time", "--fail"} <= named
    assert named - {"--explain"} <= offered


def test_every_topology_is_documented_and_no_other():
    assert [codes(row[0])[0] for row in table(PAGE, "name", "pairs")] == list(NAMES)


def paths(value, prefix=""):
    """Yield the path of every key of a report down to those of a robot; ID stands for a robot."""
    for key, inner in value.items():
        if prefix != "robots":
            yield (here := f"{prefix}.{key}".lstrip("."))
        else:
            here = "robots.ID"
        if isinstance(inner, dict) and here != "robots.ID.goals":
            yield from paths(inner, here)


def test_every_key_of_the_report_is_documented_and_no_other(tmp_path):
    (tmp_path / "p.rmr").write_text("p(R).")
    report = json.loads(invoke(main, ["eval", str(tmp_path / "p.rmr")]).stdout)
    assert [codes(row[0])[0] for row in table(PAGE, "key", "holds")] == list(paths(report))


def test_the_figures_are_those_of_the_code():
    text = " ".join(PAGE.split())
    assert f"More than {EDGE_FACTS_MAX} such facts" in text
    assert f"D = {RANGE_M}" in text
    assert (
        f"after {HOPS_AT_ONCE_MAX} answers in a row at one instant no frame is faster than {LATENCY // 10**6} ms"
        in text
    )
    assert f"fires {FIRING_BUDGET} rules in a sixtieth of a second" in text
    assert f"{FIRINGS_MAX} firings, or {FRAMES_MAX} frames" in text
