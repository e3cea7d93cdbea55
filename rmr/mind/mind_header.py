"""The header of a mind's log: all that makes the node anew, and what its replay depends on.

It is a dict of plain values (msgpack, `fact_values`). The program itself is not in it, but its digest: a recording
holds the byte-code once for all robots.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields
from typing import Any, Final

from rmr.base import arena
from rmr.base.record import record
from rmr.bytecode.program import ANY, Anything, Constant
from rmr.coord.timing import ClaimTiming, ElectionTiming, LivenessTiming, Order, ScheduleTiming, Timing
from rmr.mind.fact_values import pack, unpack
from rmr.mind.mind_versions import is_compiled, versions
from rmr.node.actions.dispatcher import Handler
from rmr.node.config import FinishPattern, NodeConfig
from rmr.node.trace import TraceLevel
from rmr.radio.phy import Bursts, RadioConfig
from rmr.vm.engines import Engine

_GROUPS: Final = {
    "election": ElectionTiming,
    "schedule": ScheduleTiming,
    "claim": ClaimTiming,
    "liveness": LivenessTiming,
}


async def never_called(*_: Any) -> None:
    """Stand in for a user's handler, whose code a header does not have."""
    raise AssertionError("the handler of a header is not called")


@record
class MindHeader:
    """One incarnation of one robot."""

    config: NodeConfig
    program: int
    """Digest of the byte-code (`rmr.bytecode.codec.digest`)."""
    payload_max: int
    """Octets of payload that a frame held."""
    bodily: bool
    """Whether the robot had a body."""
    timed: bool
    """Whether the host measured processor time."""
    neighbors: bool
    """Whether the host offered who is in range."""
    witnessed: bool
    """Whether somebody was told what happened in the robot, and might insert facts."""
    actions: tuple[Handler, ...]
    """The handlers of users, with `never_called` for what they run."""
    versions: dict[str, str]
    compiled: bool


def encode_header(
    config: NodeConfig,
    program: int,
    handlers: Mapping[str, Handler],
    *,
    payload_max: int,
    bodily: bool,
    timed: bool,
    neighbors: bool,
    witnessed: bool,
) -> bytes:
    """Return the header of a node with this configuration."""
    return pack(
        {
            "config": _config(config),
            "program": program,
            "payload_max": payload_max,
            "bodily": bodily,
            "timed": timed,
            "neighbors": neighbors,
            "witnessed": witnessed,
            "actions": [
                [
                    name,
                    handler.effect,
                    handler.wheels,
                    handler.takes_over,
                    handler.at_once,
                    handler.to_area,
                    handler.takes,
                ]
                for name, handler in sorted(handlers.items())
            ],
            "versions": versions(),
            "compiled": is_compiled(),
        }
    )


def decode_header(data: bytes) -> MindHeader:
    """Return the header in `data`. Raises ValueError if it is none."""
    found = unpack(data)
    try:
        return MindHeader(
            config=_as_config(found["config"]),
            program=found["program"],
            payload_max=found["payload_max"],
            bodily=found["bodily"],
            timed=found["timed"],
            neighbors=found["neighbors"],
            witnessed=found["witnessed"],
            actions=tuple(Handler(name, never_called, *traits) for name, *traits in found["actions"]),
            versions=dict(found["versions"]),
            compiled=found["compiled"],
        )
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise ValueError(f"no header of a mind's log: {error}") from None


def _config(config: NodeConfig) -> dict[str, Any]:
    """Return `config` without its callbacks, as plain values; facts of other robots are left out."""
    return {
        "robot": config.robot,
        "roster": list(config.roster),
        "arena": arena.to_data(config.arena),
        "seed": config.seed,
        "radio": asdict(config.radio),
        "facts": [fact for fact in config.facts if fact[1] in (None, config.robot)],
        "finish": None if config.finish is None else _finish(config.finish),
        "epoch": config.epoch,
        "predecessor_ended": config.predecessor_ended,
        "phase": config.phase,
        "trace": int(config.trace),
        "engine": config.engine.value,
        "turn": config.turn,
        "timing": None if config.timing == Timing() else _timing(config.timing),
        "without": sorted(config.without),
        **({"navigates": True} if config.navigates else {}),
    }


def _as_config(data: Mapping[str, Any]) -> NodeConfig:
    radio = dict(data["radio"])
    if radio["bursts"] is not None:
        radio["bursts"] = Bursts(**radio["bursts"])
    roster: Iterable[int] = data["roster"]
    return NodeConfig(
        robot=data["robot"],
        roster=dict.fromkeys(roster),
        arena=arena.from_data(data["arena"]),
        seed=data["seed"],
        radio=RadioConfig(**radio),
        facts=tuple((name, owner, args) for name, owner, args in data["facts"]),
        finish=None if data["finish"] is None else _as_finish(data["finish"]),
        epoch=data["epoch"],
        predecessor_ended=data.get("predecessor_ended"),  # a log of an older version has none, and is told as such
        phase=data["phase"],
        trace=TraceLevel(data["trace"]),
        engine=Engine(data["engine"]),
        turn=data["turn"],
        timing=Timing() if data["timing"] is None else _as_timing(data["timing"]),
        navigates=data.get("navigates", False),  # as above
        without=frozenset(data["without"]),
    )


def _finish(finish: FinishPattern) -> list[Any]:
    """Return the pattern with each constant in a list of its own, and None for what matches anything."""
    name, patterns = finish
    return [name, [None if isinstance(each, Anything) else [each.value] for each in patterns]]


def _as_finish(data: Any) -> FinishPattern:
    name, patterns = data
    return name, tuple(ANY if each is None else Constant(each[0]) for each in patterns)


def _timing(timing: Timing) -> dict[str, Any]:
    data: dict[str, Any] = {field.name: getattr(timing, field.name) for field in fields(timing)}
    groups = {name: asdict(data[name]) for name in _GROUPS}
    return data | groups | {"order": timing.order.value}


def _as_timing(data: Mapping[str, Any]) -> Timing:
    groups: dict[str, Any] = {name: made(**data[name]) for name, made in _GROUPS.items()}
    return Timing(**{**data, **groups, "order": Order(data["order"])})
