"""The frame of a byte-code file: header, directory of tables, tables (paper IV.A).

    offset  octets  what
    0       4       magic ``RMR`` and 0x1A
    4       1       version
    5       1       flags: bit 0 strategy textual, bit 1 a debug table is there, bit 2 a table of ensemble rules
                    follows, bit 3 strategy deadline
    6       4       size of the whole file, little-endian
    10      4       CRC-32 (zlib) of everything but these four octets
    14      ...     directory: for each table the number of entries and the offset of the first one, varints;
                    offsets count from the end of the directory
    ...     ...     the tables in the directory's order, one after the other

As in the paper, the number of facts and rules and the offset of the first of each are found without reading anything
else. The order of the tables is `TABLES`; a table refers to entries of others by index.

A signed program has more behind it (`Signed`). What is signed are the octets of the file as it was before, so that it
is the same program with and without; only who judges signatures (`rmr.bus.signing`) reads what stands there.

    0       4       magic ``RMRS``
    4       2       octets of the certificate, little-endian
    6       2       octets of the signature, little-endian
    8       ...     the certificate of the signer (X.509, DER)
    ...     ...     the signature (ECDSA, DER), to the end of the file
"""

import struct
import zlib
from typing import NamedTuple

from rmr.bytecode.octets import BytecodeError, Reader, Writer

MAGIC = b"RMR\x1a"
VERSION = 3
FLAG_TEXTUAL = 1
FLAG_DEBUG = 2
FLAG_ENSEMBLE = 4
FLAG_DEADLINE = 8
FLAG_WORDS = {
    FLAG_TEXTUAL: "order textual",
    FLAG_DEADLINE: "order deadline",
    FLAG_DEBUG: "with a debug table",
    FLAG_ENSEMBLE: "with ensemble rules",
}
"""What each flag says."""
HEADER = struct.Struct("<4sBBII")
CRC_OFFSET = 10
SIGNED_MAGIC = b"RMRS"
SIGNED_HEAD = struct.Struct("<4sHH")
SIZE_MAX = 1 << 22
"""Largest file in octets, with its signature: robots have megabytes, not gigabytes (paper V.B.2), and a decoded octet
may take thirty in memory."""

DEBUG = "debug"
"""The table that a run does not read."""
TABLES = ("constants", "code", "functions", "predicates", "effects", "facts", "goals", "rules", "assertions", DEBUG)
ENSEMBLE = "ensemble"
"""The table behind the others in a file with `FLAG_ENSEMBLE`."""


def tables_of(flags: int) -> tuple[str, ...]:
    """Return the tables of a file with these flags, in the order of its directory."""
    return (*TABLES, ENSEMBLE) if flags & FLAG_ENSEMBLE else TABLES


class Table(NamedTuple):
    """The extent of one table: octets ``start`` to ``end`` (exclusive) hold ``entries`` entries."""

    entries: int
    start: int
    end: int


class Layout(NamedTuple):
    """The header and the directory, decoded."""

    flags: int
    size: int
    crc: int
    directory: int
    """Offset of the directory."""
    tables: dict[str, Table]


class Signed(NamedTuple):
    """A file, and who has signed it, as the file says: nothing of that is checked here."""

    program: bytes
    """The octets that are signed; all of the file if it is not."""
    certificate: bytes = b""
    signature: bytes = b""

    def joined(self) -> bytes:
        """Return the file. Raises BytecodeError if it exceeds `SIZE_MAX`."""
        head = SIGNED_HEAD.pack(SIGNED_MAGIC, len(self.certificate), len(self.signature)) if self.signature else b""
        data = self.program + head + self.certificate + self.signature
        if len(data) > SIZE_MAX:
            raise BytecodeError(f"the program takes {len(data)} octets with its signature, at most {SIZE_MAX}")
        return data


