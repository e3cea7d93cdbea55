"""The solver of type inference: types flow from cell to cell until nothing changes any more.

Cells only ever widen, and the lattice is a few steps high, so that it ends after few rounds. What is open when
all else is settled is asked for by its fallbacks: of all types that they need it takes the narrowest. What it
then is flows on, and so forth. The outcome does not depend on the order in which the program states things,
unless things contradict each other.

Where a list flows, its items flow: each cell of a list has a cell for them. The type of a list that holds
itself would have no end; lists are followed a bounded number deep.
"""

from collections import deque
from collections.abc import Iterator, Sequence

from rmr.bytecode.conform import NESTING_MAX
from rmr.bytecode.program import Base, Type
from rmr.lang.analyse.types import OPEN, TypeCell, join
from rmr.lang.read.source_text import Span


class Solver:
    """The cells of one program and what flows between them."""

    def __init__(self) -> None:
        self._queue: deque[tuple[TypeCell, Sequence[TypeCell]]] = deque()
        self._sources: dict[TypeCell, None] = {}
        self._fresh: list[TypeCell] = []
        self._linked: set[tuple[TypeCell, TypeCell]] = set()
        self._asked: set[tuple[TypeCell, TypeCell]] = set()
        self.endless = False
        """Lists were nested deeper than values can be."""

    def flow(self, source: TypeCell, target: TypeCell) -> None:
        """Let `target` be at least as wide as `source`."""
        if not target.fixed:
            source.targets.append(target)
            self._pass(source, target)

    def fall_back(self, source: TypeCell, target: TypeCell) -> None:
        """Let `target` be of `source`'s type if nothing else gives it one."""
        if not target.fixed:
            source.fallbacks.append(target)
            self._sources[source] = None

    def solve(self) -> None:
        """Let all types flow, first forward, then to what is still open."""
        self._settle()
        self._fresh = [cell for cell in self._sources if cell.kind.base is not Base.OPEN]
        while wanted := self._ask():
            for cell, (kind, origin) in wanted.items():
                self._widen(cell, kind, origin)
            self._settle()

    # ---- forward

    def _settle(self) -> None:
        while self._queue:
            source, targets = self._queue.popleft()
            for target in targets:
                self._pass(source, target)

    def _pass(self, source: TypeCell, target: TypeCell) -> None:
        if source.kind.base is Base.OPEN:
            return
        self._widen(target, source.kind, source.origin, mixed=source.mixed)
        if source.kind.base is not Base.LIST or target.kind.base is not Base.LIST:
            return
        one = self._items(source)
        other = self._items(target)
        if one is not None and other is not None and (one, other) not in self._linked:
            self._linked.add((one, other))
            one.targets.append(other)
            self._queue.append((one, (other,)))

    def _widen(self, cell: TypeCell, kind: Type, origin: Span | None, *, mixed: bool = False) -> None:
        wider = join(cell.kind, kind)
        mixes = wider.base is Base.FLOAT and (mixed or cell.mixed or Base.INT in {cell.kind.base, kind.base})
        if wider != cell.kind:
            cell.origin = origin
            self._fresh.append(cell)
        elif mixes == cell.mixed:
            return
        cell.kind = wider
        cell.mixed = mixes
        self._queue.append((cell, cell.targets))

    def _items(self, cell: TypeCell) -> TypeCell | None:
        """Return the cell of a list's items, or None if lists were nested too deep."""
        if cell.items is None and cell.depth < NESTING_MAX:
            cell.items = TypeCell(OPEN, None, depth=cell.depth + 1)
        self.endless |= cell.items is None
        return cell.items

    @staticmethod
    def holds_itself(whole: TypeCell) -> bool:
        """Whether a list's own type flows to its items, or to theirs, or theirs to its own."""
        within: list[TypeCell] = []
        cell = whole.items
        while cell is not None:
            within.append(cell)
            cell = cell.items
        return not _reached([whole]).isdisjoint(within) or whole in _reached(within)

    # ---- to what is open

    def _ask(self) -> dict[TypeCell, tuple[Type, Span | None]]:
        """Return what open cells are asked to be, the narrowest each, by what has a type since last time."""
        wanted: dict[TypeCell, tuple[Type, Span | None]] = {}
        queue: deque[tuple[TypeCell, Sequence[TypeCell]]] = deque((cell, cell.fallbacks) for cell in self._fresh)
        self._fresh = []
        while queue:
            source, targets = queue.popleft()
            kind, origin = wanted.get(source, (source.kind, source.origin))
            for target in targets if kind.base is not Base.OPEN else ():
                if target.kind.base is Base.OPEN and (target not in wanted or _key(kind) < _key(wanted[target][0])):
                    wanted[target] = (kind, origin)
                    queue.append((target, target.fallbacks))
                has, _ = wanted.get(target, (target.kind, None))
                if kind.base is Base.LIST and has.base is Base.LIST:
                    queue.extend(self._ask_items(source, target))
        return wanted

    def _ask_items(self, source: TypeCell, target: TypeCell) -> Iterator[tuple[TypeCell, Sequence[TypeCell]]]:
        """Let the items of `target` fall back on those of `source`; yield these if they have not been asked."""
        one = self._items(source)
        other = self._items(target)
        if one is not None and other is not None and (one, other) not in self._asked:
            self._asked.add((one, other))
            one.fallbacks.append(other)
            yield one, (other,)


def _reached(cells: list[TypeCell]) -> set[TypeCell]:
    """Return the cells to which types flow from any of `cells`."""
    seen = set(cells)
    queue = deque(cells)
    while queue:
        cell = queue.popleft()
        new = [target for target in (*cell.targets, *cell.fallbacks) if target not in seen]
        seen.update(new)
        queue.extend(new)
    return seen


def _key(kind: Type) -> tuple[int, bool]:
    """Return what orders types, the narrower first; of types that contradict each other any one will do."""
    return kind.base, not kind.name
