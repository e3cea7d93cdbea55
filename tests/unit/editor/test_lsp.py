"""`rmr lsp` as an editor meets it: a client that speaks the protocol over the pipes of a process."""

import json
import os
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest
from lsp_client import LspClient, LspError, span

from rmr.lang.compiler import compile_file
from rmr.lang.diagnostics.render import to_json
from rmr.lang.read.include import LIBRARY, library_files
from rmr_editor.programs import Lines

pytestmark = pytest.mark.medium
FACE = "\U0001f600"
URI = "untitled:a.rmr"


@pytest.fixture
def editor():
    with LspClient("--stdio") as client:
        yield client.initialize()


def codes(diagnostics):
    return [each["code"] for each in diagnostics]


# ---- diagnostics


def test_every_error_and_warning_comes_at_once_with_its_place_its_page_and_its_hint(editor, tmp_path):
    path = tmp_path / "a.rmr"
    text = f"type p(robot, int).\n/* {FACE} */ p(R, one), q(R) -> r(R).\np(R).\nlocation(R, L), L = S -o 1.\n"
    path.write_text(text)
    editor.open(path.as_uri(), text)
    found = editor.diagnostics(path.as_uri())
    compilation = compile_file(path)
    expected = to_json(compilation.diagnostics, compilation.sources)
    assert codes(found) == [each["code"] for each in expected]
    assert {"E001", "E011", "W102"} <= set(codes(found))
    for each, own in zip(found, expected, strict=True):
        wide = 1 if own["line"] == 2 else 0  # a face takes two units of UTF-16
        assert span(each) == (
            (own["line"] - 1, own["column"] - 1 + wide),
            (own["end_line"] - 1, own["end_column"] - 1 + wide),
        )
        assert each["severity"] == {"error": 1, "warning": 2}[own["severity"]]
        assert each["message"] == own["message"]
        related = [note["message"] for note in each.get("relatedInformation", [])]
        assert own["hint"] is None or related[0] == f"hint: {own['hint']}"
        page = unquote(urlparse(each["codeDescription"]["href"]).path)
        assert Path(page).read_text().startswith(f"# {each['code']}")
    notes = [note["message"] for each in found for note in each.get("relatedInformation", [])]
    assert "declared here" in notes


@pytest.mark.parametrize(("offered", "chosen", "units"), [("utf-8", "utf-8", 4), ("utf-32", "utf-32", 1)])
def test_positions_are_in_the_encoding_that_was_agreed_on(offered, chosen, units):
    with LspClient() as client:
        client.initialize(general={"positionEncodings": [offered, "utf-16"]})
        assert client.capabilities["positionEncoding"] == chosen
        client.open(URI, f"p(R). /* {FACE} */ p(R) -> 1.\n")
        [found] = client.diagnostics(URI)
        start = len("p(R). /* ") + units + len(" */ p(R) ")
        assert span(found) == ((0, start), (0, start + 2))


def test_an_editor_without_an_encoding_gets_utf_16_and_one_without_notes_the_hint_in_the_message():
    with LspClient() as client:
        client.initialize(general={}, textDocument={})
        assert client.capabilities["positionEncoding"] == "utf-16"
        client.open(URI, "p(R). p(R) -> 1.\n")
        [found] = client.diagnostics(URI)
        assert found["message"] == "unexpected `->`\nhint: a rule is written `body -o head.`"
        assert "relatedInformation" not in found


def test_edits_of_parts_and_of_the_whole_text_lead_to_the_text_that_the_editor_has(editor):
    editor.open(URI, f"p(R). // {FACE}\np(R) -o 1.\n")
    assert editor.diagnostics(URI, 1) == []
    behind_the_face = ((0, 11), (0, 11), "x")
    without_an_end = ((1, 0), (1, 4), f"p(R), /* {FACE} */ q(R, ")
    editor.change(URI, 2, behind_the_face, without_an_end, ((0, 0), (0, 0), "\n"))
    [found] = editor.diagnostics(URI, 2)
    assert (found["code"], found["range"]["start"]["line"]) == ("E001", 2)
    editor.change(URI, 3, "p(R).\np(R) -o 1.\n")
    assert editor.diagnostics(URI, 3) == []
    editor.change(URI, 4, ((0, 4), (7, 99), ""))
    assert codes(editor.diagnostics(URI, 4)) == ["E001"]


