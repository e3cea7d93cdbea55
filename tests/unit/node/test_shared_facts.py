"""Shared facts on the air: told at once and again, withdrawn, aged, numbered, bounded."""

import itertools
from random import Random

import pytest
from flock import Flock, losing

from rmr.base.time import milliseconds, seconds
from rmr.base.values import Robot, Symbol
from rmr.bytecode.program import Duty
from rmr.lang.compiler import compile_source
from rmr.node import payloads
from rmr.node.logic import shared_facts
from rmr.node.payloads import PayloadKind, SharedFrame, WireError
from rmr.node.ports import Received

PROGRAM = """
    type shared level(robot, int).
    type seen(robot, robot, int).
    type set(robot, int).
    type drop(robot).
    peer(R, N), level(N, L), not seen(R, N, L) -o seen(R, N, L).
    set(R, L), level(R, _) -o level(R, L).
    drop(R), level(R, _) -o 1.
"""


MIXED = """
    type shared level(robot, int).
    type shared mood(robot, mood, float).
    type seen(robot, robot, int).
    type saw(robot, mood).
    peer(R, N), level(N, L) -o seen(R, N, L).
    peer(R, N), mood(N, M, _) -o saw(R, M).
"""


class Air:
    """Remembers the frames of shared facts; loses those that `loses` says."""

    def __init__(self, loses=lambda now, source, target: False):
        self.frames = []
        self.loses = loses

    def __call__(self, now, source, target, payload):
        if payload[0] == PayloadKind.SHARED:
            self.frames.append((now, source, target, payload))
        return not self.loses(now, source, target)

    def sent(self, source, target=2):
        return [(now, payload) for now, one, other, payload in self.frames if (one, other) == (source, target)]


def known(flock, robot):
    """What a robot has heard: (owner, values)."""
    program = flock.program
    (hidden,) = program.ensemble
    return sorted(flock.node(robot).machine.held(hidden.predicate))


def test_a_fact_is_known_at_once_and_withdrawn_when_its_owner_uses_it_up():
    air = Air()
    flock = Flock(PROGRAM, 2, passes=air)
    flock.insert(1, "level", 7)
    flock.wait(0.05)
    assert known(flock, 2) == [(Robot(1), 7)]
    assert known(flock, 1) == [], "a robot's own facts are its facts alone"
    assert flock.facts(2) == ["seen(@2, @1, 7)"], "what is heard is no fact of the robot's own"
    flock.insert(1, "drop")
    flock.wait(0.6)
    assert known(flock, 2) == []
    flock.wait(10)
    assert 2 < len(air.sent(1)) < 8, "a few frames more say that there is none, then it falls silent"


def test_changes_are_told_at_a_bounded_rate_and_the_last_one_is_known():
    air = Air()
    flock = Flock(PROGRAM, 2, passes=air)
    flock.insert(1, "level", 0)
    for number in range(1, 101):
        flock.wait(number * 0.02)
        flock.insert(1, "set", number)
    flock.wait(2.5)
    assert known(flock, 2) == [(Robot(1), 100)]
    times = [now for now, _ in air.sent(1)]
    gaps = [later - earlier for earlier, later in itertools.pairwise(times)]
    assert min(gaps) >= shared_facts.CHANGE_MIN
    assert len(times) <= 2.5 / 0.2 + 2


def test_what_holds_is_told_again_and_a_lost_frame_is_made_good():
    air = Air(lambda now, source, target: now < milliseconds(500))
    flock = Flock(PROGRAM, 2, passes=air)
    flock.insert(1, "level", 7)
    flock.wait(0.5)
    assert known(flock, 2) == []
    flock.wait(0.8)
    assert known(flock, 2) == [(Robot(1), 7)]
    flock.wait(20)
    times = [now for now, _ in air.sent(1)]
    gaps = [later - earlier for earlier, later in itertools.pairwise(times)]
    assert max(gaps) <= shared_facts.REFRESH
    assert len(times) < 20 / 0.6


def test_what_is_not_heard_for_three_seconds_is_withdrawn_and_is_back_with_the_next_frame():
    silence = (seconds(2), seconds(9))
    flock = Flock(PROGRAM, 2, passes=Air(lambda now, *_: silence[0] <= now < silence[1]))
    flock.insert(1, "level", 7)
    flock.wait(4)
    assert known(flock, 2) == [(Robot(1), 7)], "heard within the last 3 s"
    flock.wait(5.1)
    assert known(flock, 2) == []
    flock.wait(9.8)
    assert known(flock, 2) == [(Robot(1), 7)]


def test_at_a_loss_of_a_fifth_facts_are_known_nearly_always():
    flock = Flock(PROGRAM, 3, passes=losing(Random(5), 0.2))
    for robot in (1, 2, 3):
        flock.insert(robot, "level", robot)
    flock.wait(3)
    missing = 0
    for step in range(300):
        flock.wait(3 + step * 0.2)
        missing += sum(2 - len(known(flock, robot)) for robot in (1, 2, 3))
    assert missing <= 18, f"{missing} of 1800 looks"


