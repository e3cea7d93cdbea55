"""Handlers of users in a replay: they are not executed; what they did to their robot is done again from the log."""

from collections.abc import Iterable

from rmr.mind.mind_header import UserAction
from rmr.mind.replay_feed import ReplayFeed
from rmr.node.actions.dispatcher import Handler


def replayed_handlers(actions: Iterable[UserAction], feed: ReplayFeed) -> dict[str, Handler]:
    """Return a handler for each of `actions` whose steps come from `feed`."""
    return {}
