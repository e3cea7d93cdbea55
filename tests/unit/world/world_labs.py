"""Helpers: lab files made from text, one robot or a few in a plain room."""

from pathlib import Path

from rmr_world.finding import Finding, LabError
from rmr_world.lab import Lab
from rmr_world.lab_file import load_lab

LABS = Path(__file__).parents[3] / "deploy" / "labs"

ROOM = """\
lab: room
program: room.rmr
arena: {size: [3.0, 1.5]}
robots:
  - {id: 1, pose: [0.5, 0.75, 0deg]}
"""


def lab_of(folder: Path, text: str) -> Lab:
    """Return the lab that `text` describes."""
    path = folder / "lab.yaml"
    path.write_text(text, encoding="utf-8")
    return load_lab(path)


def problems_of(folder: Path, text: str | bytes) -> list[Finding]:
    """Return all that is wrong with a lab file; fails when nothing is."""
    path = folder / "lab.yaml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    try:
        load_lab(path)
    except LabError as error:
        return error.problems
    raise AssertionError("the lab file was accepted")


def complaints(folder: Path, text: str | bytes) -> list[str]:
    """Return the problems as ``line:column: path: message``."""
    return [str(problem).removeprefix(f"{problem.file}:") for problem in problems_of(folder, text)]
