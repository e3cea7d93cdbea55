"""The cells of the floor: whoever may hear of a frame listens to the cell that it comes from.

The claims are put as what a grid *overlooks*, so that they can be turned on grids whose cells are too narrow: a
search that found nothing wrong with those would be worth nothing.
"""

import math
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.base.time import TICK_HZ
from rmr.radio.air import Announcement
from rmr.radio.cells import (
    CELL_MAX,
    HYSTERESIS_M,
    LAG_S,
    RANGE_MAX_M,
    Cell,
    Grid,
    grid_of,
    interference_range_m,
)
from rmr.radio.frame import BROADCAST, DataFrame, encode_data
from rmr.radio.links import SHADOWING_SIGMAS
from rmr.radio.phy import RELEVANCE_DB, RadioConfig, airtime, path_loss_db
from rmr.radio.station import Station

INDOORS = RadioConfig(tx_power_dbm=-50.0)
"""A range of about 1.9 m."""

SPEED_MPS = 0.5

configs = st.builds(
    RadioConfig,
    tx_power_dbm=st.floats(-60, 30),
    sensitivity_dbm=st.floats(-150, 0),
    exponent=st.floats(1, 8),
    shadowing_db=st.floats(0, 30),
)
speeds = st.floats(0.01, 10.0)


def matters(config, distance):
    """Whether a receiver at this distance would keep the frame, on the best link that there can be."""
    best = SHADOWING_SIGMAS * config.shadowing_db
    power = config.tx_power_dbm + best - path_loss_db(distance, config.exponent)
    return power >= config.sensitivity_dbm - RELEVANCE_DB


# --- those who stand ----------------------------------------------------------------------------------------


def place(rng, width):
    """Return a place anywhere, on a border or a corner, or a hair beside one."""
    hair = width * rng.choice((0.0, 1e-12, -1e-12, 1e-3, -1e-3))
    borders = [rng.randrange(-4, 5) * width + hair for _ in "xy"]
    anywhere = [rng.uniform(-4.0, 4.0) * width for _ in "xy"]
    return [rng.choice(pair) for pair in zip(borders, anywhere, strict=True)]


def overlooked(config, grid, rng, pairs=300):
    """Return the pairs of a listener and a sender who should hear each other of which the grid knows nothing."""
    range_m = interference_range_m(config)
    found = []
    for _ in range(pairs):
        x, y = place(rng, grid.width_m)
        distance = range_m * rng.choice((rng.random(), 0.999, 1.0))
        angle = rng.choice((rng.uniform(0.0, math.tau), rng.randrange(8) * math.tau / 8))
        other = x + distance * math.cos(angle), y + distance * math.sin(angle)
        near = matters(config, math.dist((x, y), other))
        if near and grid.cell_of(*other) not in grid.cell_of(x, y).ring:
            found.append(((x, y), other))
    return found


@given(configs, speeds, st.integers(0, 2**32))
def test_every_robot_within_interference_range_is_in_the_cell_ring(config, speed, seed):
    assert overlooked(config, grid_of(config, speed), Random(seed), pairs=30) == []


@pytest.mark.parametrize("share", [0.3, 0.9, 0.99])
def test_with_cells_narrower_than_the_range_the_search_finds_pairs_that_miss_each_other(share):
    range_m = interference_range_m(INDOORS)
    assert overlooked(INDOORS, Grid(range_m * share), Random(1)) != []
    assert overlooked(INDOORS, Grid(range_m), Random(1)) == []


# --- those who drive ----------------------------------------------------------------------------------------


def walk(rng, start, speed, ticks):
    """Yield places, one for each tick: straight on at some speed up to `speed`, with a new direction now and then."""
    x, y = start
    vx = vy = 0.0
    for tick in range(ticks):
        if tick % 20 == 0:
            pace, angle = rng.choice((0.0, speed, speed)), rng.choice((rng.uniform(0.0, math.tau), 0.0, math.pi))
            vx, vy = pace * math.cos(angle) / TICK_HZ, pace * math.sin(angle) / TICK_HZ
        x, y = x + vx, y + vy
        yield x, y


