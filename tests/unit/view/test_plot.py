"""`rmr plot`: figures from data files, and what is said of files and names that are wrong."""

import builtins
import json
import subprocess
import sys
from xml.etree import ElementTree

import pytest

from rmr_view.chart import ChartError, read
from rmr_view.plot import main

SVG = "{http://www.w3.org/2000/svg}"
SERIES = {"label": "ours, $x$ & <more>", "kind": "line", "x": [1, 2, 3], "y": [1.5, 2.5, 2.0]}
INTERVALS = {"low": [1.0, None, 1.5], "high": [2.0, 3.0, None]}


def figure(*series, **panel):
    return {
        "title": "A title",
        "note": "of 3 seeds",
        "panels": [{"x": "robots", "y": "time, s", "series": list(series), **panel}],
    }


ALL_KINDS = figure(
    SERIES | INTERVALS,
    {**SERIES, "label": "alone", "kind": "points"},
    {**SERIES, "label": "bar", "kind": "bars"} | INTERVALS,
    {**SERIES, "label": "low", "kind": "stack", "group": "simulated"},
    {**SERIES, "label": "top", "kind": "stack", "group": "simulated"} | INTERVALS,
    {**SERIES, "label": "low", "kind": "stack", "group": "processes"},
    lines=[{"y": 2.2, "label": "target"}],
    ticks=[{"at": 1, "label": "one"}, {"at": 3, "label": "three"}],
)


@pytest.fixture
def data(tmp_path):
    """A folder with a figure of every kind of series."""
    (tmp_path / "kinds.json").write_text(json.dumps({"name": "kinds", "rows": [1], "figure": ALL_KINDS}))
    return tmp_path


def plotted(data, *words):
    return main([*words, "--data", str(data)])


def texts(path):
    return ["".join(each.itertext()) for each in ElementTree.parse(path).iter(f"{SVG}text")]


@pytest.mark.medium
def test_a_figure_shows_its_axes_labels_note_and_every_series_as_text(data, capsys):
    assert plotted(data, "kinds") == 0
    assert capsys.readouterr().out == f"{data / 'kinds.svg'}\n"
    shown = texts(data / "kinds.svg")
    wanted = {"A title", "of 3 seeds", "robots", "time, s", "target", "one", "ours, $x$ & <more>", "low, processes"}
    assert wanted <= set(shown)


def test_the_same_data_give_the_same_octets(data):
    assert plotted(data, "kinds", "-o", str(data / "one")) == plotted(data, "--all", "-o", str(data / "other")) == 0
    assert (data / "one" / "kinds.svg").read_bytes() == (data / "other" / "kinds.svg").read_bytes()


def test_without_a_name_the_known_figures_are_listed(data, capsys):
    (data / "another.json").write_text("{}")
    assert plotted(data) == 0
    assert capsys.readouterr().out == "another\nkinds\n"


def test_an_unknown_name_gets_the_nearest_one_and_the_list(data, capsys):
    assert plotted(data, "kind") == 2
    told = capsys.readouterr().err
    assert "no figure 'kind'; did you mean 'kinds'?" in told
    assert "known in" in told


def test_missing_folder_is_reported(tmp_path, capsys):
    assert plotted(tmp_path / "nowhere", "kinds") == 2
    assert "there is no folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("", "EOF"),
        ("{", "EOF"),
        ("[1]", "object"),
        ("[" * 100_000, "recursion"),
        ("{}", "its key `figure` is missing"),
        (json.dumps({"figure": figure()}), "figure.panels.0.series"),
        (json.dumps({"figure": figure(SERIES | {"y": [1.0]})}), "differ in length"),
        (json.dumps({"figure": figure(SERIES | {"low": [1, 1, 1]})}), "low and high go together"),
        (json.dumps({"figure": figure(SERIES | {"kind": "pie"})}), "figure.panels.0.series.0.kind"),
        (json.dumps({"figure": figure(SERIES | {"colour": "red"})}), "colour"),
        (json.dumps({"figure": figure(SERIES | {"y": [1.0, float("nan"), 2.0]})}), "figure.panels.0.series.0.y.1"),
        (json.dumps({"figure": figure(SERIES | {"y": [1.0, 1e308, 2.0]})}), "figure.panels.0.series.0.y.1"),
        ("\x00\xff", "expected"),
    ],
)
def test_broken_file_is_reported_with_its_place_and_nothing_is_drawn(data, capsys, content, told):
    (data / "broken.json").write_text(content)
    assert plotted(data, "kinds", "broken") == 3
    message = capsys.readouterr().err
    assert told in message
    assert "broken.json" in message
    assert not (data / "kinds.svg").exists()


def test_many_mistakes_are_counted_and_not_all_shown(data):
    (data / "broken.json").write_text(json.dumps({"figure": figure(SERIES | {"x": ["a"] * 20, "y": [1.0] * 20})}))
    with pytest.raises(ChartError, match="and 15 more"):
        read(data / "broken.json")


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (ModuleNotFoundError("No module named 'matplotlib'", name="matplotlib"), "pip install 'rmr-robots[plot]'"),
        (ModuleNotFoundError("No module named 'numpy'", name="numpy"), "cannot be loaded; install it anew"),
        (ImportError("libpng is broken"), "libpng is broken"),
    ],
)
def test_missing_or_broken_matplotlib_is_reported_with_the_remedy(data, capsys, monkeypatch, error, told):
    real = builtins.__import__

    def absent(name, *rest, **more):
        if name.partition(".")[0] == "matplotlib":
            raise error
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", absent)
    assert plotted(data, "kinds") == 1
    assert told in capsys.readouterr().err


def test_unwritable_folder_is_reported(data, capsys):
    (data / "file").write_text("")
    assert plotted(data, "kinds", "-o", str(data / "file" / "deeper")) == 2
    assert "rmr plot: " in capsys.readouterr().err


def test_a_panel_without_bars_may_begin_anywhere_and_have_log_axes(data):
    shape = figure(SERIES, x_log=True, y_log=True, y_from=0.5)
    (data / "log.json").write_text(json.dumps({"figure": shape}))
    assert plotted(data, "log") == 0
    shown = texts(data / "log.svg")
    assert {"robots", "1", "2"} <= set(shown)
    assert [text for text in shown if "math" in text] == []


def test_help_and_names_do_not_load_matplotlib(data):
    code = f"from rmr_view.plot import main; main(['--data', {str(data)!r}])"
    code = f"import sys; {code}; print('matplotlib' in sys.modules)"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.splitlines() == ["kinds", "False"]


def test_matplotlib_warning_is_reported_without_a_source_position(tmp_path, capsys):
    shown = figure({**SERIES, "label": "\N{ROBOT FACE}"}, title="\N{CJK UNIFIED IDEOGRAPH-6A5F}")
    (tmp_path / "odd.json").write_text(json.dumps({"name": "odd", "rows": [1], "figure": shown}))
    assert plotted(tmp_path, "odd") == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines
    assert all(line.startswith("rmr plot: odd: ") and "draw.py" not in line for line in lines)
