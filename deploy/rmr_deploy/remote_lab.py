"""A lab over several hosts, seen from a machine that need be none of them: `rmr ps --connect ENDPOINT` and other verbs.

It is a client of the bus. Each launcher that takes part in the lab (`host_company`) answers how its own processes are
and has their logs; that of a robot's host carries out an order about it, and that of the world's host ends the lab.
"""

import asyncio
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import inf
from pathlib import Path
from typing import Any

from rmr.bus import wire
from rmr.bus.keys import ANY_LAB, Keys
from rmr.bus.session import Bus
from rmr.entry import ExitCode
from rmr_deploy.disturb import WorldAddress, ask_world, find, keys_of, open_at
from rmr_deploy.event_log import EVENTS_FILE
from rmr_deploy.host_company import GONE_S
from rmr_deploy.run_choice import FleetError, Remote
from rmr_deploy.run_logs import RunLogs
from rmr_deploy.run_requests import RequestError, UnansweredError, Who, read_answer, told_by


@contextmanager
def opened_lab(connect: str, secret: Path | None, lab: str | None, *, acts: bool) -> Iterator[Remote]:
    """Find the lab that runs at the endpoint `connect`, called `lab` if that is said. Raises FleetError.

    `secret` is the file with the secret, or the folder with keys: those of an operator where the verb `acts`.
    """
    place = find(connect, None, secret, lab)
    keys_of(lab)
    with asyncio.Runner() as runner:
        roles = ("operator",) if acts else ("operator", "viewer")
        bus = runner.run(_called(open_at, place, *roles))
        try:
            yield RemoteLab(runner, bus, place, lab)
        finally:
            runner.run(_called(bus.close))


async def _called(function: Any, *arguments: Any) -> Any:
    """Call `function` on the event loop."""
    return function(*arguments)


