"""Completion in real shells, and `python -m rmr`."""

import os
import pty
import select
import shutil
import signal
import subprocess
import sys
import time

import pytest

from rmr import __version__

CODE = "import sys; from {module} import {function}; sys.exit({function}())"
HOMES = {
    "rmr": ("rmr.cli", "main"),
    "rmrc": ("rmr.cli", "compile_main"),
    "rmr-agent": ("rmr_agent.main", "main"),
    "rmr-world": ("rmr_world.main", "main"),
}


@pytest.fixture
def shell(tmp_path):
    """Return the path of a shell, and an environment with the four programs on the path, in an empty folder."""
    for name, (module, function) in HOMES.items():
        script = tmp_path / "bin" / name
        script.parent.mkdir(exist_ok=True)
        script.write_text(f"#!{sys.executable}\n{CODE.format(module=module, function=function)}\n")
        script.chmod(0o755)
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "cave.rmr").touch()
    environment = os.environ | {
        "PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}",
        "TERM": "dumb",
        "HOME": str(tmp_path),
    }

    def found(name):
        path = shutil.which(name)
        if path is None and os.environ.get("CI") != "true":
            pytest.skip(f"no {name} on the PATH: apt-get install {name}")
        assert path is not None, f"CI is true and there is no {name}: .ci/run installs it"
        return path, environment, tmp_path / "here"

    return found


def test_bash_completes_commands_options_values_labs_and_files(shell):
    bash, environment, folder = shell("bash")
    lines = ["rmr doc", "rmr sim co", "rmr sim --see", "rmr check ca", "rmr-agent --durability = po", "rmrc --st"]
    script = "source <(rmr completion bash)\n"
    for line in lines:
        words = line.split()
        script += f"COMP_WORDS=({line}) COMP_CWORD={len(words) - 1}; _rmr; echo ${{COMPREPLY[*]}}\n"
    answer = subprocess.run(
        [bash, "--norc", "-c", script], env=environment, cwd=folder, capture_output=True, text=True, check=True
    )
    assert answer.stderr == ""
    assert answer.stdout.splitlines() == ["doctor", "corridor", "--seed --seeds", "cave.rmr", "power", "--strip"]


def test_fish_completes_commands_options_values_labs_and_files(shell):
    fish, environment, folder = shell("fish")
    lines = ["rmr doc", "rmr sim corr", "rmr sim --see", "rmr check cav", "rmr-agent --durability po", "rmrc --st"]
    script = "rmr completion fish | source\n" + "".join(f"complete -C '{line}'\n" for line in lines)
    answer = subprocess.run(
        [fish, "--no-config", "-c", script], env=environment, cwd=folder, capture_output=True, text=True, check=True
    )
    assert answer.stderr == ""
    assert [line.split("\t")[0] for line in answer.stdout.splitlines()] == [
        *("doctor", "corridor", "--seed", "--seeds", "cave.rmr", "power", "--strip")
    ]
    assert "Say what this machine lacks" in answer.stdout


def test_zsh_completes_commands_options_values_labs_and_files(shell):
    zsh, environment, folder = shell("zsh")
    terminal, end = pty.openpty()
    process = subprocess.Popen(
        [zsh, "-f", "-i"], env=environment, cwd=folder, stdin=end, stdout=end, stderr=end, start_new_session=True
    )

    def typed(text, wanted):
        os.write(terminal, text.encode())
        shown, until = "", time.monotonic() + 60
        while wanted not in shown:
            assert time.monotonic() < until, f"after {text!r} there is no {wanted!r} in {shown!r}"
            if select.select([terminal], [], [], 1)[0]:
                shown += os.read(terminal, 4096).decode(errors="replace")

    try:
        typed("autoload -Uz compinit; compinit -D; source <(rmr completion zsh); echo rea''dy\n", "ready")
        for line, wanted in {
            "rmr doc": "tor ",
            "rmr sim corr": "idor ",
            "rmr sim --see": "d",
            "rmr check cav": "e.rmr ",
            "rmr-agent --durability po": "wer ",
            "rmrc --st": "rip ",
        }.items():
            typed("\x15", "")
            typed(line, line[-1])
            typed("\t", wanted)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        os.close(terminal)
        os.close(end)


def test_python_runs_the_package_as_the_command():
    answer = subprocess.run([sys.executable, "-m", "rmr", "--version"], capture_output=True, text=True, check=True)
    assert (answer.stdout, answer.stderr) == (f"rmr (rmr-robots) {__version__}\n", "")
    wrong = subprocess.run([sys.executable, "-m", "rmr", "sym"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("rmr: unknown command 'sym'; did you mean 'sim'?\n")
