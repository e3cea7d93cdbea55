"""Source text in the making: lines, each as deep as the block that it stands in."""

from collections.abc import Iterable


class Lines:
    """Collects the lines of a module."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self.depth = 0
        """How far in the next line stands."""

    def __call__(self, *lines: str) -> None:
        """Add lines to the block."""
        margin = " " * self.depth
        self._lines += [margin + line for line in lines]

    def block(self, head: str) -> "Level":
        """Add the line `head`; what is added meanwhile stands below it."""
        self(head)
        level = self.level()
        self.enter()
        return level

    def level(self) -> "Level":
        """Come back to where it stands now, however deep what is added meanwhile goes."""
        return Level(self)

    def enter(self) -> None:
        """Let all that is added from here on stand one step further in, until the enclosing level ends."""
        self.depth += 1

    @property
    def is_open(self) -> bool:
        """Whether the last line begins a block in which nothing stands yet."""
        return bool(self._lines) and self._lines[-1].endswith(":")

    def mark(self) -> int:
        """Return a place for `insert`."""
        return len(self._lines)

    def insert(self, mark: int, lines: Iterable[str]) -> None:
        """Add lines, as deep as the line before, at a place where none have been added yet."""
        margin = " " * self.depth
        self._lines[mark:mark] = [margin + line for line in lines]

    @property
    def text(self) -> str:
        """All of it."""
        return "\n".join([*self._lines, ""])

    def __len__(self) -> int:
        return len(self._lines)


class Level:
    """Where lines stood when it was made; they do again at the end of its ``with``."""

    __slots__ = ("_depth", "_lines")

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self._depth = lines.depth

    def __enter__(self) -> None:
        """Leave the lines as they are."""

    def __exit__(self, *_: object) -> None:
        self._lines.depth = self._depth
