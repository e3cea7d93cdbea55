"""The settings of a robot process, and the security of its frames.

The level of security is the lab's, which the world sends, and the key is in files only. Lab and robot must agree. A
robot without a key in a secured lab would receive nothing. A robot with a key in a lab that is announced as open may be
the target of a downgrade attack. Neither starts.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from rmr.bus import wire
from rmr.node.actions.dispatcher import Handler
from rmr.radio.security import LEVELS, UNSECURED, Security, run_key
from rmr_agent.bytecode import Loaded, RefusedError
from rmr_agent.state_folder import StateFolder


class RobotSetup(NamedTuple):
    """The settings of a robot process; everything else comes from its world."""

    loaded: Loaded
    """Without octets: the robots wait for their first program."""
    fresh: Callable[[], dict[str, Handler]]
    """Returns handlers for one incarnation of one robot, which has the globals of the user's file to itself."""
    key: bytes | None
    """Of the radio; None where the lab's is open."""
    states: Mapping[int, StateFolder] = MappingProxyType({})
    """The folders of the robots that are durable."""


def make_security(robot: int, known: wire.Map, run: int, key: bytes | None) -> Security | None:
    """Return the security of `robot` in the run that `known` describes; None in an open lab. Raises RefusedError."""
    name = known.radio.get("security", UNSECURED)
    if not isinstance(name, str) or name not in LEVELS:
        raise RefusedError(f"its radio is secured in a way that this robot does not know ({name!r})")
    level = LEVELS[name]
    if level is None and key is None:
        return None
    if key is None:
        raise RefusedError(f"its radio is secured ({name}): start the robot with --radio-key and the file of its key")
    if level is None:
        raise RefusedError("its radio is not secured: start the robot without --radio-key, or give the lab a key_file")
    try:
        return Security(level, run_key(key, "robots", known.lab, run), robot, known.lives)
    except ValueError as error:
        raise RefusedError(f"robot {robot}: {error}") from None