def test_several_facts_and_equal_ones_are_a_set():
    flock = Flock(PROGRAM, 2)
    for value in (1, 2, 2, 300):
        flock.insert(1, "level", value)
    flock.wait(0.1)
    assert known(flock, 2) == [(Robot(1), 1), (Robot(1), 2), (Robot(1), 300)]
    flock.insert(1, "drop")
    flock.insert(1, "drop")
    flock.wait(1.0)
    assert known(flock, 2) == [(Robot(1), 2), (Robot(1), 300)], "one of two equal facts is left"


def test_what_neighbours_have_told_is_stated_anew_after_another_program_takes_over():
    program = """
        type shared level(robot, int).
        type seen(robot, robot, int).
        level(@2, 1).
        peer(R, N), level(N, L) -o seen(R, N, L).
    """
    flock = Flock(program, 2)
    flock.wait(2)
    after = compile_source(f"{program} type rise(robot). rise(R), level(R, _) -o level(R, 2).").program
    for robot in (1, 2):
        flock.node(robot).change_program(flock.kernel.now, after, 8)
    flock.node(2).insert(flock.kernel.now, "rise", ())
    flock.wait(20)
    heard = next(each.predicate for each in after.ensemble if each.duty is Duty.HEARD)
    assert list(flock.node(1).machine.each(heard)) == [(Robot(2), 2)]


def test_older_frames_and_those_of_an_earlier_life_change_nothing():
    air = Air()
    flock = Flock(PROGRAM, 2, passes=air)
    flock.insert(1, "level", 1)
    flock.wait(0.3)
    flock.insert(1, "set", 2)
    flock.wait(0.6)
    old = air.sent(1)[0][1]
    shared = flock.node(2).messenger.shared
    shared.received(flock.kernel.now, Received(old, 1, False, -50.0, 255, flock.kernel.now))
    assert known(flock, 2) == [(Robot(1), 2)]
    frame = payloads.decode_shared(old, {0: 1}, (), 7)
    part = payloads.encode_shared_part(0, [payloads.encode_values((5,), {})])
    later = payloads.encode_shared(SharedFrame(7, 1, 0, seconds(3), [part]))
    shared.received(flock.kernel.now, Received(later, 1, False, -50.0, 255, flock.kernel.now))
    assert known(flock, 2) == [(Robot(1), 5)], "its next life counts from the beginning"
    again = payloads.encode_shared(SharedFrame(7, 0, frame.number + 900, seconds(3), [part]))
    shared.received(flock.kernel.now, Received(again, 1, False, -50.0, 255, flock.kernel.now))
    assert shared._sources[1].epoch == 1


def test_facts_that_no_frame_has_room_for_are_noted_and_the_newest_are_told():
    flock = Flock(PROGRAM, 2)
    for value in range(1000, 1020):
        flock.insert(1, "level", value)
    flock.wait(0.2)
    newest = [value for _, value in known(flock, 2)]
    assert newest == list(range(1020 - len(newest), 1020))
    assert 5 < len(newest) < 20
    assert list(flock.node(1).messenger.shared.untold.values()) == [20 - len(newest)]
    (note,) = flock.noted(1, "bound_reached")
    assert note["kept"] == "octets of shared level facts"


def test_a_text_too_long_for_a_frame_is_not_told_and_others_are():
    program = """
        type shared name(robot, string).
        type seen(robot, string).
        peer(R, N), name(N, S) -o seen(R, S).
    """
    flock = Flock(program, 2)
    flock.insert(1, "name", "x" * 300)
    flock.insert(1, "name", "short")
    flock.wait(0.2)
    assert known(flock, 2) == [(Robot(1), "short")]
    assert list(flock.node(1).messenger.shared.untold.values()) == [1]


def test_two_predicates_share_a_frame_and_one_that_never_stops_does_not_keep_the_other_from_being_told():
    program = PROGRAM + "    type shared mood(robot, mood).\n    type saw(robot, mood).\n"
    program += "    peer(R, N), mood(N, M) -o saw(R, M).\n"
    dark = []
    flock = Flock(program, 2, passes=lambda now, *_: not (dark and now < dark[0]))
    flock.insert(1, "mood", Symbol("calm"))
    flock.insert(1, "level", 0)
    flock.wait(0.1)
    mood = next(
        each.predicate for each in flock.program.ensemble if flock.program.predicates[each.other].name == "mood"
    )
    for number in range(1, 301):
        flock.wait(0.1 + number * 0.02)
        flock.insert(1, "set", number % 100)
    assert flock.node(2).machine.held(mood) == [(Robot(1), Symbol("calm"))], "told again beside the changes"


