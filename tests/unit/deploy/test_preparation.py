"""What a run needs before it starts: mistakes are refused, whatever they are about."""

import os
import shutil
import stat
import sys
from pathlib import Path

import pytest

from rmr.bus.authority import Authority, holder
from rmr.bus.certificates import read_certificate
from rmr.bus.secret import read_secret
from rmr.bus.signing import read_trust
from rmr.entry import ExitCode
from rmr_agent.bytecode import load_program
from rmr_deploy import preparation
from rmr_deploy.preparation import RunRefusedError, agent_command, make_plan, world_command
from rmr_deploy.run_options import RunOptions

DASH = Path(__file__).parents[2] / "integration" / "labs" / "dash"


def test_an_empty_run_folder_that_may_not_be_written_is_wrong_usage(tmp_path, monkeypatch):
    def denied(path, *_args, **_options):
        raise PermissionError(13, os.strerror(13), str(path))

    folder = tmp_path / "run"
    folder.mkdir()
    monkeypatch.setattr(Path, "write_bytes", denied)
    with pytest.raises(RunRefusedError, match=r"dash\.rbc: Permission denied; name a run folder") as refusal:
        make_plan(RunOptions(lab=DASH, folder=folder), color=False)
    assert refusal.value.exit_code == ExitCode.USAGE


def secured(folder, settings):
    """Return a copy of the small lab with these settings of its radio."""
    lab = folder / "lab"
    shutil.copytree(DASH, lab)
    with (lab / "lab.yaml").open("a") as file:
        file.write(f"radio: {settings}\n")
    return lab


def test_the_robots_are_handed_the_file_of_the_key_and_the_world_is_not(tmp_path):
    lab = secured(tmp_path, "{key_file: lab.key}")
    (lab / "lab.key").write_text("00112233445566778899aabbccddeeff")
    plan = make_plan(RunOptions(lab=lab, folder=tmp_path / "run"), color=False)
    command = agent_command(plan, (1,), "tcp/127.0.0.1:1")
    assert command[command.index("--radio-key") + 1] == str(lab / "lab.key")
    assert "--radio-key" not in world_command(plan, "tcp/127.0.0.1:1")


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ("{key_file: lab.key}", r"lab\.key: No such file or directory; to make a key: openssl"),
        ("{security: enc-mic-64}", r"radio\.security: enc-mic-64 needs a key: name its file in radio\.key_file"),
    ],
)
def test_a_secured_lab_without_its_key_is_refused_before_anything_starts(tmp_path, settings, why):
    with pytest.raises(RunRefusedError, match=why) as refusal:
        make_plan(RunOptions(lab=secured(tmp_path, settings), folder=tmp_path / "run"), color=False)
    assert refusal.value.exit_code == ExitCode.INVALID
    assert not (tmp_path / "run").exists()


def test_a_secured_lab_without_the_library_of_its_ciphers_is_refused_before_anything_starts(tmp_path, monkeypatch):
    lab = secured(tmp_path, "{key_file: lab.key}")
    (lab / "lab.key").write_text("00112233445566778899aabbccddeeff")
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with pytest.raises(RunRefusedError, match=r"cryptography is not installed; pip install 'rmr-robots\[keys\]'"):
        make_plan(RunOptions(lab=lab, folder=tmp_path / "run"), color=False)


