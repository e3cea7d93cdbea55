"""Takes one snapshot of a durable robot: ``python -m rmr_agent.take_snapshot FOLDER SEGMENT KEY [TRUST]``.

It reads the newest snapshot and the closed segments of the journal from there on, brings a shadow of the robot to their
end (`rmr.mind.snapshot`), and writes `snapshot-SEGMENT`, once another shadow that was restored from it has shown the
same state; KEY is the file with the key of the snapshots, TRUST what the robot was given with --trust. It runs at the
lowest priority, beside the robot, and removes nothing.
"""

import os
import sys
from pathlib import Path

from rmr.bus.endpoint import BusError
from rmr.bytecode import codec
from rmr.bytecode.layout import split
from rmr.mind.journal import JournalError
from rmr.mind.segments import find_state
from rmr.mind.snapshot import shadow_of, taken_snapshot
from rmr_agent.state_files import PROGRAM, SEGMENTS, SNAPSHOTS, begun_file, read_files, snapshot_name, state_key


def take(folder: Path, segment: int, key: bytes, trust: Path | None = None) -> None:
    """Write the snapshot before `segment`. Raises JournalError, BusError, OSError."""
    segments = {number: data for number, data in read_files(folder, SEGMENTS).items() if number < segment}
    snapshots = {number: data for number, data in read_files(folder, SNAPSHOTS).items() if number < segment}
    found = find_state(segments, snapshots, key)
    if found.header is None or found.last != segment - 1 or found.dropped:
        raise JournalError(f"the journal before segment {segment} is not whole")
    data = (folder / PROGRAM).read_bytes()
    if codec.digest(data) != found.header.program:
        raise JournalError(f"{PROGRAM} is another program")
    if trust is not None:
        from rmr.bus.signing import read_trust  # noqa: PLC0415 - heavy, and used with trust alone

        if why := read_trust(trust).problem(*split(data)):
            raise JournalError(f"{PROGRAM}: {why}")
    program = codec.decode(data)
    snapshot = taken_snapshot(program, found.header, found.records, found.snapshot, segment, found.crc)
    node, skeleton = shadow_of(program, found.header, (), snapshot.state)
    node.settle()
    if skeleton.state() != snapshot.state:
        raise JournalError("the state that was written is not the one that is read")
    os.close(begun_file(folder / snapshot_name(segment), snapshot.octets(key), synced=True))


def main() -> int:
    """Take the snapshot; return the exit code."""
    os.nice(19)
    folder, segment, key_file, *trust = sys.argv[1:]
    try:
        take(Path(folder), int(segment), state_key(Path(key_file)).octets, *map(Path, trust))
    except (JournalError, BusError, codec.BytecodeError) as error:
        print(error, file=sys.stderr)
        return 1
    except OSError as error:
        print(f"{error.filename or folder}: {error.strerror or error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
