"""Builds blocks of the intermediate form from the outside in: a nested search is known loop by loop.

A compound statement is begun, filled, and made when its block ends. A block that is opened without a ``with`` stays
open until the enclosing `level` ends: so each loop of a search stands in the one before it.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial

from rmr.vm.generate.form import Block, Define, If, Loop, Statement, Try, While, with_otherwise

Make = Callable[[Block], Statement]
"""Makes a compound statement of its inner block."""


class FormBuilder:
    """Collects the statements of a module."""

    def __init__(self) -> None:
        self._blocks: list[list[Statement]] = [[]]
        """The block that statements are added to, behind those that it stands in."""
        self._makes: list[Make] = []
        """What the open blocks become, the outermost first."""

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

    @contextmanager
    def level(self) -> Iterator[None]:
        """Close all blocks at its end that have been opened in it."""
        depth = self.depth
        yield
        self.close(depth)

    @contextmanager
    def block(self, make: Make) -> Iterator[None]:
        """Add the statement that `make` makes of what is added meanwhile."""
        depth = self.depth
        self.open(make)
        yield
        self.close(depth)

    @contextmanager
    def otherwise(self) -> Iterator[None]:
        """Make what is added meanwhile the else branch of the statement that was added last."""
        depth = self.depth
        self.open_otherwise()
        yield
        self.close(depth)

    def function(self, name: str, *parameters: str) -> AbstractContextManager[None]:
        """Add a function whose body is added meanwhile."""
        return self.block(partial(Define, name, parameters))

    def when(self, test: str) -> AbstractContextManager[None]:
        """Add an If."""
        return self.block(partial(If, test))

    def loop(self, target: str, items: str) -> AbstractContextManager[None]:
        """Add a Loop."""
        return self.block(partial(Loop, target, items))

    def repeat(self, test: str) -> AbstractContextManager[None]:
        """Add a While."""
        return self.block(partial(While, test))

    def attempt(self, exception: str, name: str, *handler: Statement) -> AbstractContextManager[None]:
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