def test_edits_that_come_faster_than_compilations_end_with_the_last_one(editor):
    editor.open(URI, "p(R).\n")
    for version in range(2, 40):
        editor.change(URI, version, f"p(R).\np(R) -o 1{'.' * (version % 2)}\n")
    assert codes(editor.diagnostics(URI, 39)) == []


def test_texts_that_are_not_saved_stand_for_included_files(editor, tmp_path):
    part, main = tmp_path / "part.rmr", tmp_path / "main.rmr"
    part.write_text("p(R).\n")
    editor.open(main.as_uri(), 'include "part.rmr".\np(R) -o 1.\n')
    assert editor.diagnostics(main.as_uri(), 1) == []
    editor.open(part.as_uri(), "p(R, 1).\n")
    assert codes(editor.diagnostics(part.as_uri(), 1)) == []
    assert codes(editor.diagnostics(main.as_uri(), 1)) == ["E011"]
    editor.notify("textDocument/didClose", textDocument={"uri": part.as_uri()})
    assert editor.diagnostics(main.as_uri(), 1) == []


def test_errors_in_a_file_that_is_not_open_are_shown_and_taken_back(editor, tmp_path):
    part, main = tmp_path / "part.rmr", tmp_path / "main.rmr"
    part.write_text("p(R\n")
    editor.open(main.as_uri(), 'include "part.rmr".\n')
    assert codes(editor.diagnostics(part.as_uri())) == ["E001"]
    part.write_text("p(R).\np(R) -o 1.\n")
    change = {"uri": part.as_uri(), "type": 2}
    editor.notify("workspace/didChangeWatchedFiles", changes=[change])
    assert editor.diagnostics(part.as_uri()) == []


def test_what_was_said_about_a_closed_text_is_taken_back(editor):
    editor.open(URI, "p(R")
    assert codes(editor.diagnostics(URI)) == ["E001"]
    editor.notify("textDocument/didClose", textDocument={"uri": URI})
    assert editor.diagnostics(URI) == []


def test_the_server_asks_to_be_told_of_changes_on_disk():
    with LspClient() as client:
        client.initialize(workspace={"didChangeWatchedFiles": {"dynamicRegistration": True}})
        asked = client.next()
        assert asked["method"] == "client/registerCapability"
        [registration] = asked["params"]["registrations"]
        assert registration["registerOptions"]["watchers"] == [{"globPattern": "**/*.rmr"}]


# ---- beginning and end


def test_an_editor_that_says_so_ends_the_server(editor):
    assert editor.end() == (0, "")


def test_an_exit_without_a_shutdown_and_a_closed_pipe_are_no_orderly_end():
    with LspClient() as client:
        client.initialize().notify("exit")
        assert client.process.wait(60) == 1
    with LspClient() as client:
        client.initialize().process.stdin.close()
        assert client.process.wait(60) == 1
        assert b"Traceback" not in client.process.stderr.read()


def test_an_editor_that_dies_in_the_middle_leaves_no_traceback():
    with LspClient() as client:
        client.initialize()
        client.octets(b"Content-Length: 100\r\n\r\n{")
        client.process.stdin.close()
        assert client.process.wait(60) == 1
        said = client.process.stderr.read().decode()
        assert said.startswith("rmr lsp: the editor has broken off")
        assert said.count("\n") == 1


def test_an_editor_that_reads_nothing_any_more_leaves_no_traceback():
    reads, writes = os.pipe()
    words = [sys.executable, "-c", "from rmr.cli import main; main()", "lsp"]
    process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=writes, stderr=subprocess.PIPE)
    os.close(writes)
    os.close(reads)
    body = b'{"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": {"capabilities": {}}}'
    _, said = process.communicate(b"Content-Length: %d\r\n\r\n%b" % (len(body), body), timeout=60)
    assert (process.returncode, said) == (1, b"")


