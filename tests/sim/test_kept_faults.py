"""Fault lists that the hunt has found (kept_faults.toml) break nothing any more, but for those marked as failing."""

import re
import tomllib
from pathlib import Path

import pytest

from rmr_sim.run_setup import Options, load
from rmr_sim.seed_run import reasons, run_seed
from rmr_world.lab_file import load_lab

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
LABS = HERE.parents[1] / "deploy" / "labs"
KEPT = tomllib.loads((HERE / "kept_faults.toml").read_text())["kept"]
_PROGRAM = re.compile(r"^program: (.*)$", re.MULTILINE)


def parameter(kept):
    """Return a test's parameter: a list that is known to fail still has to fail."""
    marks = [pytest.mark.xfail(reason=kept["fails"], strict=True)] if "fails" in kept else []
    return pytest.param(kept, id=f"{kept['lab']}-{kept['seed']}", marks=marks)


def harmed_lab(kept, folder):
    """Write the lab with the kept faults; return its path. Its duration counts from the end of the last fault."""
    source = LABS / kept["lab"]
    source = source if source.suffix else source / "lab.yaml"
    text = _PROGRAM.sub(lambda match: f"program: {source.parent / match[1]}", source.read_text())
    file = folder / "lab.yaml"
    file.write_text(
        text + "".join(["faults:\n", *(f"  - {fault}\n" for fault in kept["faults"])] if kept["faults"] else [])
    )
    return file


@pytest.mark.parametrize("kept", [parameter(kept) for kept in KEPT])
def test_fault_list_found_by_a_hunt_breaks_nothing(kept, tmp_path):
    assert kept["was"], "it is told what was broken"
    file = harmed_lab(kept, tmp_path)
    ends_s = [float(end) for fault in kept["faults"] for end in re.findall(r"(?:at|to): ([0-9.]+)", fault)]
    duration = load_lab(file).duration + round(max(ends_s, default=0.0) * 1e9)
    result = run_seed(load(file, Options(duration=duration, **kept.get("options", {}))), kept["seed"])
    assert reasons(result.row) == [], result.breakdown
