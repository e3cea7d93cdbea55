"""The folder of a durable robot: whose it is, who has it, and what of it can be read."""

import errno
import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest

from rmr.base.arena import NOWHERE
from rmr.bytecode.program import Program
from rmr.mind import mind_versions
from rmr.mind.journal import Journal, JournalError, read_journal
from rmr.mind.snapshot import Snapshot
from rmr.node.config import NodeConfig
from rmr_agent import state_folder
from rmr_agent.bytecode import Loaded
from rmr_agent.state_files import default_key_file, state_key
from rmr_agent.state_folder import StateFolder, StateFullError, StateRefusedError, begun_header

LOADED = Loaded(Program(()), 7, b"program")
CONFIG = NodeConfig(4, (4, 5), NOWHERE, 1)


def header(robot=4, run=99, lab="bench"):
    return begun_header(replace(CONFIG, robot=robot), LOADED, {}, 116, lab, run)


def begun_journal(folder):
    return folder.taken_up(header(), CONFIG)[1].journal


def own_key():
    return state_key(default_key_file()).octets


def begun(path, records=()):
    """Let robot 4 begin in `path` and write `records`; leave the folder."""
    folder = StateFolder(path, 4, 7, "process")
    journal = begun_journal(folder)
    for record in records:
        journal.calls(0, record)
    folder.close()


def test_a_new_folder_is_made_and_its_journal_begins_with_the_header(tmp_path):
    path = tmp_path / "a" / "b"
    folder = StateFolder(path, 4, 7, "process")
    assert folder.header is None
    assert not (path / "journal").exists(), "a robot that is refused by its world leaves no state"
    assert folder.taken_up(header(), CONFIG)[1].stored == []
    folder.close()
    again = StateFolder(path, 4, 7, "process")
    assert again.header == header()
    assert again.config == NodeConfig(4, {4: None, 5: None}, NOWHERE, 1)
    assert len(again.taken_up(header(), CONFIG)[1].stored) == 1
    again.close()


def test_records_are_there_again_and_a_torn_one_is_dropped_with_a_word(tmp_path):
    begun(tmp_path, [b"one", b"two"])
    file = tmp_path / "journal"
    whole = file.read_bytes()
    file.write_bytes(whole[:-2])
    folder = StateFolder(tmp_path, 4, 7, "process")
    assert "the last 18 octets are no whole record and are dropped; the robot died while" in folder.dropped
    state = folder.taken_up(header(), CONFIG)[1]
    assert [each.octets for each in state.stored[1:]] == [b"one"]
    state.journal.calls(0, b"two")
    folder.close()
    assert file.read_bytes() == whole
    folder = StateFolder(tmp_path, 4, 7, "power")
    assert folder.dropped == ""
    folder.close()


def test_a_journal_damaged_in_the_middle_is_told_as_such(tmp_path):
    begun(tmp_path, [b"one", b"two"])
    file = tmp_path / "journal"
    damaged = bytearray(file.read_bytes())
    damaged[-25] ^= 1
    file.write_bytes(damaged)
    folder = StateFolder(tmp_path, 4, 7, "process")
    assert "octets are no whole record and are dropped; the file is damaged there" in folder.dropped
    assert len(folder.found.records) == 1
    folder.close()


@pytest.mark.parametrize(
    ("robot", "program", "why"),
    [
        (5, 7, "it holds the state of robot 4, not 5"),
        (4, 8, "it holds the state of another program (digest 00000007, this one has 00000008)"),
    ],
)
def test_the_state_of_another_robot_or_program_is_refused(tmp_path, robot, program, why):
    begun(tmp_path)
    with pytest.raises(StateRefusedError, match=re.escape(f"--state {tmp_path}: {why}; begin anew with an empty")):
        StateFolder(tmp_path, robot, program, "process")


def test_the_state_of_another_version_is_refused(tmp_path, monkeypatch):
    begun(tmp_path)
    here = mind_versions.versions() | {"sources": "0123"}
    monkeypatch.setattr(mind_versions, "versions", lambda: here)
    with pytest.raises(StateRefusedError, match=r"written by another version: sources of rmr .*, here 0123"):
        StateFolder(tmp_path, 4, 7, "process")


def test_the_state_of_another_lab_or_run_is_refused(tmp_path):
    begun(tmp_path)
    folder = StateFolder(tmp_path, 4, 7, "process")
    with pytest.raises(StateRefusedError, match="of a robot of lab bench, not other"):
        folder.taken_up(header(lab="other"), CONFIG)
    with pytest.raises(StateRefusedError, match="of an earlier run of lab bench"):
        folder.taken_up(header(run=100), CONFIG)
    folder.close()


