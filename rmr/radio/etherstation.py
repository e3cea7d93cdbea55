"""One robot's radio in the ether: medium access on the kernel's time, and the switch of the process around it.

A radio is part of its robot's process, as in `rmr_agent`. When that is held up (a stopped process) the station stands
still: frames that come through meanwhile are handed on, as a process that goes on decides them by their stamps, but
nothing is sent, and acknowledgements have missed their time. When the process dies the station is off until a new one
begins another life.
"""

from collections.abc import Callable
from random import Random

import numpy as np
from numpy.typing import NDArray

from rmr.base.kernel import RADIO, Alarm, Kernel
from rmr.base.time import NEVER, Instant
from rmr.radio.air import Confirmed, Received
from rmr.radio.floor import Floor
from rmr.radio.intake import Counters, Intake
from rmr.radio.mac import Mac, State, Transmission
from rmr.radio.security import Security
from rmr.radio.tallies import Tallies

Take = Callable[[Received | Confirmed], None]


class Medium:
    """What a station uses of the ether that it is in; a class and no protocol, since it is called for every frame."""

    kernel: Kernel
    floor: Floor
    tallies: Tallies
    listening: NDArray[np.bool_]
    awaiting: set[int]

    def busy(self, station: "EtherStation", now: Instant) -> bool:
        """Return whether the clear channel assessment of `station` finds the channel busy."""
        raise NotImplementedError

    def announce(self, station: "EtherStation", psdu: bytes, sequence: int, attempt: int, start: Instant) -> None:
        """Let `station` transmit `psdu` from `start` on."""
        raise NotImplementedError


class EtherStation:
    """One robot's radio in the ether."""

    def __init__(
        self, ether: Medium, index: int, mac: Mac, intake: Intake, take: Take | None, payload_max: int
    ) -> None:
        self.index = index
        self.mac = mac
        self.intake = intake
        self.take = take
        self.payload_max = payload_max
        """Octets that fit a frame."""
        self.held = False
        """Whether it is switched off or held up: it does nothing of itself and acknowledges nothing."""
        self._ether = ether
        self._alarm = Alarm(ether.kernel, RADIO, self._fire)

    @property
    def counters(self) -> Counters:
        """What it has done and what befell it."""
        return self._ether.tallies.complete(self.index, self.intake.counters)

    def request(self, payload: bytes, destination: int | None, handle: int) -> None:
        """Send `payload` (`payload_max` octets at most) to `destination`, None for all.

        A `Confirmed` with `handle` follows. Raises `ValueError` if the payload or the destination does not fit a
        frame.
        """
        kernel = self._ether.kernel
        if self.mac.request(kernel.now, payload, destination, handle):
            self._alarm.set(self.mac.next_wake)
        else:
            self.intake.counters.access_failed += 1
            kernel.at(kernel.now, RADIO, lambda _now: self._tell(Confirmed(handle, "access_failure")))

    def move(self, x: float, y: float) -> None:
        """Set the station's true position, metres."""
        self._ether.floor.move(self.index, x, y)

    def acknowledged(self, end: Instant) -> None:
        """Take note of the acknowledgement waited for, whose last symbol arrives at `end`, which is now."""
        confirmed = self.mac.acknowledged(end, end)
        self._go_on()
        self._tell(confirmed)

    # -- what befalls the process that it is part of -------------------------------------------------------------

    def hold(self) -> None:
        """Stand still: what is on the air stays there, what arrives is taken, but nothing is sent or acknowledged."""
        self.held = True
        self._alarm.set(NEVER)

    def resume(self, now: Instant) -> None:
        """Go on after `hold`: what was due in the meantime is due now, and backoffs begin anew."""
        self.held = False
        while self.mac.next_wake < now:
            if self.mac.state is State.BACKOFF:
                self.mac.back_off_again(now)
            else:
                self._fire(now)
        self._go_on()

    def switch_off(self) -> None:
        """Neither send nor hear anything more, as when the process dies; `switch_on` begins a new life."""
        self.hold()
        self._ether.listening[self.index] = False
        self._ether.awaiting.discard(self.index)

    def switch_on(self, rng: Random, security: Security | None) -> None:
        """Begin a new life in the same place, which remembers nothing of the earlier one but the counters."""
        ether, intake = self._ether, self.intake
        self.mac = Mac(intake.address, intake.pan, rng, security=security)
        self.intake = Intake(intake.address, intake.pan, intake.counters, security)
        self.held = False
        ether.listening[self.index] = True

    def _tell(self, confirmed: Confirmed) -> None:
        if self.take is not None:
            self.take(confirmed)

    def _fire(self, now: Instant) -> None:
        mac, counters = self.mac, self.intake.counters
        out = mac.fire(mac.state is State.BACKOFF and self._ether.busy(self, now))
        if isinstance(out, Transmission):
            counters.sent += 1
            self._ether.announce(self, out.psdu, out.sequence, out.attempt, out.start)
        self._go_on()
        if isinstance(out, Confirmed):
            counters.no_ack += out.status == "no_ack"
            counters.access_failed += out.status == "access_failure"
            self._tell(out)

    def _go_on(self) -> None:
        if not self.held:
            self._alarm.set(self.mac.next_wake)
        if self.mac.state in (State.SENDING, State.WAITING):
            self._ether.awaiting.add(self.index)
        else:
            self._ether.awaiting.discard(self.index)