def test_a_person_who_starts_it_is_told_what_it_is_for():
    code = "from rmr.cli import main; main()"
    words = [sys.executable, "-c", code, "lsp"]
    result = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == "rmr lsp: an editor starts this command, with pipes as its stdin and stdout\n"


# ---- broken messages


def test_no_broken_message_ends_the_server_or_prints_a_traceback(editor):
    editor.octets(b"Content-Length: 3\r\n\r\n{a}")
    assert editor.answer()["error"] == {"code": -32700, "message": "the message is no JSON in UTF-8"}
    editor.octets(b"Content-Length: 2\r\n\r\n\xff\xfe")
    assert editor.answer()["error"]["code"] == -32700
    editor.octets(b"Content-Length: %d\r\n\r\n%b" % (100_000, b"[" * 100_000))
    assert editor.answer()["error"]["code"] == -32700
    for value in ([], 3, None, "x", {}, {"jsonrpc": "1.0", "id": 1}):
        editor.send(value)
        if value != {"jsonrpc": "1.0", "id": 1}:
            assert editor.answer()["error"]["code"] == -32600
    editor.octets(b"Content-Length: none\r\nNonsense\r\n\r\n")
    with pytest.raises(LspError, match="the parameters of `textDocument/hover` are not those of the protocol"):
        editor.request("textDocument/hover", textDocument=3)
    with pytest.raises(LspError, match="Method Not Found: rmr/nothing"):
        editor.request("rmr/nothing")
    editor.notify("rmr/nothing")
    editor.notify("textDocument/didOpen", textDocument=[])
    editor.change("file:///none.rmr", 1, "p")
    editor.open(URI, "p(R).\n")
    editor.change(URI, 2, ((5, 5), (1, 1), "p(R) -o 1.\n"), ((9, 9), (9, 9), "\ud800"))
    assert editor.diagnostics(URI, 2)
    logged = [each["params"]["message"] for each in editor.told if each.get("method") == "window/logMessage"]
    assert "rmr lsp: file:///none.rmr has not been opened" in logged
    assert not any("\n" in each or "Traceback" in each for each in logged)
    assert "Traceback" not in json.dumps(editor.told)
    assert editor.end() == (0, "")


def test_a_request_that_is_cancelled_is_answered_and_the_server_goes_on(editor):
    editor.open(URI, SHOP)
    place = {"textDocument": {"uri": URI}, "position": {"line": 0, "character": 13}}
    editor.send({"jsonrpc": "2.0", "id": 900, "method": "textDocument/hover", "params": place})
    editor.notify("$/cancelRequest", id=900)
    editor.notify("$/cancelRequest", id=901)  # nobody asked
    answer = editor.answer(900)
    assert answer["error"]["code"] == -32800
    assert editor.ask("hover", URI, (0, 13)) is not None
    assert editor.end() == (0, "")


def test_a_defect_of_the_compiler_is_one_sentence_and_the_next_text_is_compiled(tmp_path):
    path = tmp_path / "sitecustomize.py"
    path.write_text(
        "import rmr.lang.compiler as compiler\n"
        "whole = compiler.check\n"
        "def check(module, *more, **options):\n"
        "    if any(each.span.end == 8 for each in module.items):\n"
        "        raise KeyError('drawn by a test')\n"
        "    return whole(module, *more, **options)\n"
        "compiler.check = check\n"
    )
    with LspClient(PYTHONPATH=str(tmp_path)) as client:
        client.initialize().open(URI, "p(R, 1).\n")  # its item ends at 7
        assert client.diagnostics(URI, 1) == []
        client.change(URI, 2, "p(R, 12).\n")
        assert client.diagnostics(URI, 2) == []
        client.change(URI, 3, "p(R, 123).\nq(R).\n")
        assert client.diagnostics(URI, 3) == []
        told = [each["params"]["message"] for each in client.told if each.get("method") == "window/logMessage"]
        assert told == ["rmr lsp: a defect of the compiler: KeyError('drawn by a test')"]
        assert client.end() == (0, "")


