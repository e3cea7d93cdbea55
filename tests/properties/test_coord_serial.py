"""The order of terms: of two different ones exactly one is better, wherever on the circle they are."""

from hypothesis import given
from hypothesis import strategies as st

from rmr.coord.term import COUNTER_MAX, NO_TERM, Term, newer, successor

COUNTERS = st.integers(1, COUNTER_MAX)
TERMS = st.builds(Term, COUNTERS, st.integers(0, 65_533))


@given(TERMS, TERMS)
def test_of_two_terms_exactly_one_is_better(one: Term, other: Term) -> None:
    assert one.better(other) + other.better(one) == (one != other)


@given(COUNTERS, st.integers(1, COUNTER_MAX // 2))
def test_terms_that_follow_within_half_of_the_circle_are_newer(counter: int, steps: int) -> None:
    later = (counter - 1 + steps) % COUNTER_MAX + 1
    assert newer(later, counter)
    assert not newer(counter, later)


@given(COUNTERS)
def test_every_counter_has_a_successor_that_a_frame_can_carry(counter: int) -> None:
    assert 1 <= successor(counter) <= COUNTER_MAX
    assert newer(successor(counter), counter)


@given(TERMS)
def test_any_term_is_better_than_none(term: Term) -> None:
    assert term.better(NO_TERM)
    assert not NO_TERM.better(term)
    assert successor(NO_TERM.counter) == 1
