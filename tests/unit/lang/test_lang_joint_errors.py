"""Rules over several robots that are wrong in themselves, or name what is: told, and not rewritten."""

import pytest
from lang_source import codes

TYPES = "type idle(robot).\ntype paired(robot, robot).\n"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (TYPES + "idle(A), idle(B), peer(A, B, B) -o paired(A, B).", "E011"),
        (TYPES + "idle(A), idle(B, 1), peer(A, B) -o paired(A, B).", "E011"),
        (TYPES + "idle(A), idle(B), peer(A, B), id() < id(B) -o paired(A, B).", "E011"),
        ("type idle(robot, ,).\ntype paired(robot, robot).\nidle(A, 1), idle(B, 1) -o paired(A, B).", "E001"),
    ],
)
def test_a_rule_over_several_robots_with_the_wrong_number_of_arguments_is_told(text, found):
    assert found in codes(text)
