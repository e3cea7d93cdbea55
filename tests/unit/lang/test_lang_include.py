"""Programs of several files: what is read, how often, and where mistakes are shown."""

import os
from pathlib import Path

import pytest
from command_runner import invoke

from rmr.commands.subcommands import command as main
from rmr.lang.compiler import compile_file
from rmr.lang.diagnostics.render import render_text, to_json
from rmr.lang.read import include
from rmr.lang.read.include import CHARACTERS_MAX, DEPTH_MAX, FILES_MAX, LIBRARY, library_files
from rmr.lang.read.source_text import SOURCE_OCTETS_MAX
from rmr.lang.read.syntax import ConstantItem


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def compiled(files, main="main.rmr"):
    """Write `files` and compile the main one, named as a person in this folder would."""
    for name, text in files.items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return compile_file(Path(main))


def told(compilation):
    """Return each diagnostic's code, its file, and the text that it underlines."""
    sources = compilation.sources
    return [
        (each.code, each.span.file, sources[each.span.file].text[each.span.start : each.span.end])
        for each in compilation.diagnostics
    ]


def names(compilation):
    return [each.name for each in compilation.program.predicates]


def test_items_stand_in_the_place_of_the_include():
    files = {"main.rmr": 'a(R). include "b.rmr". a(R) -o c(R). c(R) -o 1.', "b.rmr": "a(R) -o b(R). b(R) -o 1."}
    program = compiled(files).program
    assert [program.predicates[rule.body[0].predicate].name for rule in program.rules] == ["a", "b", "a", "c"]
    assert [(each.file, each.column) for each in program.debug.rules][:3] == [
        ("b.rmr", 1),
        ("b.rmr", 15),
        ("main.rmr", 24),
    ]


def test_a_path_is_relative_to_the_file_that_includes():
    files = {
        "labs/main.rmr": 'include "parts/one.rmr". include "../common/two.rmr".',
        "labs/parts/one.rmr": 'include "three.rmr". p(R, Y).',
        "labs/parts/three.rmr": "three(R, X).",
        "common/two.rmr": "two(R, Z).",
    }
    assert told(compiled(files, "labs/main.rmr")) == [
        ("E023", "labs/parts/one.rmr", "Y"),
        ("E023", "labs/parts/three.rmr", "X"),
        ("E023", "common/two.rmr", "Z"),
    ]


def test_a_file_is_included_once_however_it_is_spelt():
    files = {
        "main.rmr": 'include "a.rmr". include "./a.rmr". include "link.rmr". include "x/../a.rmr".',
        "a.rmr": 'type p(robot). include "b.rmr".',
        "b.rmr": "type q(robot).",
        "x/y.rmr": "",
    }
    Path("link.rmr").symlink_to("a.rmr")
    compilation = compiled(files)
    assert names(compilation) == ["p", "q"]
    assert list(compilation.sources) == ["main.rmr", "a.rmr", "b.rmr"]


def test_include_cycle_is_an_error_that_shows_the_cycle():
    files = {"main.rmr": 'include "a.rmr".', "a.rmr": 'include "b.rmr". p(R, X).', "b.rmr": '\ninclude "a.rmr".'}
    compilation = compiled(files)
    assert told(compilation) == [("E023", "a.rmr", "X"), ("E009", "b.rmr", 'include "a.rmr".')]
    circle = compilation.diagnostics[1]
    assert circle.message == "the file includes itself: a.rmr -> b.rmr -> a.rmr"
    assert [(note.span.file, note.message) for note in circle.notes] == [("a.rmr", "includes `b.rmr`")]


def test_file_that_includes_itself_is_an_include_cycle():
    compilation = compiled({"main.rmr": 'include "main.rmr".'})
    assert compilation.diagnostics[0].message == "the file includes itself: main.rmr -> main.rmr"


@pytest.mark.parametrize(
    ("octets", "message"),
    [
        (None, "no such file"),
        (b"p(R, \xe9).", "not UTF-8 at octet 5"),
        (b"RMR\x1a\x02", "this is byte-code, not source"),
        (b" " * (SOURCE_OCTETS_MAX + 1), "the file is larger than 4 MiB"),
    ],
)
def test_unreadable_file_is_an_error_at_its_include(octets, message):
    files = {"main.rmr": 'p(R).\ninclude "part.rmr".'} | ({} if octets is None else {"part.rmr": octets})
    compilation = compiled(files)
    assert told(compilation) == [("E003", "main.rmr", 'include "part.rmr".')]
    assert compilation.diagnostics[0].message == f"cannot include `part.rmr`: {message}"
    assert not compilation.unreadable


def test_a_folder_and_a_pipe_are_no_files():
    Path("folder").mkdir()
    os.mkfifo("pipe.rmr")
    compilation = compiled({"main.rmr": 'include "folder". include "pipe.rmr". include "". include "a\\0b".'})
    assert [code for code, _, _ in told(compilation)] == ["E003", "E003", "E003", "E003", "E001"]


def test_a_misspelt_file_gets_the_name_of_one_that_is_there():
    compilation = compiled({"main.rmr": 'include "parts/formtion.rmr".', "parts/formation.rmr": ""})
    assert compilation.diagnostics[0].hint == "did you mean `formation.rmr`?"


def test_absent_include_suppresses_undefined_name_errors():
    rule = "p(R), X = total + 1, X > 2 -o q(R, X), alarm(R), t(R, Y)."
    text = f'include "absent.rmr". {rule} assert(p(R), q(R, 1), 2, alarm(R)).'
    assert told(compiled({"main.rmr": text})) == [
        ("E003", "main.rmr", 'include "absent.rmr".'),
        ("E030", "main.rmr", "Y"),
    ]


