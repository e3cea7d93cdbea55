"""Small recordings of any shape: how many chunks, of what, with which attachments, finished or not, and by whom.

Most are written as a run writes them. Others are what a tool for MCAP files makes of one: chunks without compression or
without checksums, messages outside of chunks, a summary that lacks parts.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from mcap.writer import CompressionType, IndexType, Writer
from record_maker import about, end_without_closing

from rmr.record.channels import BY_TOPIC, schema_of
from rmr.record.mcap_writer import PROFILE
from rmr.record.record_writer import RecordWriter
from rmr.record.run_about import METADATA_NAME, checked

Row = tuple[str, int, bytes]
"""A message as every reader sees it: topic, instant, data."""

NAMES = ("floor.json", "lab.yaml", "program.rbc")


@dataclass(frozen=True)
class DrawnRecording:
    """What a recording holds."""

    chunks: tuple[tuple[Row, ...], ...]
    attachments: dict[str, bytes]
    finished: bool
    tool: Mapping[str, Any] | None
    """Options of a tool's writer; None: written as a run writes it."""

    @property
    def rows(self) -> list[Row]:
        """All messages, in order of time."""
        return sorted((row for chunk in self.chunks for row in chunk), key=lambda row: row[1])


def drawn(seed: int) -> DrawnRecording:
    """Return the shape that `seed` draws."""
    random = Random(f"{seed}/recording")
    number = random.choice((0, 1, 1, 2, 3, 4))
    chunks = tuple(tuple(_row(random, place) for _ in range(random.randint(1, 4))) for place in range(number))
    names = random.sample(NAMES, random.choice((0, 0, 1, 2)))
    attachments = {name: random.randbytes(random.choice((0, 1, 30))) for name in names}
    return DrawnRecording(chunks, attachments, random.random() < 0.7, _tool(random) if seed % 3 == 2 else None)


def _row(random: Random, place: int) -> Row:
    at = 10 * place + random.choice((random.randint(0, 9), random.randint(0, 40)))  # chunks may overlap
    if random.random() < 0.5:
        return "/mind", at, bytes(random.choices(b"ab\x00\xff", k=random.randint(0, 12)))
    return random.choice(("/trace", "/faults")), at, b'{"n":%d}' % random.randint(0, 99)


def _tool(random: Random) -> Mapping[str, Any]:
    """Options with checksums: without them no reader can tell what is damaged."""
    flags = ("use_chunking", "repeat_channels", "repeat_schemas", "use_statistics", "use_summary_offsets")
    return {
        "compression": random.choice((CompressionType.NONE, CompressionType.ZSTD)),
        "index_types": random.choice((IndexType.ALL, IndexType.NONE, IndexType.CHUNK)),
        "enable_data_crcs": True,
        **{flag: random.random() < 0.7 for flag in flags},
    }


def write_drawn(path: Path, recording: DrawnRecording) -> bytes:
    """Write `recording` to `path`; return its octets."""
    if recording.tool is None:
        writer = RecordWriter(path, about())
        for name, data in recording.attachments.items():
            writer.attach(name, data)
        for chunk in recording.chunks:
            for topic, at, data in chunk:
                writer.write(topic, at, data)
            writer.flush()
        if recording.finished:
            writer.close()
        else:
            end_without_closing(writer)
        assert writer.failure is None
    else:
        write_by_tool(path, recording, recording.tool)
    return path.read_bytes()


def write_by_tool(path: Path, recording: DrawnRecording, options: Mapping[str, Any]) -> None:
    """Write `recording` as another tool does that writes a recording of rmr anew."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(PROFILE, "another tool")
        writer.add_metadata(METADATA_NAME, checked(about().to_metadata()))
        for name, data in recording.attachments.items():
            writer.add_attachment(0, 0, name, "application/octet-stream", data)
        channels: dict[str, int] = {}
        for chunk in recording.chunks:
            for topic, at, data in chunk:
                if topic not in channels:
                    number = writer.register_schema(BY_TOPIC[topic].schema, *schema_of(topic))
                    channels[topic] = writer.register_channel(topic, BY_TOPIC[topic].encoding, number)
                writer.add_message(channels[topic], at, data, at)
            writer.flush()
        if recording.finished:
            writer.finish()
        writer.flush()
