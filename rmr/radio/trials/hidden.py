"""Hidden stations: A and C send to B, and hear each other, or not.

    hidden            A and C 80 m from B on opposite sides: too far from each other to hear or be sensed
    exposed_control   the same 80 m, but 28 m apart: they hear each other
    near_far_hidden   A 90 m and C 65 m from B on opposite sides: hidden, and C is 4 dB stronger at B

The distances suit the radio of the reference (`rmr.radio.trials.REFERENCE`); for another radio they are scaled so that
the power at B lies as far above the sensitivity. Where power falls slowly with distance (exponents up to 2.7), A and C
cannot both reach B without hearing each other; such a case is refused. Shares are of the frames offered to each.
"""

from dataclasses import dataclass
from functools import partial
from math import log10

from rmr.base.time import NS_PER_S, Duration, Instant, seconds
from rmr.radio.phy import LOCK_RATIO, LOSS_AT_1_M_DB, NOISE_BELOW_SENSITIVITY_DB, RadioConfig, path_loss_db
from rmr.radio.trials import REFERENCE, Row, Runs
from rmr.radio.trials.contention import check_load, start_traffic
from rmr.radio.trials.link import DISTANCE_MAX_M
from rmr.radio.trials.places import ORIGIN, at_angle
from rmr.radio.trials.statistics import mean, over_few, ratio
from rmr.radio.trials.traffic import Frame, Scene, check_payload, in_ms

DRAIN: Duration = NS_PER_S
WARM_UP: Duration = NS_PER_S

OPPOSITE = 180.0
CASES = {
    "hidden": (80.0, 80.0, OPPOSITE),
    "exposed_control": (80.0, 80.0, 20.0),
    "near_far_hidden": (90.0, 65.0, OPPOSITE),
}
"""Name -> metres from A to B, metres from C to B, degrees between them."""

NAMES = ("A", "C")
B = 0


@dataclass(frozen=True)
class Hidden:
    """Parameters of the experiment. Raises `ValueError` for values that cannot be run."""

    case: str
    """One of `CASES`."""
    load_fps: float | None
    """Frames a second of each of the two; None: saturated."""
    payload: int = 50
    unicast: bool = False
    measured_s: float = 120.0

    def __post_init__(self) -> None:
        check_payload(self.payload)
        if self.case not in CASES:
            raise ValueError(f"case {self.case!r}: write one of {', '.join(CASES)}")
        check_load(len(NAMES), self.load_fps and self.load_fps * len(NAMES), self.measured_s)


def distances(case: str, config: RadioConfig) -> tuple[float, float]:
    """Return the metres from A and from C to B for this radio. Raises `ValueError` if there are none."""
    weaker_db = (config.tx_power_dbm - config.sensitivity_dbm) - (REFERENCE.tx_power_dbm - REFERENCE.sensitivity_dbm)
    a_m, c_m = (
        10.0 ** ((path_loss_db(metres, REFERENCE.exponent) - LOSS_AT_1_M_DB + weaker_db) / (10.0 * config.exponent))
        for metres in CASES[case][:2]
    )
    if min(a_m, c_m) < 1.0:
        raise ValueError(
            "so weak a radio hides stations at less than a metre: raise its power, or lower its sensitivity"
        )
    if max(a_m, c_m) > DISTANCE_MAX_M:
        raise ValueError(f"so strong a radio reaches over {DISTANCE_MAX_M:g} m: lower its power, or raise the exponent")
    if CASES[case][2] == OPPOSITE and _hears(a_m + c_m, config):
        raise ValueError("A and C hear each other, so slowly does power fall with distance: raise the exponent")
    return a_m, c_m


def _hears(metres: float, config: RadioConfig) -> bool:
    """Whether a receiver at a distance of `metres` locks on to a frame, and so senses it."""
    power_dbm = config.tx_power_dbm - path_loss_db(metres, config.exponent)
    return power_dbm - (config.sensitivity_dbm - NOISE_BELOW_SENSITIVITY_DB) > 10.0 * log10(LOCK_RATIO)


def run(case: Hidden, runs: Runs) -> Row:
    """Return what becomes of the frames of each of the two."""
    a_m, c_m = distances(case.case, runs.config)
    samples = list(runs.over(partial(_sample, case, runs.config), runs.seeds))
    row: Row = {
        "case": case.case,
        "type": "unicast_ack" if case.unicast else "broadcast",
        "dA_m": round(a_m, 3),
        "dC_m": round(c_m, 3),
        "angle_deg": CASES[case.case][2],
        "saturated": case.load_fps is None,
        "load_per_node_fps": case.load_fps,
        "payload_bytes": case.payload,
        "measured_s_per_rep": case.measured_s,
        "reps": len(samples),
    }
    for name in NAMES:
        row[name] = {field: over_few([sample[name][field] for sample in samples]) for field in samples[0][name]}
    both = [mean([sample[name]["delivery_ratio"] for name in NAMES]) for sample in samples]
    return {**row, "both_delivery_ratio": over_few(both)}


def _sample(case: Hidden, config: RadioConfig, seed: int) -> dict[str, dict[str, float]]:
    scene = Scene(config, seed)
    scene.listener(B, ORIGIN, scene.note_delivery)
    end = WARM_UP + seconds(case.measured_s)
    a_m, c_m = distances(case.case, config)
    destination = B if case.unicast else None
    for address, place in enumerate((at_angle(a_m, 0.0), at_angle(c_m, CASES[case.case][2])), 1):
        scene.sender(address, place, destination, case.payload)
        start_traffic(scene, address, case.load_fps, end)
    scene.kernel.run_until(end - 1 if case.load_fps is None else end + DRAIN)
    return {name: _findings(scene.senders[address].frames, end) for address, name in enumerate(NAMES, 1)}


def _findings(frames: list[Frame], end: Instant) -> dict[str, float]:
    offered = [frame for frame in frames if WARM_UP <= frame.offered < end]
    delivered = [frame for frame in offered if frame.has_arrived]
    count = len(offered)
    return {
        "delivery_ratio": ratio(len(delivered), count),
        "confirmed_over_offered": ratio(sum(frame.status != "" for frame in offered), count),
        "caf_ratio": ratio(sum(frame.status == "access_failure" for frame in offered), count),
        "no_ack_ratio": ratio(sum(frame.status == "no_ack" for frame in offered), count),
        "attempts_per_offered": ratio(sum(frame.attempts for frame in offered), count),
        "mean_e2e_ms": mean([in_ms(frame.delivered - frame.offered) for frame in delivered]),
    }
