"""Coordination frames: every message comes back, every octet string is a message or an error, sizes are exact."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmr.base.grid_path import GridPath
from rmr.coord import messages as m
from rmr.coord.leader import split_path
from rmr.coord.term import COUNTER_MAX, Term
from rmr.coord.timing import GRID, HEADWAY_UNIT, MS

EVENTS = st.binary(min_size=6, max_size=6)
ROBOTS = st.integers(0, 65533)
TIMES = st.integers(0, 2**32 - 1).map(lambda t: t * MS)
TERMS = st.builds(Term, st.integers(0, 0xFFFF), ROBOTS)
LED = st.builds(Term, st.integers(1, COUNTER_MAX), ROBOTS)
"""Terms that somebody leads."""
WAYS = st.integers(0, 15)
DURATIONS = st.integers(0, 0xFFFF).map(lambda d: d * GRID)


@st.composite
def jobs(draw: st.DrawFn) -> m.Job:
    time = draw(TIMES)
    base = m.on_grid(time)
    missed = draw(st.none() | st.integers(-0x8000, 0x7FFE).map(lambda d: base + d * GRID))
    return m.Job(
        draw(EVENTS), time, draw(TERMS), draw(TIMES), draw(TIMES), base + draw(DURATIONS), draw(DURATIONS),
        draw(TIMES), draw(st.integers(0, 255)) * HEADWAY_UNIT, draw(WAYS), missed,
        draw(st.booleans()), draw(st.integers(0, 7)),
    )  # fmt: skip


@st.composite
def scheds(draw: st.DrawFn) -> m.Sched:
    issued = draw(TIMES)
    base = m.on_grid(issued)
    entries = st.builds(
        m.Entry,
        ROBOTS,
        st.integers(-16, 60_000).map(lambda age: base - age * GRID),
        st.none() | st.integers(-0x8000, 0x7FFE).map(lambda d: base + d * GRID),
        DURATIONS,
        WAYS,
        st.sampled_from((m.Phase.WAITING, m.Phase.IN, m.Phase.OUT, m.Phase.GONE, m.Phase.PROVISIONAL)),
    )
    parts = draw(st.integers(1, m.PARTS_MAX))
    return m.Sched(
        draw(EVENTS), issued, draw(LED), draw(st.booleans()), draw(ROBOTS), draw(DURATIONS),
        draw(st.integers(0, 0xFFFF)), draw(st.integers(0, parts - 1)), parts,
        tuple(draw(st.lists(entries, max_size=m.ENTRIES_MAX))),
    )  # fmt: skip


@st.composite
def beacons(draw: st.DrawFn) -> m.Beacon:
    start = draw(TIMES)
    phase = draw(st.sampled_from((m.Phase.CLAIM, m.Phase.IN, m.Phase.YIELD, m.Phase.OUT, m.Phase.GONE)))
    return m.Beacon(
        draw(EVENTS), draw(TIMES), draw(TERMS), draw(ROBOTS), draw(TIMES), phase, draw(WAYS), start,
        start + draw(DURATIONS),
    )  # fmt: skip


@given(st.one_of(jobs(), scheds(), beacons()))
def test_every_message_comes_back_as_it_was(message: m.Message) -> None:
    assert m.decode(m.encode(message)) == message


@pytest.mark.medium
@given(jobs(), scheds(), beacons())
def test_frames_have_the_sizes_of_their_table(job: m.Job, sched: m.Sched, beacon: m.Beacon) -> None:
    assert len(m.encode(job)) == 35
    assert len(m.encode(sched)) == 24 + 9 * len(sched.entries) <= m.PAYLOAD_MAX
    assert len(m.encode(beacon)) == 28


@given(st.lists(st.integers(0, 7), max_size=600), EVENTS, TIMES, TERMS, WAYS)
def test_a_path_comes_back_from_its_parts(
    steps: list[int], event: bytes, time: int, term: Term, direction: int
) -> None:
    parts = split_path(event, time, term, direction, GridPath((3, 4), tuple(steps)))
    decoded = [m.decode(m.encode(part)) for part in parts]
    assert decoded == parts
    assert [step for part in parts for step in part.steps] == steps
    assert all(len(m.encode(part)) <= m.PAYLOAD_MAX for part in parts)


@given(st.sampled_from((107, 103, 95)), st.lists(st.integers(0, 7), max_size=600), EVENTS, TIMES, TERMS, WAYS)
def test_a_path_fits_frames_that_security_has_made_shorter(
    limit: int, steps: list[int], event: bytes, time: int, term: Term, direction: int
) -> None:
    parts = split_path(event, time, term, direction, GridPath((3, 4), tuple(steps)), limit)
    assert [m.decode(m.encode(part), limit) for part in parts] == parts
    assert [step for part in parts for step in part.steps] == steps
    assert max(len(m.encode(part)) for part in parts) <= limit


@pytest.mark.parametrize(("limit", "entries", "steps"), [(116, 10, 242), (107, 9, 218), (103, 8, 208), (95, 7, 186)])
def test_a_frame_is_filled_as_far_as_it_goes(limit: int, entries: int, steps: int) -> None:
    assert (m.entries_max(limit), m.steps_max(limit)) == (entries, steps)
    assert m.SCHED_OCTETS + entries * m.ENTRY_OCTETS <= limit < m.SCHED_OCTETS + (entries + 1) * m.ENTRY_OCTETS
    assert m.PATH_OCTETS + -(-3 * steps // 8) <= limit < m.PATH_OCTETS + -(-3 * (steps + 1) // 8)


@given(
    st.binary(max_size=130) | st.tuples(st.integers(1, 4), st.binary(max_size=120)).map(lambda t: bytes(t[:1]) + t[1])
)
def test_any_octets_are_a_message_or_an_error(octets: bytes) -> None:
    try:
        message = m.decode(octets)
    except m.MessageError:
        return
    assert m.decode(m.encode(message)) == message


@given(st.one_of(jobs(), scheds(), beacons()), st.data())
def test_a_frame_cut_short_or_lengthened_is_an_error(message: m.Message, data: st.DataObject) -> None:
    octets = m.encode(message)
    cut = data.draw(st.integers(0, len(octets) - 1))
    with pytest.raises(m.MessageError):
        m.decode(octets[:cut])
    with pytest.raises(m.MessageError):
        m.decode(octets + b"\0")
