"""What the launchers of one lab over several hosts tell each other, on the bus: `rmr.bus.wire.Launcher`.

Each says once a second how its own robots are. That of the world's host judges the run by it: it alone says that the
run is over. The others compare their lab with its before they start a robot, and end when it says so. A host that is
cut off is silent for a while and comes back; who is silent for `GONE_S` is taken for gone.
"""

import json
import time
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from rmr.base.ids import named
from rmr.bus import wire
from rmr.bus.keys import Keys
from rmr.bus.session import Bus
from rmr_deploy.host_share import HostShare, difference, made_of
from rmr_deploy.preparation import RunPlan
from rmr_deploy.run_outcome import Befell, read_befell
from rmr_deploy.run_requests import Answer, read_answer
from rmr_world.quorum import DIED, STOPPED, Fate

TELL_S: Final = 1.0
"""Period of what a launcher tells of itself."""

SILENT_S: Final = 5.0
"""Silence of a host after which it is said."""

GONE_S: Final = 60.0
"""Silence of a host after which it is taken for gone: cables are back in less, and robots find their world again."""

ANSWER_S: Final = 2.0
"""Limit for the answer of another host to an order, which takes twice that at worst: a command waits for 5 s."""

TEXT_MAX: Final = 400
"""Characters of a reason or a folder that are told."""


class _Heard(NamedTuple):
    """What a launcher said last."""

    said: wire.Launcher
    run: int
    """The number of its session."""
    at: float
    """When, monotonic seconds."""


