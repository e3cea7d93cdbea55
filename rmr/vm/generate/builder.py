"""Builds blocks of the intermediate form from the outside in: a nested search is known loop by loop.

A compound statement is begun, filled, and made when its block ends. A block that is opened without a ``with`` stays
open until the enclosing `level` ends: so each loop of a search stands in the one before it.
"""

from collections.abc import Callable, Iterable
from functools import partial
from types import TracebackType

from rmr.vm.generate.form import Block, Define, If, Loop, Statement, Try, While, with_otherwise

Make = Callable[[Block], Statement]
"""Makes a compound statement of its inner block."""


class FormBuilder:
    """Collects the statements of a module."""

    def __init__(self) -> None:
        self._blocks: list[list[Statement]] = [[]]
        """The open blocks, the outermost first; statements are added to the last one."""
        self._makes: list[Make] = []
        """The constructors that make a statement of each open block when it is closed, the outermost first."""

    def __call__(self, *statements: Statement) -> None:
        """Add statements to the block."""
        self._blocks[-1] += statements

    @property
    def depth(self) -> int:
        """How many blocks are open."""
        return len(self._makes)

    def open(self, make: Make) -> None:
        """Open a block that stays open until the enclosing level ends."""
        self._blocks.append([])
        self._makes.append(make)

    def open_otherwise(self) -> None:
        """Open the else branch of the statement that was added last."""
        self.open(partial(with_otherwise, self._blocks[-1].pop()))

    def close(self, depth: int) -> None:
        """Close all blocks but the outermost `depth`."""
        while len(self._makes) > depth:
            statement = self._makes.pop()(tuple(self._blocks.pop()))
            self._blocks[-1].append(statement)

    def level(self) -> "NestedBlock":
        """Return a context that closes the blocks opened in it."""
        return NestedBlock(self)

    def block(self, make: Make) -> "NestedBlock":
        """Return a context whose statements become the inner block of the statement that `make` returns."""
        return NestedBlock(self, make)

    def otherwise(self) -> "NestedBlock":
        """Return a context whose statements become the else branch of the statement that was added last."""
        return NestedBlock(self, partial(with_otherwise, self._blocks[-1].pop()))

    def function(self, name: str, *parameters: str) -> "NestedBlock":
        """Add a function whose body is added meanwhile."""
        return self.block(partial(Define, name, parameters))

    def when(self, test: str) -> "NestedBlock":
        """Add an If."""
        return self.block(partial(If, test))

    def loop(self, target: str, items: str) -> "NestedBlock":
        """Add a Loop."""
        return self.block(partial(Loop, target, items))

    def repeat(self, test: str) -> "NestedBlock":
        """Add a While."""
        return self.block(partial(While, test))

    def attempt(self, exception: str, name: str, *handler: Statement) -> "NestedBlock":
        """Add a Try whose body is added meanwhile."""
        return self.block(partial(Try, exception, name, handler))

    def mark(self) -> int:
        """Return a position in the block for `insert`."""
        return len(self._blocks[-1])

    def insert(self, mark: int, statements: Iterable[Statement]) -> None:
        """Insert statements at a position that was marked in the same block."""
        self._blocks[-1][mark:mark] = statements

    @property
    def statements(self) -> Block:
        """All that has been added, once all blocks are closed."""
        assert not self._makes
        return tuple(self._blocks[0])


class NestedBlock:
    """A context that closes, at its end, the blocks opened in it; with `make`, it opens one at its beginning.

    A class rather than a generator (`contextlib.contextmanager`): a program of some rules enters thousands of them.
    """

    __slots__ = ("_build", "_depth", "_make")

    def __init__(self, build: FormBuilder, make: Make | None = None) -> None:
        self._build = build
        self._make = make
        self._depth = 0

    def __enter__(self) -> None:
        self._depth = self._build.depth
        if self._make is not None:
            self._build.open(self._make)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if kind is None:  # after an exception the form is discarded
            self._build.close(self._depth)
