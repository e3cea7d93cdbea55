"""The fixpoint solver of type inference: a work-list over cells whose types only widen.

Termination: the lattice is a few steps high, so each cell changes a few times. After the forward pass a cell that is
still open takes the narrowest type that its fallbacks offer; that type flows forward again, until no fallback offers
anything. Without contradictions the result does not depend on the order of the program's items.

A list's items have a cell of their own, and flow where the list flows. The type of a list that contains itself would
be infinite; nesting is cut off at a fixed depth.
"""

from collections import deque
from collections.abc import Iterator, Sequence

from rmr.bytecode.conform import NESTING_MAX
from rmr.bytecode.program import Base, Type
from rmr.lang.analyse.types import OPEN, TypeCell, join
from rmr.lang.read.source_text import Span


class Solver:
    """The cells of one program and the flow edges between them."""

    def __init__(self) -> None:
        self._queue: deque[tuple[TypeCell, Sequence[TypeCell]]] = deque()
        self._sources: dict[TypeCell, None] = {}
        self._fresh: list[TypeCell] = []
        self._linked: set[tuple[TypeCell, TypeCell]] = set()
        self._asked: set[tuple[TypeCell, TypeCell]] = set()
        self.endless = False
        """True after a list type exceeded the nesting bound of values."""

    def flow(self, source: TypeCell, target: TypeCell) -> None:
        """Add the constraint that `target` is at least as wide as `source`."""
        if not target.fixed:
            source.targets.append(target)
            self._pass(source, target)

    def fall_back(self, source: TypeCell, target: TypeCell) -> None:
        """Add the default that `target` has the type of `source` if no flow gives it one."""
        if not target.fixed:
            source.fallbacks.append(target)
            self._sources[source] = None

    def solve(self) -> None:
        """Propagate all types: first forward, then in rounds to the cells that are still open."""
        self._settle()
        # Later rounds start only from cells that changed; `_widen` collects them.
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
        # Each pair of item cells is linked once, however often its lists are passed.
        if one is not None and other is not None and (one, other) not in self._linked:
            self._linked.add((one, other))
            one.targets.append(other)
            self._queue.append((one, (other,)))

    def _widen(self, cell: TypeCell, kind: Type, origin: Span | None, *, mixed: bool = False) -> None:
        wider = join(cell.kind, kind)
        # A float that ints flow into too ("mixed") needs a conversion at run time, even where its type stays float.
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
        """Return the cell of a list's items, made on first use, or None beyond the nesting bound."""
        if cell.items is None and cell.depth < NESTING_MAX:
            cell.items = TypeCell(OPEN, None, depth=cell.depth + 1)
        self.endless |= cell.items is None
        return cell.items

    @staticmethod
    def holds_itself(whole: TypeCell) -> bool:
        """Whether the list type is recursive: it flows to the items at some depth, or their type flows to it."""
        within: list[TypeCell] = []
        cell = whole.items
        while cell is not None:
            within.append(cell)
            cell = cell.items
        return not _reached([whole]).isdisjoint(within) or whole in _reached(within)

    # ---- fallbacks of open cells

    def _ask(self) -> dict[TypeCell, tuple[Type, Span | None]]:
        """Return the types for open cells, the narrowest offered to each, offered by cells changed since last time.

        Nothing is assigned here: all offers of a round are compared first, so that their order does not matter.
        """
        wanted: dict[TypeCell, tuple[Type, Span | None]] = {}
        queue: deque[tuple[TypeCell, Sequence[TypeCell]]] = deque((cell, cell.fallbacks) for cell in self._fresh)
        self._fresh = []
        while queue:
            source, targets = queue.popleft()
            # An open cell passes on the offer that it got itself.
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
        """Add the fallback from the items of `source` to those of `target`; yield it the first time."""
        one = self._items(source)
        other = self._items(target)
        if one is not None and other is not None and (one, other) not in self._asked:
            self._asked.add((one, other))
            one.fallbacks.append(other)
            yield one, (other,)


def _reached(cells: list[TypeCell]) -> set[TypeCell]:
    """Return the cells reachable from `cells` along flows and fallbacks."""
    seen = set(cells)
    queue = deque(cells)
    while queue:
        cell = queue.popleft()
        new = [target for target in (*cell.targets, *cell.fallbacks) if target not in seen]
        seen.update(new)
        queue.extend(new)
    return seen


def _key(kind: Type) -> tuple[int, bool]:
    """Return the sort key of types, narrowest first; the order of types that contradict each other is arbitrary."""
    return kind.base, not kind.name