class RemoteLab:
    """A lab whose launchers are asked on the bus."""

    launched = True
    """Whether the run goes on."""
    launcher = None
    """There is not one on this machine: they are among the processes that are told."""
    processes = ()

    def __init__(self, runner: asyncio.Runner, bus: Bus, place: WorldAddress, lab: str | None) -> None:
        """Ask who is there. Raises FleetError if that is not one lab, or not `lab`."""
        self._runner = runner
        self._bus = bus
        self._place = place
        told = self._asked(Keys(ANY_LAB).look("*"), {"do": "status"})
        labs = sorted({name for name, _ in told})
        if lab is None and len(labs) > 1:
            raise FleetError(f"several labs run at {place.endpoint}: {', '.join(labs)}; choose with --lab")
        if lab is not None and labs and lab not in labs:
            raise FleetError(f"no lab {lab} runs at {place.endpoint}, but {', '.join(labs)}", ExitCode.FAILED)
        if not labs:
            raise FleetError(self._nobody(lab), ExitCode.FAILED)
        self.lab = lab or labs[0]
        self._keys = Keys(self.lab)
        self._heard: dict[str, wire.Launcher] = {}
        """What each launcher said last by itself."""
        answers = {host: answer for (name, host), answer in told.items() if name == self.lab}
        about = next(iter(answers.values()))
        self.hub = str(about["hub"])
        self.shares: dict[str, list[int]] = about["shares"]
        """The robots of each host."""
        self._folders = {host: str(answer["folder"]) for host, answer in answers.items()}
        self._runner.run(_called(bus.subscribe, self._keys.host("*"), self._hear))

    def _nobody(self, lab: str | None) -> str:
        """Return why no launcher answers. Raises FleetError if nobody else does either."""
        question = wire.AskDisturbances("list", None)
        there = self._runner.run(ask_world(self._bus, Keys(lab or ANY_LAB), question, self._place.endpoint))
        return (
            f"lab {there.lab} runs at {self._place.endpoint} without rmr up --hosts, so no launcher answers there; "
            f"on its machine verbs go without --connect, and rmr attach shows it from here"
        )

    @property
    def _hub_is_silent(self) -> str:
        return f"host {self.hub}, which has the world of lab {self.lab}, does not answer at {self._place.endpoint}"

    @property
    def roster(self) -> tuple[int, ...]:
        """The ids of the robots."""
        return tuple(sorted(robot for robots in self.shares.values() for robot in robots))

    def _hear(self, _key: str, message: wire.Envelope) -> None:
        said = message.body
        if isinstance(said, wire.Launcher) and message.sender == wire.OPERATOR_ID:
            self._heard[said.host] = said
            self.launched = self.launched and not (said.host == self.hub and said.state == "over")

    def _asked(self, key: str, request: Mapping[str, Any]) -> dict[tuple[str, str], dict[str, Any]]:
        """Return the answers to a question about the status, by lab and host."""
        return {(str(told.get("lab")), host): told for host, told in self._answers(key, request)}

    def _answers(self, key: str, request: Mapping[str, Any]) -> list[tuple[str, dict[str, Any]]]:
        """Return the hosts that answer, and what they tell. Raises RequestError if one of them refuses."""
        order = wire.HostOrder(json.dumps(request).encode())
        # Three seconds are the limit: after them a router takes a host for cut off. Else an answer takes milliseconds.
        replies = [envelope.body for envelope, _ in self._runner.run(self._bus.ask(key, order, 3.0))]
        return [
            (said.host, told_by(read_answer(said.answer) or {}))
            for said in replies
            if isinstance(said, wire.HostAnswer)
        ]

    def home(self, robot: Who) -> str:
        """Return the host of a robot, of the world or of the router."""
        if isinstance(robot, str):
            return self.hub
        return next(host for host, robots in self.shares.items() if robot in robots)

    def ask(self, request: Mapping[str, Any], _patience_s: float | None = None) -> dict[str, Any]:
        """Have a request carried out or answered by the launcher that it concerns. Raises RequestError, FleetError."""
        if request["do"] == "status":
            return self._status()
        host = self.home(request["robot"])
        key = self._keys.look(host) if request["do"] == "facts" else self._keys.order(host)
        return self._told(host, key, request)

    def _told(self, host: str, key: str, request: Mapping[str, Any]) -> dict[str, Any]:
        answers = self._answers(key, request)
        if not answers:
            raise UnansweredError(f"the launcher of host {host} does not answer at {self._place.endpoint}")
        return answers[0][1]

    def _status(self) -> dict[str, Any]:
        """Return the status of all hosts in the form of that of one. Raises FleetError.

        Of a host that does not answer it has what the world's host knows.
        """
        told = {host: answer for (_, host), answer in self._asked(self._keys.look("*"), {"do": "status"}).items()}
        if self.hub not in told:
            raise FleetError(self._hub_is_silent, ExitCode.FAILED)
        rows: dict[str, list[dict[str, Any]]] = {"processes": [], "robots": []}
        for host in sorted(self.shares, key=lambda host: (host != self.hub, host)):
            teller = told.get(host, told[self.hub])
            for name, word in (("processes", "name"), ("robots", "process")):
                rows[name] += _rows_of(host, teller[name], word, itself=host in told)
        return {**told[self.hub], **rows}

    def usage(self) -> dict[str, tuple[float | None, float | None, float]]:
        """Return what each process of the hosts that answer uses, by its name with the host."""
        told = self._asked(self._keys.look("*"), {"do": "usage"})
        return {
            f"{host}/{name}": tuple(each)
            for (_, host), answer in told.items()
            for name, each in answer["usage"].items()
        }

    def config(self) -> dict[str, Any]:
        """Return the lab as the world's host has it. Raises FleetError."""
        try:
            answers = self._answers(self._keys.look(self.hub), {"do": "config"})
        except RequestError as error:  # a lab that is too long for a message
            raise FleetError(str(error), ExitCode.FAILED) from None
        if not answers:
            raise FleetError(self._hub_is_silent, ExitCode.FAILED)
        return answers[0][1]

    # --- logs

    def logs(self, robots: Sequence[Who], *, events_only: bool) -> list[RunLogs]:
        """Return the logs of each host that takes part in the lab."""
        hosts = sorted(host for host, robots_there in self.shares.items() if robots_there or host == self.hub)
        return [HostLogs(self, host, robots, events_only=events_only) for host in hosts]

    def log(self, host: str, **request: Any) -> dict[str, Any]:
        """Return the sizes of the logs of `host`, or a part of one; empty where it does not answer."""
        answers = self._answers(self._keys.look(host), {"do": "logs", **request})
        return answers[0][1] if answers else {}

    # --- end

    def wait_for_end(self, timeout_s: float | None) -> tuple[bool, str]:
        """Wait until the run is over; return whether it has finished, and a sentence. Raises FleetError."""
        end = time.monotonic() + (inf if timeout_s is None else timeout_s)
        heard_s = time.monotonic()
        while self.launched:
            if time.monotonic() > end:
                raise FleetError(f"lab {self.lab} still runs after {timeout_s:g} s", ExitCode.FAILED)
            if self.hub in self._heard:
                del self._heard[self.hub]
                heard_s = time.monotonic()
            if time.monotonic() - heard_s > GONE_S:
                raise FleetError(f"{self._hub_is_silent}, for {GONE_S:g} s", ExitCode.FAILED)
            self._runner.run(asyncio.sleep(0.05))
        over = self._heard[self.hub]
        report = f"the report is on host {self.hub}, in {over.folder}"
        return over.finished, f"lab {self.lab}: {over.reason}; {report}"

    def bring_down(self, timeout_s: float) -> str:
        """End the lab on all hosts; return a sentence. Raises FleetError."""
        end = time.monotonic() + timeout_s
        answers = self._answers(self._keys.order(self.hub), {"do": "down"})
        if not answers:
            raise FleetError(self._hub_is_silent, ExitCode.FAILED)
        others = self._folders.keys() - {self.hub}
        while self.launched or not all(self._has_left(host) for host in others):
            if time.monotonic() > end or (not self._bus.connected and not self.launched):
                break
            self._runner.run(asyncio.sleep(0.05))
        if self.launched:
            raise FleetError(f"lab {self.lab} has not ended within {timeout_s:g} s", ExitCode.FAILED)
        downs = [self.hub, *sorted(host for host in others if self._has_left(host))]
        silent = sorted(host for host in self.shares if host not in downs and self.shares[host])
        rest = f"; host {', '.join(silent)} has not said so" if silent else ""
        report = f"the report is on host {self.hub}, in {self._folders[self.hub]}"
        return f"lab {self.lab} is down on host {', '.join(downs)}{rest}; {report}"

    def _has_left(self, host: str) -> bool:
        return host in self._heard and self._heard[host].state == "left"