def test_requests_before_the_first_and_behind_the_last_one_are_refused():
    with LspClient() as client:
        with pytest.raises(LspError, match="the first request is `initialize`"):
            client.ask("hover", URI, (0, 0))
        client.open(URI, "p(R).\n")
        client.initialize()
        client.request("shutdown")
        with pytest.raises(LspError, match="the server has been shut down; what is left is `exit`"):
            client.ask("hover", URI, (0, 0))


# ---- names

SHOP = """\
type action moveto(R: robot, A: area) -o at(R, A).
type !due(robot, float).  // seconds
const patience = 2 * 10.
fun late(T, D) = T > D + patience.

?arrived(R).
start(R).
!due(R, 30.0).

crossing: assert(crossing(R, D), at(R, exit), D, broadcast(R)).

start(R), !due(R, D), not (late(1.0, D)) -o crossing(R, D).
crossing(R, D), D > patience, [1] = [1] -o moveto(R, exit), seen(R, abs(D)).
at(R, exit) -o arrived(R).
seen(R, _) -o 1.
"""


def where(text, word, number=0, inside=0):
    """Return the position of the `number`-th occurrence of a word in a text."""
    offset = -1
    for _ in range(number + 1):
        offset = text.index(word, offset + 1)
    before = text[: offset + inside]
    return before.count("\n"), len(before) - before.rfind("\n") - 1


def spans(locations):
    return [(span(each), each["uri"]) for each in locations]


def named(text, word, *numbers):
    """Return the spans of some occurrences of a word."""
    return [(where(text, word, each), where(text, word, each, len(word))) for each in numbers]


@pytest.fixture
def shop(editor):
    editor.open(URI, SHOP)
    assert editor.diagnostics(URI) == []
    return editor


@pytest.mark.parametrize(
    ("word", "lines"),
    [
        (
            "moveto",
            [
                "type action moveto(R: robot, A: area) -o at(R, A).",
                "an action, declared in untitled:a.rmr, line 1",
                "Provided: drives to the area",
            ],
        ),
        ("due", ["type !due(robot, float).", "a persistent predicate, declared in untitled:a.rmr, line 2"]),
        ("crossing(", ["type crossing(robot, float).", "a temporary predicate, first used in untitled:a.rmr, line 10"]),
        ("arrived", ["type arrived(robot).", "a temporary predicate, first used in untitled:a.rmr, line 6; a goal"]),
        ("at(R, exit)", ["type sensor at(robot, area).", "Provided: the robot is in the area"]),
        ("late", ["fun late(T, D) = T > D + patience."]),
        ("patience", ["const patience = 2 * 10."]),
        ("abs", ["abs(X)", "of ints an int, else a float"]),
        ("D, ", ["D: float"]),
        ("crossing:", ["served by", "moveto(R, exit)", "its effect at(R, exit), the finish fact"]),
    ],
)
def test_hover_says_what_a_name_is(shop, word, lines):
    found = shop.ask("hover", URI, where(SHOP, word))
    assert [each for each in lines if each not in found["contents"]["value"]] == []
    assert found["contents"]["kind"] == "markdown"


def test_hover_over_nothing_says_nothing(shop):
    assert shop.ask("hover", URI, (4, 0)) is None
    assert shop.ask("hover", URI, where(SHOP, "seconds")) is None
    assert shop.ask("hover", "untitled:other.rmr", (0, 0)) is None


def test_definition_leads_to_the_declaration_or_the_first_use(shop):
    for word, used, declared in (("moveto", 1, 0), ("late", 1, 0), ("patience", 1, 0), ("seen", 1, 0), ("due", 2, 0)):
        found = shop.ask("definition", URI, where(SHOP, word, used, 1))
        assert [span(each) for each in found] == named(SHOP, word, declared), word


