"""Finds what an MCAP file holds, by its index or in one pass over its records, without reading the chunks.

An index is not needed: a file that is still being written, or was cut short, is read up to its last whole record. The
pass may be continued when the file has grown. Only files of the profile `rmr` are taken: their channels stand outside
of chunks, and all messages in them. A tool that has written one anew may have put channels into chunks, and messages
outside: such a message counts as a chunk of its own.
"""

import os
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from rmr.record.being_written import is_locked
from rmr.record.mcap_format import (
    CHUNK_HEAD,
    HEAD,
    MAGIC,
    MAGIC_NAME,
    MESSAGE_FIXED,
    MESSAGE_HEAD,
    Content,
    FormatError,
    RecordCode,
    messages,
)
from rmr.record.mcap_writer import PROFILE
from rmr.record.run_about import METADATA_NAME, is_intact
from rmr.record.zstd import ZstdDecompressor, ZstdError, get_frame_info

# ---- the index at the end of a finished file: where its chunks, attachments and metadata stand, and its checksums
#
# The index has a checksum of its own. Where that is right, a damaged length somewhere in the file hides nothing of
# what stands behind it, and channels and names are known whatever has become of their records.

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


CONTENT_OCTETS_MAX: Final = 1 << 24
"""Bound of a record that is read whole; chunks and attachments have bounds of their own."""
CHUNK_OCTETS_MAX: Final = 1 << 28
"""Bound of a chunk's records: a damaged length does not use up the memory."""


class RecordingError(Exception):
    """A recording cannot be read, or written; the message says which, why, and what to do."""


