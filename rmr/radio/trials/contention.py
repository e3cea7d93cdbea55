"""Contention: stations around a silent sink share the channel.

The senders stand on a circle of 10 m around the sink, so that all are in range of each other and equally strong at
the sink. Each is offered frames at independent random times (Poisson), or always the next one (saturated); the
frames go to all, or to the sink with acknowledgement. The first second does not count.

Delays count from the offering: *access* to the first symbol of the first attempt, *e2e* to the arrival of the last
symbol at the sink (delivered frames). *Service* is the time from the request to its confirmation, whatever its status.
Shares are of the frames offered. Frames that wait at the end get `DRAIN` to leave, except under saturation. A frame
that the sink receives twice counts as delivered once, and as one duplicate.
"""

from dataclasses import dataclass
from functools import partial

from rmr.base.time import NS_PER_S, Duration, Instant, seconds
from rmr.radio.phy import RadioConfig
from rmr.radio.trials import Row, Runs
from rmr.radio.trials.places import ORIGIN, circle
from rmr.radio.trials.statistics import mean, over_few, percentile, ratio
from rmr.radio.trials.traffic import Frame, Scene, check_payload, in_ms, octets_of, send_always, send_poisson

RADIUS_M = 10.0
DRAIN: Duration = NS_PER_S
"""Longer than any frame waits on a channel that can carry its load."""
SENDERS_MAX = 1_000
"""Stations around one sink; beyond that nothing is delivered, and the experiment shows nothing."""
SECONDS_MAX = 86_400.0
OFFERED_MIN_FPS = 1e-6
"""A frame in eleven days."""
OFFERED_MAX_FPS = 100_000.0
"""Hundreds of times what the channel carries."""
FRAMES_MAX = 5_000_000
"""Frames of one run: the story of each is kept to its end, about a gigabyte in all."""

SINK = 0


@dataclass(frozen=True)
class Contention:
    """Parameters of the experiment. Raises `ValueError` for values that cannot be run."""

    senders: int
    offered_fps: float | None
    """Frames a second of all senders together; None: saturated."""
    payload: int = 50
    """Octets."""
    unicast: bool = False
    """To the sink, with acknowledgement; else to all."""
    measured_s: float = 60.0
    warm_up_s: float = 1.0

    def __post_init__(self) -> None:
        check_payload(self.payload)
        if not 1 <= self.senders <= SENDERS_MAX:
            raise ValueError(f"{self.senders} senders: write 1 to {SENDERS_MAX}")
        check_load(self.senders, self.offered_fps, self.measured_s)


def check_load(senders: int, offered_fps: float | None, measured_s: float) -> None:
    """Raise `ValueError` if a load of `offered_fps`, all `senders` together, or its duration is out of range."""
    if not 0.0 < measured_s <= SECONDS_MAX:
        raise ValueError(f"{measured_s:g} s: write more than 0, at most {SECONDS_MAX:g} (a day)")
    if offered_fps is not None and not OFFERED_MIN_FPS <= offered_fps <= OFFERED_MAX_FPS:
        raise ValueError(f"{offered_fps:g} frames/s offered: write {OFFERED_MIN_FPS:g} to {OFFERED_MAX_FPS:g}")
    # Upper bound on the frames that one saturated sender sends in a second.
    frames = measured_s * (senders * 240.0 if offered_fps is None else offered_fps)
    if frames > FRAMES_MAX:
        raise ValueError(f"up to {frames:,.0f} frames a run, at most {FRAMES_MAX:,}: try more runs of less time")


def run(case: Contention, runs: Runs) -> Row:
    """Return what the sink and the senders find."""
    samples = list(runs.over(partial(_sample, case, runs.config), runs.seeds))
    return {
        "type": "unicast_ack_to_sink" if case.unicast else "broadcast",
        "saturated": case.offered_fps is None,
        "N_senders": case.senders,
        "offered_total_fps": case.offered_fps,
        "payload_bytes": case.payload,
        "psdu_bytes": octets_of(case.payload),
        "measured_s_per_rep": case.measured_s,
        "warmup_s": case.warm_up_s,
        "reps": len(samples),
        **{name: over_few([sample[name] for sample in samples]) for name in samples[0]},
    }


def _sample(case: Contention, config: RadioConfig, seed: int) -> dict[str, float]:
    scene = Scene(config, seed)
    scene.listener(SINK, ORIGIN, scene.note_delivery)
    begin = seconds(case.warm_up_s)
    end = begin + seconds(case.measured_s)
    destination = SINK if case.unicast else None
    for address, place in enumerate(circle(case.senders, RADIUS_M), 1):
        scene.sender(address, place, destination, case.payload)
        start_traffic(scene, address, case.offered_fps and case.offered_fps / case.senders, end)
    scene.kernel.run_until(begin)
    before = _heard(scene)
    scene.kernel.run_until(end - 1)
    if case.offered_fps is not None:
        scene.kernel.run_until(end + DRAIN)
    heard, duplicates = (after - earlier for after, earlier in zip(_heard(scene), before, strict=True))
    return _findings(case, scene, (begin, end), heard, duplicates)


def start_traffic(scene: Scene, address: int, rate_fps: float | None, until: Instant) -> None:
    """Have the sender at `address` offered frames at a rate, or always (None), until then."""
    sender = scene.senders[address]
    chance = scene.chance(f"station{address}/arrivals")
    if rate_fps is None:
        send_always(scene, sender, chance)
    else:
        send_poisson(scene, sender, rate_fps, chance, until)


def _heard(scene: Scene) -> tuple[int, int]:
    """Return how many frames all stations have received, and how many repeats the sink."""
    stations = scene.ether.stations
    return sum(station.counters.received for station in stations), stations[0].counters.duplicates


def _findings(
    case: Contention, scene: Scene, window: tuple[Instant, Instant], heard: int, duplicates: int
) -> dict[str, float]:
    begin, end = window
    frames = [frame for sender in scene.senders.values() for frame in sender.frames]
    offered = [frame for frame in frames if begin <= frame.offered < end]
    aired = [frame for frame in offered if frame.attempts]
    delivered = [frame for frame in offered if frame.has_arrived]
    access = [in_ms(frame.aired - frame.offered) for frame in aired]
    e2e = [in_ms(frame.delivered - frame.offered) for frame in delivered]
    found = {
        "delivery_ratio_sink": ratio(len(delivered), len(offered)),
        "channel_access_failure_ratio": _share(offered, "access_failure"),
        "throughput_sink_fps": sum(begin <= frame.delivered < end for frame in frames) / case.measured_s,
        "mean_access_delay_ms": mean(access),
        "p95_access_delay_ms": percentile(access, 0.95),
        "mean_e2e_ms": mean(e2e),
        "p95_e2e_ms": percentile(e2e, 0.95),
        "p99_e2e_ms": percentile(e2e, 0.99),
        "mean_service_ms": mean([in_ms(frame.confirmed - frame.taken) for frame in offered if frame.status]),
        "attempts_per_transmitted_frame": ratio(sum(frame.attempts for frame in aired), len(aired)),
    }
    if case.unicast:
        found["no_ack_ratio"] = _share(offered, "no_ack")
        found["duplicates_per_delivered"] = ratio(duplicates, len(delivered))
    else:
        found["delivery_ratio_all_receivers"] = ratio(heard, len(offered) * case.senders)
        found["collision_loss_ratio_at_sink_given_transmitted"] = (
            1 - ratio(len(delivered), len(aired)) if aired else 0.0
        )
    return found


def _share(frames: list[Frame], status: str) -> float:
    return ratio(sum(frame.status == status for frame in frames), len(frames))