def test_references_are_all_places_and_without_the_declaration_if_that_is_asked(shop):
    found = shop.ask("references", URI, where(SHOP, "patience", 1), context={"includeDeclaration": True})
    assert [span(each) for each in found] == named(SHOP, "patience", 0, 1, 2)
    found = shop.ask("references", URI, where(SHOP, "due"), context={"includeDeclaration": False})
    assert [span(each) for each in found] == named(SHOP, "due", 1, 2)
    found = shop.ask("documentHighlight", URI, where(SHOP, "(R, D), at", inside=4))
    line, _ = where(SHOP, "(R, D), at")
    assert {span(each)[0][0] for each in found} == {line}
    assert len(found) == 2


def test_names_are_found_across_files_that_include_each_other(editor, tmp_path):
    part, main = tmp_path / "part.rmr", tmp_path / "main.rmr"
    text = f'/* {FACE} */ include "part.rmr".\n/* {FACE} */ ready(R) -o 1.\n'
    editor.open(main.as_uri(), text)
    editor.open(part.as_uri(), "type ready(robot).\nready(R).\n")
    found = editor.ask("definition", main.as_uri(), (1, 9))
    assert spans(found) == [(((0, 5), (0, 10)), part.as_uri())]
    found = editor.ask("references", part.as_uri(), (1, 2), context={"includeDeclaration": True})
    assert spans(found) == [
        (((1, 9), (1, 14)), main.as_uri()),
        (((0, 5), (0, 10)), part.as_uri()),
        (((1, 0), (1, 5)), part.as_uri()),
    ]
    [found] = editor.ask("definition", main.as_uri(), (0, 21))
    assert found["uri"] == part.as_uri()


def test_symbols_are_the_items_of_a_file(shop):
    found = shop.ask("documentSymbol", URI)
    assert [each["name"] for each in found[:5]] == ["moveto", "due", "patience", "late", "?arrived(R)."]
    assert [each["detail"] for each in found[:5]] == ["action", "predicate", "constant", "function", "goal"]
    assert [each["name"] for each in found if each["detail"] == "assertion"] == ["crossing"]
    assert span(found[1]) == ((1, 0), (1, 24))
    assert found[1]["selectionRange"]["start"] == {"line": 1, "character": 6}
    assert found[-1]["name"] == "seen(R, _) -o 1."


def test_an_editor_that_knows_no_trees_gets_a_list_of_symbols():
    with LspClient() as client:
        client.initialize(textDocument={})
        client.open(URI, "type p(robot).\n")
        [found] = client.ask("documentSymbol", URI)
        assert (found["name"], found["location"]["uri"]) == ("p", URI)


def test_completion_knows_the_words_of_the_program_what_robots_provide_and_keywords(editor):
    text = SHOP + "crossing(Robot, Time), mo"
    editor.open(URI, text)
    end = text.count("\n"), len("crossing(Robot, Time), mo")
    items = editor.ask("completion", URI, end)
    found = {each["label"]: each for each in items}
    assert {"due", "crossing", "moveto", "goto", "pose", "patience", "late", "abs", "then", "collect", "Time"} <= set(
        found
    )
    assert "D" not in found  # of another item
    assert found["goto"]["detail"] == "type action goto(robot, float, float)."
    assert found["goto"]["documentation"]["value"] == "drives to a point, metres"
    assert found["due"]["detail"] == "type !due(robot, float)."
    assert len({(each["label"], each["kind"]) for each in items}) == len(items)  # `id` is a fact and a function


def test_nothing_is_completed_in_comments_and_strings(editor):
    editor.open(URI, 'p(R). // here\nq(R, "there"). /* and */ s(R).\n')
    assert editor.ask("completion", URI, (0, 13)) == []
    assert editor.ask("completion", URI, (1, 8)) == []
    assert editor.ask("completion", URI, (1, 20)) == []
    assert editor.ask("completion", URI, (1, 26)) != []


# ---- layout


