"""The settings of a robot process."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from rmr.node.actions.dispatcher import Handler
from rmr_agent.bytecode import Loaded
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
