"""The results of `rmr radio` as text: the label of each field of a row, and its unit.

One table names all fields that are shown; a field that is not in it only stands in the JSON.
"""

from collections.abc import Iterator, Mapping
from math import inf
from typing import Any

NAMES: dict[str, tuple[str, str]] = {
    "delivery_ratio_sink": ("arrive at the sink", "%"),
    "channel_access_failure_ratio": ("find no free channel", "%"),
    "no_ack_ratio": ("are never acknowledged", "%"),
    "collision_loss_ratio_at_sink_given_transmitted": ("of those sent, do not arrive", "%"),
    "delivery_ratio_all_receivers": ("arrive at a station, mean of all", "%"),
    "duplicates_per_delivered": ("arrive twice", "%"),
    "throughput_sink_fps": ("arrive at the sink", "frames/s"),
    "mean_access_delay_ms": ("until on the air, mean", "ms"),
    "p95_access_delay_ms": ("until on the air, 95 of 100", "ms"),
    "mean_e2e_ms": ("until arrived, mean", "ms"),
    "p95_e2e_ms": ("until arrived, 95 of 100", "ms"),
    "p99_e2e_ms": ("until arrived, 99 of 100", "ms"),
    "mean_service_ms": ("time in the radio, mean", "ms"),
    "attempts_per_transmitted_frame": ("attempts of a frame on the air", ""),
    "delivery_ratio": ("arrive at B", "%"),
    "confirmed_over_offered": ("done with at the end", "%"),
    "caf_ratio": ("find no free channel", "%"),
    "attempts_per_offered": ("attempts of a frame", ""),
    "both_delivery_ratio": ("arrive at B, mean of both", "%"),
    "discovery_heard_ratio": ("members that hear the discovery", "%"),
    "reply_delivery_ratio": ("replies that arrive", "%"),
    "all_replies_received_prob": ("storms in which all replies arrive", "%"),
    "last_reply_ms": ("the last reply arrives after", "ms"),
    "median_reply_ms": ("half of the replies within", "ms"),
    "attempts_per_member": ("attempts of a reply", ""),
    "member_hears_other_reply_ratio": ("replies that another member hears", "%"),
    "first_ok": ("the first frame is received", "%"),
    "second_ok": ("the second frame is received", "%"),
    "access_ms": ("until on the air", "ms"),
    "oneway_ms": ("until arrived", "ms"),
    "confirm_ms": ("until confirmed", "ms"),
    "rx_dbm": ("power at the receiver (RSSI)", "dBm"),
    "snr_db": ("power over the noise", "dB"),
    "lqi": ("link quality (LQI), 0 to 255", ""),
    "ber": ("bits wrong", "%"),
    "per": ("frames lost", "%"),
    "success": ("frames received", "%"),
    "airtime_us": ("time on the air", "us"),
}
"""Field -> label and unit; with the unit ``%`` the field is a share."""

WIDTH = max(len(words) for words, _ in NAMES.values())


def row_text(row: Mapping[str, Any]) -> str:
    """Return the lines of a table."""
    return "".join(f"{line}\n" for line in _lines(row, ""))


def _lines(row: Mapping[str, Any], indent: str) -> Iterator[str]:
    for name, value in row.items():
        if name in NAMES:
            words, unit = NAMES[name]
            yield f"{indent}{words:{WIDTH}}{_value(value, unit)}".rstrip()
        elif isinstance(value, dict) and any(field in NAMES for field in value):
            yield f"{indent}{name}"
            yield from _lines(value, indent + "  ")


def _value(value: Any, unit: str) -> str:
    """Return a value with unit and confidence interval, or a distribution as mean, 95th percentile and maximum.

    All values with intervals are counts, times or shares: intervals are clipped to the possible range.
    """
    if not isinstance(value, dict):
        return f"{_number(value, unit)} {unit}"
    if "max" in value:
        mean, usual, longest = (_number(value[name], unit) for name in ("mean", "p95", "max"))
        return f"{mean} {unit}, 95 of 100 within {usual.strip()}, all within {longest.strip()}"
    if value.get("n_reps") == 0:
        return f"{'-':>9}"  # there was nothing to take it from, in no run
    middle = _number(value["mean"] if "mean" in value else value["p"], unit)
    if value["ci95"] is None:
        return f"{middle} {unit}"
    most = 1.0 if unit == "%" else inf
    low, high = (_number(min(max(end, 0.0), most), unit).strip() for end in value["ci95"])
    return f"{middle} {unit:8}  {low} .. {high}"


def _number(value: float, unit: str) -> str:
    return f"{100 * value:9.2f}" if unit == "%" else f"{value:9.2f}" if isinstance(value, float) else f"{value:9}"
