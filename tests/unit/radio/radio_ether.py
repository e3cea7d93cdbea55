"""A small deterministic host for stations: the seam through which the radio is tested.

`Ether` hands each announcement to all other stations, at once or after a delay, and advances the stations in
order of time. A script of requests goes in, a log of (instant, station, output) comes out.
"""

from collections.abc import Callable, Iterable
from heapq import heappop, heappush
from random import Random

from rmr.base.time import NS_PER_US, Duration, Instant
from rmr.radio.air import ACK_ATTEMPT, Announcement, Confirmed, Output, Received
from rmr.radio.frame import DataFrame, encode_data
from rmr.radio.phy import RadioConfig, airtime
from rmr.radio.security import Security
from rmr.radio.station import Station

PAN = 7
US = NS_PER_US
MS = 1000 * US


def transmission(
    source: int,
    start: Instant,
    *,
    x: float,
    payload: bytes = b"x" * 40,
    to: int = 0xFFFF,
    sequence: int = 0,
    attempt: int = 0,
    power_dbm: float = 0.0,
) -> Announcement:
    """Return the announcement of one data frame."""
    psdu = encode_data(DataFrame(PAN, to, source, sequence & 0xFF, to != 0xFFFF, payload))
    return Announcement(source, sequence, attempt, start, start + airtime(len(psdu)), power_dbm, x, 0.0, psdu)


def station(
    address: int = 1, *, seed: int = 5, grace: Duration = 0, security: Security | None = None, **config: object
) -> Station:
    """Return a station at the origin."""
    settings = RadioConfig(**config)  # type: ignore[arg-type]
    return Station(address, PAN, seed, Random(f"{seed}/{address}"), settings, grace, security=security)


class Ether:
    """Stations at (x, y), addressed 0, 1, 2, ... in the order given."""

    def __init__(
        self,
        places: Iterable[tuple[float, float]],
        *,
        seed: int = 5,
        grace: Duration = 0,
        delay: Callable[[], Duration] | None = None,
        secure: Callable[[int], Security | None] = lambda address: None,
        **config: object,
    ) -> None:
        self.places = list(places)
        self.stations = [
            station(a, seed=seed, grace=grace, security=secure(a), **config) for a in range(len(self.places))
        ]
        for one, place in zip(self.stations, self.places, strict=True):
            one.move(*place)
        self.delay = delay
        self.log: list[tuple[Instant, int, Output]] = []
        self.on_output: Callable[[Instant, int, Output], None] = lambda at, who, what: None
        self._calls: list[tuple[Instant, int, Callable[[], None]]] = []
        self._count = 0

    def at(self, when: Instant, call: Callable[[], None]) -> None:
        """Run `call` at `when`."""
        self._count += 1
        heappush(self._calls, (when, self._count, call))

    def send(self, when: Instant, who: int, payload: bytes, to: int | None = None, handle: int = 0) -> None:
        """Let station `who` request a transmission at `when`."""
        self.at(when, lambda: self.stations[who].request(when, payload, to, handle))

    def run(self, until: Instant) -> None:
        """Advance everything up to `until`."""
        while True:
            next_call = self._calls[0][0] if self._calls else until + 1
            now = min(next_call, *(one.next_wake for one in self.stations))
            if now > until:
                return
            while self._calls and self._calls[0][0] <= now:
                heappop(self._calls)[2]()
            for who, one in enumerate(self.stations):
                if one.next_wake <= now:
                    for output in one.advance(now, *self.places[who]):
                        self._publish(now, who, output)

    def _publish(self, now: Instant, who: int, output: Output) -> None:
        self.log.append((now, who, output))
        self.on_output(now, who, output)
        if not isinstance(output, Announcement):
            return
        for other in self.stations:
            if self.delay is None:
                other.hear(output)
            else:
                self.at(now + self.delay(), lambda other=other: other.hear(output))

    def received(self, who: int) -> list[Received]:
        """Return what station `who` has received."""
        return [what for _, at, what in self.log if at == who and isinstance(what, Received)]

    def confirmed(self, who: int) -> list[Confirmed]:
        """Return the outcomes of station `who`'s requests."""
        return [what for _, at, what in self.log if at == who and isinstance(what, Confirmed)]

    def confirmed_at(self, who: int) -> list[Instant]:
        """Return when they became known."""
        return [when for when, at, what in self.log if at == who and isinstance(what, Confirmed)]

    def announced(self, who: int, *, acks: bool = False) -> list[Announcement]:
        """Return what station `who` has put on the air: data frames, or acknowledgements."""
        mine = [what for _, at, what in self.log if at == who and isinstance(what, Announcement)]
        return [what for what in mine if bool(what.attempt & ACK_ATTEMPT) == acks]