def _rows_of(host: str, rows: list[dict[str, Any]], word: str, *, itself: bool) -> list[dict[str, Any]]:
    """Return the rows about `host`, whose process stands under `word` with its host: as it tells itself, or another."""
    if itself:
        return [{**row, word: f"{host}/{row[word]}"} for row in rows if "/" not in row[word]]
    return [row for row in rows if row[word].startswith(f"{host}/")]


class HostLogs(RunLogs):
    """The logs of one host's part of a run, as its launcher tells them."""

    def __init__(self, lab: RemoteLab, host: str, robots: Sequence[Who], *, events_only: bool) -> None:
        super().__init__(Path(), robots, events_only=events_only)
        self.host = f"{host}/"
        self._lab = lab
        self._ahead_s = 0.0

    @property
    def clock_s(self) -> float:
        """Wall time on the host, as far as its last answer tells."""
        return time.time() + self._ahead_s

    def _new(self) -> Iterator[tuple[Path, bytes]]:
        host = self.host.rstrip("/")
        told = self._lab.log(host)
        if not told:
            return
        self._ahead_s = told["clock_s"] - time.time()
        for name, size in told["files"].items():
            path = Path(name)
            while self._read.get(path, 0) < size and (name == EVENTS_FILE or not self._events_only):
                piece = self._lab.log(host, file=name, begin=self._read.get(path, 0))
                if not piece or piece["end"] == self._read.get(path, 0):
                    break
                self._read[path] = piece["end"]
                yield path, piece["lines"].encode()