def test_a_journal_damaged_at_its_beginning_is_refused_at_every_octet(tmp_path):
    begun(tmp_path)
    file = tmp_path / "journal"
    whole = file.read_bytes()
    for place in range(0, len(whole), 7):
        damaged = bytearray(whole)
        damaged[place] ^= 0x41
        file.write_bytes(damaged)
        with pytest.raises(StateRefusedError, match="damaged at the beginning"):
            StateFolder(tmp_path, 4, 7, "process")


def test_a_second_process_is_kept_out_until_the_first_has_ended(tmp_path):
    holder = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(
            StateRefusedError, match=rf"another robot's process uses the folder \(process {holder.pid}\)"
        ):
            StateFolder(tmp_path, 4, 7, "process")
    finally:
        holder.kill()
        holder.communicate()
    StateFolder(tmp_path, 4, 7, "process").close()


_HOLD = """
import sys
from pathlib import Path
from rmr_agent.state_files import default_key_file, state_key
from rmr_agent.state_folder import StateFolder
folder = StateFolder(Path(sys.argv[1]), 4, 7, "process")
print("held", flush=True)
sys.stdin.read()
"""


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StateRefusedError, match=r"Not a directory|File exists"):
        StateFolder(tmp_path / "file", 4, 7, "process")


def test_a_full_disk_is_told_with_the_file_and_the_reason(tmp_path, monkeypatch):
    folder = StateFolder(tmp_path, 4, 7, "process")
    journal = begun_journal(folder)

    def full(descriptor, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(state_folder.os, "write", full)
    with pytest.raises(StateFullError) as told:
        journal.calls(0, b"x")
    assert str(told.value).startswith(f"the robot's state cannot be written to {tmp_path / 'journal'}: No space left")
    folder.close()


def test_a_short_write_counts_as_a_full_disk_and_leaves_a_torn_record(tmp_path, monkeypatch):
    folder = StateFolder(tmp_path, 4, 7, "process")
    journal = begun_journal(folder)
    write = os.write
    monkeypatch.setattr(state_folder.os, "write", lambda descriptor, data: write(descriptor, data[:5]))
    with pytest.raises(StateFullError):
        journal.calls(0, b"x")
    folder.close()
    found = read_journal((tmp_path / "journal").read_bytes())
    assert (len(found.records), found.dropped) == (1, 5)


def test_power_syncs_each_record(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(state_folder.os, "fdatasync", synced.append)
    folder = StateFolder(tmp_path, 4, 7, "power")
    journal: Journal = begun_journal(folder)
    journal.calls(0, b"x")
    assert len(synced) == 2
    assert replace(header(), run=1) != folder.header
    folder.close()


def test_each_segment_is_a_file_and_the_journal_goes_on_in_the_last_one(tmp_path):
    folder = StateFolder(tmp_path, 4, 7, "process")
    journal = begun_journal(folder)
    for record in (b"one", b"two", b"three"):
        journal.calls(0, record)
        journal.next_segment()
    folder.close()
    assert sorted(path.name for path in tmp_path.glob("journal*")) == ["journal", "journal-1", "journal-2", "journal-3"]
    folder = StateFolder(tmp_path, 4, 7, "process")
    assert [each.octets for each in folder.found.records if each.kind == 1] == [b"one", b"two", b"three"]
    begun_journal(folder).calls(0, b"four")
    folder.close()
    assert read_journal((tmp_path / "journal-3").read_bytes()).records[-1].octets == b"four"


def test_segments_behind_a_damaged_one_are_removed_with_a_word(tmp_path):
    folder = StateFolder(tmp_path, 4, 7, "process")
    journal = begun_journal(folder)
    for record in (b"one", b"two"):
        journal.calls(0, record)
        journal.next_segment()
    folder.close()
    damaged = tmp_path / "journal-1"
    damaged.write_bytes(damaged.read_bytes()[:-1] + b"?")
    folder = StateFolder(tmp_path, 4, 7, "process")
    assert f"{damaged}: the last" in folder.dropped
    assert "the file is damaged there" in folder.dropped
    begun_journal(folder)
    folder.close()
    assert not (tmp_path / "journal-2").exists()


def test_a_damaged_snapshot_is_passed_over_with_a_word_and_removed(tmp_path):
    folder = StateFolder(tmp_path, 4, 7, "process")
    journal = begun_journal(folder)
    journal.calls(0, b"one")
    journal.next_segment()
    folder.close()
    (tmp_path / "snapshot-1").write_bytes(b"torn")
    folder = StateFolder(tmp_path, 4, 7, "process")
    on = "it is passed over, and the robot goes on from the begin of the journal"
    assert folder.passed_over == [f"{tmp_path}/snapshot-1: it is cut short; {on}"]
    assert folder.taken_up(header(), CONFIG)[1].snapshot is None
    folder.close()
    assert not (tmp_path / "snapshot-1").exists()


def test_a_snapshot_that_does_not_lead_to_what_is_recorded_is_passed_over_for_the_one_before(tmp_path, caplog):
    folder = StateFolder(tmp_path, 4, 7, "process")
    journal = begun_journal(folder)
    for number in (1, 2):
        journal.calls(0, b"one")
        (tmp_path / f"snapshot-{number}").write_bytes(Snapshot(number, journal._crc, 7, b"state").octets(own_key()))
        journal.next_segment()
    folder.close()
    folder = StateFolder(tmp_path, 4, 7, "process")
    tried = []

    def make(config, state):
        tried.append(len(state.stored))
        if len(tried) < good:
            raise JournalError("it does not come out again")
        return state.journal

    good = 2
    folder.go_on(header(), CONFIG, make).calls(0, b"two")
    assert tried == [1, 3]
    [told] = [record.getMessage() for record in caplog.records]
    on = "it is passed over, and the robot goes on from the one before"
    assert told == f"{tmp_path}/snapshot-2: it does not come out again; {on}"
    folder.close()
    folder = StateFolder(tmp_path, 4, 7, "process")
    assert folder.found.snapshot.segment == 1
    assert folder.found.records[-1].octets == b"two"
    good = 9
    with pytest.raises(JournalError, match="does not come out again"):
        folder.go_on(header(), CONFIG, make)
    folder.close()
    assert (tmp_path / "snapshot-1").exists(), "what cannot be gone on from is left for a look at it"


def foreign(path):
    """Put a crafted snapshot, whole but of another key, into a folder of robot 4."""
    folder = StateFolder(path, 4, 7, "process")
    journal = begun_journal(folder)
    journal.calls(0, b"one")
    crafted = Snapshot(1, journal._crc, 7, b"crafted").octets(b"a key beside the file")
    journal.next_segment()
    folder.close()
    (path / "snapshot-1").write_bytes(crafted)
    return path


def test_a_snapshot_of_another_key_is_refused_with_what_to_do_and_stays(tmp_path):
    path = foreign(tmp_path / "4")
    before = {file.name: file.read_bytes() for file in path.iterdir()}
    why = "its snapshot 1 was written with another key, by somebody else or elsewhere: if you trust who wrote it"
    todo = "name the key with --state-key FILE; begin anew with an empty folder, or give another one"
    with pytest.raises(StateRefusedError, match=re.escape(f"--state {path}: {why}, {todo}")):
        StateFolder(path, 4, 7, "process")
    assert {file.name: file.read_bytes() for file in path.iterdir()} == before


def test_a_key_is_made_once_outside_of_the_folder_and_others_cannot_read_it(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "home"))
    file = tmp_path / "home" / "rmr" / "state.key"
    StateFolder(tmp_path / "4", 4, 7, "process").close()
    assert not file.exists(), "without snapshots no key is needed"
    StateFolder(tmp_path / "5", 5, 7, "process", b"program", 1 << 20).close()
    made = file.read_text()
    StateFolder(tmp_path / "6", 6, 7, "process", b"program", 1 << 20).close()
    assert file.read_text() == made
    assert file.stat().st_mode & 0o077 == 0
    assert [one.name for one in file.parent.iterdir()] == ["state.key"]
    file.chmod(0o644)
    with pytest.raises(StateRefusedError, match=f"other users may read or change this secret; run: chmod 600 {file}"):
        StateFolder(tmp_path / "6", 6, 7, "process", b"program", 1 << 20)


def test_a_user_without_a_home_names_a_file_for_the_key(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    (tmp_path / "file").touch()
    with pytest.raises(StateRefusedError, match=r"file.*: .*; name a file for it with --state-key FILE, or take no"):
        StateFolder(tmp_path / "5", 5, 7, "process", b"program", 1 << 20)
    StateFolder(tmp_path / "5", 5, 7, "process", b"program", 1 << 20, tmp_path / "own.key").close()
    assert (tmp_path / "own.key").exists()


@pytest.mark.medium
@pytest.mark.skipif(mind_versions.is_compiled(), reason="where rmr is compiled there are no snapshots")
def test_a_snapshot_that_cannot_be_taken_is_told_once_and_the_journal_stays(tmp_path, caplog):
    folder = StateFolder(tmp_path, 4, 7, "process", b"no program", 1)
    journal = begun_journal(folder)
    for _ in range(2):
        journal.calls(0, b"one")
        assert journal.full
        journal.next_segment()
        if (thread := folder._taker._thread) is not None:
            thread.join()
    folder.close()
    [told] = [record.getMessage() for record in caplog.records]
    why = "not RMR byte-code (it does not begin with the magic octets)"
    assert told == f"robot 4: no snapshot of the state: {why}; the journal grows"
    assert (tmp_path / "journal").exists()
