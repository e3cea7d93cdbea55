"""How fast a program is distributed: over the radio, where frames are short and few, and over the bus."""

from dataclasses import dataclass
from typing import Final

from rmr.base.time import Duration, milliseconds, seconds
from rmr.load.load_messages import FRAGMENT_HEAD


@dataclass(frozen=True, slots=True)
class LoadPace:
    """The intervals and sizes of one carrier."""

    octets_max: int
    """Octets of a message."""
    poll: Duration
    """Between two questions to a robot that has not answered."""
    gap: Duration
    """Between two fragments."""
    patience: Duration
    """Silence after which a robot counts as one that has not heard."""
    lead: Duration
    """From the decision to the instant of the switch: in three quarters of it all robots must have confirmed it."""
    at_once: int = 1
    """Fragments that are sent together."""

    @property
    def piece_octets(self) -> int:
        """Octets of a fragment."""
        return self.octets_max - FRAGMENT_HEAD


BUS_OCTETS_MAX: Final = 32 << 10
"""A message of the bus has at most 48 KiB."""

BUS: Final = LoadPace(BUS_OCTETS_MAX, milliseconds(200), milliseconds(2), seconds(5), seconds(2), at_once=4)


def radio_pace(payload_max: int) -> LoadPace:
    """Return the pace over radios with so many octets of payload.

    A frame takes 4.3 ms on the air, and robots have their own to send. At a loss of 0.3 a question and its answer, each
    repeated three times by the radio, fail about once in fifty; the lead has room for twenty of them.
    """
    return LoadPace(payload_max, milliseconds(300), milliseconds(20), seconds(10), seconds(4))


ASK_EVERY: Final = milliseconds(150)
ASKS: Final = 8
"""How often a robot that starts asks the others for their program, less one: it waits as long after the last time."""
TELL_EVERY: Final = seconds(5)
"""Period with which robots say what they have been loaded with."""
TELL_WITHIN: Final = milliseconds(100)
"""Random delay of an answer: another robot may have given it by then."""
WANT_EVERY: Final = milliseconds(400)
"""Between two requests for missing fragments."""
GIVE_UP: Final = seconds(10)
"""Time without a new fragment after which a robot that waits for its program begins with the one that it has."""
FORGET: Final = seconds(30)
"""Silence of the coordinator after which a robot that is ready, and has no instant, counts the load as failed."""