def test_mistakes_across_files_are_shown_with_both_files():
    files = {"main.rmr": 'include "a.rmr".\ntype p(robot).\n', "a.rmr": "type p(robot, int).\n"}
    compilation = compiled(files)
    text = render_text(compilation.diagnostics, compilation.sources, color=False)
    assert text == (
        "main.rmr:2:6: error[E010]: `p` is declared twice\n"
        "    2 | type p(robot).\n"
        "      |      ^\n"
        "a.rmr:1:6: note: first declared here\n"
        "    1 | type p(robot, int).\n"
        "      |      -\n"
        "  hint: drop one of them\n"
    )
    assert [each["file"] for each in to_json(compilation.diagnostics, compilation.sources)] == ["main.rmr"]


def test_syntax_error_in_an_included_file_suppresses_undefined_name_errors():
    files = {"main.rmr": 'include "a.rmr". q(R) -o moveto(R, b). q(R).', "a.rmr": "type action moveto[robot](area)."}
    assert [code for code, _, _ in told(compiled(files))] == ["E001"]


def test_depth_number_and_size_of_files_are_bounded():
    deep = {f"f{k}.rmr": f'include "f{k + 1}.rmr".' for k in range(DEPTH_MAX + 5)}
    assert [code for code, _, _ in told(compiled(deep, "f0.rmr"))] == ["E008"]
    wide = {f"g{k}.rmr": "" for k in range(FILES_MAX)}
    includes = "".join(f'include "g{k}.rmr".\n' for k in range(FILES_MAX))
    assert [code for code, _, _ in told(compiled({"wide.rmr": includes} | wide, "wide.rmr"))] == ["E008"]
    count = CHARACTERS_MAX // SOURCE_OCTETS_MAX + 2
    large = {f"h{k}.rmr": "\n" * SOURCE_OCTETS_MAX for k in range(count)}
    includes = "".join(f'include "h{k}.rmr".\n' for k in range(count))
    assert [code for code, _, _ in told(compiled({"large.rmr": includes} | large, "large.rmr"))] == ["E008"]


# ---- the library


GRADIENT = 'include "std/gradient.rmr".\ngradient_source(@1, home).\n'


def test_a_file_of_the_library_is_found_wherever_the_including_file_is():
    files = {"labs/deep/main.rmr": 'include "../part.rmr".', "labs/part.rmr": GRADIENT}
    compilation = compiled(files, "labs/deep/main.rmr")
    assert compilation.diagnostics == []
    assert "gradient_hops" in names(compilation)
    assert {each.file for each in compilation.program.debug.rules} == {"std/gradient.rmr"}, "wherever RMR is installed"


def test_a_file_beside_the_includer_comes_before_that_of_the_library():
    compilation = compiled({"main.rmr": 'include "std/gradient.rmr". mine(@1) -o 1.', "std/gradient.rmr": "mine(R)."})
    assert [each.file for each in compilation.included] == ["std/gradient.rmr"]
    assert names(compilation) == ["mine"]


def test_a_missing_file_of_the_library_names_those_that_exist():
    files = ", ".join(library_files())
    compilation = compiled({"main.rmr": 'include "std/gradeint.rmr".\ninclude "std/zzzzzzzz.rmr".'})
    assert told(compilation) == [
        ("E003", "main.rmr", f'include "std/{each}.rmr".') for each in ("gradeint", "zzzzzzzz")
    ]
    assert [each.hint for each in compilation.diagnostics] == [
        f"did you mean `std/gradient.rmr`? The library has {files}",
        f"the library has {files}",
    ]


def test_a_mistake_that_meets_a_file_of_the_library_names_the_file():
    compilation = compiled({"main.rmr": f"{GRADIENT}type gradient_source(robot)."})
    text = render_text(compilation.diagnostics, compilation.sources, color=False)
    assert "main.rmr:3:6: error[E010]: `gradient_source` is declared twice" in text
    assert f"{LIBRARY / 'gradient.rmr'}:" in text
    swapped = compiled({"main.rmr": "gradient_source(@1).\n" + GRADIENT})
    assert [code for code, _, _ in told(swapped)] == ["E011"]


def test_each_file_of_the_library_is_a_program_whose_names_begin_with_those_of_the_library():
    stems = {each.removeprefix("std/").removesuffix(".rmr") for each in library_files()}
    for name in library_files():
        compilation = compiled({"main.rmr": f'include "{name}".'})
        assert [each.code for each in compilation.diagnostics if each.code != "W115"] == [], name
        known = compilation.checked.names
        made = {each.name for each in compilation.checked.ensemble.made}
        own = {each.name for each in known.signatures.values() if not each.provided} - made
        constants = {each.name.text for each in compilation.module.items if isinstance(each, ConstantItem)}
        found = {*own, *known.functions, *constants}
        assert {each for each in found if each.split("_")[0] not in stems or "_" not in each} == set(), name


def test_fix_leaves_the_library_alone(monkeypatch):
    folder = Path("installed").resolve()
    folder.mkdir()
    (folder / "part.rmr").write_text("p(R)\n")
    monkeypatch.setattr(include, "LIBRARY", folder)
    Path("main.rmr").write_text('include "std/part.rmr".\nq(R)\n')
    invoke(main, ["check", "--fix", "main.rmr"])
    assert (Path("main.rmr").read_text(), (folder / "part.rmr").read_text()) == (
        'include "std/part.rmr".\nq(R).\n',
        "p(R)\n",
    )
