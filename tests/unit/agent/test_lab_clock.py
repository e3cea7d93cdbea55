"""Lab time in a robot process: estimated from round trips, monotone while one clock runs."""

from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.base.time import NS_PER_MS, NS_PER_S
from rmr_agent.clock import AHEAD_MAX, SAMPLES_MAX, LabClock

MS = NS_PER_MS


def round_trip(clock, true_offset, asked, there, back, *, served=0, state="running"):
    """Let `clock` ask at monotonic `asked`; the question is under way for `there` ns, the answer for `back`."""
    arrived = asked + there
    clock.sample(state, asked, arrived + true_offset, arrived + served + true_offset, arrived + served + back)


def test_clock_offset_is_exact_for_equal_delays_regardless_of_server_time():
    clock = LabClock()
    round_trip(clock, -5 * NS_PER_S, 100, MS, MS, served=40 * MS)
    assert clock.at(7 * NS_PER_S) == 2 * NS_PER_S
    assert clock.delay == 2 * MS


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 20 * MS), st.integers(0, 20 * MS)), min_size=1, max_size=SAMPLES_MAX),
    st.integers(-(10**15), 10**15),
)
def test_the_error_is_at_most_half_of_the_shortest_round_trip(ways, offset):
    clock = LabClock()
    for index, (there, back) in enumerate(ways):
        round_trip(clock, offset, index * NS_PER_S, there, back)
    shortest = min(there + back for there, back in ways)
    now = len(ways) * NS_PER_S
    assert abs(clock.at(now) - (now + offset)) <= shortest // 2 + 1


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 20 * MS), st.integers(0, 20 * MS)), min_size=2, max_size=20))
def test_lab_time_never_goes_back_while_the_same_clock_runs(ways):
    clock, seen = LabClock(), []
    for index, (there, back) in enumerate(ways):
        round_trip(clock, 0, index * 10 * MS, there, back)
        seen.append(clock.at(index * 10 * MS + there + back))
    assert seen == sorted(seen)


def test_lab_time_is_clamped_to_the_run():
    clock = LabClock()
    assert clock.state == "unknown"
    clock.sample("waiting", 0, 0, 0, MS)
    assert (clock.at(5), clock.at(10**12), clock.running) == (0, 0, False)
    round_trip(clock, 0, 10, 0, 0)
    assert clock.running
    clock.sample("stopped", 20, 17, 17, 30)
    assert clock.at(10**12) == 17


def test_a_start_that_is_set_for_a_moment_ahead_shows_as_negative_time():
    clock = LabClock()
    round_trip(clock, -NS_PER_S - 100 * MS, NS_PER_S, 0, 0)
    assert clock.at(NS_PER_S) == -100 * MS


def test_another_clock_may_be_behind_the_old_one():
    clock = LabClock()
    round_trip(clock, 0, 0, MS, MS)
    assert clock.at(60 * NS_PER_S) == 60 * NS_PER_S
    clock.forget()
    round_trip(clock, -59 * NS_PER_S, 60 * NS_PER_S, 5 * MS, 5 * MS)
    assert clock.at(61 * NS_PER_S) == 2 * NS_PER_S


def test_clock_drift_is_followed_because_old_samples_expire():
    clock = LabClock()
    round_trip(clock, 0, 0, 0, 0)
    for index in range(SAMPLES_MAX):
        round_trip(clock, MS, (index + 1) * NS_PER_S, 10, 10)
    assert clock.at(20 * NS_PER_S) == 20 * NS_PER_S + MS


def test_backward_clock_step_is_adopted_at_the_next_sample_despite_faster_old_samples():
    clock = LabClock()
    for index in range(SAMPLES_MAX):
        round_trip(clock, 0, index * MS, 10, 10)
    round_trip(clock, -3 * NS_PER_S, NS_PER_S, 5 * MS, 5 * MS)
    assert clock.at(5 * NS_PER_S) == 2 * NS_PER_S


def test_slow_clock_reply_is_not_taken_for_a_clock_step():
    clock = LabClock()
    round_trip(clock, 0, 0, 10, 10)
    round_trip(clock, 0, NS_PER_S, 0, 900 * MS)
    assert clock.delay == 20


def test_lab_time_freezes_instead_of_going_back_after_a_backward_clock_step():
    clock = LabClock()
    round_trip(clock, 0, 0, MS, MS)
    assert clock.at(4 * NS_PER_S) == 4 * NS_PER_S
    clock.doubt()
    round_trip(clock, -3 * NS_PER_S, 4 * NS_PER_S, MS, MS)
    assert clock.at(6 * NS_PER_S) == 4 * NS_PER_S
    assert clock.at(8 * NS_PER_S) == 5 * NS_PER_S


def test_lab_time_freezes_when_the_world_is_silent_and_resumes_with_it():
    clock = LabClock()
    round_trip(clock, 0, 0, MS, MS)
    clock.hear(2 * NS_PER_S, 2 * NS_PER_S)
    assert clock.at(2 * NS_PER_S + AHEAD_MAX // 2) == 2 * NS_PER_S + AHEAD_MAX // 2
    assert clock.at(60 * NS_PER_S) == 2 * NS_PER_S + AHEAD_MAX
    clock.hear(60 * NS_PER_S, 60 * NS_PER_S)
    assert clock.at(60 * NS_PER_S) == 60 * NS_PER_S


def test_a_sample_stamped_far_ahead_does_not_stand_for_a_world_that_falls_silent():
    clock = LabClock()
    round_trip(clock, 0, 0, MS, MS)
    clock.hear(1 << 60, 2 * NS_PER_S)
    assert clock.at(60 * NS_PER_S) == 2 * NS_PER_S + AHEAD_MAX


def test_new_world_clock_does_not_inherit_the_running_state_of_the_old_one():
    clock = LabClock()
    clock.sample("running", 0, 100, 100, 0)
    assert clock.running
    clock.forget()
    assert (clock.running, clock.state) == (False, "unknown")
