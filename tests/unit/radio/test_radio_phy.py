"""Power, bit errors, lock, capture, half duplex and clear channel assessment."""

from math import comb, exp

import pytest
from radio_ether import US

from rmr.radio import phy
from rmr.radio.phy import (
    BIT,
    RadioConfig,
    ReceptionVerdict,
    Signal,
    airtime,
    bit_error_rate,
    channel_busy,
    channel_of,
    draw,
    interference,
    link_quality,
    locked_on,
    milliwatts,
    path_loss_db,
    reception,
    success_probability,
)

CAPTURE = channel_of(RadioConfig())
AWGN = channel_of(RadioConfig(interference="awgn"))
STRONG_DBM = -50.0


def signal(source: int, start_us: int, dbm: float = STRONG_DBM, length_us: int = 2144) -> Signal:
    return Signal(start_us * US, (start_us + length_us) * US, source, milliwatts(dbm))


def verdicts(*signals: Signal, channel=CAPTURE, deaf=()) -> list[ReceptionVerdict]:
    air = sorted(signals, key=lambda s: (s.start, s.source))
    return [reception(one, air, [(a * US, b * US) for a, b in deaf], channel) for one in signals]


@pytest.mark.parametrize(("octets", "us"), [(5, 352), (31, 1184), (61, 2144), (111, 3744), (127, 4256)])
def test_a_frame_takes_32_us_an_octet_and_six_octets_of_phy_header(octets: int, us: int) -> None:
    assert airtime(octets) == us * US


def test_path_loss_grows_by_thirty_decibels_a_decade_from_the_reference_metre_on() -> None:
    assert path_loss_db(1.0, 3.0) == path_loss_db(0.2, 3.0) == 46.6777
    assert path_loss_db(10.0, 3.0) == pytest.approx(76.6777)
    assert path_loss_db(100.0, 2.0) == pytest.approx(86.6777)


@pytest.mark.parametrize("ratio_db", [-6.0, -3.0, 0.0, 1.0, 3.0])
def test_the_bit_error_rate_follows_the_formula_of_the_standard(ratio_db: float) -> None:
    ratio = milliwatts(ratio_db)
    terms = [(-1) ** k * comb(16, k) * exp(20 * ratio * (1 / k - 1)) for k in range(2, 17)]
    assert bit_error_rate(ratio) == pytest.approx(8 / 15 / 16 * sum(terms), rel=1e-9)


def test_a_bit_is_a_coin_toss_among_sixteen_symbols_without_signal_and_certain_from_6_db_on() -> None:
    # Guessing one of 16 symbols: wrong 15 times in 16, and half of the bits of a wrong symbol (8/15) are wrong.
    assert bit_error_rate(0.0) == pytest.approx(8 / 15 * 15 / 16)
    assert bit_error_rate(4.0) < 1e-15
    assert success_probability(4.0, 1000) == 1.0


def test_at_the_sensitivity_a_frame_of_20_octets_is_lost_about_once_in_a_hundred_times() -> None:
    at_sensitivity = Signal(0, airtime(20), 1, milliwatts(-85.0))
    below = Signal(0, airtime(20), 1, milliwatts(-88.0))
    assert 0.985 < reception(at_sensitivity, [at_sensitivity], [], CAPTURE).success < 0.995
    assert reception(below, [below], [], CAPTURE).success < 0.2


def test_capture_effect_needs_three_decibels_and_equal_power_destroys_both_frames() -> None:
    assert [v.cause for v in verdicts(signal(1, 0), signal(2, 0))] == ["collision", "collision"]
    weaker, stronger = verdicts(signal(1, 0), signal(2, 0, STRONG_DBM + 3.01))
    assert (weaker.success, stronger.success) == (0.0, 1.0)
    stronger, weaker = verdicts(signal(1, 0, STRONG_DBM + 3.01), signal(2, 0))
    assert (stronger.success, weaker.success) == (1.0, 0.0)


def test_the_stronger_takes_the_receiver_from_a_frame_that_is_still_in_its_preamble() -> None:
    first, second = verdicts(signal(1, 0), signal(2, 150, STRONG_DBM + 10))
    assert (first.success, second.success) == (0.0, 1.0)


