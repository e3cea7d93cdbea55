"""`robot.state` of a durable robot, kept over restarts.

After each activation of a handler, the dict is packed. If it differs from what was packed last, it is logged as a step
of the handler (`action_steps.STATE`) before the step at the activation's end. A replay, which does not execute the
handler, takes it from there. What a handler changes between two activations (in a condition that is not true) is logged
at the next one.

The form is msgpack, with the values of the language and tuples as extensions: lists stay lists, and tuples tuples.
Other types are refused, as their classes may not be there, or may be others, when the robot is started again.

This module is never compiled, like the modules of handlers (`rmr.node.actions.handle`).
"""

from collections.abc import Awaitable, Callable
from typing import Any, Final

import msgpack  # type: ignore[import-untyped]

from rmr.base.values import Robot, Symbol
from rmr.mind import action_steps as steps
from rmr.mind import fact_values
from rmr.mind.recorded_actions import StepLog
from rmr.node.actions.handle import ActionFailed

STATE_OCTETS_MAX: Final = 1 << 16
"""Longest packed state: it is written whole at each change, and a write is to take less than a millisecond."""
_TUPLE: Final = 3
"""An extension beside those of `fact_values`: a state comes back with its tuples and its lists."""
_PLAIN: Final = (type(None), bool, int, float, str, bytes, list, dict)
_EMPTY: Final = b"\x80"


class UnkeptError(ValueError):
    """A value cannot be kept; the message says which one."""


def pack_state(state: dict[Any, Any]) -> bytes:
    """Return the octets of `state`. Raises UnkeptError for a value that cannot be kept."""
    for key, value in state.items():
        _check(value, f"robot.state[{key!r}]")
        if type(key) not in (str, int, Symbol, Robot):
            raise UnkeptError(f"robot.state has the key {key!r}, a {type(key).__name__}; keys are strings or integers")
    try:
        packed: bytes = msgpack.packb(state, default=_extension, strict_types=True)
    except (OverflowError, ValueError) as error:
        raise UnkeptError(f"robot.state cannot be kept: {error}") from None
    if len(packed) > STATE_OCTETS_MAX:
        raise UnkeptError(f"robot.state has {len(packed)} octets; at most {STATE_OCTETS_MAX} can be kept")
    return packed


def _check(value: Any, where: str, depth: int = 0) -> None:
    kind = type(value)
    if depth > 100:
        raise UnkeptError(f"{where[:80]}... is nested too deeply to be kept")
    if kind in (list, tuple):
        for place, item in enumerate(value):
            _check(item, f"{where}[{place}]", depth + 1)
    elif kind is dict:
        for key, item in value.items():
            _check(key, f"a key of {where}", depth + 1)
            _check(item, f"{where}[{key!r}]", depth + 1)
    elif kind not in _PLAIN and kind not in (Symbol, Robot):
        raise UnkeptError(
            f"{where} holds a {kind.__name__}, which a durable robot cannot keep; it keeps None, bool, int, float, "
            "str, bytes, lists, tuples and dicts"
        )


def unpack_state(data: bytes) -> dict[Any, Any]:
    """Return the state that `pack_state` has packed."""
    state: dict[Any, Any] = msgpack.unpackb(data, ext_hook=_of_extension, strict_map_key=False)
    return state


def replace_state(state: dict[Any, Any], data: bytes) -> None:
    """Make `state` what `pack_state` has packed."""
    state.clear()
    state.update(unpack_state(data))


def _extension(value: Any) -> Any:
    if isinstance(value, tuple):
        return msgpack.ExtType(_TUPLE, msgpack.packb(list(value), default=_extension, strict_types=True))
    return fact_values.extension(value)


def _of_extension(code: int, data: bytes) -> Any:
    if code == _TUPLE:
        return tuple(msgpack.unpackb(data, ext_hook=_of_extension, strict_map_key=False))
    return fact_values.of_extension(code, data)


class StateKeeper:
    """Logs the state of one robot where a handler has changed it."""

    def __init__(self) -> None:
        self._packed = _EMPTY

    def log(self, state: dict[str, Any], log: StepLog) -> None:
        """Log `state` if it has changed. Raises ActionFailed if it holds what cannot be kept."""
        if not state and self._packed == _EMPTY:
            return
        try:
            packed = pack_state(state)
        except UnkeptError as error:
            raise ActionFailed(str(error)) from None
        if packed != self._packed:
            self._packed = packed
            log.add(steps.STATE, packed)

    def go_on(self, state: dict[str, Any]) -> None:
        """Take `state` for logged: it came from the log."""
        self._packed = pack_state(state)


class KeptRun:
    """A handler's awaitable whose robot's state is logged after each activation."""

    def __init__(self, begun: Awaitable[None], keep: Callable[[], None]) -> None:
        self._coroutine = begun.__await__()
        self._keep = keep

    def __await__(self) -> Any:
        return self

    def __next__(self) -> object:
        try:
            awaited = next(self._coroutine)
        except StopIteration:
            self._keep()
            raise
        except ActionFailed:
            self._keep()
            raise
        except BaseException:
            self._keep_quietly()
            raise
        self._keep()
        return awaited

    def close(self) -> None:
        """Break the handler off."""
        try:
            self._coroutine.close()
        finally:
            self._keep_quietly()

    def _keep_quietly(self) -> None:
        """Keep the state where another failure is told already."""
        try:
            self._keep()
        except ActionFailed:
            return