def test_formatting_is_that_of_rmr_fmt_and_changes_only_lines_that_differ(editor):
    text = f"p(R).\n// {FACE}\nq( R ) .  // {FACE}\nr(R).\n"
    editor.open(URI, text)
    options = {"tabSize": 2, "insertSpaces": True}
    [edit] = editor.ask("formatting", URI, options=options)
    assert (span(edit), edit["newText"]) == (((2, 0), (3, 0)), f"q(R).  // {FACE}\n")
    editor.change(URI, 2, (*span(edit), edit["newText"]))
    assert editor.ask("formatting", URI, options=options) == []
    editor.change(URI, 3, "p(R")
    assert editor.ask("formatting", URI, options=options) is None


# ---- edits


def edited(text, edit, uri=URI):
    """Return a text after the edits of a workspace edit that concern it."""
    [change] = [each for each in edit["documentChanges"] if each["textDocument"]["uri"] == uri]
    for each in sorted(change["edits"], key=span, reverse=True):
        lines = Lines(text, "utf-16")
        start, end = (lines.offset(*position) for position in span(each))
        text = text[:start] + each["newText"] + text[end:]
    return text


@pytest.mark.parametrize(
    ("word", "number", "new"),
    [
        ("due", 1, "limit"),
        ("patience", 2, "slack"),
        ("late", 0, "tardy"),
        ("crossing(", 2, "passing("),
        ("seen", 0, "met"),
    ],
)
def test_a_name_is_another_one_everywhere(shop, word, number, new):
    edit = shop.ask("rename", URI, where(SHOP, word, number), newName=new.rstrip("("))
    assert edited(SHOP, edit) == SHOP.replace(word, new)
    assert edit["documentChanges"][0]["textDocument"]["version"] == 1


def test_a_variable_is_another_one_in_its_item_alone(shop):
    edit = shop.ask("rename", URI, where(SHOP, "R, _)"), newName="Robot")
    assert edited(SHOP, edit) == SHOP.replace("seen(R, _)", "seen(Robot, _)")


def test_a_name_is_another_one_in_all_files_of_the_program(editor, tmp_path):
    part, main = tmp_path / "part.rmr", tmp_path / "main.rmr"
    part.write_text("ready(R).\n")
    text = f'include "part.rmr".\n/* {FACE} */ ready(R) -o 1.\n'
    editor.open(main.as_uri(), text)
    edit = editor.ask("rename", main.as_uri(), (1, 10), newName="waiting")
    assert edited(text, edit, main.as_uri()) == text.replace("ready", "waiting")
    assert edited("ready(R).\n", edit, part.as_uri()) == "waiting(R).\n"
    assert {each["textDocument"]["version"] for each in edit["documentChanges"]} == {1, None}


def test_a_file_of_the_library_is_found_offered_and_left_alone(editor, tmp_path):
    main = (tmp_path / "main.rmr").as_uri()
    editor.open(main, 'include "std/gradient.rmr".\n$gradient_hops(R, home, H) -o far(R, H).\nfar(R, _) -o 1.\n')
    assert editor.diagnostics(main) == []
    found = editor.ask("definition", main, (0, 14)) + editor.ask("definition", main, (1, 3))
    assert {each["uri"] for each in found} == {(LIBRARY / "gradient.rmr").as_uri()}
    assert [each["label"] for each in editor.ask("completion", main, (0, 12))] == library_files()
    with pytest.raises(LspError, match=r"in the library, in std/gradient\.rmr"):
        editor.ask("rename", main, (1, 3), newName="hops")


def test_a_name_in_a_part_of_two_programs_is_another_one_in_both(editor, tmp_path):
    programs = {tmp_path / f"{name}.rmr": f'include "part.rmr".\nseen(R) -o {name}(R).\n' for name in ("one", "two")}
    texts = programs | {tmp_path / "part.rmr": "type seen(robot).\nseen(R) -o 1.\n"}
    for path, text in texts.items():
        path.write_text(text)
        editor.open(path.as_uri(), text)
    edit = editor.ask("rename", (tmp_path / "part.rmr").as_uri(), (0, 5), newName="met")
    for path, text in texts.items():
        assert edited(text, edit, path.as_uri()) == text.replace("seen", "met")