def test_a_receiver_that_has_locked_does_not_change_over_to_a_stronger_frame() -> None:
    first, second = verdicts(signal(1, 0), signal(2, 200, STRONG_DBM + 10))
    assert (first.success, second.success) == (0.0, 0.0)


def test_a_short_interferer_inside_a_locked_frame_destroys_it() -> None:
    locked, _ = verdicts(signal(1, 0), signal(2, 1000, length_us=352))
    assert locked == ReceptionVerdict(0.0, "collision")


def test_weak_interferers_add_up() -> None:
    for count, success in ((4, 1.0), (6, 0.0)):
        rest = [signal(2 + k, 100 * k, STRONG_DBM - 10) for k in range(count)]
        crowd = [signal(9, 600, STRONG_DBM - 6)] if count == 6 else []
        assert verdicts(signal(1, 0), *rest, *crowd)[0].success == success


def test_frames_that_only_touch_do_not_disturb_each_other() -> None:
    assert [v.success for v in verdicts(signal(1, 0), signal(2, 2144))] == [1.0, 1.0]


def test_a_frame_that_begins_while_the_receiver_is_locked_on_another_is_lost() -> None:
    _, late = verdicts(signal(1, 0), signal(2, 1900, STRONG_DBM + 20))
    assert late == ReceptionVerdict(0.0, "collision")


@pytest.mark.parametrize("deaf", [(-100, 1), (500, 600), (2143, 3000)])
def test_a_station_that_transmits_during_any_part_of_a_frame_does_not_receive_it(deaf: tuple[int, int]) -> None:
    assert verdicts(signal(1, 0), deaf=[deaf]) == [ReceptionVerdict(0.0, "deaf")]


def test_a_station_that_transmits_just_before_and_after_a_frame_receives_it() -> None:
    assert verdicts(signal(1, 0), deaf=[(-900, 0), (2144, 3000)])[0].success == 1.0


def test_as_noise_equal_power_is_mostly_survived_by_the_first_and_never_by_the_second() -> None:
    # At 0 dB the formula gives a bit error rate of 1.0e-4: (1 - 1.0e-4)^(8 * 67 bits) = 0.948; ns-3: 0.94.
    first, second = verdicts(signal(1, 0, -30), signal(2, 1, -30), channel=AWGN)
    assert first.success == pytest.approx((1 - bit_error_rate(1.0)) ** 536, rel=1e-3)
    assert 0.9 < first.success < 0.96
    assert second == ReceptionVerdict(0.0, "collision")


def test_as_noise_each_stretch_of_interference_counts_by_its_own_length() -> None:
    whole, _ = verdicts(signal(1, 0, -30), signal(2, 0, -31), channel=AWGN)
    half, _ = verdicts(signal(1, 0, -30), signal(2, 1072, -31), channel=AWGN)
    assert half.success == pytest.approx(whole.success**0.5, rel=1e-9)


def test_interference_sums_are_skipped_for_frames_that_cannot_be_locked_on(monkeypatch: pytest.MonkeyPatch) -> None:
    summed = []
    monkeypatch.setattr(phy, "interference", lambda *arguments: summed.append(1) or interference(*arguments))
    crowd = [signal(source, source) for source in range(100)]
    assert set(verdicts(*crowd)) == {ReceptionVerdict(0.0, "collision")}
    assert not summed
    assert verdicts(signal(1, 0, -40), *(signal(source, source, -60) for source in range(2, 52)))[0].success == 1.0
    assert summed


def test_as_noise_the_stronger_of_two_frames_that_start_together_is_locked_on() -> None:
    weak, strong = verdicts(signal(1, 0, -33), signal(2, 0, -30), channel=AWGN)
    assert weak == ReceptionVerdict(0.0, "collision")
    assert strong.success > 0.99


def test_stretches_of_interference_cover_the_frame_and_sum_what_is_present() -> None:
    others = [signal(2, -10, 0.0, 20), signal(3, 5, 0.0, 10)]
    assert interference(0, 20 * US, others) == [(5 * US, 1.0), (5 * US, 2.0), (5 * US, 1.0), (5 * US, 0)]


