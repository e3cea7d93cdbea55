"""Fragmentation of large messages: the sender cuts them into `wire.Part`s, a receiver reassembles them.

The parts of a message follow each other on one key, so a receiver keeps at most one unfinished message for each
stream (key and sender), and drops it when a part is missing. The memory of all unfinished messages is bounded: the
oldest is dropped first.
"""

from collections.abc import Iterator

from rmr.bus import wire
from rmr.bus.checks import MalformedError

HELD_OCTETS_MAX = 2 * wire.WHOLE_OCTETS_MAX
"""Octets of unfinished messages that one process keeps."""


class TooLargeError(ValueError):
    """A message is larger than can be sent even in parts; `octets` is its length."""

    def __init__(self, octets: int) -> None:
        super().__init__(f"a message of {octets} octets; at most {wire.WHOLE_OCTETS_MAX} can be sent")
        self.octets = octets


def cut(data: bytes, serial: int) -> Iterator[wire.Part]:
    """Yield the parts of an encoded message, the `serial`-th of its sender. Raises TooLargeError."""
    if len(data) > wire.WHOLE_OCTETS_MAX:
        raise TooLargeError(len(data))
    size = wire.PART_OCTETS_MAX
    count = -(-len(data) // size)
    for index in range(count):
        yield wire.Part(serial, index, count, data[index * size : (index + 1) * size])


class Unfinished:
    """The unfinished messages of one process."""

    def __init__(self) -> None:
        self._held: dict[tuple[str, int], tuple[int, int, list[bytes]]] = {}
        """Run, serial and the octets so far of each stream's message, the oldest stream first."""

    def add(self, key: str, message: wire.Envelope) -> wire.Envelope | None:
        """Take a part; return the whole message once it is the last one. Raises MalformedError."""
        part = message.body
        assert isinstance(part, wire.Part)
        stream = (key, message.sender)
        run, serial, octets = self._held.pop(stream, (message.run, part.serial, []))
        if part.place == 0:
            run = message.run
            serial = part.serial
            octets = []
        if (run, serial, len(octets)) != (message.run, part.serial, part.place) or part.parts > wire.PARTS_MAX:
            return None  # a part is missing: the rest of the message is useless
        octets.append(part.octets)
        if len(octets) < part.parts:
            self._held[stream] = run, serial, octets
            self._bound()
            return None
        whole = wire.decode(b"".join(octets), wire.WHOLE_OCTETS_MAX)
        if isinstance(whole.body, wire.Part) or (whole.sender, whole.run) != (message.sender, message.run):
            raise MalformedError("expected a message of the sender of its parts")
        return whole

    def _bound(self) -> None:
        while sum(len(part) for _, _, octets in self._held.values() for part in octets) > HELD_OCTETS_MAX:
            self._held.pop(next(iter(self._held)))
