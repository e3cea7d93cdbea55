"""What a run needs before its first process starts: a valid lab, a compiled program, a folder, a port, command lines.

Everything that a person can get wrong is found here, so that nothing has to be stopped because of it: the lab
file and the program are judged as a whole, with every mistake shown, and the lab's own facts and finish
pattern are judged against the program. `RunRefusedError` carries the message and the exit code.
"""

import contextlib
import os
import shutil
import socket
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from rmr.base.file_errors import naming
from rmr.base.ids import spelled
from rmr.base.time import in_seconds
from rmr.bus.certificates import INDEX_FILE, KEYS_VARIABLE, CertificateError, read_certificate
from rmr.bus.endpoint import is_loopback
from rmr.bus.keys import WORLD
from rmr.bus.secret import SECRET_FILE, SecretError, make_secret, read_secret
from rmr.entry import ExitCode
from rmr.entry.files import unreadable
from rmr.record.record_writer import RecordWriter
from rmr.record.recording import PARTS_FOLDER
from rmr.record.run_about import LAUNCHER_PROCESS, about_run
from rmr.record.run_files import attach_files
from rmr_deploy.active_runs import OPERATOR_KEYS
from rmr_deploy.host_share import HostShare, ShareError, share_of
from rmr_deploy.resolved_lab import write_lab
from rmr_deploy.run_options import RunOptions
from rmr_deploy.sign import signed
from rmr_world.finding import LabError
from rmr_world.lab import Lab, ProgramLoad
from rmr_world.lab_file import lab_path, load_lab, radio_key
from rmr_world.lab_program import (
    LoadedProgram,
    ProgramError,
    later_programs,
    load_handlers,
    load_lab_program,
    validated,
)
from rmr_world.run_folder import RunFolderError, make_run_folder


