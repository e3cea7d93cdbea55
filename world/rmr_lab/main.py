"""The commands `rmr lab`, `rmr new` and `rmr check LAB`: their options alone, so that `--help` costs little."""
# ruff: noqa: PLC0415 - what does the work loads when it is asked for

import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rmr.entry import ExitCode, print_json, run
from rmr.entry.command_line import Command, CommandGroup, CommandLineError, Parser, Runnable, Subcommand
from rmr_world.provided_labs import existing_lab, provided_labs

# --- rmr check LAB


def _declare_check(parser: Parser) -> None:
    parser.positional("paths", "LAB", read=existing_lab, count="+", usage="LAB...")
    parser.flag("--json", dest="as_json", help="Print the findings as one JSON document on stdout.")
    parser.flag("--explain", help="Also list the passages, who needs them, and what turns cover.")
    parser.option("--svg", metavar="FILE", read=Path, help="Draw the lab: floor, areas, robots and their ways.")
    parser.option("--hosts", metavar="FILE", read=Path, help="Also check the hosts over which the lab is spread.")
    parser.flag("--no-code", help="Execute no Python file: those of actions and events are not checked.")


def _check(paths: list[Path], as_json: bool, explain: bool, svg: Path | None, hosts: Path | None, no_code: bool) -> int:
    """Check labs, and programs by themselves; return the exit code."""
    from rmr_lab.lab_check import perform

    if svg is not None and len(paths) != 1:
        raise CommandLineError("--svg draws one lab: name one")
    if svg is not None and paths[0].suffix == ".rmr":
        raise CommandLineError("--svg draws a lab: name a lab file or its folder, not a program")
    if hosts is not None and (len(paths) != 1 or paths[0].suffix == ".rmr"):
        raise CommandLineError("--hosts goes with one lab: name its file, its folder or a provided lab")
    if explain and any(path.suffix == ".rmr" for path in paths):
        raise CommandLineError("--explain explains labs or programs: name one kind at a time")
    return perform(paths, as_json=as_json, explain=explain, svg=svg, hosts=hosts, execute=not no_code)


check = Command(
    """\
Check LAB, a lab.yaml, its folder or a provided lab, and all that is judged before it runs.

That is the lab file, its program, whether both fit, deadlines, ways, turns, and the files of actions and events.
These are Python files and are executed, as a run does: look into a lab that is not yours, or say --no-code.
A program, PROG.rmr, is checked by itself.
""",
    _declare_check,
    _check,
)

# --- rmr lab schema


def _declare_schema(parser: Parser) -> None:
    parser.option("-o", "--output", metavar="FILE", read=Path, help="Write it to FILE instead.")


def _schema(output: Path | None) -> int:
    """Print or write the schema; return the exit code."""
    from rmr_world.schema import json_schema

    text = json.dumps(json_schema(), indent=2) + "\n"
    if output is None:
        print(text, end="")
        return ExitCode.OK
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        print(f"{output}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE
    return ExitCode.OK


_SCHEMA = Command(
    """\
Print the JSON Schema (2020-12) of the lab file, for editors.

A lab file that begins with `# yaml-language-server: $schema=FILE` is completed and checked by them as it is
written.
""",
    _declare_schema,
    _schema,
)

# --- rmr lab list


def _declare_list(parser: Parser) -> None:
    parser.flag("--json", dest="as_json", help="Print the list as JSON on stdout.")


def _list(as_json: bool) -> None:
    """Print the provided labs."""
    from rmr_lab.lab_folders import about

    rows = [{"name": name, "about": about(folder), "folder": str(folder)} for name, folder in provided_labs().items()]
    if as_json:
        print_json({"labs": rows})
        return
    width = max((len(row["name"]) for row in rows), default=0)
    print("".join(f"{row['name'].ljust(width)}  {row['about']}\n" for row in rows), end="")


_LIST = Command(
    "List the labs that come with RMR: each runs by its name, in every folder, as in `rmr up corridor`.",
    _declare_list,
    _list,
)

# --- rmr lab copy, rmr new


def _declare_copy(parser: Parser) -> None:
    parser.positional("name", "NAME", read=str)
    parser.positional("folder", "DIR", count="?", usage="[DIR]")


def _copy(name: str, folder: Path | None) -> int:
    """Copy a provided lab; return the exit code."""
    from rmr_lab.lab_folders import copy as copy_lab

    target = Path(name) if folder is None else folder
    return _write("rmr lab copy", target, lambda: copy_lab(name, target))


_COPY = Command(
    "Copy the provided lab NAME, with its program, to DIR, which must not exist yet (default: NAME).",
    _declare_copy,
    _copy,
)


def _declare_new(parser: Parser) -> None:
    parser.positional("name", "NAME")
    parser.option("--from", dest="origin", metavar="LAB", help="Begin with the files of a provided lab (rmr lab list).")


def _new(name: Path, origin: str | None) -> int:
    """Write a lab; return the exit code."""
    from rmr_lab.lab_folders import write_lab

    return _write("rmr new", name, lambda: write_lab(name, origin))


new = Command(
    """\
Write a lab of your own into the folder NAME, which must not exist yet: it runs at once.

It holds the lab file, a program, an action in Python, a test, files for the CI of GitHub and GitLab, and a README that
says what to do with them.
""",
    _declare_new,
    _new,
)


def _write(shown: str, folder: Path, written: Callable[[], list[Path]]) -> int:
    """Write a lab into `folder` and print its files; return the exit code. `shown` is the command, for errors."""
    from rmr_lab.lab_folders import CopyError

    try:
        files = written()
    except CopyError as error:
        raise CommandLineError(str(error)) from None
    except OSError as error:
        print(f"{shown}: {error.filename or folder}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE
    for file in files:
        print(os.fspath(file))
    print(f"now: rmr check {folder} && rmr sim {folder} && rmr up {folder}", file=sys.stderr)
    return ExitCode.OK


def _entry(summary: str, command: Runnable) -> Subcommand:
    return Subcommand(summary, lambda: command)


command = CommandGroup(
    "List and copy labs; print the schema of the lab file.",
    {
        "schema": _entry("Print the JSON Schema of the lab file.", _SCHEMA),
        "list": _entry("List the provided labs.", _LIST),
        "copy": _entry("Copy a provided lab into a folder of your own.", _COPY),
    },
    {"check": "rmr check"},
)


def main(words: Sequence[str] | None = None, name: str = "rmr lab") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command.main(words, name))


def check_main(words: Sequence[str] | None = None, name: str = "rmr check") -> int:
    """Check labs in the name of the command that was given; return the exit code."""
    return run(name, lambda: check.main(words, name))


def new_main(words: Sequence[str] | None = None, name: str = "rmr new") -> int:
    """Run `rmr new`; return its exit code."""
    return run(name, lambda: new.main(words, name))


if __name__ == "__main__":
    sys.exit(main())
