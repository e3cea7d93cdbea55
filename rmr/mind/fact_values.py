"""Values of facts, and what contains them, as msgpack: symbols and robots remain what they are, tuples come back."""

from typing import Any, Final

import msgpack  # type: ignore[import-untyped]

from rmr.base.values import Robot, Symbol

_SYMBOL: Final = 1
_ROBOT: Final = 2


def pack(data: Any) -> bytes:
    """Return `data` (None, values of facts, lists, tuples, dicts with string keys) as octets."""
    packed: bytes = msgpack.packb(data, default=extension, strict_types=True)
    return packed


def unpack(data: bytes) -> Any:
    """Return what `pack` packed, each list and tuple as a tuple. Raises ValueError for other octets."""
    try:
        return msgpack.unpackb(data, ext_hook=of_extension, use_list=False, strict_map_key=False)
    except Exception as error:  # msgpack raises its own and any of the built-in ones
        raise ValueError(f"no msgpack of a mind's log: {error}") from None


def extension(value: Any) -> Any:
    """Return what msgpack writes in place of a value that it does not know. Raises TypeError for any other."""
    if isinstance(value, Symbol):
        return msgpack.ExtType(_SYMBOL, str(value).encode("utf-8", "surrogatepass"))
    if isinstance(value, Robot):
        return msgpack.ExtType(_ROBOT, int(value).to_bytes(8, "little", signed=True))
    if isinstance(value, tuple):
        return list(value)
    raise TypeError(f"a mind's log cannot hold a {type(value).__name__}")


def of_extension(code: int, data: bytes) -> Any:
    """Return the symbol or robot of an extension. Raises ValueError for an unknown one."""
    if code == _SYMBOL:
        return Symbol(data.decode("utf-8", "surrogatepass"))
    if code == _ROBOT:
        return Robot(int.from_bytes(data, "little", signed=True))
    raise ValueError(f"the unknown extension {code}")