def test_an_editor_that_knows_no_versions_gets_plain_edits():
    with LspClient() as client:
        client.initialize(workspace={}).open(URI, "p(R).\np(R) -o 1.\n")
        edit = client.ask("rename", URI, (0, 0), newName="q")
        assert [span(each) for each in edit["changes"][URI]] == [((0, 0), (0, 1)), ((1, 0), (1, 1))]


def test_what_may_get_another_name_is_shown_before(shop):
    found = shop.ask("prepareRename", URI, where(SHOP, "due", 1, 2))
    assert (span(found), found["placeholder"]) == (named(SHOP, "due", 1)[0], "due")


@pytest.mark.parametrize(
    ("word", "new", "why"),
    [
        ("due", "Limit", "`Limit` is no name of a predicate: a lower-case letter, then letters, digits and `_`"),
        ("due", "", "`` is no name of a predicate"),
        ("due", "a b", "`a b` is no name"),
        ("due", "type", "`type` is a reserved word"),
        ("due", "crossing", "`crossing` is taken"),
        ("due", "pose", "`pose` is taken"),
        ("patience", "exit", "`exit` is taken"),
        ("D, ", "R", "`R` is taken"),
        ("D, ", "d", "`d` is no name of a variable: an upper-case letter or `_`"),
        ("moveto", "drive", "`moveto` is provided by robots under this name"),
        ("at(R, exit)", "there", "`at` is provided by robots under this name"),
        ("abs", "absolute", "`abs` is a function of the language"),
        ("seconds", "hours", "here is no name of a predicate, action, function, constant or variable"),
    ],
)
def test_a_name_that_is_none_is_refused_in_one_sentence(shop, word, new, why):
    with pytest.raises(LspError) as refused:
        shop.ask("rename", URI, where(SHOP, word), newName=new)
    assert str(refused.value).startswith(why)
    assert "\n" not in str(refused.value)


def test_a_name_in_an_item_with_a_syntax_error_is_not_renamed_in_parts(editor):
    editor.open(URI, "p(R).\np(R), -o -o q(R).\np(R) -o 1.\n")
    with pytest.raises(LspError, match="`p` stands in an item with a syntax error, which comes first"):
        editor.ask("rename", URI, (0, 0), newName="q2")


def test_hints_whose_words_are_known_are_quick_fixes(editor):
    text = f"/* {FACE} */ p(R).\n/* {FACE} */ p(R) -> q(R).\n/* {FACE} */ q(R), X = sqr(1) -o stop(R).\n"
    editor.open(URI, text)
    whole = {"start": {"line": 0, "character": 0}, "end": {"line": 9, "character": 0}}
    found = editor.ask("codeAction", URI, range=whole, context={"diagnostics": []})
    titles = ["write `-o`", "write `sqrt`", "insert `type action stop(robot).`"]
    assert sorted(each["title"] for each in found) == sorted(titles)
    fixed = {each["title"]: edited(text, each["edit"]) for each in found}
    assert fixed["write `-o`"] == text.replace("->", "-o")
    assert fixed["write `sqrt`"] == text.replace("sqr", "sqrt")
    declared = "type action stop(robot).\n"
    assert fixed["insert `type action stop(robot).`"] == text.replace("p(R).", f"{declared}p(R).", 1)
    assert {each["kind"] for each in found} == {"quickfix"}
    assert [each["code"] for action in found for each in action["diagnostics"]] == ["E001", "E015", "W108"]
    first = {"start": {"line": 0, "character": 0}, "end": {"line": 0, "character": 5}}
    assert editor.ask("codeAction", URI, range=first, context={"diagnostics": []}) == []
    assert editor.ask("codeAction", URI, range=whole, context={"diagnostics": [], "only": ["refactor"]}) == []
