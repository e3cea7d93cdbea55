"""A lab file's key: what it makes of the radio, and that it goes nowhere."""

import pytest
from world_labs import ROOM, complaints, lab_of

from rmr.bus import wire
from rmr.bus.process import Ending
from rmr.radio.security import LEVELS
from rmr_world.finding import LabError
from rmr_world.lab_file import radio_key
from rmr_world.schema import RadioSpec
from rmr_world.server import WorldServer

DIGITS = "00112233445566778899aabbccddeeff"


def secured(folder, settings, digits=DIGITS):
    (folder / "lab.key").write_text(digits)
    return lab_of(folder, ROOM + f"radio: {settings}\n")


@pytest.mark.parametrize(
    ("settings", "level"),
    [
        ("{key_file: lab.key}", "enc-mic-64"),
        ("{key_file: lab.key, security: enc-mic-32}", "enc-mic-32"),
        ("{key_file: lab.key, security: enc-mic-128}", "enc-mic-128"),
    ],
)
def test_key_file_is_relative_to_the_lab_file_and_defaults_to_8_octets_of_integrity(tmp_path, settings, level):
    lab = secured(tmp_path, settings)
    assert lab.radio.security == level
    assert radio_key(lab) == bytes.fromhex(DIGITS)


@pytest.mark.parametrize("settings", ["{}", "{security: none}"])
def test_a_lab_without_a_key_is_open(tmp_path, settings):
    lab = secured(tmp_path, settings)
    assert lab.radio.security == "none"
    assert radio_key(lab) is None


def test_the_names_of_levels_are_those_of_the_radio():
    names = RadioSpec.model_json_schema()["properties"]["security"]["anyOf"][0]["enum"]
    assert names == list(LEVELS)


def test_unused_key_and_unknown_security_level_are_mistakes(tmp_path):
    [unused] = complaints(tmp_path, ROOM + "radio: {security: none, key_file: lab.key}\n")
    assert unused.startswith("6:8: radio: ")
    assert "uses no key: remove security, or key_file" in unused
    [unknown] = complaints(tmp_path, ROOM + "radio: {security: enc-mic-16}\n")
    assert "radio.security: " in unknown
    assert "enc-mic-64" in unknown


def test_secured_lab_without_a_key_file_loads_and_starting_its_robots_names_what_is_missing(tmp_path):
    lab = secured(tmp_path, "{security: enc-mic-128}")
    with pytest.raises(LabError, match=r"lab\.yaml:6:19: radio\.security: enc-mic-128 needs a key: .*radio\.key_file"):
        radio_key(lab)


@pytest.mark.parametrize(("digits", "what"), [("xyz", "line 1"), (DIGITS[:-2], "30 hexadecimal digits instead of 32")])
def test_key_file_without_a_key_is_reported_at_its_place_in_the_lab_file(tmp_path, digits, what):
    lab = secured(tmp_path, "{key_file: lab.key}", digits)
    with pytest.raises(LabError) as wrong:
        radio_key(lab)
    message = str(wrong.value)
    assert "lab.yaml:6:19: radio.key_file: " in message
    assert what in message
    assert message.endswith("openssl rand -hex 16 > lab.key")


def test_setup_message_of_the_world_holds_the_security_level_but_not_the_key_or_its_file(tmp_path):
    lab = secured(tmp_path, "{key_file: lab.key}")
    told = WorldServer(lab, 1, None, Ending(), when_ready=False)._map
    assert told.radio["security"] == "enc-mic-64"
    octets = wire.encode(wire.WORLD_ID, 1, 1, told)
    assert b"enc-mic-64" in octets
    assert b"lab.key" not in octets
    assert bytes.fromhex(DIGITS) not in octets
    assert DIGITS.encode() not in octets
