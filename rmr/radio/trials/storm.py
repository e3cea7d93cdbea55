"""Reply storms: a broadcast that all members answer.

The initiator in the middle broadcasts a discovery. Each member that receives it hands its reply to its radio after a
random time, even between 0 and the jitter; with none, all do so at the same instant. Replies go to all, or to the
initiator with acknowledgement. Times count from the first symbol of the discovery. One seed is one storm.
"""

from dataclasses import dataclass
from functools import partial
from statistics import median

from rmr.base.kernel import ROBOT
from rmr.base.time import NS_PER_MS, Duration, Instant, milliseconds
from rmr.radio.air import Received
from rmr.radio.phy import RadioConfig
from rmr.radio.trials import Row, Runs
from rmr.radio.trials.places import ORIGIN, Place, circle, disk
from rmr.radio.trials.statistics import over_many, ratio, share
from rmr.radio.trials.traffic import Frame, Scene, Sender, check_payload, in_ms

GEOMETRIES = {
    "circle": "circle radius 10 m (equal power)",
    "disk": "uniform disk radius 20 m (near-far)",
}
MEMBERS_MAX = 1_000
JITTER_MAX_MS = 60_000.0

BEGIN: Instant = 10 * NS_PER_MS
"""When the discovery is handed to the initiator's radio."""
LAST: Duration = 250 * NS_PER_MS
"""After the last reply is handed over, all is done: four attempts take at most 170 ms, and the discovery 42 ms."""

INITIATOR = 0


@dataclass(frozen=True)
class Storm:
    """How many answer how. Raises `ValueError` for what cannot be run."""

    members: int
    jitter_ms: float
    geometry: str = "circle"
    """One of `GEOMETRIES`."""
    payload: int = 50
    unicast: bool = False
    discovery_payload: int = 20

    def __post_init__(self) -> None:
        check_payload(self.payload)
        check_payload(self.discovery_payload)
        if not 1 <= self.members <= MEMBERS_MAX:
            raise ValueError(f"{self.members} members: write 1 to {MEMBERS_MAX}")
        if not 0.0 <= self.jitter_ms <= JITTER_MAX_MS:
            raise ValueError(f"a jitter of {self.jitter_ms:g} ms: write 0 to {JITTER_MAX_MS:g}")
        if self.geometry not in GEOMETRIES:
            raise ValueError(f"geometry {self.geometry!r}: write one of {', '.join(GEOMETRIES)}")


def run(case: Storm, runs: Runs) -> Row:
    """Return how many replies arrive, and when."""
    samples = list(runs.over(partial(_sample, case, runs.config), runs.seeds))
    row: Row = {
        "replies": "unicast_ack" if case.unicast else "broadcast",
        "N_members": case.members,
        "reply_jitter_ms": case.jitter_ms,
        "geometry": GEOMETRIES[case.geometry],
        "payload_bytes": case.payload,
        "discovery_payload_bytes": case.discovery_payload,
        "reps": len(samples),
    }
    complete = sum(sample["reply_delivery_ratio"] == 1.0 for sample in samples)
    for name in samples[0]:
        row[name] = over_many([value for sample in samples if (value := sample[name]) is not None])
        if name == "no_ack_ratio":
            row["all_replies_received_prob"] = share(complete, len(samples))
    return row


def _sample(case: Storm, config: RadioConfig, seed: int) -> dict[str, float | None]:
    scene = Scene(config, seed)
    initiator = scene.sender(INITIATOR, ORIGIN, None, case.discovery_payload)
    initiator.on_received = scene.note_delivery
    waits = scene.chance("waits")
    for address, place in enumerate(_places(case, scene), 1):
        member = scene.sender(address, place, INITIATOR if case.unicast else None, case.payload)
        member.on_received = partial(_discovered, scene, member, milliseconds(case.jitter_ms * waits.random()))
    scene.kernel.at(BEGIN, ROBOT, initiator.offer)
    scene.kernel.run_until(BEGIN + milliseconds(case.jitter_ms) + LAST)
    return _findings(case, scene, initiator.frames[0].aired)


def _places(case: Storm, scene: Scene) -> list[Place]:
    if case.geometry == "circle":
        return circle(case.members, 10.0)
    return disk(case.members, 20.0, scene.chance("places"))


def _discovered(scene: Scene, member: Sender, wait: Duration, received: Received) -> None:
    """Have `member` answer after `wait` if what it has received is the discovery."""
    if received.source == INITIATOR:
        scene.kernel.at(received.stamp + wait, ROBOT, member.offer)


def _findings(case: Storm, scene: Scene, began: Instant) -> dict[str, float | None]:
    members = [sender for address, sender in scene.senders.items() if address != INITIATOR]
    replies = [frame for member in members for frame in member.frames]
    arrivals = [in_ms(frame.delivered - began) for frame in replies if frame.has_arrived]
    found: dict[str, float | None] = {
        "discovery_heard_ratio": ratio(len(replies), case.members),
        "reply_delivery_ratio": ratio(len(arrivals), case.members),
        "channel_access_failure_ratio": _share(replies, "access_failure", case.members),
        "no_ack_ratio": _share(replies, "no_ack", case.members),
        "last_reply_ms": max(arrivals, default=None),
        "median_reply_ms": median(arrivals) if arrivals else None,
        "attempts_per_member": ratio(sum(frame.attempts for frame in replies), case.members),
    }
    if not case.unicast:
        overheard = sum(member.station.counters.received for member in members) - len(replies)
        found["member_hears_other_reply_ratio"] = ratio(overheard, case.members * (case.members - 1))
    return found


def _share(replies: list[Frame], status: str, members: int) -> float:
    return ratio(sum(frame.status == status for frame in replies), members)
