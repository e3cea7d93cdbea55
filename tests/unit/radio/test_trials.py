"""The experiments with the radio: what their rows hold, and what must be true of any radio."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from rmr.radio.phy import RadioConfig
from rmr.radio.trials import REFERENCE, Row, Runs, contention, hidden, latency, link, overlap, storm

FILES = Path(__file__).parents[2] / "validation" / "reference"

BRIEF = Runs(REFERENCE, range(2))
RUNS: dict[str, Callable[[Runs], Row]] = {
    "contention": partial(contention.run, contention.Contention(3, 60.0, measured_s=2.0)),
    "contention, acknowledged": partial(contention.run, contention.Contention(3, 60.0, unicast=True, measured_s=2.0)),
    "contention, saturated": partial(contention.run, contention.Contention(3, None, measured_s=0.3)),
    "hidden_terminal": partial(hidden.run, hidden.Hidden("hidden", 50.0, measured_s=2.0)),
    "reply_storm": partial(storm.run, storm.Storm(5, 5.0, "disk")),
    "reply_storm, acknowledged": partial(storm.run, storm.Storm(5, 5.0, unicast=True)),
    "latency_single_hop": partial(latency.run, latency.Latency(count=20)),
    "capture_overlap": partial(overlap.run, overlap.Overlap(0.0, 100.0, count=20)),
    "psr_vs_distance": lambda runs: link.drawn(105.0, 61, runs, 20),
}


def reference_rows(name: str) -> Iterable[dict[str, Any]]:
    for series in json.loads((FILES / f"{name}.json").read_text())["series"]:
        series.pop("events_per_rep", None)  # of ns-3's own kernel
        yield from series.get("rows", [series])


def names(row: dict[str, Any]) -> list[str]:
    """Return the names of a row's fields and of their fields, but not of a histogram's bins."""
    nested = [f"{name}.{field}" for name, value in row.items() if isinstance(value, dict) for field in value]
    return sorted([*row, *(name for name in nested if not name.startswith("hist_"))])


def run(case: str, runs: Runs = BRIEF) -> Row:
    return RUNS[case](runs)


@pytest.mark.parametrize("case", RUNS)
def test_a_row_has_the_fields_of_the_reference(case: str) -> None:
    file, *_ = case.split(",")
    row = run(case)
    if file == "capture_overlap":
        del row["offset_us"]  # the reference groups its rows by it
    assert names(row) in [names(each) for each in reference_rows(file)]


@pytest.mark.parametrize("case", RUNS)
def test_the_same_seeds_give_the_same_row_in_whatever_order_they_are_run_and_others_another(case: str) -> None:
    def backwards(trial: Callable[[int], Any], seeds: Sequence[int]) -> Iterable[Any]:
        return [trial(seed) for seed in reversed(seeds)][::-1]

    row = run(case)
    assert json.loads(json.dumps(row)) == row
    assert run(case, replace(BRIEF, over=backwards)) == row
    if case != "capture_overlap":  # of 20 equal pairs two seeds may lose as many
        assert run(case, Runs(REFERENCE, range(7, 9))) != row


# ---- contention


def test_lone_sender_has_no_loss_and_no_channel_wait() -> None:
    row = contention.run(contention.Contention(1, 5.0, measured_s=20.0), Runs(seeds=range(1)))
    assert row["delivery_ratio_sink"]["mean"] == row["delivery_ratio_all_receivers"]["mean"] == 1.0
    assert row["channel_access_failure_ratio"]["mean"] == 0.0
    assert row["mean_e2e_ms"]["mean"] == pytest.approx(row["mean_access_delay_ms"]["mean"] + 2.144)
    assert row["p95_access_delay_ms"]["mean"] == 2.56


def test_a_saturated_sender_sends_a_frame_for_each_mean_backoff_airtime_and_space() -> None:
    row = contention.run(contention.Contention(1, None, measured_s=5.0), Runs(seeds=range(1)))
    assert row["throughput_sink_fps"]["mean"] == pytest.approx(1000 / (1.44 + 2.144 + 0.64), rel=0.02)


def test_a_frame_whose_acknowledgement_is_lost_is_delivered_once_and_is_a_duplicate() -> None:
    lossy = Runs(RadioConfig(loss=0.3), range(1))
    row = contention.run(contention.Contention(1, 20.0, unicast=True, measured_s=20.0), lossy)
    # Lost with all four attempts: 0.3^4; delivered, and the acknowledgement lost, so that it comes again: a third.
    assert row["delivery_ratio_sink"]["mean"] == pytest.approx(1 - 0.3**4, abs=0.02)
    assert 0.2 < row["duplicates_per_delivered"]["mean"] < 0.6
    assert row["attempts_per_transmitted_frame"]["mean"] > 1.5


def test_more_load_costs_more_frames_and_more_time() -> None:
    light, heavy = (
        contention.run(contention.Contention(10, fps, measured_s=2.0), Runs(seeds=range(1))) for fps in (20.0, 300.0)
    )
    assert heavy["delivery_ratio_sink"]["mean"] < light["delivery_ratio_sink"]["mean"] - 0.1
    assert heavy["mean_e2e_ms"]["mean"] > light["mean_e2e_ms"]["mean"] + 2.0


# ---- hidden stations and storms


def test_hidden_terminals_lose_more_frames_than_visible_ones() -> None:
    heard, unheard = (
        hidden.run(hidden.Hidden(case, 50.0, measured_s=5.0), Runs(seeds=range(2)))["both_delivery_ratio"]["mean"]
        for case in ("exposed_control", "hidden")
    )
    assert unheard < heard - 0.05


def test_hidden_stations_stand_where_the_reference_has_them_and_nearer_with_a_weaker_radio() -> None:
    assert hidden.distances("near_far_hidden", REFERENCE) == pytest.approx((90.0, 65.0))
    weaker = hidden.distances("hidden", replace(REFERENCE, tx_power_dbm=-30.0))
    assert weaker == pytest.approx((8.0, 8.0))  # 30 dB are a decade of distance
    with pytest.raises(ValueError, match="less than a metre"):
        hidden.distances("hidden", replace(REFERENCE, tx_power_dbm=-60.0))
    with pytest.raises(ValueError, match="reaches over 100000 m"):
        hidden.distances("exposed_control", RadioConfig(tx_power_dbm=40.0, sensitivity_dbm=-130.0, exponent=1.5))


@pytest.mark.parametrize("case", ["hidden", "near_far_hidden"])
def test_stations_that_would_hear_each_other_are_not_called_hidden(case: str) -> None:
    assert hidden.distances(case, RadioConfig(exponent=3.0))
    with pytest.raises(ValueError, match="A and C hear each other"):
        hidden.distances(case, RadioConfig(exponent=2.5))
    assert hidden.distances("exposed_control", RadioConfig(exponent=2.5))


def test_second_frame_stronger_than_any_distance_allows_is_refused() -> None:
    case = overlap.Overlap(-29.0, 1.0)
    assert overlap.second_m(case, RadioConfig(exponent=3.0)) == pytest.approx(1.08, abs=0.01)
    with pytest.raises(ValueError, match="write -20 or more"):
        overlap.second_m(case, RadioConfig(exponent=2.0))


def test_answers_that_take_their_time_arrive() -> None:
    hasty, patient = (
        storm.run(storm.Storm(20, jitter_ms), Runs(seeds=range(10)))["reply_delivery_ratio"]["mean"]
        for jitter_ms in (0.0, 1000.0)
    )
    assert hasty < 0.5
    assert patient > 0.95


def test_a_storm_counts_from_the_first_symbol_of_the_discovery() -> None:
    # 20 octets are 1.184 ms on the air; an answer at once begins 0.32 ms later at the earliest and takes 2.144 ms.
    row = storm.run(storm.Storm(1, 0.0), Runs(seeds=range(20)))
    assert 1.184 + 0.32 + 2.144 <= row["last_reply_ms"]["mean"] <= 1.184 + 2.56 + 2.144
    assert row["all_replies_received_prob"]["k"] == 20


# ---- overlap, latency, link


def test_two_frames_of_equal_power_survive_as_noise_and_destroy_each_other_as_real_radios_have_it() -> None:
    case = overlap.Overlap(0.0, 100.0, count=50)
    assert overlap.run(case, Runs(REFERENCE, range(1)))["first_ok"]["p"] > 0.8
    assert overlap.run(case, Runs(seeds=range(1)))["first_ok"]["p"] == 0.0
    assert overlap.run(replace(case, sir_db=6.0), Runs(seeds=range(1)))["first_ok"]["p"] == 1.0


def test_a_second_frame_that_begins_after_the_first_is_received_too() -> None:
    row = overlap.run(overlap.Overlap(0.0, 2144.0, count=20), Runs(seeds=range(1)))
    assert row["first_ok"]["k"] == row["second_ok"]["k"] == 20


@pytest.mark.parametrize(("unicast", "answer_us"), [(False, 0), (True, 544)])
def test_alone_on_the_channel_a_frame_takes_one_of_eight_times(unicast: bool, answer_us: int) -> None:
    row = latency.run(latency.Latency(50, unicast, 300), Runs(seeds=range(1)))
    access = range(320, 2561, 320)
    assert list(row["hist_access_us"]) == [str(us) for us in access]
    assert list(row["hist_oneway_us"]) == [str(us + 2144) for us in access]
    assert list(row["hist_confirm_us"]) == [str(us + 2144 + answer_us) for us in access]
    assert row["delivered"] == sum(row["hist_access_us"].values()) == 300


def test_as_many_frames_arrive_as_the_formulas_say() -> None:
    row = link.drawn(105.0, 61, Runs(REFERENCE, range(1)), 1000)
    assert 0.7 < row["success"] < 0.9
    low, high = row["ci95"]
    assert low <= link.at_distance(105.0, 61, REFERENCE)["success"] <= high


def test_losses_come_on_top_and_shadowing_blurs_the_border() -> None:
    config = RadioConfig()
    near, far = (link.at_distance(metres, 61, config)["success"] for metres in (10.0, 25.0))
    assert near == pytest.approx(1.0)
    assert far == pytest.approx(0.0, abs=1e-3)
    assert link.at_distance(10.0, 61, replace(config, loss=0.25))["success"] == pytest.approx(0.75)
    shadowed = replace(config, shadowing_db=6.0)
    assert link.at_distance(10.0, 61, shadowed)["success"] < 0.99
    assert link.at_distance(25.0, 61, shadowed)["success"] > 0.1


# ---- what cannot be run


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: contention.Contention(0, 10.0), "0 senders: write 1 to 1000"),
        (lambda: contention.Contention(10, 0.0), "0 frames/s offered"),
        (lambda: contention.Contention(10, 1e-320), "frames/s offered: write 1e-06 to 100000"),
        (lambda: contention.Contention(10, float("nan")), "nan frames/s offered"),
        (lambda: contention.Contention(10, 10.0, payload=117), "117 octets: a frame carries 0 to 116"),
        (lambda: contention.Contention(10, 10.0, measured_s=0.0), "0 s: write more than 0"),
        (lambda: contention.Contention(10, 1e4, measured_s=1e4), "up to 100,000,000 frames a run, at most 5,000,000"),
        (lambda: contention.Contention(10, None, measured_s=1e4), "up to 24,000,000 frames a run"),
        (lambda: hidden.Hidden("hidden", 1e5, measured_s=100.0), "200000 frames/s offered"),
        (lambda: hidden.Hidden("hiding", 10.0), "write one of hidden, exposed_control, near_far_hidden"),
        (lambda: storm.Storm(1001, 10.0), "1001 members: write 1 to 1000"),
        (lambda: storm.Storm(10, -1.0), "a jitter of -1 ms"),
        (lambda: storm.Storm(10, 1.0, "square"), "write one of circle, disk"),
        (lambda: overlap.Overlap(40.0, 1.0), "a ratio of 40 dB: write -29 to 29"),
        (lambda: overlap.Overlap(1.0, -1.0), "an offset of -1 us"),
        (lambda: overlap.Overlap(1.0, 1.0, psdu=128), "a PSDU of 128 octets: a data frame has 11 to 127"),
        (lambda: latency.Latency(count=0), "0 frames: write 1 to"),
        (lambda: link.LinkTrial(-1.0), "a distance of -1 m"),
        (lambda: Runs(seeds=()), "at least one replication"),
        (lambda: Runs(seeds=[-1]), "seed -1: write 0 or more"),
    ],
)
def test_trial_settings_out_of_range_are_refused_with_the_limit(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        make()
