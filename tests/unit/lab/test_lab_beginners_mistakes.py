"""What `rmr check` says of lab files that beginners write: each wrong line, and the output, stand in one file.

Run with RMR_REWRITE=1 to write the outputs anew, and review them as a diff.
"""

import difflib
import os
from pathlib import Path

import pytest

from rmr_lab.lab_check import check

PAGE = Path(__file__).with_name("beginners_mistakes.txt")
RULER = "----\n"
PROGRAM = """\
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
type !due(robot, float).
start(R).
start(R), due(R, D) -o go(R, D).
go(R, D) -o moveto(R, yard).
"""
LAB = """\
lab: room
program: room.rmr
finish: at(R, yard)
arena: {size: [3.0, 1.5]}
areas:
  yard: {slots: [[2.5, 0.3], [2.5, 0.8]]}
robots:
  - {id: 1, pose: [0.5, 0.3, 0deg]}
  - {id: 2, pose: [0.8, 0.3, 0deg]}
facts:
  - due(@1, 30)
"""


def r(right, wrong):
    """Return the lab with one thing replaced."""
    assert right in LAB
    return LAB.replace(right, wrong, 1)


LABS = [
    r("[0.5, 0.3, 0deg]", "[0.5, 0.3, 90]"),
    r("lab: room\n", ""),
    r("lab: room", "lab: My Room"),
    r("program: room.rmr\n", ""),
    r("program: room.rmr", "program: rom.rmr"),
    r("program: room.rmr", "program: room.txt"),
    r("finish: at(R, yard)", "finish: at(yard)"),
    r("finish: at(R, yard)", "finish: at(@1, yard)"),
    r("finish: at(R, yard)", "finish: at(R, yrad)"),
    r("finish: at(R, yard)", "finish: at(R, Yard)."),
    r("finish: at(R, yard)", "finish: at(R, A)"),
    r("finish: at(R, yard)", "finish: done(R)"),
    r("finish: at(R, yard)", "finish: all at yard"),
    r("size: [3.0, 1.5]", "size: 3.0 x 1.5"),
    r("size: [3.0, 1.5]", "width: 3, height: 1.5"),
    r("size: [3.0, 1.5]", "size: [300cm, 150cm]"),
    r("arena:", "area:"),
    r("areas:\n", "area:\n"),
    r("  yard: {slots", "  Yard: {slots"),
    r("slots: [[2.5, 0.3], [2.5, 0.8]]", "slots: [2.5, 0.3]"),
    r("slots: [[2.5, 0.3], [2.5, 0.8]]", "pos: [2.5, 0.3]"),
    r("slots: [[2.5, 0.3], [2.5, 0.8]]", "[2.5, 0.3]"),
    r("{slots: [[2.5, 0.3], [2.5, 0.8]]}", "[2.5, 0.3]"),
    r("id: 1, pose: [0.5, 0.3, 0deg]", "id: 1, pose: [0.5, 0.3]"),
    r("id: 1, pose", "name: r1, pose"),
    r("id: 1, pose: [0.5, 0.3, 0deg]", "id: 1, x: 0.5, y: 0.3"),
    r("id: 1, pose", "id: @1, pose"),
    r("id: 1, pose", "id: '1', pose"),
    r("id: 2", "id: 1"),
    r("0.3, 0deg]}\n  - {id: 2", "0.3, 90°]}\n  - {id: 2"),
    r("0.3, 0deg]}\n  - {id: 2", "0.3, east]}\n  - {id: 2"),
    r("  - {id: 1, pose: [0.5, 0.3, 0deg]}\n", "  1: {pose: [0.5, 0.3, 0deg]}\n"),
    r("robots:\n  - {id: 1, pose: [0.5, 0.3, 0deg]}\n  - {id: 2, pose: [0.8, 0.3, 0deg]}", "robots: 2"),
    r("  - due(@1, 30)", "  - due(1, 30)"),
    r("  - due(@1, 30)", "  - due(@1, 30)."),
    r("  - due(@1, 30)", "  - due(@1, 30s)"),
    r("  - due(@1, 30)", "  - due(@1)"),
    r("  - due(@1, 30)", "  - due(@3, 30)"),
    r("  - due(@1, 30)", "  - deu(@1, 30)"),
    r("facts:\n  - due(@1, 30)", "facts: [due(@1, 30), due(@2, 30)]"),
    r("  - due(@1, 30)", "  - !due(@1, 30)"),
    r("  - due(@1, 30)", "  - due(@1, D)"),
    r("  - due(@1, 30)", "  - due: [1, 30]"),
    LAB + "duration: 2 minutes\n",
    LAB + "duration: 90 s\n",
    LAB + "durration: 90s\n",
    LAB + "\tseed: 1\n",
    LAB + "seed 1\n",
    LAB + "obstacles:\n  - [1.2, 0, 1.8, 0.6]\n",
    LAB + "obstacles:\n  - {rect: [1.2, 0, 1.8, 0.6]}\n",
    LAB + "obstacles:\n  - {box: [1.2, 0, 0.6, 0.6]}\n",
    LAB + "obstacles: {box: [1.2, 0, 1.8, 0.6]}\n",
    LAB + "bottleneck: gate\n",
    LAB + "bottleneck: [yard, yard]\n",
    LAB + "robot: {radius: 7}\n",
    LAB + "robot: {radius: 7cm}\n",
    LAB + "robot: {speed: 0.2m/s}\n",
    LAB + "actions: act.py\n",
    LAB + "actions: act\n",
    LAB + "actions: [act.py]\n",
    LAB + "faults:\n  - {at: 5s, kill: 9}\n",
    LAB + "faults:\n  - {kill: 1}\n",
    LAB + "faults:\n  - {at: 5, stop: 1}\n",
    LAB + "radio: {loss: 50%}\n",
    LAB + "radio: {range: 2}\n",
    "",
    "- a\n",
    PROGRAM,
    LAB + "localisation: {beacons: [0, 0]}\n",
    r("]}\n  - {id: 2", "]\n  - {id: 2"),
    r("lab: room", 'lab: "room'),
    r("pose: [0.5, 0.3, 0deg]", "pose: [0,5, 0,3, 0deg]"),
]


def section(folder, text):
    """Return what is wrong in `text`, the lines that differ from the right lab, and what is said of them."""
    (folder / "lab.yaml").write_text(text, encoding="utf-8")
    (folder / "room.rmr").write_text(PROGRAM, encoding="utf-8")
    found = check(folder / "lab.yaml")
    lines = [line for line in difflib.ndiff(LAB.splitlines(), text.splitlines()) if line[0] in "+-"]
    return "\n".join(lines[:6]) + "\n" + found.text(color=False).replace(f"{folder}/", "")


@pytest.mark.parametrize("number", range(len(LABS)))
def test_wrong_lab_file_of_a_beginner_is_reported_as_on_the_page(tmp_path, number):
    found = section(tmp_path, LABS[number])
    if os.environ.get("RMR_REWRITE"):
        with PAGE.open("w" if number == 0 else "a", encoding="utf-8") as page:
            page.write(found + RULER)
    else:
        assert found == PAGE.read_text(encoding="utf-8").split(RULER)[number]
