"""`rmr eval` as a process: the same octets under every hash seed, Ctrl-C, and a quick `--help`."""

import json
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.medium

PROGRAM = """
type wish(robot).  type done(robot).  type action pass(R: robot) -o done(R).
wish(R).  ready(R).
ready(R) -o pass(R).
crossing: assert(wish(R), done(R), 20, broadcast(R)).
a(R, 5).
a(R, N), N > 0 -o a(R, N - 1), {B | edge(R, B) | b(B, R, N)}.
b(R, A, N) -o c(R, A, N).
b(R, A, N) -o d(R, A, N, now()).
"""
OPTIONS = shlex.split("--robots 5 --topology ring --edges edge --loss 0.3 --seed 9 --action-time 1s")
SPIN = "a(R).\na(R) -o a(R).\n"
RMR = [sys.executable, "-c", "from rmr.cli import main; main()"]


def octets(folder: Path, hash_seed: str) -> tuple[bytes, bytes]:
    """Return report and trace of one run."""
    run = subprocess.run(
        [*RMR, "eval", str(folder / "p.rmr"), *OPTIONS, "--trace", str(folder / "t.jsonl")],
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        capture_output=True,
        check=True,
    )
    return run.stdout, (folder / "t.jsonl").read_bytes()


def test_the_same_seed_gives_the_same_octets_under_every_hash_seed(tmp_path):
    (tmp_path / "p.rmr").write_text(PROGRAM)
    report, trace = octets(tmp_path, "1")
    assert octets(tmp_path, "4711") == (report, trace)
    assert json.loads(report)["messages"]["repeated"] > 0
    assert trace.count(b"\n") > 100


def test_ctrl_c_ends_the_run_and_prints_the_report_so_far(tmp_path):
    (tmp_path / "p.rmr").write_text(SPIN)
    os.mkfifo(tmp_path / "trace")
    process = subprocess.Popen(
        [*RMR, "eval", str(tmp_path / "p.rmr"), "--until", "1e8", "--trace", str(tmp_path / "trace")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    with (tmp_path / "trace").open("rb") as trace:
        assert b"fired" in trace.readline()
        process.send_signal(signal.SIGINT)
        trace.read()
    out, err = process.communicate()
    assert process.returncode == 1
    report = json.loads(out)
    assert not report["quiescent"]
    assert report["firings"] > 0
    assert b"rmr eval: interrupted at" in err
    assert b"Traceback" not in err


def test_help_costs_neither_the_compiler_nor_a_node():
    code = "import sys, contextlib; from rmr.commands.subcommands import command as rmr\n"
    code += "with contextlib.suppress(SystemExit): rmr.main(['eval', '--help'])\n"
    code += "print(sorted(set(sys.modules) & {'lark', 'rmr.lang.compiler', 'rmr.node.node', 'rmr.vm.machine'}))"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "--action-time" in shown
    assert shown.endswith("[]\n")
