"""The pictures of the docs are what their scripts draw, and need nothing from elsewhere."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

PICTURES = Path(__file__).parents[3] / "docs" / "pictures"


def test_diagram_of_the_parts_is_what_its_script_draws():
    done = subprocess.run([sys.executable, str(PICTURES / "parts.py")], capture_output=True, text=True, check=True)
    assert done.stdout == (PICTURES / "parts.svg").read_text()


@pytest.mark.parametrize("name", ["parts.svg", "corridor.svg"])
def test_picture_is_one_file_without_scripts_and_has_a_dark_form(name):
    text = (PICTURES / name).read_text()
    assert ElementTree.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"
    assert "prefers-color-scheme: dark" in text
    assert "<script" not in text
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")
    assert len(text) < 300_000