@pytest.mark.parametrize("cut", range(1, 14))
def test_a_frame_cut_short_is_counted_as_malformed(cut):
    air = Air()
    flock = Flock(PROGRAM, 2, passes=air)
    flock.insert(1, "level", 7)
    flock.wait(0.1)
    payload = air.sent(1)[0][1]
    assert len(payload) == 12
    if cut in (12, 13):
        payload += bytes(cut - 11)
    else:
        payload = payload[:cut]
    whole = cut == payloads.SHARED_OCTETS
    node = flock.node(2)
    node.messenger.receive(flock.kernel.now, Received(payload, 1, False, -50.0, 255, flock.kernel.now))
    assert node.messenger.malformed == (0 if whole else 1)


def test_values_of_another_type_are_malformed():
    flock = Flock(PROGRAM, 2)
    flock.wait(0.01)
    part = payloads.encode_shared_part(0, [payloads.encode_values(("text",), {})])
    frame = payloads.encode_shared(SharedFrame(7, 0, 1, seconds(3), [part]))
    with pytest.raises(WireError):
        flock.node(2).messenger.shared.received(0, Received(frame, 1, False, -50.0, 255, 0))
    assert known(flock, 2) == []
    flock.insert(1, "level", 7)
    flock.wait(5)
    assert known(flock, 2) == [(Robot(1), 7)], "nothing of the malformed frame is left"
    flock.node(2).messenger.shared._expire(seconds(60))
    assert known(flock, 2) == []


@pytest.mark.parametrize("seed", range(40))
def test_whatever_the_octets_a_frame_is_taken_up_as_a_whole_or_counted(seed):
    """Random octets behind the head, and good frames with a few octets changed."""
    rng = Random(seed)
    flock = Flock(MIXED, 2)
    flock.insert(1, "level", 7)
    flock.insert(1, "mood", Symbol("calm"), 1.5)
    node = flock.node(2)
    for number in range(1, 60):
        part = payloads.encode_shared_part(0, [payloads.encode_values((rng.randrange(300),), {})])
        payload = bytearray(payloads.encode_shared(SharedFrame(7, 0, number, seconds(3), [part])))
        if rng.random() < 0.5:
            payload[payloads.SHARED_OCTETS :] = rng.randbytes(rng.randrange(1, 40))
        else:
            for _ in range(rng.randrange(3)):
                payload[rng.randrange(payloads.SHARED_OCTETS, len(payload))] = rng.randrange(256)
        now = flock.kernel.now
        before = node.messenger.malformed
        held = [node.machine.held(each.predicate) for each in flock.program.ensemble]
        node.messenger.receive(now, Received(bytes(payload), 1, False, -50.0, 255, now))
        if node.messenger.malformed > before:
            assert held == [node.machine.held(each.predicate) for each in flock.program.ensemble]
        flock.wait(flock.now_s + 0.05)
    flock.wait(flock.now_s + 10)
    for each in flock.program.ensemble:
        assert len(node.machine.held(each.predicate)) <= 1


def test_another_programs_frames_and_those_of_too_many_robots_are_ignored(monkeypatch):
    monkeypatch.setattr(shared_facts, "SOURCES_MAX", 3)
    flock = Flock(PROGRAM, 2)
    shared = flock.node(2).messenger.shared
    part = payloads.encode_shared_part(0, [payloads.encode_values((5,), {})])
    for digest, source in ((8, 50), (7, 51), (7, 52), (7, 53), (7, 54)):
        frame = payloads.encode_shared(SharedFrame(digest, 0, 1, seconds(3), [part]))
        shared.received(0, Received(frame, source, False, -50.0, 255, 0))
    assert [int(robot) for robot, _ in known(flock, 2)] == [51, 52, 53]


def test_a_thousand_neighbours_take_a_bounded_part_of_the_air():
    """Each tells at intervals that grow with their number."""
    flock = Flock(PROGRAM, 1)
    air = []
    node = flock.node(1)
    flock.robots[1].transmit = lambda payload, *_: air.append(flock.kernel.now)
    for other in range(2, 1002):
        node.state.peers.heard(0, other, -60.0)
    node.state.peers.neighbors = lambda now: list(range(2, 1002))
    flock.insert(1, "level", 0)
    for number in range(1, 601):
        flock.wait(number * 0.1)
        flock.insert(1, "set", number)
    assert 60 / 25 <= len(air) <= 60 / 7 + 1


def test_a_program_that_shares_nothing_sends_no_such_frame():
    air = Air()
    flock = Flock("type level(robot, int).\nlevel(R, 1).\nlevel(R, X), X < 5 -o level(R, X + 1).\n", 2, passes=air)
    flock.wait(5)
    assert air.frames == []
    assert not flock.node(1).messenger.shared.used