def across(width, speed, ticks):
    """Yield places of one that drives straight over the border at `width`, as long before as after it."""
    for tick in range(-ticks // 2, ticks // 2):
        yield width + HYSTERESIS_M + tick * speed / TICK_HZ, 0.5 * width


def unheard(config, grid, listener, sender, delays):
    """Return the places at which two who drive should have heard each other, and did not.

    A listener follows its own cell at each tick, and what it declares takes effect some ticks later, in order.
    """
    cell, under_way, ring = None, [], None
    found = []
    for tick, (own, other) in enumerate(zip(listener, sender, strict=True)):
        followed = grid.follow(cell, *own)
        if ring is None:
            ring = followed.ring
        if followed != cell:
            cell = followed
            under_way.append((tick + next(delays), cell.ring))
        while under_way and under_way[0][0] <= tick:
            ring = under_way.pop(0)[1]
        if matters(config, math.dist(own, other)) and grid.cell_of(*other) not in ring:
            found.append((own, other))
    return found


TICKS = 240
SLOWEST_TICKS = int(LAG_S * TICK_HZ) - 1
"""A declaration that takes as long as there is; the sample on which it goes takes the last tick."""


@settings(max_examples=40)
@given(configs, speeds, st.integers(0, 2**32))
def test_two_driving_robots_miss_no_frame_while_cell_declarations_are_delayed(config, speed, seed):
    rng = Random(seed)
    grid = grid_of(config, speed)
    delays = iter(lambda: rng.choice((0, 1, rng.randrange(SLOWEST_TICKS), SLOWEST_TICKS)), None)
    start = place(rng, grid.width_m)
    other = [along + rng.uniform(-1.0, 1.0) * interference_range_m(config) for along in start]
    walks = walk(rng, start, speed, TICKS), walk(rng, other, speed, TICKS)
    assert unheard(config, grid, *walks, delays) == []


def at_the_border(grid):
    """What the worst case overlooks: one drives on at full speed towards another two cells away."""
    slowest = iter(lambda: SLOWEST_TICKS, None)
    standing = [(2.0 * grid.width_m, 0.5 * grid.width_m)] * TICKS
    return unheard(INDOORS, grid, across(grid.width_m, SPEED_MPS, TICKS), standing, slowest)


def test_robot_crossing_a_cell_border_at_full_speed_misses_no_frame_at_the_longest_delay():
    assert at_the_border(grid_of(INDOORS, SPEED_MPS)) == []


@pytest.mark.parametrize(
    "margin_m", [0.0, HYSTERESIS_M, SPEED_MPS * LAG_S, HYSTERESIS_M + 0.9 * SPEED_MPS * LAG_S], ids=str
)
def test_robot_crossing_a_cell_border_misses_frames_with_a_smaller_margin(margin_m):
    assert at_the_border(Grid(interference_range_m(INDOORS) + margin_m)) != []


def test_robot_jittering_on_a_cell_border_or_corner_keeps_its_cell():
    grid, rng, cell = grid_of(INDOORS, SPEED_MPS), Random(3), None
    followed = []
    for _ in range(500):
        shaken = [grid.width_m + rng.uniform(-0.49, 0.49) * HYSTERESIS_M for _ in "xy"]
        cell = grid.follow(cell, *shaken)
        followed.append(cell)
    assert len(set(followed)) == 1


# --- the range and the cells ----------------------------------------------------------------------------------


def heard_at(distance):
    """Return whether a station at this distance counts what it hears of a frame as on the air."""
    station = Station(2, 7, 1, Random(1), INDOORS)
    psdu = encode_data(DataFrame(7, BROADCAST, 1, 0, False, b"x"))
    station.hear(Announcement(1, 0, 0, 0, airtime(len(psdu)), INDOORS.tx_power_dbm, distance, 0.0, psdu))
    return bool(station._air)


def test_the_range_is_the_one_at_which_a_station_forgets_frames():
    range_m = interference_range_m(INDOORS)
    assert 1.8 < range_m < 2.0
    assert heard_at(range_m * 0.9999)
    assert not heard_at(range_m * 1.0001)


def test_shadowing_widens_the_range_by_three_deviations():
    shadowed = interference_range_m(RadioConfig(tx_power_dbm=-50.0, shadowing_db=4.0))
    assert shadowed == pytest.approx(interference_range_m(RadioConfig(tx_power_dbm=-38.0)))


def test_the_range_is_never_below_the_metre_within_which_distance_costs_nothing_and_has_an_end():
    assert interference_range_m(RadioConfig(tx_power_dbm=-60.0, sensitivity_dbm=0.0)) == pytest.approx(1.0)
    assert interference_range_m(RadioConfig(exponent=0.001)) == RANGE_MAX_M
    assert interference_range_m(RadioConfig(exponent=0.0)) == RANGE_MAX_M


def test_cells_are_counted_from_the_origin_in_all_directions():
    grid = Grid(2.0)
    assert [grid.cell_of(x, 0.5) for x in (-2.1, -2.0, -0.1, 0.0, 1.9, 2.0)] == [
        Cell(column, 0) for column in (-2, -1, -1, 0, 0, 1)
    ]
    assert sorted(grid.cell_of(-1.0, 3.0).ring) == [Cell(x, y) for x in (-2, -1, 0) for y in (0, 1, 2)]


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(-2.0, 2.0))
def test_however_far_away_cells_are_bounded_and_neighbours_have_each_other_in_their_rings(x, step):
    grid = Grid(2.0)
    cell, other = grid.cell_of(x, -x), grid.cell_of(x + step, -x + step)
    assert max(map(abs, cell)) <= CELL_MAX
    assert other in cell.ring
    assert grid.follow(cell, x, -x) == cell


@pytest.mark.parametrize("width", [0.0, -1.0, math.nan])
def test_cells_without_a_width_are_refused(width):
    with pytest.raises(ValueError, match="wide"):
        Grid(width)
