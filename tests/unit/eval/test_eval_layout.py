"""Reports as people read them are JSON all the same."""

import json

from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.commands.eval_command import LINE_WIDTH, laid_out

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=60,
)


@settings(max_examples=50)
@given(VALUES)
def test_layout_keeps_the_json_value(value):
    assert json.loads(laid_out(value)) == value


def test_what_fits_stays_on_a_line_and_the_rest_has_an_item_a_line():
    value = {"small": [1, 2], "large": ["x" * 40, "y" * 40, {"z": 3}]}
    assert laid_out(value).splitlines() == [
        "{",
        '  "small": [1, 2],',
        '  "large": [',
        f'    "{"x" * 40}",',
        f'    "{"y" * 40}",',
        '    {"z": 3}',
        "  ]",
        "}",
    ]
    assert all(len(line) <= LINE_WIDTH + 1 for line in laid_out({"k": list(range(500))}).splitlines())
