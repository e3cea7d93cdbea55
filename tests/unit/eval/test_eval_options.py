"""The values of the options of `rmr eval`: what they mean, and what is said of one that is none."""

import pytest

from rmr.base.time import milliseconds, seconds
from rmr.eval.options import DURATION_S_MAX, OptionError, duration, outside_event, robots, share


@pytest.mark.parametrize(
    ("text", "ids"),
    [
        ("1", (1,)),
        ("4", (1, 2, 3, 4)),
        ("0-5,9", (0, 1, 2, 3, 4, 5, 9)),
        ("0-0", (0,)),
        ("9, 2-3", (2, 3, 9)),
        ("65533-65533", (65533,)),
    ],
)
def test_robots_are_a_number_or_ids_in_ascending_order(text, ids):
    assert robots(text) == ids


def test_as_many_robots_as_there_are_ids_are_possible():
    assert len(robots("65533")) == 65533


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0", "1 to 65533 robots, not '0'; write 0-0 for robot 0 alone"),
        ("65534", "1 to 65533 robots"),
        ("9" * 5000, "1 to 65533 robots"),
        ("-3", "'-3' is no id and no range of ids"),
        ("", "'' is no id"),
        ("1,,2", "'' is no id"),
        ("1,two", "'two' is no id"),
        ("7-3", "the range 7-3 ends before it begins; write 3-7"),
        ("1,1-2", "robot 1 is listed twice"),
        ("1-70000", "there is no robot 70000: ids are 0 to 65533"),
        ("٣", "is no id"),
    ],
)
def test_invalid_robots_option_is_refused_with_the_reason(text, message):
    with pytest.raises(OptionError, match=message):
        robots(text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("60s", seconds(60)),
        ("500ms", milliseconds(500)),
        ("1.5min", seconds(90)),
        ("2", seconds(2)),
        ("0", 0),
        ("0.25", milliseconds(250)),
        ("1e-3s", milliseconds(1)),
        (" 5ms ", milliseconds(5)),
    ],
)
def test_durations_are_those_of_the_language_and_plain_numbers_are_seconds(text, value):
    assert duration(text) == value


@pytest.mark.parametrize("text", ["", "s", "-1s", "5 hours", "1h", "1 s", "nan", "inf", "1_000", "0x10", "५s"])
def test_invalid_duration_is_refused_with_examples(text):
    with pytest.raises(OptionError, match=r"is no duration; write 500ms, 2s, 1\.5min, or a number of seconds"):
        duration(text)


@pytest.mark.parametrize("text", ["1e999", f"{DURATION_S_MAX * 10:.0f}s"])
def test_a_duration_beyond_all_runs_is_refused(text):
    with pytest.raises(OptionError, match="too long"):
        duration(text)


def test_shares_lie_from_0_to_1():
    assert [share(text) for text in ("0", "0.1", "1")] == [0.0, 0.1, 1.0]


@pytest.mark.parametrize("text", ["1.1", "-0.1", "10%", "nan", "", "half"])
def test_invalid_share_is_refused_with_an_example(text):
    with pytest.raises(OptionError, match=r"a share from 0 to 1, not .*; 0\.1 loses one frame in ten"):
        share(text)


def test_an_outside_event_of_octets_that_are_no_text_is_refused():
    assert outside_event('1s: say(@1, "\u00e9\U0001f600")')[1] == 'say(@1, "\u00e9\U0001f600")'
    with pytest.raises(OptionError, match="is not UTF-8"):
        outside_event(b'1s: say(@1, "\xff")'.decode("utf-8", "surrogateescape"))


def test_an_outside_event_is_an_instant_and_a_fact():
    assert outside_event("2.5s: online(@3, l1)") == (seconds(2.5), "online(@3, l1)")
    assert outside_event('1:say(@1, "a: b")') == (seconds(1), 'say(@1, "a: b")')


@pytest.mark.parametrize("text", ["", "online(@3, l1)", "2s", "2s:", "2s:  "])
def test_an_event_without_an_instant_or_without_a_fact_is_refused(text):
    with pytest.raises(OptionError, match=r"is no time and fact; write '2\.5s: online"):
        outside_event(text)


def test_a_wrong_value_is_not_repeated_at_full_length():
    with pytest.raises(OptionError) as caught:
        duration("x" * 10_000)
    assert len(str(caught.value)) < 150