def test_a_bit_lasts_four_microseconds() -> None:
    assert airtime(61) / BIT == 8 * 67


def test_the_channel_is_busy_while_a_frame_that_can_be_received_is_in_the_window() -> None:
    loud, faint = signal(1, 0, -84.9), signal(1, 0, -92.0)
    assert channel_busy(1 * US, [loud], [], CAPTURE)
    assert channel_busy(2271 * US, [loud], [], CAPTURE)  # its last microsecond lies inside the window
    assert not channel_busy(2272 * US, [loud], [], CAPTURE)
    assert not channel_busy(0, [loud], [], CAPTURE)
    assert not channel_busy(1000 * US, [faint], [], CAPTURE)


def test_the_channel_is_busy_while_signals_too_weak_to_receive_add_up_to_the_energy_threshold() -> None:
    channel = channel_of(RadioConfig(energy_threshold_db=-5.0))
    assert not channel_busy(100 * US, [signal(1, 0, -91.0)], [], channel)
    assert channel_busy(100 * US, [signal(k, 0, -91.0) for k in (1, 2)], [], channel)


def test_in_mode_awgn_a_receivable_frame_that_was_not_locked_on_counts_by_its_energy_alone() -> None:
    missed = [(-20 * US, 20 * US)]  # transmitting when it began
    assert channel_busy(500 * US, [signal(1, 0, -74.9)], missed, AWGN)
    assert not channel_busy(500 * US, [signal(1, 0, -75.1)], missed, AWGN)
    assert channel_busy(500 * US, [signal(1, 0, -75.1)], [], AWGN)


def test_the_channel_is_busy_while_the_receiver_is_locked_on_a_frame_below_the_sensitivity() -> None:
    quiet = signal(1, 0, -88.0)
    assert not channel_busy(159 * US, [quiet], [], CAPTURE)
    assert channel_busy(161 * US, [quiet], [], CAPTURE)
    assert locked_on(161 * US, [quiet], [], CAPTURE) is quiet


def test_a_frame_that_ends_inside_the_window_is_missed_only_in_mode_awgn() -> None:
    loud = signal(1, 0, -60)
    assert channel_busy(2200 * US, [loud], [], CAPTURE)
    assert not channel_busy(2200 * US, [loud], [], AWGN)


def test_a_station_that_transmits_takes_the_channel_for_busy() -> None:
    assert channel_busy(100 * US, [], [(0, 50 * US)], CAPTURE)


def test_link_quality_spans_its_octet() -> None:
    assert [link_quality(dbm, 1.0, RadioConfig()) for dbm in (-90.0, -85.0, -65.0, -45.0, 0.0)] == [
        0,
        0,
        128,
        255,
        255,
    ]
    assert link_quality(-60.0, 0.5, RadioConfig(interference="awgn")) == 127


def test_a_draw_depends_on_each_of_its_arguments_and_is_fair() -> None:
    base = (7, 1, 2, 0, 3)
    others = [tuple(v + (k == at) for k, v in enumerate(base)) for at in range(5)]
    assert len({draw(*arguments) for arguments in [base, *others]}) == 6
    draws = [draw(7, source, sequence, 0, 3) for source in range(10) for sequence in range(1000)]
    for half in ([word >> 32 for word in draws], [word & 0xFFFFFFFF for word in draws]):
        assert sum(half) / len(half) / 2**32 == pytest.approx(0.5, abs=0.01)
        assert sum(word < 0.2 * 2**32 for word in half) / len(half) == pytest.approx(0.2, abs=0.012)


def test_draws_of_high_addresses_differ() -> None:
    assert len({draw(7, source, 0, 0, receiver) for source in range(0, 65536, 256) for receiver in (1, 65533)}) == 512


@pytest.mark.parametrize("wrong", [{"interference": "magic"}, {"loss": 1.5}])
def test_a_wrong_configuration_says_what_to_write(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="write"):
        RadioConfig(**wrong)
