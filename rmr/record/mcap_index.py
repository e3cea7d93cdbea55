"""The index at the end of a finished file: where its chunks, attachments and metadata stand, and its checksums.

The index has a checksum of its own. Where that is right, a damaged length somewhere in the file hides nothing of what
stands behind it, and channels and names are known whatever has become of their records.
"""

import zlib
from collections.abc import Callable
from typing import Final, NamedTuple

from rmr.record.mcap_format import CHUNK_HEAD, HEAD, MAGIC, Content, FormatError, RecordCode

DATA_END_OCTETS: Final = HEAD.size + 4
FOOTER_OCTETS: Final = HEAD.size + 8 + 8 + 4
INDEX_OCTETS_MAX: Final = 1 << 28
"""Bound of an index that is read: some million chunks."""
CRC_OCTETS: Final = 1 << 20
"""How much of a file is read at a time for its checksum."""


class ScannedChannel(NamedTuple):
    """A channel of a file."""

    topic: str
    encoding: str


class ChunkSpan(NamedTuple):
    """Where a chunk stands in its file."""

    offset: int
    """Of its data."""
    length: int
    """Octets of its data."""
    begin: int
    end: int
    """Instants of its first and last message."""
    size: int
    """Octets of its records, uncompressed."""
    crc: int
    compression: str


class AttachmentSpan(NamedTuple):
    """Where an attachment stands in its file."""

    begin: int
    """Of its record's content, which the checksum behind the data is of."""
    offset: int
    """Of its data."""
    size: int
    media_type: str


class FileIndex(NamedTuple):
    """What an undamaged index tells."""

    channels: dict[int, ScannedChannel]
    chunks: list[ChunkSpan]
    attachments: dict[str, AttachmentSpan]
    metadata: list[tuple[str, int, int]]
    """Name of each metadata record, offset of its mapping, and octets from there."""
    data_end: int
    """Offset of the record that ends the data."""


Read = Callable[[int, int], bytes]
"""Returns the octets of a file at an offset, of a length."""


def read_index(read: Read, size: int) -> FileIndex | None:
    """Return the index of a file of `size` octets; None if it has none, or a damaged one."""
    tail = read(size - FOOTER_OCTETS - len(MAGIC), FOOTER_OCTETS + len(MAGIC))
    if not tail.endswith(MAGIC) or len(tail) < FOOTER_OCTETS + len(MAGIC):
        return None
    footer = Content(tail[HEAD.size :])
    start = footer.number(8)
    footer.number(8)
    crc = footer.number(4)
    length = size - len(MAGIC) - 4 - start
    if not DATA_END_OCTETS < start < size or length > INDEX_OCTETS_MAX:
        return None
    octets = read(start, length)
    if crc not in (0, zlib.crc32(octets)):  # 0: a tool that writes no checksums
        return None
    index = FileIndex({}, [], {}, [], start - DATA_END_OCTETS)
    try:
        _take_records(index, Content(octets[: length - FOOTER_OCTETS + 4]), read)
    except FormatError:
        return None
    return index


def _take_records(index: FileIndex, records: Content, read: Read) -> None:
    while records.left:
        code, length = HEAD.unpack(records.octets(HEAD.size))
        content = Content(records.octets(length))
        if code == RecordCode.CHANNEL:
            number = content.number(2)
            content.number(2)
            index.channels[number] = ScannedChannel(content.text(), content.text())
        elif code == RecordCode.CHUNK_INDEX:
            index.chunks.append(_chunk(content, read))
        elif code == RecordCode.ATTACHMENT_INDEX:
            _attachment(index, content)
        elif code == RecordCode.METADATA_INDEX:
            offset = content.number(8)
            octets = content.number(8)
            name = content.text()
            before = HEAD.size + 4 + len(name.encode())
            index.metadata.append((name, offset + before, octets - before))


def _chunk(content: Content, read: Read) -> ChunkSpan:
    begin, end, offset, _ = (content.number(8) for _ in range(4))
    content.octets(content.number(4) + 8)
    compression = content.text()
    length = content.number(8)
    size = content.number(8)
    head = offset + HEAD.size
    crc = int.from_bytes(read(head + CHUNK_HEAD.size - 4, 4), "little")
    inside = CHUNK_HEAD.size + 4 + len(compression.encode()) + 8
    return ChunkSpan(head + inside, length, begin, end, size, crc, compression)


def _attachment(index: FileIndex, content: Content) -> None:
    offset, *_, size = (content.number(8) for _ in range(5))
    name = content.text()
    media_type = content.text()
    begin = offset + HEAD.size
    inside = 16 + 4 + len(name.encode()) + 4 + len(media_type.encode()) + 8
    index.attachments[name] = AttachmentSpan(begin, begin + inside, size, media_type)


def data_checksums(read: Read, index: FileIndex) -> tuple[int, int]:
    """Return the checksum that the file has of its data (0: none), and the one that the data has."""
    record = read(index.data_end, DATA_END_OCTETS)
    stated = int.from_bytes(record[HEAD.size :], "little")
    if record[: HEAD.size] != HEAD.pack(RecordCode.DATA_END, 4):
        stated = ~stated  # of no data: the record itself is damaged
    crc = 0
    for at in range(0, index.data_end, CRC_OCTETS):
        crc = zlib.crc32(read(at, min(CRC_OCTETS, index.data_end - at)), crc)
    return stated, crc
