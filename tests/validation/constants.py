"""constants.json: every constant of the standard against what our radio does, measured by `probe`.

Each key of the file is either compared or named in `NOT_MODELLED` with the reason, and a key that is in neither is a
missed check, so that none can be forgotten.
"""

from collections.abc import Callable, Iterator
from math import log10

import probe
from probe import microseconds
from reference import EXPONENT, SENSITIVITY_DBM, load
from verdicts import Check, Data, Estimate, Value, compared, equal

from rmr.base.time import NS_PER_S
from rmr.radio.frame import FCS_OCTETS, HEADER_OCTETS, PAYLOAD_MAX, PSDU_MAX, check_sequence
from rmr.radio.phy import (
    BIT,
    OCTET,
    SYMBOL,
    SYNCHRONISATION,
    RadioConfig,
    airtime,
    channel_busy,
    channel_of,
    link_quality,
    path_loss_db,
    reception,
)
from rmr.radio.phy import (
    HEADER_OCTETS as PHY_HEADER_OCTETS,
)
from rmr.radio.trials import REFERENCE

FILE = "constants"
AWGN = RadioConfig(sensitivity_dbm=SENSITIVITY_DBM, interference="awgn", exponent=EXPONENT)
CAPTURE = RadioConfig(sensitivity_dbm=SENSITIVITY_DBM, exponent=EXPONENT)
POWER_STEP_DB = 0.001
"""To which powers are measured."""
KERMIT = 0x2189
"""The CRC that constants.json describes, of the digits 1 to 9: the catalogues of CRCs give it as the check value."""

NOT_MODELLED = {
    "phy.chips_per_symbol": "the model counts bits; chips are inside its bit error rate",
    "phy.ED_symbols": "no energy detection besides the assessment; its length is CCA_symbols",
    "phy.ED_value": "no energy detection is offered",
    "phy.RSSI": "ns-3 3.44 has none; ours is the power of the frame received",
    "phy.adjacent_channel_rejection_db": "there is one channel",
    "phy.alternate_channel_rejection_db": "there is one channel",
    "mac.MHR_short_inter_pan_bytes": "there is one PAN",
    "mac.MHR_ext_intra_pan_bytes": "addresses are short ones",
    "mac.aMinMPDUOverhead": "a bound for frame types that are not used",
    "mac.aMaxMACSafePayloadSize": "a bound for frame types that are not used",
}

Pair = tuple[Value, Value]
"""Ours, the reference's."""


def checks() -> Iterator[Check]:
    """Yield the checks of every constant."""
    data = load(FILE)
    keys = [f"{part}.{key}" for part in ("phy", "mac") for key in data[part]]
    for key in keys:
        part, _, name = key.partition(".")
        entry = data[part][name]
        if key in NOT_MODELLED:
            yield Check(FILE, part, name, "", _text(entry), unjudged=NOT_MODELLED[key])
        elif key in MEASURED:
            ours, theirs = MEASURED[key](entry)
            yield equal((FILE, part, name), ours, theirs)
        elif key in POWERS:
            yield compared((FILE, part, name), Estimate(POWERS[key]()), Estimate(_number(entry)), POWER_STEP_DB)
        else:
            yield equal((FILE, part, name), "not looked at", _text(entry))
    yield Check(FILE, "file", "ber_formula", "", data["ber_formula"], unjudged="compared point by point: per_vs_snr")


def _text(entry: object) -> str:
    return str(entry.get("v", "")) if isinstance(entry, dict) else str(entry)


def _number(entry: Data) -> float:
    return float(entry["v"] if "v" in entry else entry["ns3_dbm"].rpartition("=> ")[2].split()[0])


def _broadcast(_: object) -> Pair:
    """A broadcast is transmitted once, whoever hears it, and does not ask for an acknowledgement."""
    return probe.transmissions_unanswered(None), 1


def _assessment(entry: Data) -> Pair:
    us = [microseconds(probe.assessment_ns()), microseconds(probe.assessed_ns(CAPTURE))]
    return us, [float(entry["us"])] * 2


def _cca_modes(_: object) -> Pair:
    """Energy, or locked on a frame however weak; a frame that cannot be locked on, for the awgn mode, is nothing."""
    channel = channel_of(AWGN)
    noise = probe.noise_dbm(channel)
    weak, weaker = (probe.alone(noise + ratio_db) for ratio_db in (-4.9, -5.1))
    answers: list[Value] = [channel_busy(1_000_000, [frame], [], channel) for frame in (weak, weaker)]
    return answers, [True, False]


def _link_quality(_: object) -> Pair:
    """In awgn the probability of success in 255 parts, cut off; in capture_3db over eight values, all of the span."""
    parts: list[Value] = [link_quality(-80.0, p, AWGN) for p in (0.0, 0.25, 0.5, 1.0)]
    real = [link_quality(SENSITIVITY_DBM + db, 1.0, CAPTURE) for db in range(-1, 42)]
    return [*parts, min(real), max(real), len(set(real)) >= 8], [0, 63, 127, 255, 0, 255, True]


def _required_sensitivity(entry: Data) -> Pair:
    """The default; under one PSDU of 20 octets in a hundred is lost there, and over one in a hundred 0.1 dB lower.

    The standard counts the errors of the PSDU, without those of the header before it.
    """
    config = RadioConfig()
    lost = []
    for lower_db in (0.0, 0.1):
        frame = probe.alone(config.sensitivity_dbm - lower_db, 20 - PHY_HEADER_OCTETS)
        lost.append(1.0 - reception(frame, [frame], [], channel_of(config)).success)
    return [config.sensitivity_dbm, lost[0] < 0.01 < lost[1]], [float(entry["v"]), True]