def split(data: bytes) -> Signed:
    """Return the program in `data` and its signature, if it has one.

    Raises:
        BytecodeError: the signature is not whole.
    """
    size = HEADER.unpack_from(data)[3] if len(data) >= HEADER.size and data.startswith(MAGIC) else len(data)
    rest = data[size : size + SIGNED_HEAD.size]
    if size < HEADER.size or not rest or not rest.startswith(SIGNED_MAGIC[: len(rest)]):
        return Signed(data)  # whether that is byte-code is seen by `read_layout`
    there = len(data) - size
    if there < SIGNED_HEAD.size:
        raise BytecodeError(f"truncated: {there} octets of its signature are there, the head alone has 8")
    _, certificate, signature = SIGNED_HEAD.unpack(rest)
    begins = size + SIGNED_HEAD.size
    wanted = SIGNED_HEAD.size + certificate + signature
    if there < wanted:
        raise BytecodeError(f"truncated: {there} of {wanted} octets of its signature are there; sign it anew")
    if there > wanted or not certificate or not signature:
        raise BytecodeError(f"malformed signature: its head says {wanted} octets, {there} are there; sign it anew")
    return Signed(data[:size], data[begins : begins + certificate], data[begins + certificate :])


def checksum(data: bytes) -> int:
    """Return the CRC-32 of a file without the four octets that hold it."""
    return zlib.crc32(data[CRC_OFFSET + 4 :], zlib.crc32(data[:CRC_OFFSET]))


def assemble(flags: int, tables: dict[str, tuple[int, bytes]]) -> bytes:
    """Return the file made of `tables` (name: number of entries, octets).

    Raises:
        BytecodeError: the file exceeds `SIZE_MAX`.
    """
    directory = Writer()
    offset = 0
    names = tables_of(flags)
    for name in names:
        count, octets = tables[name]
        directory.varint(count)
        directory.varint(offset)
        offset += len(octets)
    body = bytes(directory.octets) + b"".join(tables[name][1] for name in names)
    size = HEADER.size + len(body)
    if size > SIZE_MAX:
        raise BytecodeError(f"the program takes {size} octets, at most {SIZE_MAX} are possible")
    data = HEADER.pack(MAGIC, VERSION, flags, size, 0) + body
    return HEADER.pack(MAGIC, VERSION, flags, size, checksum(data)) + body


def read_layout(data: bytes) -> Layout:
    """Return the layout of `data`.

    Raises:
        BytecodeError: no byte-code, another version, truncated, longer than the header says, or damaged.
    """
    # From general to specific: a wrong magic explains every later mismatch, a truncation the checksum's.
    if data[:4] != MAGIC[: len(data)] or not data:
        raise BytecodeError("not RMR byte-code (it does not begin with the magic octets)")
    if len(data) > 4 and data[4] != VERSION:
        raise BytecodeError(f"byte-code of version {data[4]}, but this runtime reads version {VERSION}; recompile it")
    if len(data) < HEADER.size:
        raise BytecodeError(f"truncated: {len(data)} octets are there, the header alone has {HEADER.size}")
    _, _, flags, size, crc = HEADER.unpack_from(data)
    if len(data) < size:
        raise BytecodeError(f"truncated: {len(data)} of {size} octets are there")
    if len(data) > size or size > SIZE_MAX:
        raise BytecodeError(f"wrong size: the header says {size} octets, {len(data)} are there (at most {SIZE_MAX})")
    if crc != checksum(data):
        raise BytecodeError(f"damaged: its CRC-32 is {checksum(data):08x}, the header says {crc:08x}")
    if flags & ~(FLAG_TEXTUAL | FLAG_DEBUG | FLAG_ENSEMBLE | FLAG_DEADLINE):
        raise BytecodeError(f"malformed byte-code: unknown flags 0x{flags:02x}")
    if flags & FLAG_TEXTUAL and flags & FLAG_DEADLINE:
        raise BytecodeError(f"malformed byte-code: two strategies in the flags 0x{flags:02x}")
    return Layout(flags, size, crc, HEADER.size, _read_directory(data, tables_of(flags)))


def _read_directory(data: bytes, names: tuple[str, ...]) -> dict[str, Table]:
    """Return the extents of the tables, each within the file and behind the last one."""
    reader = Reader(data, HEADER.size, len(data))
    entries = [(reader.varint(), reader.varint()) for _ in names]
    base = reader.position
    starts = [base + offset for _, offset in entries]
    ends = [*starts[1:], len(data)]
    tables = {}
    for name, (count, _), start, end in zip(names, entries, starts, ends, strict=True):
        if not base <= start <= end <= len(data) or count > end - start:
            raise BytecodeError(f"malformed byte-code: the table of {name} does not fit ({count} entries)")
        tables[name] = Table(count, start, end)
    if starts[0] != base:
        raise BytecodeError("malformed byte-code: a gap before the first table")
    return tables
