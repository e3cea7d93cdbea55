"""The jobs of docs/sweeps.md share a sweep: each is run as its scheduler would, and the shards are merged."""

import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from doc_blocks import blocks_of

pytestmark = [pytest.mark.medium, pytest.mark.real]

PAGE = Path(__file__).parents[2] / "docs" / "sweeps.md"
BLOCKS = {block.words[0]: block.text for block in blocks_of(PAGE.read_text("utf-8")) if block.words}
SWEEP = "rmr sim corridor --robots 1 --seeds 1-8"
SHARDS = ("1", "2", "3", "4")


def ended(words, folder, **variables):
    """Run a command with the `rmr` of this environment; return its exit code."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(words, cwd=folder, check=False, env={**os.environ, "PATH": path, **variables}).returncode


def files_in(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """What one machine leaves."""
    folder = tmp_path_factory.mktemp("alone")
    assert ended(shlex.split(f"{SWEEP} --jobs 1 --run alone"), folder) == 0
    return files_in(folder / "alone")


def slurm(folder):
    """Start the tasks of the array, one of them twice, as after a requeue."""
    (folder / "sweep.sbatch").write_text(BLOCKS["sweep.sbatch"])
    assert "#SBATCH --array=1-4\n" in BLOCKS["sweep.sbatch"]
    for task in (*SHARDS, "2"):
        assert ended(["sh", "sweep.sbatch"], folder, SLURM_ARRAY_TASK_ID=task) == 0
    return "slurm"


def gnu_parallel(folder):
    """Without GNU parallel its words are put together here: `{}` is each word after `:::`."""
    [line] = BLOCKS["parallel.sh"].replace("\\\n", " ").splitlines()
    command, _, inputs = line.partition(" ::: ")
    rmr = command[command.index("rmr ") :]
    assert inputs.split() == list(SHARDS)
    if shutil.which("parallel") is not None:
        assert ended(["sh", "-c", f"parallel --jobs 1 {rmr} ::: {inputs}"], folder) == 0
        return "parallel"
    for word in inputs.split():
        assert ended(shlex.split(rmr.replace("{}", word)), folder) == 0
    return "parallel"


def kubernetes(folder):
    """Start the container of each pod of the Indexed Job; `/runs` is a folder here."""
    spec = yaml.safe_load(BLOCKS["job.yaml"])["spec"]
    assert (spec["completionMode"], spec["completions"]) == ("Indexed", len(SHARDS))
    [container] = spec["template"]["spec"]["containers"]
    [mount] = container["volumeMounts"]
    words = [*container["command"], *(each.replace(mount["mountPath"], "runs") for each in container["args"])]
    for index in range(spec["completions"]):
        assert ended(words, folder, JOB_COMPLETION_INDEX=str(index)) == 0
    return "runs"


@pytest.mark.parametrize("jobs", [slurm, gnu_parallel, kubernetes], ids=lambda jobs: jobs.__name__)
def test_the_jobs_of_the_page_leave_what_one_machine_leaves(tmp_path, alone, jobs):
    folders = sorted((tmp_path / jobs(tmp_path)).iterdir())
    assert len(folders) == len(SHARDS)
    assert ended(["rmr", "sweep", "merge", *map(str, folders), "-o", "whole"], tmp_path) == 0
    assert files_in(tmp_path / "whole") == alone


def test_the_cluster_of_the_page_leaves_what_one_machine_leaves(tmp_path, alone):
    """The lines of the page, on a free port; the group that the shell began ends with it."""
    pytest.importorskip("distributed", reason="Dask is not installed: pip install 'rmr-robots[cluster]'")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    script = BLOCKS["cluster.sh"].replace("8786", port)
    with (tmp_path / "log").open("w") as log:
        shell = subprocess.Popen(
            ["sh", "-c", script],
            cwd=tmp_path,
            env={**os.environ, "PATH": path},
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
        try:
            code = shell.wait(timeout=600)
        finally:
            os.killpg(shell.pid, signal.SIGKILL)
            shell.wait()
    assert code == 0, (tmp_path / "log").read_text()
    assert files_in(tmp_path / "cluster") == alone
