"""docs/radio-security.md says what the code says: levels and their cost, limits, counters."""

import re

import yaml
from doc_pages import blocks, codes, page, table

from rmr.radio.frame import PAYLOAD_MAX
from rmr.radio.receive_filter import DUPLICATE_WINDOW, Counters
from rmr.radio.security import FRAMES_MAX, LEVELS, LIVES_MAX, UNSECURED, extended_address
from rmr_world.lab import KEYED
from rmr_world.schema import RadioSpec

PAGE = page("radio-security")


def test_the_levels_are_documented_with_their_cost():
    rows = table(PAGE, "`radio.security`", "level", "integrity code", "a forgery succeeds once in", "payload")
    assert rows[0][:3] == (f"`{UNSECURED}`", "", "")
    assert rows[0][4] == f"{PAYLOAD_MAX} octets"
    assert [(codes(row[0])[0], row[1], row[2], row[4]) for row in rows[1:]] == [
        (name, str(int(level)), f"{level.code_octets} octets", f"{level.payload_max} octets")
        for name, level in LEVELS.items()
        if level is not None
    ]


def test_the_limits_are_those_of_the_code():
    text = " ".join(PAGE.split())
    assert f"started {LIVES_MAX} times in a run" in text
    assert f"A life has {FRAMES_MAX:,} frames".replace(",", " ") in text
    assert FRAMES_MAX == 2**24
    assert "times 2^24" in text
    assert f"within {DUPLICATE_WINDOW // 1_000_000} ms" in text
    assert f"`{extended_address(0, 0)[:4].hex(' ').upper()}`" in text


def test_the_counters_named_are_the_radios():
    named = set(re.findall(r"`frames\.(\w+)`", PAGE))
    assert {"forged", "replayed", "unsecured", "duplicates", "access_failed"} == named
    assert named <= set(Counters().as_dict())


def test_the_lab_files_example_is_what_it_says_it_is():
    settings = yaml.safe_load(blocks(PAGE, "yaml")[0])["radio"]
    assert RadioSpec.model_validate(settings).key_file == "lab.key"
    assert f"the same as security: {KEYED}" in PAGE
