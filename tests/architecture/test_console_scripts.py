"""Every console script answers `--help` and `--version`, quickly and on stdout, and stands in the documentation."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from source_tree import PROJECT, ROOT, SCRIPTS

pytestmark = pytest.mark.medium

HELP_CPU_MS_MAX = 400
"""The target is 150 ms and is measured by `make bench`; a loaded machine must not fail the suite."""


CTRL_C = """
import signal, sys
class CtrlC:
    def find_spec(self, name, *_):
        if name in {modules}:
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, CtrlC())
"""
"""Ctrl-C comes while one of `modules` is imported."""


def code_of(script: str) -> str:
    module, function = SCRIPTS[script].split(":")
    return f"import sys; sys.argv[0] = {script!r}; from {module} import {function}; sys.exit({function}())"


def run(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code_of(script), *arguments], capture_output=True, text=True, timeout=30, check=False
    )


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_command_explains_itself(script):
    answer = run(script, "--help")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.lower().startswith("usage:")
    assert answer.stderr == ""


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_command_tells_its_version(script):
    answer = run(script, "--version")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout == f"rmr ({PROJECT['project']['name']}) {PROJECT['project']['version']}\n"


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_command_answers_an_unknown_option_with_usage_and_exit_code_2(script):
    answer = run(script, "--no-such-option")
    assert answer.returncode == 2
    assert "usage" in answer.stderr.lower()
    assert "Traceback" not in answer.stderr


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs wait4")
def test_the_help_of_rmr_costs_little_processor_time():
    code = "import sys; sys.argv = ['rmr', '--help']; from rmr.cli import main; main()"
    assert min(cpu_ms(code) for _ in range(3)) < HELP_CPU_MS_MAX


def cpu_ms(code: str) -> float:
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    return (usage.ru_utime + usage.ru_stime) * 1e3


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_command_stands_in_the_documentation(script):
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
    text = "\n".join(page.read_text() for page in pages)
    assert f"`{script}" in text or f"{script} " in text or f"`{script.replace('rmr-', 'rmr ')}" in text


@pytest.mark.parametrize("module", sorted({target.split(":")[0] for target in SCRIPTS.values()}))
def test_what_a_script_names_loads_next_to_nothing_so_that_ctrl_c_finds_it_prepared(module):
    code = f"import sys; before = set(sys.modules); import {module}; print(*set(sys.modules) - before)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    foreign = {name for name in loaded if name.split(".")[0] not in sys.stdlib_module_names}
    assert foreign == {"rmr", "rmr.compiled", "rmr.entry", module, module.split(".")[0]}


@pytest.mark.parametrize("script", SCRIPTS)
def test_ctrl_c_while_a_command_loads_is_told_in_a_word(script):
    code = CTRL_C.format(modules=("argparse", "rmr.entry.command_line")) + code_of(script)
    answer = subprocess.run([sys.executable, "-c", code, "--help"], capture_output=True, text=True, check=False)
    assert (answer.returncode, answer.stderr.split(": ")[1:]) == (1, ["interrupted\n"])


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_standard_output_that_is_closed_or_full_is_told(script):
    words = [sys.executable, "-c", code_of(script), "--help"]
    closing = ["sh", "-c", 'exec "$@" >&-', "sh", *words]
    closed = subprocess.run(closing, stderr=subprocess.PIPE, text=True, check=False)
    assert closed.returncode == 1
    assert closed.stderr.split(": ")[1].startswith("standard output is closed; ")
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}  # as for users
    with Path("/dev/full").open("w") as full:
        answer = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=buffered)
    assert answer.returncode == 1
    assert answer.stderr.split(": ")[1:] == ["cannot write the output", "No space left on device\n"]


def test_what_a_run_loads_is_set_aside_from_the_garbage_collector_once():
    code = (
        "import gc; from rmr_sim.main import main; words = ['corridor', '--actions', 'none.py'];"
        "main(words); first = gc.get_freeze_count();"
        "main(words); print(gc.isenabled(), first > 10_000, gc.get_freeze_count() <= first)"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.split() == ["True", "True", "True"]
