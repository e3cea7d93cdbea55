"""The state of links: what it follows from, and that everybody sees the same."""

import subprocess
import sys
from itertools import permutations
from math import inf
from random import Random
from statistics import fmean, pstdev

import pytest

from rmr.base.time import NEVER, NS_PER_MS, NS_PER_S
from rmr.radio.links import (
    CYCLES,
    DISTURBANCES_MAX,
    GROUPS_MAX,
    SHADOWING_SIGMAS,
    Disturbance,
    Links,
    partition,
)
from rmr.radio.phy import Bursts, RadioConfig

S, MS = NS_PER_S, NS_PER_MS
PLAIN = RadioConfig()
BURSTS = Bursts(200 * MS, 50 * MS, 0.9)
BURSTY = RadioConfig(bursts=BURSTS)
STRETCH = CYCLES * (BURSTS.good + BURSTS.bad)
SHADOWED = RadioConfig(shadowing_db=6.0)
PAIRS = [(a, b) for a in range(40) for b in range(a)]


def states(links, source, receiver, until, step=MS):
    return [links.is_bad(source, receiver, at) for at in range(0, until, step)]


def spells(states):
    """Return the lengths of the whole good and bad times among `states`, in steps."""
    lengths = {False: [], True: []}
    begin = None
    for at in range(1, len(states)):
        if states[at] != states[at - 1]:
            if begin is not None:
                lengths[states[at - 1]].append(at - begin)
            begin = at
    return lengths


# --- bursts ---------------------------------------------------------------------------------------------------


def test_good_and_bad_times_have_their_mean_lengths_and_are_exponential():
    seen = [spells(states(Links(BURSTY, seed), 1, 2, 3 * STRETCH)) for seed in range(12)]
    good, bad = ([length for one in seen for length in one[state]] for state in (False, True))
    assert fmean(good) == pytest.approx(200, rel=0.1)
    assert fmean(bad) == pytest.approx(50, rel=0.1)
    assert pstdev(good) == pytest.approx(fmean(good), rel=0.15)


def test_a_link_is_bad_for_its_share_of_the_time_from_the_very_beginning():
    share = BURSTS.bad / (BURSTS.good + BURSTS.bad)
    for at in (0, STRETCH - 1, STRETCH, 10_000 * STRETCH + 7):
        assert fmean([Links(BURSTY, 7).is_bad(a, b, at) for a, b in PAIRS]) == pytest.approx(share, abs=0.05)


def test_frames_are_lost_with_the_probabilities_of_the_two_states():
    links = Links(RadioConfig(loss=0.1, bursts=BURSTS), 7)
    found = {(links.is_bad(1, 2, at), round(links.loss(1, 2, at), 9)) for at in range(0, STRETCH, MS)}
    assert found == {(False, 0.1), (True, round(1 - 0.9 * 0.1, 9))}
    assert links.loses
    assert not links.even


def test_a_link_is_bad_both_ways_at_the_same_time_and_other_links_at_other_times():
    links = Links(BURSTY, 7)
    assert states(links, 1, 2, STRETCH) == states(links, 2, 1, STRETCH)
    assert states(links, 1, 2, STRETCH) != states(links, 1, 3, STRETCH)
    assert states(links, 1, 2, STRETCH) != states(Links(BURSTY, 8), 1, 2, STRETCH)


# --- the same for everybody ------------------------------------------------------------------------------------


def test_link_gain_and_loss_do_not_depend_on_earlier_queries():
    asked = [(a, b, at) for a, b in PAIRS[:30] for at in (0, 3 * STRETCH, 17, STRETCH - 1, STRETCH)]
    config = RadioConfig(loss=0.1, shadowing_db=4.0, bursts=BURSTS)

    def answers(order):
        links = Links(config, 7)
        return {(a, b, at): (links.gain_db(a, b, at), links.loss(a, b, at)) for a, b, at in order}

    expected = {query: answers([query])[query] for query in asked}
    shuffled = Random(1).sample(asked, len(asked))
    assert answers(asked) == answers(shuffled) == expected


def test_processes_agree_whatever_their_hash_seed():
    code = (
        "from rmr.radio.links import Links; from rmr.radio.phy import Bursts, RadioConfig;"
        "links = Links(RadioConfig(shadowing_db=4.0, bursts=Bursts(10**8, 10**8)), 7);"
        "print([(links.gain_db(a, b, 0), links.is_bad(a, b, 10**9 * a)) for a in range(9) for b in range(a)])"
    )
    said = [
        subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONHASHSEED": seed}, capture_output=True, text=True, check=True
        ).stdout
        for seed in ("1", "2")
    ]
    assert said[0] == said[1]
    assert "True" in said[0]
    assert "False" in said[0]


# --- shadowing -------------------------------------------------------------------------------------------------


def test_shadowing_is_normal_symmetric_lasting_and_bounded():
    links = Links(SHADOWED, 7)
    gains = [links.gain_db(a, b, 0) for a, b in PAIRS]
    assert fmean(gains) == pytest.approx(0.0, abs=0.6)
    assert pstdev(gains) == pytest.approx(6.0, rel=0.08)
    assert gains == [links.gain_db(b, a, 1000 * S) for a, b in PAIRS]
    assert gains != [Links(SHADOWED, 8).gain_db(a, b, 0) for a, b in PAIRS]
    assert links.fades


