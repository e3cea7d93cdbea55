"""`rmr lab check`, which `rmr check LAB` becomes: findings for people or as JSON, and the picture."""

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rmr.entry import ExitCode
from rmr_lab.explained_lab import ExplainedLab, show
from rmr_lab.explained_lab import explain as explain_lab
from rmr_lab.lab_check import ERROR, CheckResult, check
from rmr_lab.picture import draw
from rmr_world.bound import bound_s, destinations
from rmr_world.lab import Lab
from rmr_world.narrow_places import narrow_places
from rmr_world.validate.first_instant import first_destinations


def perform(paths: Sequence[Path], *, as_json: bool, explain: bool, svg: Path | None, execute: bool) -> int:
    """Check `paths`, print the findings, explain the labs, draw one if `svg` is given; return the exit code.

    `execute`: Python files of the labs are executed.
    """
    found = [check(path, execute=execute) for path in paths]
    explained = _explained(found) if explain else []
    if as_json:
        listed = [entry for each in found for entry in each.as_json()]
        labs = {"labs": [asdict(each) for each in explained]}
        print(json.dumps({"diagnostics": listed, "explanation": labs} if explain else listed, indent=2))
    else:
        _show(found)
        print("\n".join(map(show, explained)), end="")
    code = _exit_code(found)
    if svg is not None:
        code = _draw(found[0], svg, explain=explain) or code
    return code


def _explained(found: Sequence[CheckResult]) -> list[ExplainedLab]:
    """Return the explanations of the labs without errors."""
    return [
        explain_lab(str(each.path), each.lab, each.program)
        for each in found
        if each.lab is not None and each.program is not None and ERROR not in each.severities
    ]


def _show(found: Sequence[CheckResult]) -> None:
    color = sys.stderr.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    for each in found:
        print(each.text(color), end="", file=sys.stderr)
    severities = [severity for each in found for severity in each.severities]
    errors = severities.count(ERROR)
    if severities:
        print(f"{_counted(errors, 'error')}, {_counted(len(severities) - errors, 'warning')}", file=sys.stderr)
    for each in found:
        if each.lab is not None and ERROR not in each.severities:
            print(f"{each.path}: {_in_short(each.lab)}", file=sys.stderr)


def _counted(number: int, word: str) -> str:
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _in_short(lab: Lab) -> str:
    least_s = bound_s(lab)
    bound = f"; no schedule finishes sooner than {least_s:.2f} s" if 0.0 < least_s < float("inf") else ""
    return f"{_counted(len(lab.robots), 'robot')}, {_counted(len(lab.arena.areas), 'area')}{bound}"


def _exit_code(found: Sequence[CheckResult]) -> int:
    if any(ERROR in each.severities and not each.unreadable for each in found):
        return ExitCode.INVALID
    return ExitCode.USAGE if any(each.unreadable for each in found) else 0


def _draw(found: CheckResult, svg: Path, *, explain: bool) -> int:
    """Write the picture, with the narrow passages if it is to `explain`; return the exit code."""
    lab = found.lab
    if lab is None:
        print(f"{svg} is not drawn: the lab file has errors", file=sys.stderr)
        return ExitCode.INVALID
    goals = destinations(lab) if found.program is None else first_destinations(lab, found.program)
    try:
        passages = narrow_places(lab.arena).passages if explain else ()
        svg.write_text(draw(lab, goals, passages), encoding="utf-8")
    except OSError as error:
        print(f"{svg}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE
    return 0
