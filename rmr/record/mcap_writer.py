"""A writer of MCAP files that can close a chunk at any time.

What has been handed to `message` is in the file when `flush` has returned, in a chunk of its own. A file that is cut
short after that, by a full disk or a killed process, is read up to its last whole chunk (`rmr.record.mcap_scan`).
Schemas and channels stand before the first chunk with a message of theirs, outside of chunks, so that such a file can
be read without its summary.
"""

import struct
import zlib
from collections.abc import Callable, Mapping
from operator import itemgetter
from typing import Final, Protocol

from rmr.record import mcap_format
from rmr.record.mcap_format import HEAD, MAGIC, MESSAGE_FIXED, MESSAGE_HEAD, RecordCode

PROFILE: Final = "rmr"
COMPRESSION: Final = "zstd"
_INSTANT: Final = itemgetter(0)
_MESSAGE: Final = int(RecordCode.MESSAGE)
_HEAD_OCTETS: Final = HEAD.size
_pack_head: Final[Callable[..., bytes]] = MESSAGE_HEAD.pack


class OctetSink(Protocol):
    """Where a file's octets go: an unbuffered binary file."""

    def write(self, octets: bytes, /) -> int | None:
        """Write `octets` and return how many were written. Raises OSError."""


class McapWriter:
    """One file that is being written. Every method may raise OSError."""

    def __init__(self, sink: OctetSink, library: str) -> None:
        from rmr.record.zstd import ZstdCompressor  # noqa: PLC0415 - 4 ms, which robots that are not recorded need not spend

        self._sink = sink
        self._position = 0
        self._crc = 0
        """Checksum of all that has been written."""
        self._compressor = ZstdCompressor(level=1)
        self._schemas: dict[str, int] = {}
        self._repeated: list[bytes] = []
        """Schema records, then channel records, for the summary."""
        self._channels: list[bytes] = []
        self._counts: list[int] = []
        """Messages of each channel; channel n is at n - 1."""
        self._pending: list[tuple[int, int, bytes]] = []
        """Messages of the chunk to come: instant, channel, data."""
        self._pending_octets = 0
        self._chunks: list[bytes] = []
        self._attachments: list[bytes] = []
        self._metadata: list[bytes] = []
        self._span: tuple[int, int] | None = None
        """Instants of the first and the last message."""
        self._put(MAGIC)
        self._put(mcap_format.record(RecordCode.HEADER, mcap_format.text(PROFILE), mcap_format.text(library)))

    def _put(self, octets: bytes) -> int:
        """Write `octets`; return the offset at which they stand."""
        offset = self._position
        view = memoryview(octets)
        while view:  # an unbuffered file may take a part only
            written = self._sink.write(view)  # type: ignore[arg-type]
            if not written:
                raise OSError("nothing was written")
            view = view[written:]
        self._position = offset + len(octets)
        self._crc = zlib.crc32(octets, self._crc)
        return offset

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        octets = mcap_format.metadata(name, values)
        offset = self._put(octets)
        self._metadata.append(
            mcap_format.record(
                RecordCode.METADATA_INDEX, struct.pack("<QQ", offset, len(octets)), mcap_format.text(name)
            )
        )

    def attach(self, name: str, media_type: str, data: bytes, at: int) -> None:
        """Write an attachment."""
        octets = mcap_format.attachment(name, media_type, data, at)
        offset = self._put(octets)
        self._attachments.append(mcap_format.attachment_index(offset, len(octets), at, len(data), name, media_type))

    def channel(self, topic: str, encoding: str, schema_name: str, schema_encoding: str, schema: bytes) -> int:
        """Write a channel, with its schema if that is new; return the channel's number."""
        number = self._schemas.get(schema_name)
        if number is None:
            number = len(self._schemas) + 1
            octets = mcap_format.schema(number, schema_name, schema_encoding, schema)
            self._put(octets)
            self._repeated.append(octets)
            self._schemas[schema_name] = number
        octets = mcap_format.channel(len(self._channels) + 1, number, topic, encoding)
        self._put(octets)
        self._channels.append(octets)
        self._counts.append(0)
        return len(self._channels)

    def message(self, channel: int, at: int, data: bytes) -> None:
        """Take a message of `channel` into the present chunk; write the chunk if it is full."""
        self._pending.append((at, channel, data))
        self._pending_octets += MESSAGE_HEAD.size + len(data)
        # Size at which a chunk is closed: of a file cut short this much is lost at most, and more compresses hardly
        # better.
        if self._pending_octets >= 64 * 1024:
            self.flush()

    def flush(self) -> None:
        """Close the chunk and write it, its messages in order of time. Nothing is written if there are none."""
        pending = self._pending
        if not pending:
            return
        pending.sort(key=_INSTANT)
        self._pending = []
        self._pending_octets = 0
        parts: list[bytes] = []
        entries: dict[int, list[int]] = {}
        offset = 0
        for at, channel, data in pending:
            length = MESSAGE_FIXED + len(data)
            parts.append(_pack_head(_MESSAGE, length, channel, 0, at, at))
            parts.append(data)
            places = entries.get(channel)
            if places is None:
                places = entries[channel] = []
            places.append(at)
            places.append(offset)
            offset += _HEAD_OCTETS + length
        self._write_chunk(b"".join(parts), entries, pending[0][0], pending[-1][0])

    def _write_chunk(self, records: bytes, entries: Mapping[int, list[int]], begin: int, end: int) -> None:
        compressed = self._compressor.compress(records, self._compressor.FLUSH_FRAME)
        chunk = mcap_format.chunk(begin, end, len(records), zlib.crc32(records), COMPRESSION, compressed)
        indexes = [mcap_format.message_index(channel, each) for channel, each in entries.items()]
        start = self._put(b"".join([chunk, *indexes]))
        offsets: dict[int, int] = {}
        at = start + len(chunk)
        for (channel, each), index in zip(entries.items(), indexes, strict=True):
            offsets[channel] = at
            at += len(index)
            self._counts[channel - 1] += len(each) // 2
        sizes = (len(compressed), len(records))
        self._chunks.append(
            mcap_format.chunk_index(begin, end, start, len(chunk), offsets, at - start - len(chunk), COMPRESSION, sizes)
        )
        first, last = self._span or (begin, end)
        self._span = min(first, begin), max(last, end)

    def finish(self) -> None:
        """Write what is left, and the summary with the index of the file. Nothing can be written afterwards."""
        self.flush()
        self._put(mcap_format.record(RecordCode.DATA_END, struct.pack("<I", self._crc)))
        start = self._position
        groups = (
            (RecordCode.SCHEMA, self._repeated),
            (RecordCode.CHANNEL, self._channels),
            (RecordCode.STATISTICS, [self._statistics()]),
            (RecordCode.CHUNK_INDEX, self._chunks),
            (RecordCode.ATTACHMENT_INDEX, self._attachments),
            (RecordCode.METADATA_INDEX, self._metadata),
        )
        summary: list[bytes] = []
        offsets: list[bytes] = []
        at = start
        for code, records in groups:
            octets = b"".join(records)
            if octets:
                summary.append(octets)
                offsets.append(
                    mcap_format.record(RecordCode.SUMMARY_OFFSET, struct.pack("<BQQ", code, at, len(octets)))
                )
                at += len(octets)
        head = HEAD.pack(RecordCode.FOOTER, 20) + struct.pack("<QQ", start, at)
        octets = b"".join([*summary, *offsets])
        self._put(b"".join([octets, head, struct.pack("<I", zlib.crc32(octets + head)), MAGIC]))

    def _statistics(self) -> bytes:
        first, last = self._span or (0, 0)
        counts = b"".join(struct.pack("<HQ", number, count) for number, count in enumerate(self._counts, 1))
        numbers = (len(self._schemas), len(self._channels), len(self._attachments), len(self._metadata))
        return mcap_format.record(
            RecordCode.STATISTICS,
            struct.pack("<QHIIIIQQI", sum(self._counts), *numbers, len(self._chunks), first, last, len(counts)),
            counts,
        )
