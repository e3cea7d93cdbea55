"""Recordings for tests."""

from pathlib import Path

from rmr.record.record_writer import RecordWriter
from rmr.record.run_about import RunAbout, about_run

ROSTER = (1, 2, 3)


def about(process: str = "sim", run: str = "", seed: int = 7) -> RunAbout:
    return about_run("corridor", "simulated" if process == "sim" else "processes", seed, ROSTER, process, run)


def trace(at_s: float, robot: int = 1, text: str = "") -> dict[str, object]:
    return {"t": at_s, "robot": robot, "what": "said", "text": text}


def write_part(
    path: Path, process: str, *, run: str = "", robot: int = 1, messages: int = 300, finish: bool = True, seed: int = 7
) -> Path:
    """Write a file with a message every 10 ms, flushed each second; unfinished, it is that of a killed process."""
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = RecordWriter(path, about(process, run, seed))
    writer.attach("floor.json", b"{}")
    for number in range(messages):
        writer.write("/trace", number * 10**7 + robot, trace(number / 100, robot))
        if number % 100 == 99:
            writer.flush()
    if finish:
        writer.close()
    else:
        end_without_closing(writer)
    assert writer.failure is None
    return path


def end_without_closing(writer: RecordWriter) -> None:
    """Leave the file as a process does that is killed."""
    writer._close_file()