class HostCompany:
    """The launchers of the hosts of one lab, as that of one host hears them."""

    def __init__(
        self,
        plan: RunPlan,
        share: HostShare,
        bus: Bus,
        perform: Callable[[Mapping[str, Any]], Answer | None],
        look: Callable[[Mapping[str, Any]], Answer | None],
    ) -> None:
        """`perform` carries out an order about an own robot, `look` answers a question; None: it is another's affair.

        Raises OSError if a file that all hosts must have alike cannot be read."""
        self._plan = plan
        self._share = share
        self._bus = bus
        self._keys = Keys(plan.lab.name)
        self._shares = {host.name: host.robots for host in share.hosts}
        self._made_of = made_of(plan.lab, plan.program.digest, plan.options.actions)
        self._heard: dict[str, _Heard] = {}
        self._told = wire.Launcher(share.here.name, "waiting", (), (), (), "", False, "", b"")
        self._told_s = 0.0
        self._twin = False
        self._began = time.monotonic()
        self.folders: dict[str, list[str]] = {}
        """The run folders of the other hosts that were heard of."""
        self.befell: dict[tuple[str, int], Befell] = {}
        """What befell their robots, by host and the number of the session of its launcher."""
        bus.subscribe(self._keys.host("*"), self._hear)
        bus.serve(self._keys.order(share.here.name), lambda order, _: self._answer(order, perform))
        bus.serve(self._keys.look(share.here.name), lambda order, _: self._answer(order, look))

    # --- orders and questions ------------------------------------------------------------------------------

    async def order(self, host: str, request: Mapping[str, Any]) -> str:
        """Have the launcher of `host` carry out a request; return why it was refused, empty if it was not."""
        if not self._is_there(host):
            return f"host {host} is not there"
        order = wire.HostOrder(json.dumps(dict(request)).encode())
        for reply, _ in await self._bus.ask(self._keys.order(host), order, ANSWER_S):
            if isinstance(reply.body, wire.HostAnswer):
                return str((read_answer(reply.body.answer) or {}).get("refused", ""))
        return f"host {host} does not answer: whether it was carried out is not known"

    def _answer(
        self, message: wire.Envelope, carry_out: Callable[[Mapping[str, Any]], Answer | None]
    ) -> wire.HostAnswer | None:
        """Return the answer to an order or a question; None where it is no affair of this launcher."""
        if message.sender != wire.OPERATOR_ID or not isinstance(message.body, wire.HostOrder):
            return None
        try:
            request = json.loads(message.body.request)
        except (ValueError, RecursionError):
            return None
        answer = carry_out(request) if isinstance(request, dict) else None
        if answer is None:
            return None
        octets = json.dumps({"refused": answer} if isinstance(answer, str) else {"told": answer}).encode()
        if len(octets) > wire.MESSAGE_OCTETS_MAX // 2:
            octets = json.dumps(
                {"refused": f"host {self._share.here.name} has more to tell than fits an answer"}
            ).encode()
        return wire.HostAnswer(self._share.here.name, octets)

    # --- what is told ----------------------------------------------------------------------------------------

    def tell(
        self,
        state: str,
        gone: Mapping[int, str] | None = None,
        *,
        finished: bool = False,
        reason: str = "",
        befell: bytes = b"",
    ) -> None:
        """Tell how this host is, if that is news or was told `TELL_S` ago.

        `gone` are robots that are not there, each with one of `wire.ENDS`.
        """
        news = wire.Launcher(
            self._share.here.name,
            state,
            tuple(self._shares.items()),
            self._made_of,
            tuple((gone or {}).items()),
            str(self._plan.folder.absolute())[:TEXT_MAX],
            finished,
            reason[:TEXT_MAX],
            befell,
        )
        if news != self._told or time.monotonic() - self._told_s >= TELL_S:
            self._told = news
            self._told_s = time.monotonic()
            self._bus.publish(self._keys.host(self._share.here.name), news)

    def _hear(self, _key: str, message: wire.Envelope) -> None:
        said = message.body
        if message.sender != wire.OPERATOR_ID or not isinstance(said, wire.Launcher) or said.host not in self._shares:
            return
        if said.host == self._share.here.name:
            self._twin |= message.run != self._bus.run and said.state != "left"
            return
        before = self._heard.get(said.host)
        if before is not None and before.run != message.run and self._lives(before):
            return  # a second one in the name of a host is about to be refused
        self.befell[said.host, message.run] = read_befell(said.befell)
        self._heard[said.host] = _Heard(said, message.run, time.monotonic())
        if said.folder not in (known := self.folders.setdefault(said.host, [])):
            known.append(said.folder)

    @staticmethod
    def _lives(heard: _Heard, within_s: float = SILENT_S) -> bool:
        """Whether a launcher has been heard within this time, and has not left."""
        return heard.said.state != "left" and time.monotonic() - heard.at < within_s

    # --- what is heard ---------------------------------------------------------------------------------------

    @property
    def hub(self) -> wire.Launcher | None:
        """What the launcher of the world's host said last; None before."""
        heard = self._heard.get(self._share.hub.name)
        return None if heard is None else heard.said

    @property
    def hub_silent_s(self) -> float:
        """How long ago the launcher of the world's host was heard last, in seconds; 0 before the first time."""
        heard = self._heard.get(self._share.hub.name)
        return 0.0 if heard is None else time.monotonic() - heard.at

    @property
    def is_twin(self) -> bool:
        """Whether another launcher takes part as this host already."""
        return self._twin

    def refusal(self) -> str:
        """Return why this host cannot take part; empty if it can, or if that is not known yet."""
        here = self._share.here.name
        if self._twin:
            return f"host {here} takes part already: another rmr up --here {here} runs"
        if self._share.has_world or self.hub is None:
            return ""
        theirs = dict(self.hub.shares)
        return difference(self._made_of, self.hub.made_of, self._shares, theirs, here, self._share.hub.name)

    @property
    def settled(self) -> bool:
        """Whether this host may start its robots: the world's host was heard, and a twin would have been."""
        return self.hub is not None and time.monotonic() - self._began > 1.2 * TELL_S

    def missing(self) -> list[str]:
        """Return the hosts with robots whose launchers are not there, with these robots."""
        return [
            f"{name} ({named(robots)})"
            for name, robots in self._shares.items()
            if robots and name != self._share.here.name and not self._is_there(name)
        ]

    def silent(self) -> list[str]:
        """Return the hosts that have been silent for a while, and have not said that they leave."""
        now = time.monotonic()
        return [name for name, heard in self._heard.items() if heard.said.state != "left" and now - heard.at > SILENT_S]

    def _is_there(self, name: str) -> bool:
        heard = self._heard.get(name)
        return heard is not None and self._lives(heard, GONE_S)

    def staying(self) -> list[str]:
        """Return the other hosts that were heard of just now, and have not left."""
        return [name for name, heard in self._heard.items() if self._lives(heard)]

    def lost(self, *, started: bool) -> dict[int, Fate]:
        """Return what became of the robots of other hosts that are not there and will not be.

        Until the run has `started` a host that has gone is only missing: it may come again.
        """
        lost: dict[int, Fate] = {}
        for name, heard in self._heard.items():
            robots = self._shares[name]
            if not self._is_there(name):
                if not started:
                    continue
                lost |= dict.fromkeys(robots, STOPPED if heard.said.state == "left" else DIED)
            lost |= {robot: STOPPED if end == STOPPED else DIED for robot, end in heard.said.gone if robot in robots}
        return lost

    def killed(self) -> set[int]:
        """Return the robots of other hosts that were killed by a person or a fault of the lab: the run goes on."""
        said = [heard.said for heard in self._heard.values()]
        return {robot for one in said for robot, end in one.gone if end == "killed"}

    def reasons(self) -> dict[str, str]:
        """Return the hosts that have left, and why."""
        return {name: heard.said.reason for name, heard in self._heard.items() if heard.said.state == "left"}
