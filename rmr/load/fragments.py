"""A program in fragments, whole or as far as it has come."""

from typing import Final

from rmr.bytecode.layout import SIZE_MAX
from rmr.load.load_messages import COUNT_MAX, LoadError


class Fragments:
    """The fragments of one program, all of `piece_octets` but the last one."""

    def __init__(self, digest: int, octets: int, piece_octets: int) -> None:
        """Raise LoadError if no program has so many octets, or it has too many fragments."""
        self.digest: Final = digest
        self.octets: Final = octets
        self.piece_octets: Final = piece_octets
        self.count: Final = -(-octets // piece_octets)
        if not 0 < octets <= SIZE_MAX or self.count > COUNT_MAX:
            raise LoadError(f"a program of {octets} octets in {self.count} fragments is too large")
        self._pieces: dict[int, bytes] = {}

    @classmethod
    def of(cls, digest: int, program: bytes, piece_octets: int) -> "Fragments":
        """Return the fragments of a whole program. Raises LoadError."""
        fragments = cls(digest, len(program), piece_octets)
        for number in range(fragments.count):
            fragments._pieces[number] = program[number * piece_octets : (number + 1) * piece_octets]
        return fragments

    def is_same(self, digest: int, octets: int, piece_octets: int) -> bool:
        """Return whether these are the fragments of such a program."""
        return (self.digest, self.octets, self.piece_octets) == (digest, octets, piece_octets)

    def add(self, number: int, piece: bytes) -> bool:
        """Take a fragment; return whether it was missing. One of the wrong size is none."""
        size = self.piece_octets if number < self.count - 1 else self.octets - number * self.piece_octets
        if number >= self.count or len(piece) != size or number in self._pieces:
            return False
        self._pieces[number] = piece
        return True

    def piece(self, number: int) -> bytes | None:
        """Return a fragment; None if it is missing."""
        return self._pieces.get(number)

    @property
    def missing(self) -> list[int]:
        """The numbers of the missing fragments."""
        return [number for number in range(self.count) if number not in self._pieces]

    @property
    def whole(self) -> bytes | None:
        """The program; None while fragments are missing."""
        if len(self._pieces) < self.count:
            return None
        return b"".join([self._pieces[number] for number in range(self.count)])
