"""Writes a recording: messages as dicts, by topic.

A host that records goes on whatever happens: a file that cannot be written any more (a full disk) is closed, `failure`
says why, and all that is written later is dropped. The host says so once.

A host in real time calls `flush` once a second: what was written before is then in the file, and survives the end of
the process. One in virtual time does not, so that its file depends on the messages alone.
"""

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import msgpack  # type: ignore[import-untyped]

from rmr import __version__
from rmr.base.time import Instant
from rmr.record.channels import BY_TOPIC, schema_of
from rmr.record.mcap_writer import McapWriter, OctetSink
from rmr.record.run_about import METADATA_NAME, RunAbout

LIBRARY: Final = f"rmr {__version__}"

MEDIA_TYPES: Final = {
    ".json": "application/json",
    ".yaml": "application/yaml",
    ".rmr": "text/plain",
    ".py": "text/x-python",
}
"""Media types of attachments, by suffix; others are octets."""

encode_json: Final = json.JSONEncoder(separators=(",", ":")).encode


class RecordWriter:
    """One recording that is being written. No method raises OSError: see `failure`."""

    def __init__(self, path: Path, about: RunAbout, sink: OctetSink | None = None) -> None:
        """Begin the file at `path`, which is replaced; `sink` takes its octets instead, for tests."""
        self.path = path
        self.failure: str | None = None
        """Why the recording ended early, as a sentence; None while all is well."""
        self.count = 0
        """Number of messages written."""
        self.tap: Callable[[str, Instant, Mapping[str, Any]], None] | None = None
        """Called with each message, too, except for those that are encoded already."""
        self._numbers: dict[str, int] = {}
        """Channel numbers by topic."""
        self._file = sink
        self._mcap: McapWriter | None = None
        self._attempt(lambda: self._open(about))

    def _open(self, about: RunAbout) -> None:
        if self._file is None:
            self._file = self.path.open("wb", buffering=0)
        self._mcap = McapWriter(self._file, LIBRARY)
        self._mcap.metadata(METADATA_NAME, about.to_metadata())

    def _attempt(self, step: Callable[[], object]) -> None:
        """Do `step`; if the file cannot be written, stop recording."""
        try:
            step()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.failure = f"the recording {self.path} ends early: {error.strerror or error}"
        self._mcap = None
        self._close_file()

    def _close_file(self) -> None:
        file = self._file
        if file is not None and hasattr(file, "close"):
            with suppress(OSError):
                file.close()

    def write(self, topic: str, now: Instant, message: Mapping[str, Any]) -> None:
        """Write `message` on the channel `topic` at `now`; an instant before 0 counts as 0."""
        if self.tap is not None:
            self.tap(topic, now, message)
        if BY_TOPIC[topic].encoding == "json":
            self.write_encoded(topic, now, encode_json(message).encode())
        else:
            packed: bytes = msgpack.packb(message)
            self.write_encoded(topic, now, packed)

    def write_encoded(self, topic: str, now: Instant, data: bytes) -> None:
        """Write a message that has the channel's encoding already."""
        mcap = self._mcap
        if mcap is None:
            return
        try:
            number = self._numbers.get(topic) or self._channel(mcap, topic)
            mcap.message(number, max(0, now), data)
            self.count += 1
        except OSError as error:
            self._fail(error)

    def mind(self, now: Instant, robot: int, epoch: int, data: bytes) -> None:
        """Write a piece of the log of a robot's mind, in its incarnation `epoch`."""
        self.write("/mind", now, {"robot": robot, "epoch": epoch, "data": data})

    def _channel(self, mcap: McapWriter, topic: str) -> int:
        channel = BY_TOPIC[topic]
        encoding, schema = schema_of(topic)
        number = self._numbers[topic] = mcap.channel(topic, channel.encoding, channel.schema, encoding, schema)
        return number

    def attach(self, name: str, data: bytes, now: Instant = 0) -> None:
        """Add a file."""
        mcap = self._mcap
        if mcap is not None:
            media_type = MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
            self._attempt(lambda: mcap.attach(name, media_type, data, max(0, now)))

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record."""
        mcap = self._mcap
        if mcap is not None:
            self._attempt(lambda: mcap.metadata(name, values))

    def flush(self) -> None:
        """Put all that has been written into the file."""
        if self._mcap is not None:
            self._attempt(self._mcap.flush)

    def close(self) -> None:
        """Write the index and close the file."""
        if self._mcap is not None:
            self._attempt(self._mcap.finish)
            self._mcap = None
            self._close_file()
