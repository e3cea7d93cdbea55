"""`rmr check`: diagnostics, and with `--explain` why a program without errors does what it does."""
# ruff: noqa: PLC0415 - see rmr.commands

import os
import stat
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rmr.base.printable import counted
from rmr.commands import diagnosed
from rmr.commands.common import write
from rmr.entry import print_json
from rmr.entry.command_line import Command, CommandLineError, Parser

if TYPE_CHECKING:
    from rmr.lang.compiler import Compilation
    from rmr.lang.diagnostics.diagnostic import Fix


ABOUT = """\
Check programs and labs and print what is wrong with them.

LAB is a lab.yaml, its folder or a provided lab: checked is all that is judged before a run. Its Python files of
actions and events are executed, as a run does: look into a lab that is not yours, or say --no-code.
With --hosts also checked is a file that says which host has the world and which robots of the lab.

With --explain also print, for each program without errors, which rules lead to which goals, which actions serve
which time assertions and how, what each rule needs and sends, and whether all robots can be run at once; for each lab,
its passages, which robots need them, and what the turns of its time assertions cover. With --json that is one object.

With --fix the corrections of errors that the compiler knows are written into the programs and the files that they
include, and what remains is printed. Warnings are left alone: there the program may mean what it says.
"""


def _declare(parser: Parser) -> None:
    parser.positional("programs", "PROG.rmr|LAB", count="+", usage="PROG.rmr|LAB...")
    parser.flag("--json", dest="as_json", help="Print the diagnostics as one JSON document on stdout.")
    parser.flag("--fix", help="Correct the errors of programs where what to write is known.")
    parser.flag("--explain", help="Also say which rules reach which goals, and so on.")
    parser.option("--svg", metavar="FILE", read=Path, help="Draw a lab: floor, areas, robots and their ways.")
    parser.option("--hosts", metavar="FILE", read=Path, help="Also check the hosts over which a lab is spread.")
    parser.flag("--no-code", help="Execute no Python file of a lab: those of actions and events are not checked.")


def _check(
    programs: list[Path],
    as_json: bool,
    fix: bool,
    explain: bool,
    svg: Path | None,
    hosts: Path | None,
    no_code: bool,
) -> int:
    """Check programs; a command line with a lab is one for `rmr_lab`."""
    if svg is not None or hosts is not None or any(_is_lab(path) for path in programs):
        if fix:
            raise CommandLineError("--fix corrects programs: name the PROG.rmr of the lab")
        given = {"--json": as_json, "--explain": explain, "--no-code": no_code}
        flags = [flag for flag, is_given in given.items() if is_given]
        files = {"--svg": svg, "--hosts": hosts}
        options = [*flags, *(word for flag, file in files.items() if file for word in (flag, os.fspath(file)))]
        from rmr.commands.subcommands import OtherPackage

        return OtherPackage("rmr_lab.main:check_main").main([*options, "--", *map(os.fspath, programs)], "rmr check")
    from rmr.lang.compiler import compile_file

    code = 0
    compilations = [compile_file(path) for path in programs]
    # Behind a syntax error that has been corrected there may be further errors, which are corrected in the next pass.
    for _ in range(10 if fix else 0):
        if code or not any(each.fix for every in compilations for each in every.errors):
            break
        code = _correct(compilations)
        compilations = [compile_file(path) for path in programs]
    if not as_json:
        diagnosed.show(compilations)
    if explain:
        _explain(compilations, as_json)
    elif as_json:
        print_json({"diagnostics": diagnosed.as_json(compilations)})
    return code or diagnosed.exit_code(compilations)


def _correct(compilations: Sequence["Compilation"]) -> int:
    """Write the corrections of errors into the files that they concern, the library's not; return the exit code."""
    from rmr.lang.read.include import in_library

    fixes: dict[str, dict[Fix, None]] = {}  # each once: files may be included by several
    sources = {file: source for each in compilations for file, source in each.sources.items()}
    for error in [error for each in compilations for error in each.errors]:
        if error.fix is not None and not in_library(error.fix.span.file):
            fixes.setdefault(error.fix.span.file, {})[error.fix] = None
    code = 0
    for file, found in fixes.items():
        old = sources[file].text
        new = ""
        at = count = 0
        for each in sorted(found, key=lambda one: one.span.start):
            if each.span.start >= at:  # of two that overlap the first: what the other one is now is seen next time
                new += old[at : each.span.start] + each.text
                at = each.span.end
                count += 1
        target = Path(file).resolve()
        failed = write(target, (new + old[at:]).encode(), stat.S_IMODE(target.stat().st_mode))
        if not failed:
            print(f"{file}: {counted(count, 'error')} corrected", file=sys.stderr)
        code = code or failed
    return code


command = Command(ABOUT, _declare, _check)


def _is_lab(path: Path) -> bool:
    """Return whether `path` is a lab file, the folder of one, or a bare name that may be a provided lab's."""
    if path.is_dir():
        return (path / "lab.yaml").exists()
    return path.suffix in {".yaml", ".yml"} or (path.name == os.fspath(path) and not path.suffix and not path.exists())


def _explain(compilations: Sequence["Compilation"], as_json: bool) -> None:
    """Print the explanations of the programs without errors."""

    from rmr.lang.explain import explain
    from rmr.lang.explain.show import show

    explanations = [each for each in map(explain, compilations) if each is not None]
    if as_json:
        explanation = {"programs": [asdict(each) for each in explanations]}
        print_json({"diagnostics": diagnosed.as_json(compilations), "explanation": explanation})
    else:
        print("\n".join(map(show, explanations)), end="")