class RunRefusedError(Exception):
    """The run cannot begin: why, for people, and the exit code."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


STATES_FOLDER: Final = "state"
"""Folder in the run folder with a folder for the state of each robot and of the world, where these are durable."""


@dataclass(frozen=True, slots=True)
class RunPlan:
    """Everything about a run that is fixed before it begins."""

    options: RunOptions
    lab: Lab
    """With the run's seed and robots."""
    program: LoadedProgram
    """The same for every robot."""
    folder: Path
    """The run folder: report.json, logs/, the compiled program."""
    loads: tuple[tuple[ProgramLoad, LoadedProgram], ...] = ()
    """The programs that robots get while they run."""
    share: HostShare | None = None
    """What this host does for a lab over several; None: it does all."""

    @property
    def robots(self) -> tuple[int, ...]:
        """The robots whose processes are started here."""
        return self.lab.roster if self.share is None else self.share.here.robots

    @property
    def has_world(self) -> bool:
        """Whether the world is started here, and with it the end of the run is decided."""
        return self.share is None or self.share.has_world

    @property
    def about(self) -> dict[str, Any]:
        """What the record of the run's processes says of its lab."""
        lab = self.lab
        about = {"name": lab.name, "file": str(lab.path.resolve()), "robots": len(lab.robots), "seed": lab.seed}
        return about | {"roster": list(lab.roster)}

    @property
    def byte_code(self) -> Path:
        """The compiled program's file."""
        return self.folder / f"{self.lab.program.stem}.rbc"

    @property
    def secret(self) -> Path:
        """The file with the secret of the run's bus, or the launcher's keys: there until the run is over."""
        return self.folder / (SECRET_FILE if self.options.keys is None else OPERATOR_KEYS)

    @property
    def credentials(self) -> Path | None:
        """`secret`, or None where everybody is let in."""
        return None if self.share is not None and self.share.opened else self.secret

    def admission(self, process: str) -> list[str]:
        """Return the words of the command of `process` by which it is let in."""
        if self.credentials is None:
            return []
        if self.options.keys is None:
            return ["--secret", str(self.secret)]
        return ["--keys", str((self.secret.parent / process).absolute())]

    def forget_secret(self) -> None:
        """Remove what lets processes in, and leave nothing of it."""
        if self.options.keys is None:
            self.secret.unlink(missing_ok=True)
        else:
            shutil.rmtree(self.secret.parent, ignore_errors=True)

    @property
    def logs(self) -> Path:
        """The folder of the logs, one JSON-lines file per process."""
        return self.folder / "logs"

    def state(self, robots: Sequence[int] = ()) -> list[str]:
        """Return the words of a process's command by which its `robots`, or the world, are durable, if they are."""
        if not self.options.durable:
            return []
        states = self.folder / STATES_FOLDER
        return ["--state", str(states if len(robots) > 1 else states / (str(robots[0]) if robots else WORLD))]

    def part(self, process: str) -> Path | None:
        """Return the file in which `process` records its part of the run; None if nothing is recorded."""
        return None if self.options.no_record else self.folder / PARTS_FOLDER / f"{process}.mcap"

    @property
    def process_robots(self) -> list[tuple[int, ...]]:
        """The robots of each process, in the order of the roster."""
        roster = self.robots
        count = min(self.options.processes or len(roster), len(roster))
        return [roster[i * len(roster) // count : (i + 1) * len(roster) // count] for i in range(count)]

    @property
    def duration_s(self) -> float:
        """Lab seconds after which the run is over, finished or not."""
        return in_seconds(self.lab.duration)


def make_plan(options: RunOptions, *, color: bool) -> RunPlan:
    """Return the plan of a run and make its folder. Raises RunRefusedError."""
    if missing := unreadable((lab_path(options.lab), options.actions)):
        raise RunRefusedError("\n".join(f"rmr up: {line}" for line in missing), ExitCode.USAGE)
    lab = read_lab(options.lab, options.robots)
    if options.seed is not None:
        lab = replace(lab, seed=options.seed)
    options = replace(options, keys=_keys(lab, options))
    try:
        share = share_of(lab, options)
    except ShareError as error:
        raise RunRefusedError(str(error), error.exit_code) from error
    program = read_program(lab, color=color)
    try:
        options = replace(options, actions=options.actions or lab.actions)
        load_handlers(program.program, options.actions, lab.performs)
        loads = later_programs(lab, durable=options.durable) if share is None or share.has_world else ()
    except ProgramError as error:
        raise RunRefusedError(str(error), ExitCode.INVALID) from error
    try:
        plan = RunPlan(options, lab, program, make_run_folder(lab.name, options.folder), loads, share)
    except RunFolderError as error:
        raise RunRefusedError(str(error), ExitCode.USAGE) from error
    try:
        _keep_private(plan)
        plan = _signed(plan)
        plan.logs.mkdir()
        with naming(plan.byte_code):
            plan.byte_code.write_bytes(plan.program.octets)
        write_lab(plan.lab, plan.folder)
        _begin_recording(plan)
    except OSError as error:
        plan.forget_secret()
        message = f"{error.filename}: {error.strerror}; name a run folder that can be written with --run DIR"
        raise RunRefusedError(message, ExitCode.USAGE) from error
    return plan


def _begin_recording(plan: RunPlan) -> None:
    """Make the folder of the processes' recordings, with a file that holds what the run was made of. Raises OSError."""
    file = plan.part(LAUNCHER_PROCESS)
    if file is None:
        return
    if plan.options.record is not None:
        plan.options.record.open("ab").close()  # what cannot be written is told before the run
    file.parent.mkdir()
    if not plan.has_world:
        return  # a recording has it once, from the world's host
    lab = plan.lab
    writer = RecordWriter(file, about_run(lab.name, "processes", lab.seed, lab.roster, LAUNCHER_PROCESS))
    attach_files(writer, lab.arena, plan.program.octets, lab.path, lab.program, plan.options.actions)
    writer.close()


def _keep_private(plan: RunPlan) -> None:
    """Close the run folder to other users and put the secret of the run's bus into it.

    Raises RunRefusedError, OSError.
    """
    with contextlib.suppress(PermissionError):  # another user's folder that we may write to: the file is ours
        plan.folder.chmod(0o700)
    if plan.options.keys is not None:
        _hand_out_keys(plan, plan.options.keys)
        return
    if plan.credentials is None:
        assert plan.share is not None
        if plan.has_world and not is_loopback(plan.share.listen):
            where = plan.share.hub.endpoint(plan.share.protocol)
            print(f"rmr up: open: whoever reaches {where} can drive the robots and end the run", file=sys.stderr)
        return
    if plan.options.secret is not None:
        _take_secret(plan, plan.options.secret)
        return
    make_secret(plan.secret)
    try:
        read_secret(plan.secret)
    except SecretError as error:
        plan.secret.unlink()
        message = f"{plan.folder}: no file in it can be kept from other users; name another run folder with --run DIR"
        raise RunRefusedError(message, ExitCode.USAGE) from error


def _take_secret(plan: RunPlan, file: Path) -> None:
    """Copy the secret that all hosts share into the run folder; that of the world's host is made if need be.

    Raises RunRefusedError, OSError.
    """
    try:
        if plan.has_world and not file.exists():
            make_secret(file)
            print(f"made a new secret: {file}; copy it to the other hosts", file=sys.stderr)
        secret = read_secret(file)
        make_secret(plan.secret)
        plan.secret.write_text(f"{secret.user}:{secret.password}\n")
    except SecretError as error:
        plan.secret.unlink(missing_ok=True)
        raise RunRefusedError(str(error), ExitCode.INVALID) from error


def _signed(plan: RunPlan) -> RunPlan:
    """Return `plan` with its program signed by the operator, if its robots have keys. Raises RunRefusedError."""
    if plan.options.keys is None:
        return plan
    try:
        octets = signed(plan.program.octets, plan.secret)
    except CertificateError as error:
        plan.forget_secret()
        raise RunRefusedError(str(error), ExitCode.INVALID) from None
    return replace(plan, program=replace(plan.program, octets=octets))


def _keys(lab: Lab, options: RunOptions) -> Path | None:
    """Return the folder of the CA, None for a lab that has a secret. Raises RunRefusedError."""
    if not lab.mtls:
        if options.keys is not None:
            message = (
                f"rmr up: lab {lab.name} has no `bus: {{security: mtls}}`: leave --keys out, or add that to its file"
            )
            raise RunRefusedError(message, ExitCode.USAGE)
        return None
    told = os.environ.get(KEYS_VARIABLE)
    if options.keys is None and not told:
        message = f"lab {lab.name} has `security: mtls`: name the folder of its CA (rmr keys init) with --keys"
        message += ", or of this host's keys" if options.here is not None else ""
        raise RunRefusedError(message, ExitCode.INVALID)
    return options.keys or Path(told or "")


def _hand_out_keys(plan: RunPlan, ca: Path) -> None:
    """Write the keys of each process into the run folder. Raises RunRefusedError, OSError."""
    from rmr.bus.authority import Authority, write_bundle  # noqa: PLC0415 - heavy, and used with keys alone

    folder = plan.secret.parent
    try:
        if plan.share is not None and not (ca / INDEX_FILE).exists():
            _copy_keys(plan, ca)
            return
        authority = Authority(ca)
        names = {plan.secret.name: authority.good("operator")}
        names |= {"world": authority.good("world")} if plan.has_world else {}
        names |= {f"robots-{spelled(ids)}": authority.good("robot", ids) for ids in plan.process_robots}
        folder.mkdir(0o700)
        for name, who in names.items():
            write_bundle(authority.bundle(who), folder / name)
            read_certificate(folder / name)
    except CertificateError as error:
        plan.forget_secret()
        raise RunRefusedError(str(error), ExitCode.INVALID) from None


def _copy_keys(plan: RunPlan, given: Path) -> None:
    """Copy the bundles in `given` into the run folder: a host needs no CA. Raises CertificateError, OSError."""
    folder = plan.secret.parent
    folder.mkdir(0o700)
    wanted: list[tuple[str, str, tuple[int, ...]]] = [("operator", "operator", ())]
    wanted += [("world", "world", ())] if plan.has_world else []
    wanted += [(f"robot-{spelled(ids)}", f"robots-{spelled(ids)}", ids) for ids in plan.process_robots]
    for source, name, robots in wanted:
        if not (given / source).is_dir():
            who = f"robot/{spelled(robots)}" if robots else "operator/NAME" if source == "operator" else source
            get = f"rmr keys bundle CA {who} -o {source}"
            raise CertificateError(f"{given / source}: no such folder; where the CA is: {get}; then copy it here")
        read_certificate(given / source).check_role(source.partition("-")[0], robots=robots)
        shutil.copytree(given / source, folder / name)


def read_program(lab: Lab, *, color: bool) -> LoadedProgram:
    """Return the lab's program, judged by itself and against the lab. Raises RunRefusedError."""
    try:
        return validated(lab, load_lab_program(lab, color=color))
    except (LabError, ProgramError) as error:
        raise RunRefusedError(str(error), ExitCode.INVALID) from error


def read_lab(path: Path, robots: int | None) -> Lab:
    """Return the valid lab in `path`, with its first `robots` robots. Raises RunRefusedError."""
    try:
        lab = load_lab(path)
        radio_key(lab)  # the robots will read it: here it is only judged
        return lab if robots is None else lab.with_robots(robots)
    except LabError as error:
        raise RunRefusedError(str(error), ExitCode.INVALID) from error
    except OSError as error:
        raise RunRefusedError(f"{error.filename or path}: {error.strerror}", ExitCode.INVALID) from error


def free_port() -> int:
    """Return a loopback port that is free now. Another process may take it first: the world then says so."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def endpoint_of(plan: RunPlan) -> str:
    """Return where the processes of a run find each other: at a new endpoint of loopback, or that of the hosts."""
    if plan.share is not None:
        return plan.share.connect
    return f"{'tcp' if plan.options.keys is None else 'tls'}/127.0.0.1:{free_port()}"


def router_command(plan: RunPlan, share: HostShare) -> list[str]:
    """Return the command that starts the router of a lab over several hosts, under the keys of its world."""
    opened = ["--open"] if plan.credentials is None and not is_loopback(share.listen) else []
    return [*python("rmr_deploy.router"), "--listen", share.listen, *opened, *plan.admission(WORLD)]


def world_command(plan: RunPlan, endpoint: str) -> list[str]:
    """Return the command that starts the world: on one machine it is the router, too."""
    lab = plan.lab
    end = ["--listen" if plan.share is None else "--connect", endpoint]
    options = [*end, "--seed", str(lab.seed), "--robots", str(len(lab.robots)), "--when-ready"]
    options += ["--ros2"] if plan.options.ros2 else []
    return [*python("rmr_world.main"), "--config", str(lab.path), *options, *plan.state(), *plan.admission(WORLD)]


def agent_command(plan: RunPlan, robots: Sequence[int], endpoint: str) -> list[str]:
    """Return the command that starts the process of the robots `robots`."""
    actions = ["--actions", str(plan.options.actions)] if plan.options.actions else []
    files = (["--radio-key", str(plan.lab.key_file)] if plan.lab.key_file else []) + plan.state(robots)
    options = ["--id", spelled(robots), "--connect", endpoint, "--lab", plan.lab.name, *actions, *files]
    return [*python("rmr_agent.main"), *options, *plan.admission(f"robots-{spelled(robots)}"), str(plan.byte_code)]


def python(module: str) -> list[str]:
    """Return the command that runs `module` with this interpreter; -P: without the current folder in its path."""
    return [sys.executable, "-P", "-m", module]