def _idle_access(_: object) -> Pair:
    shortest, longest = (microseconds(probe.assessments(highest, 0)[0]) for highest in (False, True))
    turnaround = microseconds(probe.turnaround_ns())
    return [shortest + turnaround, longest + turnaround], [320.0, 2560.0]


def _path_loss(entry: str) -> Pair:
    assert entry.startswith("PL(d)=46.6777+10*3*log10(d/1m) dB, d>=1 m"), entry
    distances = [*range(1, 201), 0.5]
    theirs = [round(46.6777 + 30.0 * log10(max(d, 1.0)), 6) for d in distances]
    return [round(path_loss_db(d, EXPONENT), 6) for d in distances], theirs


def _us(measure: Callable[[], int]) -> Callable[[Data], Pair]:
    return lambda entry: (microseconds(measure()), float(entry["us"]))


def _plain(measure: Callable[[], Value]) -> Callable[[Data], Pair]:
    return lambda entry: (measure(), entry["v"])


MEASURED: dict[str, Callable[..., Pair]] = {
    "phy.bit_rate_bps": _plain(lambda: NS_PER_S // BIT),
    "phy.symbol_rate_sps": _plain(lambda: NS_PER_S // SYMBOL),
    "phy.symbol_us": _plain(lambda: SYMBOL // 1000),
    "phy.bits_per_symbol": _plain(lambda: SYMBOL // BIT),
    "phy.byte_us": _plain(lambda: OCTET // 1000),
    "phy.preamble_bytes": _plain(lambda: (SYNCHRONISATION - OCTET) // OCTET),
    "phy.sfd_bytes": _plain(lambda: SYNCHRONISATION // OCTET - 4),
    "phy.phr_bytes": _plain(lambda: (airtime(0) - SYNCHRONISATION) // OCTET),
    "phy.SHR_PHR_bytes": lambda entry: ([airtime(0) // OCTET, airtime(0) // 1000], [entry["v"], entry["us"]]),
    "phy.aMaxPHYPacketSize_bytes": lambda entry: (
        [PSDU_MAX, airtime(PSDU_MAX) // 1000],
        [entry["v"], entry["airtime_us"]],
    ),
    "phy.airtime_us": lambda _: (
        [airtime(octets) // 1000 for octets in range(128)],
        [32 * (6 + octets) for octets in range(128)],
    ),
    "phy.aTurnaroundTime_symbols": _us(probe.turnaround_ns),
    "phy.CCA_symbols": _assessment,
    "phy.rx_sensitivity_required_dbm": _required_sensitivity,
    "phy.CCA_modes": _cca_modes,
    "phy.tx_power": lambda entry: (RadioConfig().tx_power_dbm, float(entry["ns3_default_dbm"])),
    "phy.LQI": _link_quality,
    "phy.path_loss": _path_loss,
    "mac.aUnitBackoffPeriod_symbols": _us(probe.backoff_period),
    "mac.macMinBE": lambda entry: (probe.backoff_periods(0), 2 ** entry["v"] - 1),
    "mac.macMaxBE": lambda entry: (
        [probe.backoff_periods(busy) for busy in range(5)],
        [2**exponent - 1 for exponent in (3, 4, entry["v"], entry["v"], entry["v"])],
    ),
    "mac.macMaxCSMABackoffs": lambda entry: (probe.assessments_until_failure() - 1, entry["v"]),
    "mac.macMaxFrameRetries": lambda entry: (probe.transmissions_unanswered(2) - 1, entry["v"]),
    "mac.SIFS_symbols": lambda entry: ([microseconds(probe.space_ns(n)) for n in (11, 18)], [float(entry["us"])] * 2),
    "mac.LIFS_symbols": lambda entry: ([microseconds(probe.space_ns(n)) for n in (19, 127)], [float(entry["us"])] * 2),
    "mac.macAckWaitDuration_symbols": _us(probe.ack_wait_ns),
    "mac.ACK_PSDU_bytes": lambda entry: (probe.acknowledgement()[1], entry["v"]),
    "mac.ack_start_after_frame_end_us": lambda entry: (microseconds(probe.acknowledgement()[0]), float(entry["v"])),
    "mac.FCS_bytes": lambda entry: ([FCS_OCTETS, check_sequence(b"123456789")], [entry["v"], KERMIT]),
    "mac.MHR_short_intra_pan_bytes": lambda entry: (
        [HEADER_OCTETS, len(probe.empty_frame()) - FCS_OCTETS],
        [entry["v"]] * 2,
    ),
    "mac.max_payload_short_intra_pan": _plain(lambda: PAYLOAD_MAX),
    "mac.broadcast": _broadcast,
    "mac.worst_case_csma_until_failure_ms": lambda entry: (probe.failure_after_ns() / 1e6, entry["v"]),
    "mac.idle_channel_access_us": _idle_access,
}
"""What is exact: the key of the file, and how ours and the reference's are found."""

POWERS: dict[str, Callable[[], float]] = {
    "phy.rx_sensitivity_ns3_default_dbm": lambda: REFERENCE.sensitivity_dbm,
    "phy.noise_ns3_dbm": lambda: probe.noise_dbm(channel_of(AWGN)),
    "phy.ED_threshold": lambda: probe.least_energy_dbm(AWGN),
    "phy.min_SINR_to_lock_db": lambda: probe.least_ratio_to_lock_db(AWGN),
    "phy.co_channel_rejection_real_db": lambda: probe.least_ratio_to_survive_db(CAPTURE),
}
"""What is a power or a ratio, dB, found by trying."""
