"""Received power between the stations of the ether, by their positions.

Stations are known by their index; arrays have an entry for each. Only the stations in a transmitter's cell and the
ring around it are computed (`rmr.radio.cells`), so robots out of range cost a frame nothing but those entries. The
result for a transmitter is cached until a station moves, unless shadowing or disturbances apply.
"""

from bisect import insort
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rmr.base.time import Instant
from rmr.radio.cells import Cell, Grid, interference_range_m
from rmr.radio.links import Links
from rmr.radio.phy import LOSS_AT_1_M_DB, RELEVANCE_DB, RadioConfig

Floats = NDArray[np.float64]
Places = Any
"""An index array, in order, or a slice."""


class ReachedStations(NamedTuple):
    """The stations within reach of one transmitter, and the power that each receives."""

    at: Places
    """Indices of the stations within reach."""
    power_dbm: Floats
    """Received power at every station, dBm; minus infinity out of reach."""
    power: Floats
    """Received power at every station, milliwatts; 0 where it is too weak even to interfere."""


class PathLossMap:
    """The positions of all stations, and the path loss between them."""

    def __init__(self, config: RadioConfig, links: Links) -> None:
        self._near_dbm = config.tx_power_dbm - LOSS_AT_1_M_DB
        """Received power at 1 m and nearer."""
        self._decibels = 5.0 * config.exponent
        """Path loss of ten times the squared distance, dB: 10 n log10(d) = 5 n log10(d^2)."""
        self._least_dbm = config.sensitivity_dbm - RELEVANCE_DB
        self._links = links
        self._grid = Grid(interference_range_m(config))
        self._cells: list[Cell] = []
        self._members: dict[Cell, list[int]] = {}
        self._within: dict[Cell, Places] = {}
        self._reached: dict[int, ReachedStations] = {}
        self.room = 64  # initial capacity in stations; it doubles when it is used up
        """Length of all arrays."""
        self.x = np.zeros(self.room)
        self.y = np.zeros(self.room)
        self._places: list[tuple[float, float]] = []
        self.addresses = np.zeros(self.room, dtype=np.uint64)

    def add(self, address: int, x: float, y: float) -> int:
        """Place a new station and return its index."""
        index = len(self._cells)
        if index == self.room:
            self.room *= 2
            self.x = np.resize(self.x, self.room)
            self.y = np.resize(self.y, self.room)
            self.addresses = np.resize(self.addresses, self.room)
        self.addresses[index] = address
        self.x[index] = x
        self.y[index] = y
        self._places.append((x, y))
        self._cells.append(self._grid.cell_of(x, y))
        self._enter(index, self._cells[index])
        return index

    def move(self, index: int, x: float, y: float) -> None:
        """Set the place of a station, metres."""
        if self._places[index] == (x, y):
            return
        self._places[index] = x, y
        self.x[index] = x
        self.y[index] = y
        self._reached.clear()
        was = self._cells[index]
        cell = self._grid.cell_of(x, y, was)
        if cell is not was:
            self._members[self._cells[index]].remove(index)
            self._enter(index, cell)

    def cell(self, index: int) -> Cell:
        """Return the cell of a station."""
        return self._cells[index]

    def place(self, index: int) -> tuple[float, float]:
        """Return the place of a station, metres."""
        return self._places[index]

    def reached(self, index: int, start: Instant) -> ReachedStations:
        """Return what a transmission of station `index` reaches that begins at `start`."""
        if self._links.fades:  # depends on the instant: not cached
            return self._reach(index, start)
        known = self._reached.get(index)
        if known is None:
            known = self._reached[index] = self._reach(index, start)
        return known

    def _enter(self, index: int, cell: Cell) -> None:
        self._cells[index] = cell
        insort(self._members.setdefault(cell, []), index)
        self._within.clear()
        self._reached.clear()

    def _reach(self, index: int, start: Instant) -> ReachedStations:
        at = self._within_reach(self._cells[index])
        x, y = self._places[index]
        square = self.x[at] - x
        dy = self.y[at] - y
        square *= square
        dy *= dy
        square += dy
        loss_db = np.log10(np.maximum(square, 1.0, out=square), out=square)
        loss_db *= self._decibels
        heard_dbm = np.subtract(self._near_dbm, loss_db, out=loss_db)
        if self._links.fades:
            source = int(self.addresses[index])
            heard_dbm += [self._links.gain_db(source, other, start) for other in self.addresses[at].tolist()]
        power_dbm = np.empty(self.room)
        power = np.zeros(self.room)
        power_dbm.fill(-inf)
        power_dbm[at] = heard_dbm
        power_dbm[index] = -inf
        heard_dbm = power_dbm[at]
        powers = heard_dbm / 10.0
        np.power(10.0, powers, out=powers)
        powers *= heard_dbm >= self._least_dbm
        power[at] = powers
        return ReachedStations(at, power_dbm, power)

    def _within_reach(self, cell: Cell) -> Places:
        """Return the stations that a transmitter in `cell` may reach."""
        known = self._within.get(cell)
        if known is None:
            found = sorted(index for near in cell.ring for index in self._members.get(near, ()))
            everybody = len(found) == len(self._cells)
            known = slice(0, len(found)) if everybody else np.array(found, dtype=np.intp)
            self._within[cell] = known
        return known
