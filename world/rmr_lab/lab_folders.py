"""Folders with a lab, which begin with a copy of a provided one (`rmr lab copy`) or from templates (`rmr new`).

The program of a provided lab may be in another folder. The copy then holds the program itself, and its lab file names
that one. The lab of the templates runs unchanged and is a small example of each part: a floor, a program with a time
assertion, an action in Python, a test. Existing files are never overwritten.
"""

import re
from pathlib import Path

from rmr import __version__
from rmr.base.file_errors import naming
from rmr_world.document import read
from rmr_world.provided_labs import LAB_FILE, missing, provided_labs

SCHEMA_FILE = "lab.schema.json"
HEADER = f"# yaml-language-server: $schema={SCHEMA_FILE}\n"
"""First line of a lab file: editors find the schema of the file by it."""
_PROGRAM = re.compile(r"^program:[^\n#]*", re.MULTILINE)


class CopyError(Exception):
    """A copy was refused before anything was written; the message gives the reason."""


def about(folder: Path) -> str:
    """Return the first comment line of the lab file in `folder`, or an empty string."""
    lines = (folder / LAB_FILE).read_text(encoding="utf-8").splitlines()
    comments = [line.removeprefix("#").strip() for line in lines if line.startswith("# ") and "$schema" not in line]
    return comments[0] if comments else ""


def copy(name: str, folder: Path) -> list[Path]:
    """Copy the provided lab `name` to `folder`, which must not exist; return the files that were written.

    Raises CopyError, or OSError when a file cannot be written.
    """
    source = provided_labs().get(name)
    if source is None:
        raise CopyError(missing(Path(name)))
    refuse_existing(folder)
    folder.mkdir(parents=True)
    written = []
    for file in sorted(source.iterdir()):
        if not file.is_file():
            continue
        text = file.read_text(encoding="utf-8")
        if file.suffix == ".yaml":
            text, program = _copied_lab_file(text, file)
            if program is not None and not (source / program.name).exists():
                written.append(write_file(folder / program.name, program.read_text(encoding="utf-8")))
        written.append(write_file(folder / file.name, text))
    written.append(write_schema(folder))
    return sorted(set(written))


def refuse_existing(folder: Path) -> None:
    """Raise CopyError if `folder` exists."""
    if folder.exists() or folder.is_symlink():
        raise CopyError(f"{folder} is there already, and nothing is ever overwritten; name a folder that is new")


def write_schema(folder: Path) -> Path:
    """Write the schema of the lab file into `folder`, for editors; return the file."""
    import json  # noqa: PLC0415

    from rmr_world.schema import json_schema  # noqa: PLC0415 - pydantic loads only where it is needed

    return write_file(folder / SCHEMA_FILE, json.dumps(json_schema(), indent=1) + "\n")


def _copied_lab_file(text: str, file: Path) -> tuple[str, Path | None]:
    """Return the text of the copied lab file, with the header and the bare name of its program, and the program's path.

    The path is that of the original program; None where the lab file names none.
    """
    value = read(file).value
    name = value.get("program") if isinstance(value, dict) else None
    if not isinstance(name, str):
        return HEADER + text, None
    program = (file.parent / name).resolve()
    return HEADER + _PROGRAM.sub(f"program: {program.name}", text, count=1), program


def write_file(file: Path, text: str) -> Path:
    """Write `text` to `file` in UTF-8; return `file`. Raises OSError."""
    with naming(file):
        file.write_text(text, encoding="utf-8")
    return file


# ---- rmr new

LAB_NAME = re.compile(r"[a-z][a-z0-9_-]{0,63}")
"""Valid names of labs, as in the lab file (`rmr_world.schema.LAB_NAME`)."""

LAB = """\
# Three robots drive to a shelf and pack there, one at a time, each by its deadline.
lab: NAME
program: NAME.rmr
actions: actions.py
seed: 1
duration: 60s
finish: packed(R)

arena: {size: [2.4, 1.6], cell: 0.05}
obstacles:
  - {box: [1.1, 0.0, 1.3, 0.6]}
areas:
  shelf: {slots: [[2.1, 0.4], [2.1, 0.8], [2.1, 1.2]]}

robots:
  - {id: 1, pose: [0.3, 0.4, 0deg]}
  - {ids: 2-3, grid: {from: [0.3, 0.8], step: [0.0, 0.4], columns: 1}}
facts:
  - due(@1, 30)
  - due(@2, 25)
  - due(@3, 40)
"""

PROGRAM = """\
// Three robots drive to a shelf and pack there, one at a time, each by its deadline.
//
// The time assertion makes packing an event of the whole group: the robots elect a leader, which orders them by
// deadline, and the action that leads to its finish, `pack`, waits for the robot's turn.

type action moveto(R: robot, A: area) -o at(R, A).
type action pack(R: robot, T: float) -o packed(R) else dropped(R).
type action say(robot, string).
type sensor at(robot, area).
type !due(robot, float).  // seconds; the lab file says who is due when

start(R).

start(R) -o moveto(R, shelf), waiting(R).
waiting(R), at(R, shelf), due(R, D) -o ready(R, D).

packing: assert(ready(R, D), packed(R), D, say(R, "too late")).

ready(R, _) -o pack(R, 2.0).
dropped(R) -o pack(R, 2.0).
"""

