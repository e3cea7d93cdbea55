"""What the order of deliveries costs where frames are lost: a table, and JSON in build/bench-gaps.json.

    python tests/bench/gaps.py [--quick] [--output FILE] [--page FILE]

One robot sends another a fact at a constant rate, over a link that delays each frame by 5 ms and loses each, also
acknowledgements, with the same probability, as `rmr eval --loss` does. A radio repeats lost unicasts itself (three
times), so its share of lost frames is the fourth power of that of its transmissions.

*Gap.* A fact that has arrived waits for an earlier one that is missing. Told are the share of facts that wait, and how
long those wait. *Delay.* From the sending of a fact until it takes effect, of all facts. *Frames.* Frames of facts and
acknowledgements for each fact; without loss there are two.

All in virtual time, so each machine takes the same figures. The exit code is 0 only if no wait was longer than its
target.
"""

import argparse
import sys
from dataclasses import asdict, dataclass
from heapq import heappop, heappush
from random import Random

from page import add_options, keep, table

from rmr.base.time import NEVER, NS_PER_S, Instant, in_seconds, milliseconds
from rmr.node.logic.exchange import Exchange
from rmr.node.payloads import Delivery, DeliveryRole, PayloadKind

LOSSES = (0.0, 0.1, 0.2, 0.4)
RATES_PER_S = (1, 10)
FACTS = 20_000
QUICK_FACTS = 2_000
LATENCY = milliseconds(5)
GAP_P99_S_MAX = {0.0: 0.0, 0.1: 0.5, 0.2: 0.75, 0.4: 2.0}
"""Targets, seconds, by loss."""
SENDER, RECEIVER = 0, 1
FACT = Delivery(DeliveryRole.FACT, 0, ())


@dataclass(frozen=True)
class Taken:
    """The figures of one rate and loss; times in seconds."""

    rate_per_s: int
    loss: float
    waiting_share: float
    gap_p50_s: float
    gap_p99_s: float
    gap_max_s: float
    delay_p50_s: float
    delay_p99_s: float
    frames_per_fact: float


class Link:
    """Two exchanges and the frames between them."""

    def __init__(self, loss: float) -> None:
        self.loss = loss
        self.robots = (Exchange(9, 0, Random("sender")), Exchange(9, 0, Random("receiver")))
        self.frames = 0
        self.arrived: dict[int, Instant] = {}
        self.took_effect: dict[int, Instant] = {}
        self._rng = Random(f"link/{loss}")
        self._air: list[tuple[Instant, int, int, bytes]] = []
        """(arrival, number, destination, frame), a heap."""

    def run(self, facts: int, rate_per_s: int) -> None:
        """Send facts, and go on until all have taken effect."""
        sender = self.robots[SENDER]
        for fact in range(facts):
            now = fact * NS_PER_S // rate_per_s
            self._until(now)
            sender.send(now, RECEIVER, FACT, fact.to_bytes(4, "big"))
            self._settle(now)
        self._until(NEVER)

    def _until(self, end: Instant) -> None:
        while True:
            wake = min(robot.next_wake for robot in self.robots)
            now = min(wake, self._air[0][0] if self._air else NEVER)
            if now >= end:
                return
            for robot in self.robots:
                robot.wake(now)
            while self._air and self._air[0][0] <= now:
                _, _, destination, frame = heappop(self._air)
                self._take(now, destination, frame)
            self._settle(now)

    def _take(self, now: Instant, destination: int, frame: bytes) -> None:
        robot = self.robots[destination]
        source = 1 - destination
        match frame[0]:
            case PayloadKind.FACT_ACK:
                robot.acknowledged(now, frame, source)
            case PayloadKind.FACT_BASE:
                robot.base_told(now, frame, source)
            case PayloadKind.FACT_BASE_WANTED:
                robot.asked(frame, source)
            case _:
                robot.received(now, frame, source)
                self.arrived.setdefault(int.from_bytes(frame[-4:], "big"), now)

    def _settle(self, now: Instant) -> None:
        for robot in self.robots:
            arrivals, robot.arrivals = robot.arrivals, []
            for arrival in arrivals:
                self.took_effect[int.from_bytes(arrival.body, "big")] = now
            robot.news.clear()
            for frame, destination, _ in robot.outbox:
                self.frames += 1
                if self._rng.random() >= self.loss:
                    heappush(self._air, (now + LATENCY, self.frames, destination, frame))
            robot.outbox.clear()


def taken(rate_per_s: int, loss: float, facts: int) -> Taken:
    """Measure one case.

    Raises:
        AssertionError: facts were lost.
    """
    link = Link(loss)
    link.run(facts, rate_per_s)
    assert len(link.took_effect) == facts
    delays = sorted(at - fact * NS_PER_S // rate_per_s for fact, at in link.took_effect.items())
    gaps = sorted(wait for fact, at in link.took_effect.items() if (wait := at - link.arrived[fact]))
    return Taken(
        rate_per_s,
        loss,
        len(gaps) / facts,
        _quantile_s(gaps, 0.5),
        _quantile_s(gaps, 0.99),
        _quantile_s(gaps, 1.0),
        _quantile_s(delays, 0.5),
        _quantile_s(delays, 0.99),
        link.frames / facts,
    )


def _quantile_s(times: list[int], share: float) -> float:
    """Return a quantile of sorted times, seconds; 0 of none."""
    return in_seconds(times[min(int(share * len(times)), len(times) - 1)]) if times else 0.0


def lines(rows: list[Taken]) -> list[str]:
    """Return the table in Markdown, of the links that lose frames."""
    header = ("facts a second", "loss", "wait", "gap p50, p99, max", "delay p50, p99", "frames")
    return table(
        header,
        [
            (
                str(row.rate_per_s),
                f"{row.loss:.0%}",
                f"{row.waiting_share:.1%}",
                f"{row.gap_p50_s:.2f}, {row.gap_p99_s:.2f}, {row.gap_max_s:.2f} s",
                f"{row.delay_p50_s:.2f}, {row.delay_p99_s:.2f} s",
                f"{row.frames_per_fact:.2f}",
            )
            for row in rows
            if row.loss  # without loss nothing waits
        ],
    )


def main() -> int:
    """Take all figures; return 0 if the targets are met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tenth of the facts")
    add_options(parser, "gaps")
    options = parser.parse_args()
    facts = QUICK_FACTS if options.quick else FACTS
    rows = [taken(rate, loss, facts) for rate in RATES_PER_S for loss in LOSSES]
    shown = lines(rows)
    print("\n".join(shown))
    keep(options, "gaps.json", {"facts": facts, "rows": [asdict(row) for row in rows]}, "gaps", shown)
    missed = [row for row in rows if row.gap_p99_s > GAP_P99_S_MAX[row.loss]]
    for row in missed:
        print(f"at {row.rate_per_s} facts a second and a loss of {row.loss:.0%} the target is not met", file=sys.stderr)
    return bool(missed)


if __name__ == "__main__":
    sys.exit(main())