def test_shadowing_is_cut_at_three_deviations():
    links = Links(SHADOWED, 7)
    gains = [links.gain_db(a, b, 0) for a in range(150) for b in range(a)]
    limit = SHADOWING_SIGMAS * 6.0
    assert max(gains) == limit  # of 11 175 normal draws some thirty lie beyond
    assert min(gains) == -limit


# --- disturbances ------------------------------------------------------------------------------------------------


def test_links_without_disturbances_depend_on_distance_only():
    links = Links(PLAIN, 7)
    assert (links.fades, links.loses, links.even) == (False, False, True)
    assert (links.gain_db(1, 2, 0), links.loss(1, 2, 0)) == (0.0, 0.0)


def test_a_disturbance_holds_from_its_first_instant_until_before_its_end():
    links = Links(PLAIN, 7, [Disturbance(S, 2 * S, loss=0.5, attenuation_db=20.0)])
    assert [links.loss(1, 2, at) for at in (S - 1, S, 2 * S - 1, 2 * S)] == [0.0, 0.5, 0.5, 0.0]
    assert [links.gain_db(1, 2, at) for at in (S - 1, S, 2 * S - 1, 2 * S)] == [0.0, -20.0, -20.0, 0.0]


def test_partition_cuts_groups_off_from_each_other_and_ungrouped_robots_from_none():
    links = Links(PLAIN, 7, [partition([[1, 2], [3], [4, 5]])])
    cut = {pair for pair in permutations(range(1, 7), 2) if links.gain_db(*pair, 0) == -inf}
    apart = [(1, 3), (2, 3), (1, 4), (1, 5), (2, 4), (2, 5), (3, 4), (3, 5)]
    assert cut == {*apart, *[(b, a) for a, b in apart]}
    assert all(links.loss(*pair, 0) == 0.0 for pair in cut)


def test_one_way_touches_only_frames_from_an_earlier_group_to_a_later_one():
    links = Links(PLAIN, 7, [Disturbance(groups=((2,), (1, 3)), one_way=True, loss=0.4)])
    touched = {pair for pair in permutations(range(1, 4), 2) if links.loss(*pair, 0)}
    assert touched == {(2, 1), (2, 3)}


def test_losses_are_independent_and_attenuations_add_up():
    held = [
        Disturbance(loss=0.5),
        Disturbance(groups=((1,), (2,)), loss=0.2, attenuation_db=3.0),
        Disturbance(attenuation_db=4.0),
    ]
    links = Links(RadioConfig(loss=0.1), 7, held)
    assert links.loss(1, 2, 0) == pytest.approx(1 - 0.9 * 0.5 * 0.8)
    assert links.loss(1, 3, 0) == pytest.approx(1 - 0.9 * 0.5)
    assert (links.gain_db(1, 2, 0), links.gain_db(1, 3, 0)) == (-7.0, -4.0)


def test_replaced_disturbances_leave_bursts_and_shadowing_unchanged():
    config = RadioConfig(shadowing_db=4.0, bursts=BURSTS)
    links, untouched = Links(config, 7, [Disturbance(loss=0.5)]), Links(config, 7)
    links.replace([partition([[1], [2]])])
    assert links.gain_db(1, 2, 0) == -inf
    assert links.loss(3, 4, 0) == untouched.loss(3, 4, 0)
    links.replace([])
    assert links.gain_db(1, 2, 0) == untouched.gain_db(1, 2, 0)
    assert states(links, 1, 2, STRETCH) == states(untouched, 1, 2, STRETCH)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (Disturbance(5, 5), "ends after it begins"),
        (Disturbance(-1, 5), "begins at 0 or later"),
        (Disturbance(0, NEVER + 1), "ends after it begins"),
        (Disturbance(loss=1.1), "loss 1.1: write a probability"),
        (Disturbance(loss=float("nan")), "write a probability"),
        (Disturbance(attenuation_db=-1.0), "write decibels, 0 or more"),
        (Disturbance(attenuation_db=float("nan")), "write decibels"),
        (Disturbance(groups=((1,),)), "1 groups"),
        (Disturbance(groups=tuple((i,) for i in range(GROUPS_MAX + 1))), "65 groups"),
        (Disturbance(groups=((1, 2), (2,))), "a robot is in two groups"),
        (Disturbance(groups=((1,), (1 << 16,))), "16 bits"),
    ],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_invalid_disturbance_is_refused_and_changes_nothing(wrong, said):
    links = Links(PLAIN, 7, [Disturbance(loss=0.5)])
    with pytest.raises(ValueError, match=said):
        links.replace([Disturbance(loss=0.1), wrong])
    assert links.loss(1, 2, 0) == 0.5
    with pytest.raises(ValueError, match=said):
        Links(PLAIN, 7, [wrong])


def test_a_lab_has_a_bounded_number_of_disturbances():
    Links(PLAIN, 7, [Disturbance()] * DISTURBANCES_MAX)
    with pytest.raises(ValueError, match="at most 256"):
        Links(PLAIN, 7, [Disturbance()] * (DISTURBANCES_MAX + 1))


@pytest.mark.parametrize(
    "disturbance",
    [Disturbance(), partition([[1, 2], [3]], S, 2 * S), Disturbance(1, 2, ((7,), (8,)), True, 0.25, 3.0)],
)
def test_a_disturbance_on_the_wire_arrives_as_it_was(disturbance):
    assert Disturbance.from_wire(disturbance.to_wire()) == disturbance