ACTIONS = '''\
"""Handlers of the program's own actions."""

from rmr import ActionFailed, RobotHandle, action


@action("pack")
async def pack(robot: RobotHandle, seconds: float) -> None:
    """Pack for some time; fail if the robot is pushed meanwhile."""
    await robot.sleep(seconds)
    if robot.sense().bumped:
        raise ActionFailed("pushed while packing")
    robot.say(f"packed after {robot.now():.1f} s")
'''

TEST = '''\
"""Runs the lab in virtual time: `pytest`."""

from collections.abc import Callable

from rmr import Run


def test_all_robots_finish(rmr_sim: Callable[..., Run]) -> None:
    run = rmr_sim("lab.yaml", seed=1)
    assert run.finished
'''

CI = {
    ".github/workflows/lab.yml": """\
# Checks, tests and simulates the lab at every push. In a larger repository: move .github to its root, and set LAB.
name: lab
on: [push, pull_request]
permissions: {contents: read}
env: {LAB: .}
jobs:
  lab:
    runs-on: ubuntu-latest
    timeout-minutes: 20
    steps:
      - uses: actions/checkout@v4
      - uses: actions/setup-python@v5
        with: {python-version: "3.12"}
      - run: pip install 'rmr-robots~=VERSION' pytest
      - run: rmr check "$LAB"
      - run: pytest "$LAB"
      - run: rmr sim "$LAB" --seeds 1-20
""",
    ".gitlab-ci.yml": """\
# Checks, tests and simulates the lab at every push. In a larger repository: move this file to its root, and set LAB.
lab:
  image: python:3.12
  timeout: 20 minutes
  variables: {LAB: .}
  script:
    - pip install 'rmr-robots~=VERSION' pytest
    - rmr check "$LAB"
    - pytest "$LAB"
    - rmr sim "$LAB" --seeds 1-20
""",
}
"""File -> what a CI does with the lab, there."""

README = """\
# NAME

    rmr check . --svg floor.svg     # all that is judged before a run, and a picture of the floor
    rmr sim .                       # the run in virtual time, the same for the same --seed
    rmr up .                        # the same with a process for each robot
    pytest                          # the test, which runs the lab; pip install pytest, if it is not there

`lab.yaml` is the floor, `PROGRAM` what all robots do.ACTIONS
`.github` and `.gitlab-ci.yml` check, test and simulate the lab at every push; their first line says what to set.
Editors that know YAML complete `lab.yaml` by `lab.schema.json`; `rmr lab schema` prints that of a newer RMR.
"""


def write_lab(folder: Path, origin: str | None = None) -> list[Path]:
    """Write a lab named like `folder`, which must not exist; `origin` is the name of a provided lab to copy.

    Returns the files that were written. Raises CopyError, or OSError when a file cannot be written.
    """
    name = folder.resolve().name
    if LAB_NAME.fullmatch(name) is None:
        raise CopyError(f"'{name}' cannot be the name of a lab: small letters, digits, _ and -, a letter first")
    refuse_existing(folder)
    if origin is not None:
        return _from_provided(folder, name, origin)
    texts = {LAB_FILE: HEADER + LAB, f"{name}.rmr": PROGRAM, "actions.py": ACTIONS}
    folder.mkdir(parents=True)
    written = [write_file(folder / file, text.replace("NAME", name)) for file, text in texts.items()]
    about = " `actions.py` has the program's action in Python."
    return sorted([*written, write_schema(folder), *_write_rest(folder, name, f"{name}.rmr", about)])


def _from_provided(folder: Path, name: str, origin: str) -> list[Path]:
    """Copy the files of the provided lab `origin` and set the name in its lab file."""
    files = copy(origin, folder)
    file = folder / LAB_FILE
    text = file.read_text(encoding="utf-8")
    write_file(file, re.sub(r"^lab:[^\n#]*", f"lab: {name}", text, count=1, flags=re.MULTILINE))
    program = next(each.name for each in files if each.suffix in {".rmr", ".rbc"})
    return sorted([*files, *_write_rest(folder, name, program, "")])


def _write_rest(folder: Path, name: str, program: str, actions: str) -> list[Path]:
    """Write what every lab has: test, README, and what a CI does with it."""
    texts = {
        f"test_{name.replace('-', '_')}.py": TEST,
        "README.md": README.replace("NAME", name).replace("PROGRAM", program).replace("ACTIONS", actions),
        **{file: text.replace("VERSION", __version__) for file, text in CI.items()},
    }
    (folder / ".github" / "workflows").mkdir(parents=True)
    return [write_file(folder / file, text) for file, text in texts.items()]