class McapScan:
    """One file, as far as it has been looked at."""

    def __init__(self, path: Path) -> None:
        """Raise RecordingError if the file at `path` cannot be read, is no recording, or is too short to tell."""
        self.name = str(path)
        self._file = -1
        self._file = _open(path)
        self.channels: dict[int, ScannedChannel] = {}
        self._searched = False
        """Whether channels have been looked for in chunks."""
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, AttachmentSpan] = {}
        self.chunks: list[ChunkSpan] = []
        self.end = 0
        """Offset behind the last whole record."""
        self.complete = False
        """Whether the file has been finished: it has its index."""
        self._index = read_index(self._read, self.octets)
        if self._index is None:
            self._begin()
            self.extend()
        else:
            if not self._index.chunks:
                with suppress(RecordingError):  # a damaged beginning hides nothing of what the index tells
                    self._begin()
                    self.extend()
            self._take_index(self._index)

    def _take_index(self, index: FileIndex) -> None:
        """Take in what the index tells; a damaged beginning hides nothing then."""
        if all(name != METADATA_NAME for name, _, _ in index.metadata):
            self._begin()
            self.extend()
        self.channels |= index.channels
        self.chunks = index.chunks or self.chunks
        self.attachments |= index.attachments
        for name, offset, length in index.metadata:
            with suppress(FormatError):
                self._note(name, Content(self._read(offset, length)).mapping())
        self.end = self.octets
        self.complete = True

    def _begin(self) -> None:
        magic = self._read(0, len(MAGIC))
        if magic != MAGIC:
            raise RecordingError(f"{self.name}: {_not_mcap(magic)}")
        head = self._read(len(MAGIC), HEAD.size)
        code, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
        content = self._read(len(MAGIC) + HEAD.size, min(length, CONTENT_OCTETS_MAX))
        try:
            profile = Content(content).text() if code == RecordCode.HEADER and len(content) == length else None
        except FormatError:
            profile = None
        if profile is None:
            raise RecordingError(f"{self.name}: the file was cut short within its first octets: it holds nothing")
        if profile != PROFILE:
            raise RecordingError(f"{self.name}: an MCAP file, but no recording of rmr (its profile is {profile!r:.40})")
        self.end = len(MAGIC) + HEAD.size + length

    @property
    def octets(self) -> int:
        """Present length of the file."""
        return os.fstat(self._file).st_size

    def extend(self) -> None:
        """Take in the records that have come since the last call."""
        size = self.octets
        while not self.complete:
            head = self._read(self.end, HEAD.size)
            if len(head) < HEAD.size:
                return
            code, length = HEAD.unpack(head)
            if self.end + HEAD.size + length > size:
                return
            if code == RecordCode.DATA_END:
                self.complete = self._has_end(size)
                return
            try:
                self._take(code, self.end + HEAD.size, length)
            except FormatError:
                return
            self.end += HEAD.size + length

    @property
    def damage(self) -> str | None:
        """How the file is not as it was written, by the checksums of a finished one; None where they say that it is."""
        if not self.complete:
            return None
        if self._index is None:
            return "its index is damaged"
        stated, crc = data_checksums(self._read, self._index)
        if stated == 0:  # of a version that wrote none
            return None
        return None if stated == crc else "a checksum is wrong"

    @property
    def being_written(self) -> bool:
        """Whether a process is writing the file."""
        return is_locked(self._file)

    @property
    def cut_octets(self) -> int:
        """Octets at the end of the file that are no whole record, where it has not been finished."""
        return 0 if self.complete else self.octets - self.end

    def _has_end(self, size: int) -> bool:
        return self._read(size - len(MAGIC), len(MAGIC)) == MAGIC

    def _take(self, code: int, offset: int, length: int) -> None:
        """Take in a record. Raises FormatError."""
        if code == RecordCode.CHUNK:
            self.chunks.append(self._chunk(offset, length))
        elif code == RecordCode.ATTACHMENT:
            self._attachment(offset, length)
        elif code == RecordCode.MESSAGE:
            head = self._read(offset - HEAD.size, MESSAGE_HEAD.size)
            if length < MESSAGE_FIXED:
                raise FormatError("a message without its head")
            at = MESSAGE_HEAD.unpack(head)[4]
            whole = HEAD.size + length
            self.chunks.append(ChunkSpan(offset - HEAD.size, whole, at, at, whole, 0, ""))
        elif code in (RecordCode.CHANNEL, RecordCode.METADATA):
            if length > CONTENT_OCTETS_MAX:
                raise FormatError("a record that is too long")
            content = Content(self._read(offset, length))
            if code == RecordCode.METADATA:
                self._note(content.text(), content.mapping())
            else:
                self._channel(content)

    def _channel(self, content: Content) -> None:
        number = content.number(2)
        content.number(2)
        self.channels[number] = ScannedChannel(content.text(), content.text())

    def _note(self, name: str, values: dict[str, str]) -> None:
        """Take in a metadata record; of two of one name the first counts, unless it is damaged and the other is not."""
        if name not in self.metadata or (is_intact(values) and not is_intact(self.metadata[name])):
            self.metadata[name] = values

    def _chunk(self, offset: int, length: int) -> ChunkSpan:
        # What holds all of a chunk but its data: names of compressions are short.
        head = self._read(offset, min(length, CHUNK_HEAD.size + 4 + 16 + 8))
        if len(head) < CHUNK_HEAD.size:
            raise FormatError("a chunk without its head")
        begin, end, size, crc = CHUNK_HEAD.unpack_from(head)
        content = Content(head)
        content.octets(CHUNK_HEAD.size)
        compression = content.text()
        data = content.number(8)
        inside = len(head) - content.left
        if inside + data > length:
            raise FormatError("a chunk whose data is longer than it")
        return ChunkSpan(offset + inside, data, begin, end, size, crc, compression)

    def _attachment(self, offset: int, length: int) -> None:
        head = self._read(offset, min(length, 4096))
        content = Content(head)
        content.octets(16)
        name = content.text()
        media_type = content.text()
        size = content.number(8)
        inside = len(head) - content.left
        if inside + size > length:
            raise FormatError("an attachment whose data is longer than it")
        self.attachments[name] = AttachmentSpan(offset, offset + inside, size, media_type)

    def _read(self, offset: int, length: int) -> bytes:
        try:
            return os.pread(self._file, max(0, length), max(0, offset))
        except OSError as error:
            raise RecordingError(f"{self.name}: {error.strerror or error}") from error

    def attachment(self, name: str) -> bytes | None:
        """Return the data of an attachment; None without one of that name. Raises FormatError if it is damaged."""
        span = self.attachments.get(name)
        if span is None:
            return None
        inside = span.offset - span.begin
        content = self._read(span.begin, inside + span.size)
        crc = int.from_bytes(self._read(span.offset + span.size, 4), "little")
        if len(content) < inside + span.size:
            raise FormatError("the file has become shorter")
        if crc and zlib.crc32(content) != crc:
            raise FormatError("a wrong checksum")
        return content[inside:]

    def load(self, chunk: ChunkSpan) -> list[tuple[int, int, bytes]]:
        """Return the messages of a chunk: instant, channel number, data. Raises FormatError if it is damaged."""
        data = self._read(chunk.offset, chunk.length)
        if len(data) < chunk.length:
            raise FormatError("the file has become shorter")
        if chunk.size > CHUNK_OCTETS_MAX:
            raise FormatError("a length that cannot be")
        if chunk.compression == "zstd":
            try:
                if get_frame_info(data).decompressed_size != chunk.size:
                    raise FormatError("a length that cannot be")
                data = ZstdDecompressor().decompress(data)  # one for each frame
            except ZstdError as error:
                raise FormatError(str(error)) from None
            if len(data) != chunk.size:
                raise FormatError("a frame that is cut short")
        elif chunk.compression:
            raise FormatError(f"compression {chunk.compression!r:.20}, which rmr does not read")
        if chunk.crc and zlib.crc32(data) != chunk.crc:
            raise FormatError("a wrong checksum")
        channels: list[bytes] = []
        found = messages(data, channels)
        for content in channels:
            self._channel(Content(content))
        return found

    def find_channels(self) -> None:
        """Look for channels in all chunks, once: another tool writes each into the first chunk that needs it."""
        if not self._searched:
            self._searched = True
            for chunk in self.chunks:
                with suppress(FormatError):
                    self.load(chunk)

    def close(self) -> None:
        """Close the file."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def __del__(self) -> None:
        self.close()


def _open(path: Path) -> int:
    """Return the descriptor of a file that is open for reading. Raises RecordingError."""
    try:
        if path.exists() and not path.is_file():
            raise RecordingError(f"{path}: no file")
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path}: {getattr(error, 'strerror', None) or error}") from error


def _not_mcap(magic: bytes) -> str:
    """Return what is wrong with a file that begins with `magic`."""
    if not magic:
        return "the file is empty"
    if MAGIC.startswith(magic):
        return "the file was cut short within its first octets: it holds nothing"
    if magic.startswith(MAGIC_NAME):
        return "an MCAP file of another version of that format; this version of rmr reads version 0"
    return "no MCAP file"
