"""docs/recording.md: channels, files, metadata and commands are those of the code, and its example runs."""

from typing import Any

from doc_pages import blocks, codes, page, section, table

from rmr.commands.record_command import command
from rmr.record.channels import CHANNELS
from rmr.record.recording import open_recording
from rmr.record.run_about import METADATA_NAME
from rmr_sim.main import main

PAGE = page("recording")


def test_every_channel_is_documented_as_the_code_says():
    documented = [
        (codes(topic)[0], codes(schema)[0], encoding, by, content)
        for topic, schema, encoding, by, content in table(PAGE, "topic", "schema", "encoding", "written by", "content")
    ]
    assert documented == [(c.topic, c.schema, c.encoding, c.written_by, c.content) for c in CHANNELS]


def test_the_fields_of_a_frame_are_documented():
    [frames] = [channel for channel in CHANNELS if channel.topic == "/frames"]
    assert frames.properties is not None
    assert set(frames.properties) <= set(codes(section(PAGE, "Channels")))


def test_the_commands_are_documented_and_no_others():
    text = section(PAGE, "Runs of processes")
    assert [codes(row[0])[0].split()[2] for row in table(text, "command", "does")] == list(command.commands)


def test_metadata_and_attachments_of_a_run_are_documented_and_the_example_reads_it(tmp_path):
    folder = tmp_path / "look"
    assert main(["corridor", "--robots", "1", "--run", str(folder)]) == 0
    with open_recording(folder) as recording:
        metadata = set(recording.parts[0].scan.metadata)
        attachments = set(recording.attachments)
    assert METADATA_NAME in metadata
    assert metadata | {"parts", "problems"} == {codes(row[0])[0] for row in table(PAGE, "metadata", "holds")}
    assert attachments | {"actions.py"} == {codes(row[0])[0] for row in table(PAGE, "attachment", "is")}
    names: dict[str, Any] = {}
    exec(compile(blocks(PAGE, "python")[0], "recording.md", "exec"), names)
    assert {*names["octets_by_kind"](folder)} >= {"hello", "sched", "beacon"}
