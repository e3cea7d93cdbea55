"""Writes a recording: messages as dicts, by topic.

A host that records goes on whatever happens: a file that cannot be written any more (a full disk) is closed, `failure`
says why, and all that is written later is dropped. The host says so once.

Messages are encoded some dozens at a time: between two turns of a robot the code of an encoder has left the processor's
caches, and one message then costs five times as much.

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
from rmr.record.being_written import lock
from rmr.record.channels import BY_TOPIC, schema_of
from rmr.record.mcap_writer import McapWriter, OctetSink
from rmr.record.run_about import METADATA_NAME, RunAbout, checked

LIBRARY: Final = f"rmr {__version__}"

MEDIA_TYPES: Final = {
    ".json": "application/json",
    ".yaml": "application/yaml",
    ".rmr": "text/plain",
    ".py": "text/x-python",
}
"""Media types of attachments, by suffix; others are octets."""

BATCH: Final = 64
"""Messages that are encoded together at most."""

Content = Mapping[str, Any] | bytes
"""A message, or one that has its channel's encoding already."""

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
        self._tap: Callable[[str, Instant, Mapping[str, Any]], None] | None = None
        self._tapped: frozenset[str] = frozenset()
        self._pending: list[tuple[str, Instant, Callable[[], Content] | Content]] = []
        """Messages that are not encoded yet."""
        self._numbers: dict[str, int] = {}
        """Channel numbers by topic."""
        self._file = sink
        self._mcap: McapWriter | None = None
        self._about = checked(about.to_metadata())
        self._attempt(self._open)

    def _open(self) -> None:
        if self._file is None:
            file = self.path.open("wb", buffering=0)
            lock(file.fileno())
            self._file = file
        mcap = McapWriter(self._file, LIBRARY)
        mcap.metadata(METADATA_NAME, self._about)
        self._mcap = mcap

    def _attempt(self, step: Callable[[], object]) -> None:
        """Do `step`; if the file cannot be written, stop recording."""
        try:
            step()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self._pending.clear()
        why = error.strerror or error
        begun = self._mcap is not None
        self.failure = f"the recording {self.path} ends early: {why}" if begun else f"cannot write {self.path}: {why}"
        self._mcap = None
        self._close_file()

    def _close_file(self) -> None:
        file = self._file
        if file is not None and hasattr(file, "close"):
            with suppress(OSError):
                file.close()

    def tap(self, topics: frozenset[str], take: Callable[[str, Instant, Mapping[str, Any]], None]) -> None:
        """Hand each message of `topics`, which are channels of JSON, to `take` when it is written."""
        self._tap = take
        self._tapped = topics

    def write(self, topic: str, now: Instant, content: Callable[[], Content] | Content) -> None:
        """Write a message on the channel `topic` at `now`; an instant before 0 counts as 0.

        `content` is a dict, which is not changed afterwards, its encoded octets, or a function that returns either and
        is called later.
        """
        if topic in self._tapped:
            content = content() if callable(content) else content
            if self._tap is not None:
                self._tap(topic, now, json.loads(content) if isinstance(content, bytes) else content)
        if self._mcap is not None:
            self._pending.append((topic, now, content))
            if len(self._pending) >= BATCH:
                self._encode()

    def _encode(self) -> None:
        """Encode the messages that wait and put them into the present chunk."""
        mcap = self._mcap
        pending = self._pending
        self._pending = []
        if mcap is None:
            return
        try:
            for topic, now, content in pending:
                made = content() if callable(content) else content
                number = self._numbers.get(topic) or self._channel(mcap, topic)
                mcap.message(number, max(0, now), made if isinstance(made, bytes) else _encoded(topic, made))
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
        self._encode()
        if self._mcap is not None:
            self._attempt(self._mcap.flush)

    def discard(self) -> None:
        """Close the file and remove it: there is nothing to record."""
        self._mcap = None
        self._close_file()
        with suppress(OSError):
            self.path.unlink()

    def close(self) -> None:
        """Write the index and close the file."""
        self._encode()
        if self._mcap is not None:
            self.note(METADATA_NAME, self._about)
        if self._mcap is not None:
            self._attempt(self._mcap.finish)
            self._mcap = None
            self._close_file()


def _encoded(topic: str, message: Mapping[str, Any]) -> bytes:
    """Return `message` in the encoding of its channel."""
    if BY_TOPIC[topic].encoding == "json":
        return encode_json(message).encode()
    packed: bytes = msgpack.packb(message)
    return packed
