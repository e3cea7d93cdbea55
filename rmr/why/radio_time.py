"""The time of a delivery on its way: radio queue, channel access, repeats, and the receiver's tick.

With the frames on the air (`/frames` of a recording) each transmission is known. Without them the instants at which the
sender handed the delivery to its radio must do: then what the queue took counts as channel access.
"""

from collections.abc import Mapping
from typing import NamedTuple

from rmr.base.time import Duration, Instant
from rmr.why.delay import TimeOwner
from rmr.why.past_items import PastDelivery

ROUNDING: Duration = 1000
"""Instants of frames are recorded in whole microseconds."""


class Attempt(NamedTuple):
    """One transmission on the air."""

    start: Instant
    end: Instant


Attempts = Mapping[tuple[int, int], list[Attempt]]
"""By sender and handle, in order; the handle is counted anew in each incarnation, the newest one's stand last."""


class RadioPart(NamedTuple):
    """From when on an owner has the time of a delivery."""

    begin: Instant
    owner: TimeOwner


def radio_time(source: int, sent: PastDelivery, end: Instant, attempts: Attempts) -> list[RadioPart]:
    """Return the parts of a delivery of robot `source` that arrived, or was still under way, at `end`."""
    handed = [at for at, _ in sent.transmissions if at < end]
    parts = [RadioPart(sent.begun, TimeOwner.RADIO_QUEUE)]
    if not handed:
        return parts
    tries = sorted(
        Attempt(attempt.start, min(attempt.end, end))
        for at, handle in sent.transmissions
        for attempt in attempts.get((source, handle), ())
        if at - ROUNDING <= attempt.start and attempt.end <= end + ROUNDING
    )
    if not tries:
        parts.append(RadioPart(handed[0], TimeOwner.CHANNEL_ACCESS))
        if len(handed) > 1:
            parts.append(RadioPart(handed[1], TimeOwner.REPEATS))
        return parts
    parts.append(
        RadioPart(max(handed[0], _idle_from(source, tries[0].start, handed[0], attempts)), TimeOwner.CHANNEL_ACCESS)
    )
    if len(tries) > 1:
        parts.append(RadioPart(tries[0].end, TimeOwner.REPEATS))
    if end - tries[-1].end > ROUNDING:
        parts.append(RadioPart(tries[-1].end, TimeOwner.LATE_TICK))
    return parts


def _idle_from(source: int, before: Instant, since: Instant, attempts: Attempts) -> Instant:
    """Return when the sender's radio was done with what stood before a frame that began at `before`."""
    ends = [
        attempt.end
        for (sender, _), tries in attempts.items()
        if sender == source
        for attempt in tries
        if since < attempt.end <= before
    ]
    return max(ends, default=since)
