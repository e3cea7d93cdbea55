"""Cells of the floor: announcements reach all receivers in range although no sender knows their positions.

The floor is cut into square cells, fixed by the lab's radio and its robots' speed alone, so that all robots of a lab
cut it alike. An announcement goes out under the cell in which it says that its transmitter is; a robot listens to
its own cell and the ring of eight around it. Two places whose cells are not neighbours are more than a cell's width
apart along x or along y, so nothing that matters is missed as long as a width is at least the *interference range*:
the distance from which on a frame, on the best link that shadowing makes, is too weak even to disturb
(`RELEVANCE_DB`). Disturbances only take power.

A width is more than that by a margin for what a listener's cell lags behind its place:

- *Hysteresis.* A robot keeps its cell until it is `HYSTERESIS_M` outside, so one that stands on a border, or drives
  along it, does not change its mind at every sample.
- *Lag.* What a robot now hears was sent on by what it asked for a moment ago; in `LAG_S` it drives so far.

The margin stands at the listener alone: announcements carry the place that they are filed under.
"""

from dataclasses import dataclass
from math import floor
from typing import Final, NamedTuple

from rmr.radio.links import SHADOWING_SIGMAS
from rmr.radio.phy import LOSS_AT_1_M_DB, NETWORK, RELEVANCE_DB, RadioConfig

HYSTERESIS_M: Final = 0.1
"""Hysteresis: distance outside its cell up to which a robot keeps it; more than a standing robot is pushed."""

LAG_S: Final = 1.0
"""How old a place may be by which a robot listens: under half a second until a robot that steers no more
(its process was held up) stands, and as long again for a sample, a declaration and an announcement to cross the bus,
which take 17, 1 and 1 ms where nothing is held up."""

ROUNDING: Final = 1.0 + 1e-9
"""Factor on the range, for the rounding errors of logarithms and powers."""

RANGE_MAX_M: Final = 1e6
"""Greatest distance of a transmitter from the origin (`Announcement.from_wire`)."""

CELL_MAX: Final = 1 << 15
"""Last cell in each direction, which holds all beyond it: keys are bounded, and a robot beyond it has neighbours."""


class Cell(NamedTuple):
    """A cell's column and row; (0, 0) has its lower left corner at the origin of the arena."""

    x: int
    y: int

    @property
    def ring(self) -> tuple["Cell", ...]:
        """The cell and the eight around it, by row and column."""
        return tuple(Cell(self.x + dx, self.y + dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1))


def interference_range_m(config: RadioConfig) -> float:
    """Return the distance in metres beyond which a frame has no effect, at least 1 m (nearer costs the same).

    A receiver farther away forgets the frame whatever the link's shadowing.
    """
    if config.mode == NETWORK:
        return RANGE_MAX_M
    strongest_dbm = config.tx_power_dbm - LOSS_AT_1_M_DB + SHADOWING_SIGMAS * config.shadowing_db
    spare_db = strongest_dbm - (config.sensitivity_dbm - RELEVANCE_DB)
    if spare_db <= 0.0:
        return ROUNDING
    per_decade_db = 10.0 * config.exponent
    if spare_db >= 6.0 * per_decade_db:  # beyond RANGE_MAX_M; also where power does not fall with distance
        return RANGE_MAX_M
    return float(ROUNDING * 10.0 ** (spare_db / per_decade_db))


@dataclass(frozen=True, slots=True)
class Grid:
    """The cells of one lab."""

    width_m: float

    def __post_init__(self) -> None:
        if not self.width_m > 0.0:
            raise ValueError(f"cells cannot be {self.width_m} m wide")

    def cell_of(self, x: float, y: float, was: Cell | None = None) -> Cell:
        """Return the cell of a place (metres), `was` itself if it is still that one.

        A border belongs to the cell above or to the right of it.
        """
        if was is not None and floor(x / self.width_m) == was.x and floor(y / self.width_m) == was.y:
            return was
        return Cell(self._index(x), self._index(y))

    def _index(self, along: float) -> int:
        return max(-CELL_MAX, min(CELL_MAX, floor(along / self.width_m)))

    def follow(self, cell: Cell | None, x: float, y: float) -> Cell:
        """Return the cell by which a robot at (x, y) listens that listened by `cell` until now."""
        if cell is not None and max(self._outside(cell.x, x), self._outside(cell.y, y)) <= HYSTERESIS_M:
            return cell
        return self.cell_of(x, y)

    def _outside(self, index: int, along: float) -> float:
        """Return how far `along` is outside the stretch of `index`; the last stretches have no outer border."""
        below = index * self.width_m - along if index > -CELL_MAX else 0.0
        above = along - (index + 1) * self.width_m if index < CELL_MAX else 0.0
        return max(below, above)


def grid_of(config: RadioConfig, speed_mps: float) -> Grid:
    """Return the cells of a lab with this radio, whose robots drive at most `speed_mps`."""
    return Grid(interference_range_m(config) + HYSTERESIS_M + speed_mps * LAG_S)
