"""The MCAP container, octet by octet: the record types that recordings use, encoded and decoded.

A file is a magic number, records, and the magic number again. A record is a code (1 octet), the length of its content
(8 octets, little-endian) and the content. Messages stand in compressed chunks, all other records outside of them:

    magic | header | metadata | (schema | channel | attachment | chunk, message index ...)* | data end
          | summary: schemas, channels, statistics, indexes of chunks, attachments, metadata, offsets | footer | magic

The package `mcap` reads and writes the same format. Importing it costs 45 ms of processor time, which a robot process
would spend at its start, and its writer cannot be asked to close a chunk; the tests hold this module against it.
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Final

MAGIC: Final = b"\x89MCAP0\r\n"
MAGIC_NAME: Final = b"\x89MCAP"
"""The part of the magic number that does not depend on the version of the format."""

HEAD: Final = struct.Struct("<BQ")
"""Code and length before the content of each record."""
MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
"""Code, length, channel, sequence number, log time, publish time."""
MESSAGE_FIXED: Final = MESSAGE_HEAD.size - HEAD.size
CHUNK_HEAD: Final = struct.Struct("<QQQI")
"""First and last instant, uncompressed size, CRC-32 of the uncompressed octets (0: none)."""
_PAIR: Final = struct.Struct("<QQ")


class RecordCode(IntEnum):
    """The types of records."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    ATTACHMENT = 0x09
    ATTACHMENT_INDEX = 0x0A
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


class FormatError(ValueError):
    """Octets that are no record; the message says why."""


# ---- encoding


def record(code: RecordCode, *parts: bytes) -> bytes:
    """Return a record whose content is `parts`, one after the other."""
    content = b"".join(parts)
    return HEAD.pack(code, len(content)) + content


def text(value: str) -> bytes:
    """Return a string with its length before it."""
    octets = value.encode("utf-8", "replace")
    return struct.pack("<I", len(octets)) + octets


def mapping(values: Mapping[str, str]) -> bytes:
    """Return the strings of `values` with the length of them all before them."""
    content = b"".join(text(key) + text(value) for key, value in values.items())
    return struct.pack("<I", len(content)) + content


def schema(number: int, name: str, encoding: str, data: bytes) -> bytes:
    """Return a schema record."""
    return record(
        RecordCode.SCHEMA, struct.pack("<H", number), text(name), text(encoding), struct.pack("<I", len(data)), data
    )


def channel(number: int, schema_number: int, topic: str, encoding: str) -> bytes:
    """Return a channel record without metadata."""
    return record(
        RecordCode.CHANNEL, struct.pack("<HH", number, schema_number), text(topic), text(encoding), mapping({})
    )


def metadata(name: str, values: Mapping[str, str]) -> bytes:
    """Return a metadata record."""
    return record(RecordCode.METADATA, text(name), mapping(values))


def attachment(name: str, media_type: str, data: bytes, at: int) -> bytes:
    """Return an attachment record."""
    content = _PAIR.pack(at, 0) + text(name) + text(media_type) + struct.pack("<Q", len(data)) + data
    return record(RecordCode.ATTACHMENT, content, struct.pack("<I", zlib.crc32(content)))


def attachment_index(offset: int, length: int, at: int, size: int, name: str, media_type: str) -> bytes:
    """Return the index record of an attachment whose record is at `offset`."""
    return record(
        RecordCode.ATTACHMENT_INDEX,
        struct.pack("<QQQQQ", offset, length, at, 0, size),
        text(name),
        text(media_type),
    )


def chunk(begin: int, end: int, size: int, crc: int, compression: str, data: bytes) -> bytes:
    """Return a chunk record with the compressed records `data`."""
    head = CHUNK_HEAD.pack(begin, end, size, crc) + text(compression) + struct.pack("<Q", len(data))
    return record(RecordCode.CHUNK, head, data)


def message_index(channel_number: int, entries: Sequence[int]) -> bytes:
    """Return the index of one channel's messages in a chunk: the instant of each, and its offset after it."""
    packed = struct.pack(f"<{len(entries)}Q", *entries)
    return record(RecordCode.MESSAGE_INDEX, struct.pack("<HI", channel_number, len(packed)), packed)


def chunk_index(
    begin: int,
    end: int,
    offset: int,
    length: int,
    indexes: Mapping[int, int],
    index_length: int,
    compression: str,
    sizes: tuple[int, int],
) -> bytes:
    """Return the index of the chunk record at `offset`; `sizes` are those of its records, compressed and not."""
    offsets = b"".join(struct.pack("<HQ", number, at) for number, at in indexes.items())
    return record(
        RecordCode.CHUNK_INDEX,
        struct.pack("<QQQQI", begin, end, offset, length, len(offsets)),
        offsets,
        struct.pack("<Q", index_length),
        text(compression),
        _PAIR.pack(*sizes),
    )


# ---- decoding


class Content:
    """The content of a record, read field by field. Each method raises FormatError where the content ends too early."""

    __slots__ = ("_at", "_octets")

    def __init__(self, octets: bytes) -> None:
        self._octets = octets
        self._at = 0

    @property
    def left(self) -> int:
        """Number of octets not yet read."""
        return len(self._octets) - self._at

    def octets(self, count: int) -> bytes:
        """Return the next `count` octets."""
        if count > self.left:
            raise FormatError("a field reaches beyond the end of its record")
        self._at += count
        return self._octets[self._at - count : self._at]

    def number(self, size: int) -> int:
        """Return the next number, of `size` octets."""
        return int.from_bytes(self.octets(size), "little")

    def text(self) -> str:
        """Return the next string."""
        try:
            return self.octets(self.number(4)).decode()
        except UnicodeDecodeError:
            raise FormatError("a text is no UTF-8") from None

    def mapping(self) -> dict[str, str]:
        """Return the next mapping."""
        inside = Content(self.octets(self.number(4)))
        values: dict[str, str] = {}
        while inside.left:
            key = inside.text()
            values[key] = inside.text()
        return values


def messages(octets: bytes, channels: list[bytes]) -> list[tuple[int, int, bytes]]:
    """Return the messages among the records of a chunk: instant, channel, data. Raises FormatError.

    The contents of channel records are added to `channels`: other tools write them into chunks.
    """
    found: list[tuple[int, int, bytes]] = []
    at = 0
    while at < len(octets):
        if len(octets) - at < HEAD.size:
            raise FormatError("a chunk ends inside of a record")
        code, length = HEAD.unpack_from(octets, at)
        end = at + HEAD.size + length
        if end > len(octets) or (code == RecordCode.MESSAGE and length < MESSAGE_FIXED):
            raise FormatError("a chunk ends inside of a record")
        if code == RecordCode.MESSAGE:
            _, _, number, _, instant, _ = MESSAGE_HEAD.unpack_from(octets, at)
            found.append((instant, number, octets[at + MESSAGE_HEAD.size : end]))
        elif code == RecordCode.CHANNEL:
            channels.append(octets[at + HEAD.size : end])
        at = end
    return found
