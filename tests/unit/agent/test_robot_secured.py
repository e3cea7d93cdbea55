"""A robot and its lab must agree on the radio's security before the robot starts."""

import pytest

from rmr.bus import wire
from rmr.radio.frame import BROADCAST, DataFrame, decode
from rmr.radio.security import FRAMES_MAX, LIVES_MAX, SecurityError
from rmr_agent.bytecode import RefusedError
from rmr_agent.robot_setup import make_security

KEY = bytes(range(16))


def known(security=None, *, lives=0, lab="x"):
    radio = {"pan": 7, "seed": 1} | ({} if security is None else {"security": security})
    return wire.Map(lab, True, False, lives, 3, (1, 2), {}, radio, (), None, "waiting", ())


@pytest.mark.parametrize("security", [None, "none"])
def test_an_open_lab_and_a_robot_without_a_key_agree(security):
    assert make_security(1, known(security), 5, None) is None


def test_a_robot_without_a_key_does_not_start_in_a_secured_lab():
    with pytest.raises(RefusedError, match=r"secured \(enc-mic-64\): start the robot with --radio-key"):
        make_security(1, known("enc-mic-64"), 5, None)


@pytest.mark.parametrize("security", [None, "none"])
def test_robot_with_a_key_does_not_start_in_an_open_lab_or_one_announced_as_open(security):
    with pytest.raises(RefusedError, match="not secured: start the robot without --radio-key, or give the lab a key"):
        make_security(1, known(security), 5, KEY)


@pytest.mark.parametrize("security", ["enc-mic-16", "mic-64", 6, None, ["none"]])
def test_unknown_security_level_is_refused(security):
    message = known()._replace(radio={"pan": 7, "seed": 1, "security": security})
    with pytest.raises(RefusedError, match="in a way that this robot does not know"):
        make_security(1, message, 5, KEY)


def test_a_robot_that_was_started_too_often_in_one_run_says_so():
    assert make_security(1, known("enc-mic-64", lives=LIVES_MAX - 1), 5, KEY) is not None
    with pytest.raises(RefusedError, match="robot 1: the frame counter lasts for 256 starts in one run"):
        make_security(1, known("enc-mic-64", lives=LIVES_MAX), 5, KEY)


def spoken(security):
    return decode(security.protect(DataFrame(7, BROADCAST, 1, 0, False, b"hello")))


def test_keys_work_across_restarts_of_one_run_and_not_across_runs_or_labs():
    one = make_security(1, known("enc-mic-32"), 5, KEY)
    again = make_security(1, known("enc-mic-32", lives=1), 5, KEY)
    two = make_security(2, known("enc-mic-32"), 5, KEY)
    assert two.open(spoken(one)).payload == b"hello"
    frame = spoken(again)
    assert int.from_bytes(frame.payload[1:5], "little") == FRAMES_MAX
    assert two.open(frame).payload == b"hello"
    for told, run in ((known("enc-mic-32"), 6), (known("enc-mic-32", lab="y"), 5)):
        with pytest.raises(SecurityError) as refused:
            two.open(spoken(make_security(1, told, run, KEY)))
        assert refused.value.reason == "forged"
