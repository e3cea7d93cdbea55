"""A full disk: the file is named, no secret is left behind, and what became of an order is told.

The disk is the kernel's limit of a file's size, in a process of its own: a write beyond it fails, at each file in turn.
"""

import errno
import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from rmr.base.file_errors import disk_of
from rmr_deploy.run_requests import REQUESTS_FOLDER, RequestError, ask_launcher, serve_requests

pytestmark = pytest.mark.medium

DASH = Path(__file__).parents[2] / "integration" / "labs" / "dash"
LIMITED = """
import resource, signal, sys
from pathlib import Path
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
"""
PLAN = """
from rmr_deploy.preparation import RunRefusedError, make_plan
from rmr_deploy.run_options import RunOptions
try:
    make_plan(RunOptions(lab=Path(sys.argv[2]), folder=Path(sys.argv[3])), color=False)
except RunRefusedError as error:
    print(error)
"""
SECRET = """
from rmr.bus.secret import make_secret
try:
    make_secret(Path(sys.argv[2]))
except OSError as error:
    print(error.filename)
"""
RECORD = """
from rmr_deploy.active_runs import write_processes
try:
    write_processes(Path(sys.argv[2]), "tcp/127.0.0.1:1", {}, {})
except OSError as error:
    print(error.filename)
"""

END = """
from rmr_deploy.active_runs import write_end
print(write_end(Path(sys.argv[2]), 4))
"""
EVENTS = """
from rmr_deploy.event_log import EventLog
events = EventLog(Path(sys.argv[2]), lambda: None)
for robot in range(9):
    events.note("robot_back", f"robot {robot} is back", robot=robot)
print(events.failure)
"""
SERVE = """
import json
from rmr_deploy.run_requests import serve_requests
done = []
serve_requests(Path(sys.argv[2]), lambda request: done.append(request) or json.loads(sys.argv[3]))
print(json.dumps(done))
"""
ASK = """
from rmr_deploy.run_requests import RequestError, ask_launcher
try:
    ask_launcher(Path(sys.argv[2]), {"do": "status"})
except RequestError as error:
    print(error)
"""


def limited(octets, script, *words):
    """Run `script` where no file can be longer than `octets`; return what it prints."""
    command = [sys.executable, "-B", "-c", LIMITED + script, str(octets), *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    return done.stdout.strip()


@pytest.mark.parametrize(("octets", "file"), [(0, "secret"), (40, "secret"), (100, "dash.rbc"), (1000, "lab.json")])
def test_the_file_that_does_not_fit_is_named_and_no_secret_stays(tmp_path, octets, file):
    folder = tmp_path / "run"
    said = limited(octets, PLAN, DASH, folder)
    assert said == f"{folder / file}: File too large; name a run folder that can be written with --run DIR"
    assert not (folder / "secret").exists()


def test_half_a_secret_does_not_stay(tmp_path):
    path = tmp_path / "lab.secret"
    assert limited(40, SECRET, path) == str(path)
    assert not path.exists()


def test_half_a_record_of_processes_does_not_stay_and_the_one_before_does(tmp_path):
    path = tmp_path / "processes.json"
    path.write_text("{}\n")
    assert limited(20, RECORD, tmp_path) == str(path)
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("processes.json", "{}\n")]


def test_events_end_with_a_reason_and_go_on_no_more(tmp_path):
    path = tmp_path / "events.jsonl"
    assert limited(400, EVENTS, tmp_path) == f"{path}: File too large"
    *whole, _ = path.read_text().split("\n")
    assert [json.loads(line)["robot"] for line in whole] == [*range(len(whole))]
    assert 0 < len(whole) < 9
    assert limited(4000, EVENTS, tmp_path / "new") == f"{tmp_path / 'new' / 'events.jsonl'}: No such file or directory"


def test_exit_code_that_cannot_be_noted_is_told(tmp_path):
    path = tmp_path / "processes.json"
    path.write_text('{"started": {}}\n')
    path.chmod(0o600)
    told = f"{path}: File too large; rmr wait will not know that the exit code was 4"
    assert limited(20, END, tmp_path) == told
    assert limited(4000, END, tmp_path) == ""
    assert json.loads(path.read_text())["exit_code"] == 4


# --- requests


@pytest.mark.parametrize(
    ("refused", "became"),
    [
        ("", "the order was carried out, though the launcher could not write its answer"),
        ("robot 3 is dead", "the order was refused, and the launcher could not write why"),
        ({"robots": []}, "the launcher could not write its answer"),
    ],
)
def test_what_became_of_an_order_is_told_where_no_answer_can_be_written(tmp_path, refused, became):
    done = []
    folder = tmp_path / REQUESTS_FOLDER
    with ThreadPoolExecutor() as pool:
        asking = pool.submit(ask_launcher, tmp_path, {"do": "kill", "robot": 3}, 60.0)
        while not [*folder.glob("*.ask")]:
            assert not asking.done()
        stem = next(folder.glob("*.ask")).stem
        done += json.loads(limited(0, SERVE, tmp_path, json.dumps(refused)))
        with pytest.raises(RequestError) as caught:
            asking.result()
    assert str(caught.value) == f"{became}: {folder / stem}.answer: File too large, on the disk at {disk_of(folder)}"
    assert done == [{"do": "kill", "robot": 3}]
    assert [*folder.iterdir()] == []


def test_an_order_that_cannot_be_put_is_told_with_the_file_and_its_disk(tmp_path):
    said = limited(0, ASK, tmp_path)
    folder = tmp_path / REQUESTS_FOLDER
    assert said.startswith(f"the launcher cannot be asked: {folder}/")
    assert said.endswith(f".new: File too large, on the disk at {disk_of(tmp_path)}")
    assert [*folder.iterdir()] == []


def test_an_order_is_carried_out_once_whatever_becomes_of_its_answer(tmp_path, monkeypatch):
    folder = tmp_path / REQUESTS_FOLDER
    folder.mkdir()
    (folder / "a.ask").write_text("{}")
    done = []
    monkeypatch.setattr(Path, "write_text", broken_disk)
    monkeypatch.setattr(Path, "unlink", broken_disk)
    for _ in range(3):
        serve_requests(tmp_path, lambda request: done.append(request) or "")
    assert done == [{}]


def broken_disk(*_words, **_options):
    raise OSError(errno.EROFS, "Read-only file system")
