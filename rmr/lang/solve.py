"""The solver of type inference: types flow from cell to cell until nothing changes any more.

Cells only ever widen, and the lattice is a few steps high, so that it ends after few rounds. What is open when
all else is settled takes its type from its fallbacks.
"""

from collections import deque

from rmr.bytecode.program import Base, Type
from rmr.lang.source import Span
from rmr.lang.types import Cell, join


class Solver:
    """The cells of one program and what flows between them."""

    def __init__(self) -> None:
        self._sources: dict[Cell, None] = {}
        self._falling_back = False
        self._queue: deque[Cell] = deque()

    def solve(self) -> None:
        """Let all types flow, first forward, then to what is still open."""
        self._settle()
        self._falling_back = True
        self._queue.extend(cell for cell in self._sources if cell.type.base is not Base.OPEN)
        self._settle()

    def _widen(self, cell: Cell, kind: Type, origin: Span | None, *, mixed: bool = False) -> None:
        if cell.fixed:
            return
        wider = join(cell.type, kind)
        mixes = wider.base is Base.FLOAT and (mixed or cell.mixed or Base.INT in {cell.type.base, kind.base})
        if wider != cell.type:
            cell.origin = origin
        elif mixes == cell.mixed:
            return
        cell.type, cell.mixed = wider, mixes
        self._queue.append(cell)

    def _settle(self) -> None:
        while self._queue:
            cell = self._queue.popleft()
            for target in cell.targets:
                self._widen(target, cell.type, cell.origin, mixed=cell.mixed)
            for target in cell.fallbacks if self._falling_back else ():
                if target.type.base is Base.OPEN:
                    self._widen(target, cell.type, cell.origin)

    def flow(self, source: Cell, target: Cell) -> None:
        """Let `target` be at least as wide as `source`."""
        source.targets.append(target)
        self._widen(target, source.type, source.origin, mixed=source.mixed)

    def fall_back(self, source: Cell, target: Cell) -> None:
        """Let `target` be of `source`'s type if nothing else gives it one."""
        source.fallbacks.append(target)
        self._sources[source] = None
