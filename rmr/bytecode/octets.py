"""Octets of the byte-code's parts: varints, texts, values.

Numbers are little-endian base-128 varints (LEB128: 7 bits an octet, the high bit marks continuation); signed ones are
zigzag-coded before. The input of the reader is untrusted: every length and count is compared with the octets left
before anything is allocated, nesting is bounded, and every defect is a `BytecodeError` with reason and offset.
"""

import math
import struct

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.bytecode.conform import NESTING_MAX

FALSE, TRUE, INT, FLOAT, STRING, SYMBOL, ROBOT, LIST = range(8)
"""Tags of encoded values."""


class BytecodeError(Exception):
    """Octets that are no byte-code of this version; the message says why."""


def identity(value: Value) -> tuple[str, object]:
    """Return a key that distinguishes values that are equal in Python (1, 1.0, true and @1; `a` and ``"a"``)."""
    if isinstance(value, tuple):
        return ("list", tuple(identity(item) for item in value))
    return (type(value).__name__, repr(value) if isinstance(value, float) else value)


class Writer:
    """Appends encoded parts to a buffer."""

    __slots__ = ("octets",)

    def __init__(self) -> None:
        self.octets = bytearray()

    def octet(self, number: int) -> None:
        """Append one octet."""
        self.octets.append(number)

    def varint(self, number: int) -> None:
        """Append an unsigned number."""
        while number > 0x7F:
            self.octets.append(number & 0x7F | 0x80)
            number >>= 7
        self.octets.append(number)

    def zigzag(self, number: int) -> None:
        """Append a signed 64-bit number."""
        self.varint(number << 1 if number >= 0 else (-number << 1) - 1)

    def text(self, text: str) -> None:
        """Append a text: length in octets, UTF-8."""
        octets = text.encode()
        self.varint(len(octets))
        self.octets += octets

    def value(self, value: Value) -> None:
        """Append a value: its tag, then the contents."""
        # Subclasses first: bool and Robot are ints, Symbol is a str.
        if isinstance(value, bool):
            self.octet(TRUE if value else FALSE)
        elif isinstance(value, Robot):
            self.octet(ROBOT)
            self.varint(value)
        elif isinstance(value, int):
            self.octet(INT)
            self.zigzag(value)
        elif isinstance(value, float):
            self.octet(FLOAT)
            self.octets += struct.pack("<d", value)
        elif isinstance(value, str):
            self.octet(SYMBOL if isinstance(value, Symbol) else STRING)
            self.text(value)
        else:
            self.octet(LIST)
            self.varint(len(value))
            for item in value:
                self.value(item)


class Reader:
    """Decodes parts of `data` from `position` on; never reads beyond `end`."""

    __slots__ = ("data", "end", "position")

    def __init__(self, data: bytes, position: int, end: int) -> None:
        self.data = data
        self.position = position
        self.end = end

    def fail(self, reason: str) -> BytecodeError:
        """Return the error for `reason` at the present offset."""
        return BytecodeError(f"malformed byte-code at offset 0x{self.position:04x}: {reason}")

    def octet(self) -> int:
        """Take one octet."""
        if self.position >= self.end:
            raise self.fail("the table ends too early")
        number = self.data[self.position]
        self.position += 1
        return number

    def varint(self) -> int:
        """Take an unsigned number of at most 64 bits."""
        number = 0
        for place in range(10):  # ten groups of seven bits hold 64 bits
            octet = self.octet()
            number |= (octet & 0x7F) << 7 * place
            if octet < 0x80:
                # The tenth octet has room for six bits more than 64.
                if number >> 64:
                    break
                return number
        raise self.fail("a number of more than 64 bits")

    def zigzag(self) -> int:
        """Take a signed 64-bit number."""
        number = self.varint()
        return -((number + 1) >> 1) if number & 1 else number >> 1

    def count(self, limit: int | None = None) -> int:
        """Take the number of entries that follow, each at least one octet long."""
        return self.fits(self.varint(), limit)

    def fits(self, number: int, limit: int | None = None) -> int:
        """Return `number`, a count of entries, if it is within `limit`; without one, within the octets left."""
        bound = self.end - self.position if limit is None else limit
        if number > bound:
            raise self.fail(f"a count of {number} where at most {bound} fit")
        return number

    def index(self, size: int, table: str) -> int:
        """Take an index into a table of `size` entries."""
        number = self.varint()
        if number >= size:
            raise self.fail(f"index {number} into {size} {table}")
        return number

    def take(self, size: int) -> bytes:
        """Take `size` octets."""
        if size > self.end - self.position:
            raise self.fail("the table ends too early")
        self.position += size
        return self.data[self.position - size : self.position]

    def text(self) -> str:
        """Take a text."""
        octets = self.take(self.count())
        try:
            return octets.decode()
        except UnicodeDecodeError:
            raise self.fail("a text that is not UTF-8") from None

    def value(self, nesting: int = 0) -> Value:
        """Take a value."""
        tag = self.octet()
        if tag in (FALSE, TRUE):
            return tag == TRUE
        if tag == INT:
            return self._integer()
        if tag == FLOAT:
            return self._float()
        if tag == STRING:
            return self.text()
        if tag == SYMBOL:
            return Symbol(self.text())
        if tag == ROBOT:
            return self.robot()
        if tag != LIST:
            raise self.fail(f"unknown kind of value {tag}")
        if nesting >= NESTING_MAX:
            raise self.fail(f"lists nested deeper than {NESTING_MAX}")
        return tuple([self.value(nesting + 1) for _ in range(self.count())])

    def robot(self) -> Robot:
        """Take a robot id."""
        number = self.varint()
        if number > ROBOT_ID_MAX:
            raise self.fail(f"robot id {number} above {ROBOT_ID_MAX}")
        return Robot(number)

    def _integer(self) -> int:
        number = self.zigzag()
        if not INT_MIN <= number <= INT_MAX:
            raise self.fail("an integer of more than 64 bits")
        return number

    def _float(self) -> float:
        number: float = struct.unpack("<d", self.take(8))[0]
        if not math.isfinite(number):
            raise self.fail("a float that is not finite")
        return number