def test_run_folder_is_closed_to_other_users_even_one_that_was_open(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    folder.chmod(0o755)
    plan = make_plan(RunOptions(lab=DASH, folder=folder), color=False)
    assert (stat.S_IMODE(folder.stat().st_mode), stat.S_IMODE(plan.secret.stat().st_mode)) == (0o700, 0o600)
    for command in (world_command(plan, "tcp/127.0.0.1:1"), agent_command(plan, (1,), "tcp/127.0.0.1:1")):
        assert command[command.index("--secret") + 1] == str(plan.secret)
        assert read_secret(plan.secret).password not in " ".join(command)


def test_run_folder_on_a_file_system_without_permissions_is_refused(tmp_path, monkeypatch):
    """Such as FAT, where every file has the same mode: it cannot keep a secret from other users."""

    def open_to_all(path):
        path.write_text("rmr:0123456789abcdef\n")
        path.chmod(0o777)

    monkeypatch.setattr(preparation, "make_secret", open_to_all)
    with pytest.raises(
        RunRefusedError, match="no file in it can be kept from other users; name another run folder"
    ) as no:
        make_plan(RunOptions(lab=DASH, folder=tmp_path / "run"), color=False)
    assert no.value.exit_code == ExitCode.USAGE
    assert not (tmp_path / "run" / "secret").exists()


# --- keys


@pytest.fixture
def keyed(tmp_path, monkeypatch):
    """A lab with security mtls, and the folder of its CA."""
    monkeypatch.delenv("RMR_KEYS", raising=False)
    lab = tmp_path / "lab"
    shutil.copytree(DASH, lab)
    with (lab / "lab.yaml").open("a") as file:
        file.write("bus: {security: mtls}\n")
    ca = Authority.begin(tmp_path / "ca")
    for role, name in (("world", ""), ("operator", "ann"), ("robot", "1"), ("robot", "2-3")):
        ca.issue(holder(role, name))
    return lab, ca


def test_each_process_of_a_lab_with_keys_is_handed_its_own_and_none_stay(keyed, tmp_path, monkeypatch):
    lab, ca = keyed
    monkeypatch.setenv("RMR_KEYS", str(ca.folder))
    plan = make_plan(RunOptions(lab=lab, folder=tmp_path / "run", processes=2), color=False)
    assert plan.process_robots == [(1,), (2, 3)]
    commands = [world_command(plan, "tls/a:1"), *(agent_command(plan, ids, "tls/a:1") for ids in plan.process_robots)]
    for command, who in zip(commands, ("world", "robot/1", "robot/2-3"), strict=True):
        assert "--secret" not in command
        assert str(read_certificate(Path(command[command.index("--keys") + 1])).holder) == who
    assert str(read_certificate(plan.secret).holder) == "operator/ann"
    for each in ("robots-1", "robots-2-3"):
        assert load_program(plan.byte_code, read_trust(plan.secret.parent / each)).digest == plan.program.digest
    assert not (plan.folder / "secret").exists()
    plan.forget_secret()
    assert sorted(each.name for each in plan.folder.iterdir()) == ["dash.rbc", "lab.json", "logs", "record"]


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        (None, r"lab dash has `security: mtls`: name the folder of its CA \(rmr keys init\) with --keys"),
        ("nowhere", r"nowhere: no folder of a CA; make one with rmr keys init"),
        ("ca", r"no robot 2 has a certificate; issue one with rmr keys issue .* --robot 2"),
    ],
)
def test_a_lab_with_keys_is_refused_without_them_and_leaves_none_behind(keyed, tmp_path, keys, says):
    lab, ca = keyed
    ca.revoke(holder("robot", "2-3"))
    options = RunOptions(lab=lab, folder=tmp_path / "run", keys=None if keys is None else tmp_path / keys)
    with pytest.raises(RunRefusedError, match=says) as refusal:
        make_plan(options, color=False)
    assert refusal.value.exit_code == ExitCode.INVALID
    assert not (tmp_path / "run" / "keys").exists()


def test_keys_for_a_lab_with_a_secret_are_wrong_usage_but_those_of_the_environment_are_left_alone(
    keyed, tmp_path, monkeypatch
):
    _, ca = keyed
    with pytest.raises(RunRefusedError, match=r"lab dash has no `bus: \{security: mtls\}`") as refusal:
        make_plan(RunOptions(lab=DASH, folder=tmp_path / "run", keys=ca.folder), color=False)
    assert refusal.value.exit_code == ExitCode.USAGE
    monkeypatch.setenv("RMR_KEYS", str(ca.folder))
    assert "--secret" in world_command(make_plan(RunOptions(lab=DASH, folder=tmp_path / "run"), color=False), "tcp/a:1")
