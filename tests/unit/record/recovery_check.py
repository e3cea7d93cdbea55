"""What must become of a damaged recording: every reader takes what is recovered, and what is lost is told."""

from collections import Counter
from pathlib import Path

from drawn_recordings import DrawnRecording, Row
from mcap.reader import NonSeekingReader, make_reader

from rmr.record.joining import NothingToDoError, recover
from rmr.record.mcap_scan import RecordingError
from rmr.record.recording import open_recording


def rows_in(path: Path) -> tuple[list[Row], dict[str, bytes]]:
    """Return what other readers find in `path`, by its index and in one pass: messages, and attachments."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        rows = [(channel.topic, said.log_time, said.data) for _, channel, said in reader.iter_messages()]
        attachments = {each.name: each.data for each in reader.iter_attachments()}
        file.seek(0)
        streamed = NonSeekingReader(file, validate_crcs=True).iter_messages()
        assert Counter((channel.topic, said.log_time, said.data) for _, channel, said in streamed) == Counter(rows)
    return rows, attachments


def check(recording: DrawnRecording, octets: bytes, path: Path, where: str) -> bool:
    """Check what becomes of a recording of which `octets` are left; return whether anything does."""
    path.write_bytes(octets)
    problems: tuple[str, ...] = ()
    whole, told = False, ""
    try:
        problems = recover(path).problems
    except NothingToDoError:
        whole = True
    except RecordingError as error:
        told = str(error)
    if told:
        assert told.startswith(str(path)), where
        assert "\n" not in told, where
        return False
    rows, attachments = rows_in(path)
    names = recording.finished  # a file without its end has no checksum of the names of channels
    had = Counter(row if names else row[1:] for row in recording.rows)
    got = Counter(row if names else row[1:] for row in rows)
    located = recording.tool is None or recording.tool["use_chunking"]  # else one checksum is of all messages
    assert not (located and got - had), f"{where}: something else was read"
    assert [row[1] for row in rows] == sorted(row[1] for row in rows), where
    assert all(recording.attachments[name] == data for name, data in attachments.items()), where
    lost = had != got or attachments.keys() != recording.attachments.keys()
    assert not (whole and lost), where
    assert whole or problems, where
    with open_recording(path) as again:
        assert again.check(), where
        assert len(list(again.raw_messages())) == len(rows), where
    return True
