"""`rmr why` shows rules over several robots by the source rule and what its messages mean."""

import pytest
from observed_runs import written

pytestmark = pytest.mark.medium

OFFER = """\
type !edge(robot, robot).
waiting(@1, west).
free(@3, west).
edge(@1, @3).
waiting(A, L), free(B, L), edge(A, B) -o on(A, L), used(B, L).
"""


def test_a_firing_is_explained_by_its_rule_and_the_messages_of_its_robots(tmp_path, monkeypatch):
    observed = written(OFFER, "--robots 3", tmp_path, monkeypatch)
    for fact in ("on(@1, west)", "used(@3, west)"):
        text = observed.text(fact, depth=9)
        assert "__" not in text
        for words in ("offered to @3 by @1 (west), rule a.rmr:5", "free(@3, west)", "by rule a.rmr:5"):
            assert words in text, fact
    assert "waiting(@1, west) is set aside" in observed.text("on(@1, west)", depth=9)
