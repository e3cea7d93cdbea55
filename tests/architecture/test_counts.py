"""The counts of `counts.py`: what each counts, and that none is worse than it is landed."""

import ast
import json
from textwrap import dedent

import counts
import pytest
from counts import (
    FORMS,
    Row,
    constants_of,
    counted,
    defined_in,
    importers,
    lines_of,
    pages,
    read_landed,
    table,
    words_of,
    worse,
)
from source_tree import ROOT, modules


@pytest.fixture(scope="module")
def rows():
    return counted()[0]


def parsed(text):
    return ast.parse(dedent(text))


def test_no_count_is_worse_than_it_is_landed(rows):
    assert worse(rows, read_landed()) == []


def test_each_count_that_is_held_is_landed_and_no_other(rows):
    assert set(read_landed()) == {row.name for row in rows if row.held}


def test_a_count_that_grows_is_named_with_what_to_do():
    [words] = worse([Row("modules", 9, 5), Row("constants", 9, 4)], {"modules": 4, "constants": 4})
    assert words.startswith("modules: 5, landed are 4. ")
    assert "counts.py --land" in words


def test_the_program_is_red_where_a_count_grows_until_it_is_landed(tmp_path, monkeypatch, capsys):
    landed = tmp_path / "landed.json"
    landed.write_text(json.dumps({"modules": 4}))
    monkeypatch.setattr(counts, "LANDED", landed)
    monkeypatch.setattr(counts, "counted", lambda: ([Row("modules", 9, 5), Row("rooms", 9, 5, held=False)], []))
    monkeypatch.setattr("sys.argv", ["counts.py"])
    assert counts.main() == 1
    assert "worse: modules: 5" in capsys.readouterr().err
    monkeypatch.setattr("sys.argv", ["counts.py", "--land"])
    assert counts.main() == 0
    assert read_landed() == {"modules": 5}
    monkeypatch.setattr("sys.argv", ["counts.py"])
    assert counts.main() == 0


def test_constants_are_names_in_capitals_at_the_top_of_a_module():
    tree = parsed("""
        ONE = 1
        _TWO: Final = 2
        T = TypeVar("T")
        A, B = 1, 2
        small: Final = 3
        class Kind:
            INNER = 4
    """)
    assert constants_of(tree) == ["ONE", "_TWO", "T"]


def test_a_line_is_code_a_docstring_a_comment_or_blank():
    text = '''"""What it is.

# No comment.
"""
# A comment.

X = 1  # code
"""What X is."""
TEXT = f"""
# no comment {X}

"""
'''
    lines = lines_of(text, ast.parse(text))
    assert (lines.all, lines.docstrings, lines.comments, lines.code) == (12, 5, 1, 5)


def test_words_are_those_of_the_pages_that_a_reader_has():
    names = {page.relative_to(ROOT).as_posix() for page in pages()}
    assert {"README.md", "docs/language.md", "docs/evaluation/README.md", "docs/examples/README.md"} <= names
    assert not any("decisions" in name or "CHANGELOG" in name for name in names)
    assert words_of("# One `two`\n\n| a | b |\n") == 8


def test_a_form_counts_by_a_class_a_function_or_a_method_that_is_defined():
    tree = parsed("""
        from elsewhere import Peer
        class Hello:
            def take_over(self): ...
        def walk(): ...
    """)
    assert list(defined_in(tree)) == ["Hello", "Hello.take_over", "walk"]


def test_forms_that_are_left_are_named_in_the_table(rows):
    defined = {name for module in modules() for name in defined_in(module.tree)}
    by_name = {row.name: row for row in rows}
    assert all(by_name[fact].names == tuple(name for name in forms if name in defined) for fact, forms in FORMS.items())
    assert "    MindIndex, " in "\n".join(table(rows, []))


def test_imports_within_functions_count_and_those_of_oneself_do_not():
    by = importers(modules())
    assert "rmr_agent.main" in by["rmr_agent.agent_process"]  # within a function
    assert not any(name in found for name, found in by.items())
