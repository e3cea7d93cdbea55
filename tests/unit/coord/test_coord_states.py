"""The transition tables are complete, and the constants keep their relations."""

from dataclasses import replace

import pytest
from coord_campaign import run
from coord_harness import Model, ms

from rmr.coord import context
from rmr.coord.states import PASSAGES, ROLES, Passage, Role, check_passage, check_role
from rmr.coord.timing import Timing

pytestmark = pytest.mark.medium


def test_a_change_that_the_tables_do_not_list_is_our_bug() -> None:
    with pytest.raises(AssertionError, match="no transition from NONE to LEADING"):
        check_role(Role.NONE, Role.LEADING)
    with pytest.raises(AssertionError, match="no transition from OUT to INSIDE"):
        check_passage(Passage.OUT, Passage.INSIDE)


def test_every_state_can_be_reached_and_left() -> None:
    for states, steps in ((Role, ROLES), (Passage, PASSAGES)):
        assert {step.source for step in steps} == set(states)
        assert {step.target for step in steps} == set(states)
        assert all(step.on for step in steps)


def test_every_step_of_the_tables_happens_in_random_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: set[tuple[int, int, str]] = set()
    monkeypatch.setattr(context, "check_role", lambda a, b: seen.add((a, b, "role")) or check_role(a, b))
    monkeypatch.setattr(context, "check_passage", lambda a, b: seen.add((a, b, "passage")) or check_passage(a, b))
    wanted = {(s.source, s.target, "role") for s in ROLES} | {(s.source, s.target, "passage") for s in PASSAGES}
    for seed in (201, 2, 135, *range(1, 100)):
        run(seed)
        if wanted - seen == {(Role.CANDIDATE, Role.NONE, "role")}:
            break
    model = Model(1, 2)
    model.trigger(0, 1, deadline=ms(9000))
    model.withdraw(ms(100), 1)
    model.trigger(ms(150), 1, deadline=ms(9000), inside=True)
    model.run(ms(200))
    assert wanted - seen == set()


@pytest.mark.parametrize(
    ("group", "name", "ms"), [("schedule", "frozen", 900), ("schedule", "lead", 550), ("liveness", "suspicion", 1000)]
)
def test_timing_that_breaks_a_guarantee_is_refused(group: str, name: str, ms: int) -> None:
    changed = replace(getattr(Timing(), group), **{name: ms * 1_000_000})
    with pytest.raises(ValueError, match=f"raise `{group}.{name}`"):
        replace(Timing(), **{group: changed})
