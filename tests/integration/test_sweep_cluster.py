"""`rmr sim --on`: a sweep on a Dask scheduler and its workers, which are killed; rows are those of one process."""

import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from launched import eventually

import rmr
from rmr_sim import cluster_pool
from rmr_sim.main import main

pytest.importorskip("distributed", reason="Dask is not installed: pip install 'rmr-robots[cluster]'")

ROOT = Path(__file__).parents[2]
SIM = [sys.executable, "-P", "-m", "rmr_sim.main", "corridor", "--robots", "2"]
NEVER = "type action wait(R: robot, T: float) -o done(R).\ngo(R).\ngo(R) -o wait(R, 1).\n"
LAB = "lab: tiny\nprogram: tiny.rmr\narena: {size: [1.0, 1.0], cell: 0.05}\n"
LAB += "robots: [{id: 1, pose: [0.5, 0.5, 0deg]}]\nfinish: done(R)\nduration: 2s\n"
DEADLY = """
import os
from rmr_sim.event import Event

class Death(Event):
    def callback(self, simulation):
        os._exit(7)

def events(lab, seed):
    return [Death(0)] if seed == 3 else []
"""


class Cluster:
    """A scheduler and workers on loopback, known by their ids."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._all: list[subprocess.Popen[str]] = []
        self.workers: list[subprocess.Popen[str]] = []
        folder.mkdir()
        file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
        eventually(lambda: file.exists() and file.read_text().endswith("}"))
        self.address: str = json.loads(file.read_text())["address"]

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._all:
            process.kill()
        for process in self._all:
            process.wait()

    def _start(self, *words: str, path: Path | None = None) -> subprocess.Popen[str]:
        env = {**os.environ, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0", "RMR_COMPILED": ""}
        env |= {} if path is None else {"PYTHONPATH": str(path)}
        log = (self._folder / f"log-{len(self._all)}").open("w")
        command = [sys.executable, "-P", "-m", "dask", *words, "--no-dashboard"]
        with log:
            process = subprocess.Popen(command, stdout=log, stderr=log, text=True, env=env, cwd=self._folder)
        self._all.append(process)
        return process

    def work(self, path: Path | None = None) -> None:
        """Start a worker, with the packages in `path` before all others, and wait until it has joined."""
        words = ("worker", self.address, "--nthreads", "1", "--no-nanny", "--memory-limit", "0")
        self.workers.append(self._start(*words, path=path))
        log = self._folder / f"log-{len(self._all) - 1}"
        eventually(lambda: "Registered to:" in log.read_text())


def files_in(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def rows_in(folder):
    path = folder / "rows.jsonl"
    return max(0, len(path.read_text().splitlines()) - 1) if path.exists() else 0


def begun(*words):
    return subprocess.Popen([*SIM, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def code_of(words):
    try:
        return main(words)
    except SystemExit as refused:
        return int(refused.code or 0)


@pytest.mark.timeout(600)
def test_a_worker_and_then_the_scheduler_are_killed_and_rows_are_those_of_one_process(tmp_path):
    wanted, run = tmp_path / "alone", tmp_path / "run"
    options = ("--seeds", "1-10", "--chaos")
    with Cluster(tmp_path / "cluster") as cluster:
        cluster.work()
        cluster.work()
        sweep = begun(*options, "--on", cluster.address, "--run", str(run))
        eventually(lambda: rows_in(run) >= 1)
        cluster.workers[0].kill()
        eventually(lambda: rows_in(run) >= 3)
        assert cluster.workers[0].poll() == -signal.SIGKILL
        cluster.scheduler.kill()
        _, err = sweep.communicate(timeout=600)
        assert sweep.returncode == 1, err
        assert "Traceback" not in err
        over = rows_in(run)
        assert 3 <= over < 10, "it was killed on the way"
        told = f"the scheduler at {cluster.address} is gone, or was restarted: {over} of 10 runs in "
        again = f"; to go on: rmr sim corridor --robots 2 --chaos --on {cluster.address} --resume {run}\n"
        assert told in err
        assert err.endswith(again)
    with Cluster(tmp_path / "another") as cluster:
        cluster.work()
        sweep = begun(*options, "--on", cluster.address, "--resume", str(run))
        _, err = sweep.communicate(timeout=600)
        assert sweep.returncode == 0, err
        assert f"resuming: {over} of 10 runs are over\n" in err
    alone = begun(*options, "--jobs", "1", "--run", str(wanted))
    alone.communicate(timeout=300)
    assert files_in(run) == files_in(wanted)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_hunt_and_a_shard_are_those_of_one_process_and_a_deadly_seed_costs_itself_alone(tmp_path):
    (tmp_path / "lab.yaml").write_text(LAB)
    (tmp_path / "tiny.rmr").write_text(NEVER)
    (tmp_path / "deadly.py").write_text(DEADLY)
    with Cluster(tmp_path / "cluster") as cluster:
        cluster.work()
        for name, options in {"hunt": ("--hunt", "--runs", "9", "--seed", "1"), "shard": ("--seeds", "1-5")}.items():
            words = [*options, *(("--shard", "2/2") if name == "shard" else ())]
            there = begun(*words, "--on", cluster.address, "--run", str(tmp_path / name))
            out, err = there.communicate(timeout=600)
            here = begun(*words, "--jobs", "1", "--run", str(tmp_path / f"{name}-alone"))
            assert (
                out.replace(name, f"{name}-alone").splitlines()[:2] == here.communicate(timeout=600)[0].splitlines()[:2]
            )
            assert there.returncode == here.returncode, err
            assert files_in(tmp_path / name) == files_in(tmp_path / f"{name}-alone")
        for _ in range(2):
            cluster.work()  # the seed takes two with it
        words = [str(tmp_path), "--seeds", "1-6", "--events", str(tmp_path / "deadly.py"), "--on", cluster.address]
        assert code_of([*words, "--run", str(tmp_path / "deadly")]) == 1
        rows = json.loads((tmp_path / "deadly" / "sweep.json").read_text())["rows"]
        assert [row["finished"] for row in rows] == [True, True, False, True, True, True]
        assert rows[2]["error"] == "its worker died each time"


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_campaign_of_drawn_labs_on_a_cluster_and_its_shards_have_the_rows_of_one_process(tmp_path):
    """Workers do not have the modules of tests/score."""
    script = [sys.executable, str(ROOT / "tests" / "score" / "score_campaign.py"), "3", "4", "--out"]
    with Cluster(tmp_path / "cluster") as cluster:
        cluster.work()
        parts = {"all": ["--on", cluster.address], "1": ["--shard", "1/2"], "2": ["--shard", "2/2"], "alone": []}
        for name, words in parts.items():
            command = [*script, str(tmp_path / name), *words, *([] if name == "all" else ["--jobs", "1"])]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
    found = {}
    for name in parts:
        rows = [json.loads(line) for line in (tmp_path / name / "rows.jsonl").read_text().splitlines()]
        found[name] = sorted(json.dumps(row | {"cost": None}, sort_keys=True) for row in rows)
    assert len(found["alone"]) == 2
    assert found["all"] == found["alone"] == sorted(found["1"] + found["2"])


@pytest.mark.timeout(300)
def test_a_worker_of_another_rmr_is_refused_before_the_first_seed_and_one_that_joins_later_too(tmp_path):
    other = tmp_path / "other"
    for package in (ROOT / "rmr", ROOT / "world" / "rmr_sim", ROOT / "world" / "rmr_world"):
        shutil.copytree(package, other / package.name, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    with (other / "rmr_sim" / "chaos.py").open("a") as file:
        file.write("# another one\n")
    without = tmp_path / "without"
    (without / "rmr_sim").mkdir(parents=True)
    (without / "rmr_sim" / "__init__.py").touch()
    with Cluster(tmp_path / "cluster") as cluster:
        cluster.work()
        sweep = begun("--seeds", "1-40", "--on", cluster.address, "--run", str(tmp_path / "late"))
        eventually(lambda: rows_in(tmp_path / "late"))
        cluster.work(other)
        _, err = sweep.communicate(timeout=600)
        assert sweep.returncode == 1
        assert "which joined later, is of another rmr; sources of rmr: " in err
        assert "; to go on: rmr sim corridor --robots 2 --on " in err
        assert "Traceback" not in err
        cluster.work(without)
        sweep = begun("--seeds", "1-4", "--on", cluster.address, "--run", str(tmp_path / "refused"))
        _, err = sweep.communicate(timeout=600)
        assert sweep.returncode == 1
        lines = sorted(
            line.partition(" is of another ")[2] or line.partition(" has no rmr ")[2] for line in err.splitlines()
        )
        assert len(lines) == 2, err
        assert lines[0].startswith("rmr; sources of rmr: ")
        assert lines[1].startswith("that can be asked: ModuleNotFoundError(")
        assert lines[1].endswith("; there too: pip install 'rmr-robots[cluster]'")
        assert not list((tmp_path / "refused").iterdir())


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_ctrl_c_keeps_what_has_come_and_no_worker_is_said(tmp_path):
    with Cluster(tmp_path / "cluster") as cluster:
        words = [
            "corridor",
            "--robots",
            "2",
            "--seeds",
            "1-40",
            "--on",
            cluster.address,
            "--run",
            str(tmp_path / "run"),
        ]
        ended = begun(*words[3:])
        _, err = ended.communicate(timeout=600)
        assert ended.returncode == 1
        start = f"dask worker {cluster.address} --nthreads 1"
        assert err == f"rmr sim: the scheduler at {cluster.address} has no worker; start some: {start}\n"
        cluster.work()
        sweep = begun(*words[3:])
        eventually(lambda: rows_in(tmp_path / "run") >= 2)
        sweep.send_signal(signal.SIGINT)
        _, err = sweep.communicate(timeout=600)
        assert sweep.returncode == 1
        assert err.startswith("interrupted: ")
        assert f"; to go on: rmr sim corridor --robots 2 --on {cluster.address} --resume " in err
        run = tmp_path / "left"
        sweep = begun("--seeds", "1-8", "--on", cluster.address, "--run", str(run))
        eventually(lambda: rows_in(run) >= 2)
        cluster.workers[0].kill()
        assert sweep.stderr is not None
        assert sweep.stderr.readline() == f"no worker is left at {cluster.address}; waiting for one\n"
        cluster.work()
        _, err = sweep.communicate(timeout=600)
        assert (sweep.returncode, rows_in(run)) == (0, 8), err


def test_no_scheduler_is_said(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(cluster_pool, "CONNECT_S", 1)
    words = ["corridor", "--robots", "2", "--seeds", "1-2", "--run", str(tmp_path / "run"), "--on", "tcp://127.0.0.1:9"]
    assert code_of(words) == 1
    err = capsys.readouterr().err
    assert err.startswith("rmr sim: no Dask scheduler answers at tcp://127.0.0.1:9: ")
    assert err.count("\n") == 1


def test_a_cluster_with_tls_needs_certificates(tmp_path, capsys):
    words = ["corridor", "--robots", "2", "--seeds", "1-2", "--run", str(tmp_path / "run"), "--on", "tls://127.0.0.1:9"]
    assert code_of(words) == 1
    err = capsys.readouterr().err
    assert err.startswith("rmr sim: --on tls://127.0.0.1:9: Dask has no certificates here; its configuration needs ")
    assert err.count("\n") == 1


def test_what_to_install_is_said(tmp_path, capsys, monkeypatch):
    def missing(name):
        if name == "distributed":
            raise ModuleNotFoundError("No module named 'distributed'", name=name)
        return importlib.import_module(name)

    monkeypatch.setattr(cluster_pool, "import_module", missing)
    words = ["corridor", "--robots", "2", "--seeds", "1-2", "--run", str(tmp_path / "run"), "--on", "tcp://127.0.0.1:9"]
    assert code_of(words) == 1
    said = "rmr sim: --on: Dask is not installed; pip install 'rmr-robots[cluster]' brings it\n"
    assert capsys.readouterr().err == said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--seeds", "1-2", "--on", "scheduler"], "the address of a Dask scheduler, such as tcp://scheduler:8786, not"),
        (["--seeds", "1-2", "--on", "tcp://scheduler"], "the address of a Dask scheduler"),
        (["--seeds", "1-2", "--on", "http://scheduler:8786"], "the address of a Dask scheduler"),
        (["--on", "tcp://scheduler:8786"], "--on shares the runs of a sweep or a hunt: name its --seeds, or --hunt"),
        (["--seeds", "1-2", "--on", "tcp://[::1]:8786", "--jobs", "2"], "name one of them"),
    ],
)
def test_wrong_usage_is_said(capsys, words, said):
    assert code_of(["corridor", *words]) == 2
    assert said in capsys.readouterr().err


def test_the_cluster_is_loaded_only_where_one_is_asked_for(tmp_path):
    code = "import sys, rmr_sim.main; rmr_sim.main.main(sys.argv[1:]); print('distributed' in sys.modules)"
    words = ["corridor", "--robots", "1", "--seeds", "1-2", "--jobs", "2", "--run", str(tmp_path / "run")]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "False"
    assert rmr.__version__ in (tmp_path / "run" / "rows.jsonl").read_text()
