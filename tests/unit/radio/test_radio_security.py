"""Link security against the standard's own examples, and against whoever alters, repeats, cuts or forges frames."""

import subprocess
import sys

import pytest
from cryptography.hazmat.primitives.ciphers.aead import AESCCM
from radio_ether import MS, PAN, Ether, station

from rmr.radio.air import ACK_ATTEMPT, Announcement
from rmr.radio.frame import BROADCAST, FCS_OCTETS, PSDU_MAX, DataFrame, check_sequence, decode, encode_data
from rmr.radio.phy import airtime
from rmr.radio.receive_filter import DUPLICATE_WINDOW
from rmr.radio.security import (
    FRAMES_MAX,
    LIVES_MAX,
    Level,
    Security,
    SecurityError,
    extended_address,
    run_key,
)

KEY = bytes(range(0xC0, 0xD0))
"""The key of the standard's examples."""
OTHER_KEY = bytes(range(16))
SECOND = 1000 * MS
REFUSED = ("forged", "replayed", "unsecured", "malformed")


def frame(payload: bytes = b"hello", *, to: int = 2, source: int = 1, sequence: int = 3) -> DataFrame:
    return DataFrame(PAN, to, source, sequence, to != BROADCAST, payload)


def secured(address: int, *, level: Level = Level.ENC_MIC_64, key: bytes = KEY, life: int = 0) -> Security:
    return Security(level, key, address, life)


def opened(security: Security, psdu: bytes) -> DataFrame:
    decoded = decode(psdu)
    assert isinstance(decoded, DataFrame)
    return security.open(decoded)


def closed(body: bytes) -> bytes:
    """Return `body` with a right check sequence, as whoever alters a frame would send it."""
    return body + check_sequence(body).to_bytes(2, "little")


def refusal(security: Security, psdu: bytes) -> str:
    with pytest.raises(SecurityError) as refused:
        opened(security, psdu)
    return refused.value.reason


# --- the standard -------------------------------------------------------------------------------------------


def test_the_cipher_gives_the_standards_example_of_a_command_frame_at_level_6() -> None:
    # 802.15.4-2006, C.2.3: MIC of 8 octets, one encrypted octet, nonce of address, counter 5 and level.
    header = bytes.fromhex("2bdc842143020000000048deacffff010000000048deac060500000001")
    nonce = bytes.fromhex("acde480000000001 00000005 06")
    assert AESCCM(KEY, 8).encrypt(nonce, b"\xce", header).hex() == "d84fde529061f9c6f1"


def test_the_cipher_gives_the_standards_example_of_a_data_frame_at_level_4() -> None:
    # 802.15.4-2006, C.2.2: no MIC, which CCM* has and the library has not: the encrypted octets are the same.
    nonce = bytes.fromhex("acde480000000001 00000005 04")
    assert AESCCM(KEY, 4).encrypt(nonce, b"abcd", None)[:4].hex() == "d43e022b"


@pytest.mark.parametrize("level", list(Level))
def test_a_secured_frame_is_laid_out_as_the_standard_lays_it_out(level: Level) -> None:
    security = secured(1, level=level, life=2)
    security.protect(frame())
    psdu = security.protect(frame())
    # Data, security, acknowledgement wanted, PAN id compression; short addresses; frame version 1 (7.2.1.1).
    header = bytes.fromhex("6998 03 0700 0200 0100") + bytes((level,)) + bytes.fromhex("01000002")
    nonce = extended_address(PAN, 1) + bytes.fromhex("02000001") + bytes((level,))
    sealed = AESCCM(KEY, {5: 4, 6: 8, 7: 16}[level]).encrypt(nonce, b"hello", header)
    assert psdu == closed(header + sealed)
    assert b"hello" not in psdu


def test_every_station_has_an_extended_address_of_its_own() -> None:
    assert extended_address(0x1234, 0x00A6).hex() == "02524d52123400a6"
    assert len({extended_address(pan, address) for pan in (0, 1, 0x7FFF) for address in (0, 1, 255, 0xFFFD)}) == 12


@pytest.mark.parametrize(("level", "limit"), [(Level(5), 107), (Level(6), 103), (Level(7), 95)])
def test_payload_limit_of_a_secured_frame_is_reached_and_not_exceeded(level: Level, limit: int) -> None:
    security = secured(1, level=level)
    assert len(security.protect(frame(bytes(limit)))) == PSDU_MAX
    with pytest.raises(ValueError, match=f"at most {limit}"):
        security.protect(frame(bytes(limit + 1)))


@pytest.mark.parametrize("level", list(Level))
@pytest.mark.parametrize("payload", [b"", b"x", bytes(95)])
def test_protected_frame_decrypts_to_its_payload(level: Level, payload: bytes) -> None:
    psdu = secured(1, level=level).protect(frame(payload))
    assert opened(secured(2, level=level), psdu) == frame(payload)


# --- attacks on one frame -----------------------------------------------------------------------------------


def test_a_frame_with_any_one_bit_flipped_opens_nowhere() -> None:
    psdu = secured(1).protect(frame())
    body, receiver = psdu[:-FCS_OCTETS], secured(2)
    for bit in range(8 * len(body)):
        altered = bytearray(body)
        altered[bit // 8] ^= 1 << bit % 8
        try:
            decoded = decode(closed(bytes(altered)))
        except ValueError:
            assert bit < 16, "only another frame control makes it another kind of frame"
            continue
        assert isinstance(decoded, DataFrame)
        with pytest.raises(SecurityError) as refused:
            receiver.open(decoded)
        # Without the security bit it is unsecured, and so it is with another security control.
        assert refused.value.reason == ("unsecured" if bit == 3 or bit // 8 == 9 else "forged")
    assert opened(receiver, psdu) == frame()


def test_a_frame_cut_short_anywhere_opens_nowhere() -> None:
    psdu = secured(1).protect(frame())
    body, receiver = psdu[:-FCS_OCTETS], secured(2)
    reasons = [refusal(receiver, closed(body[:length])) for length in range(9, len(body))]
    assert reasons == ["unsecured"] + ["forged"] * (len(reasons) - 1)
    assert opened(receiver, psdu) == frame()


def test_a_frame_of_another_key_level_or_of_none_opens_nowhere() -> None:
    receiver = secured(2)
    assert refusal(receiver, secured(1, key=OTHER_KEY).protect(frame())) == "forged"
    assert refusal(receiver, secured(1, level=Level.ENC_MIC_32).protect(frame())) == "unsecured"
    assert refusal(receiver, secured(1, level=Level.ENC_MIC_128).protect(frame())) == "unsecured"
    assert refusal(receiver, encode_data(frame())) == "unsecured"
    assert refusal(receiver, encode_data(frame(bytes((Level.ENC_MIC_64,)) * 30))) == "unsecured"


def test_a_frame_in_the_name_of_another_source_or_network_opens_nowhere() -> None:
    psdu = secured(1).protect(frame())
    for at in (3, 5, 7):  # PAN, destination, source
        assert refusal(secured(2), closed(psdu[:at] + b"\x09\x00" + psdu[at + 2 : -FCS_OCTETS])) == "forged"


# --- replay -------------------------------------------------------------------------------------------------


def test_no_frame_opens_twice_nor_after_a_later_one_of_its_source() -> None:
    sender, receiver = secured(1), secured(2)
    first, second, third = (sender.protect(frame(sequence=k)) for k in range(3))
    assert opened(receiver, second).sequence == 1
    assert [refusal(receiver, psdu) for psdu in (second, first)] == ["replayed", "replayed"]
    assert opened(receiver, third).sequence == 2


def test_each_source_has_a_counter_of_its_own() -> None:
    receiver = secured(2)
    for source in (1, 3, 4):
        assert opened(receiver, secured(source).protect(frame(source=source))).source == source


def test_a_forged_frame_with_a_high_counter_does_not_lock_its_source_out() -> None:
    receiver = secured(2)
    assert refusal(receiver, secured(1, key=OTHER_KEY, life=200).protect(frame())) == "forged"
    assert opened(receiver, secured(1).protect(frame())) == frame()


def test_a_stations_own_frames_do_not_open_when_they_are_thrown_back_at_it() -> None:
    sender = secured(1)
    assert refusal(sender, sender.protect(frame(to=BROADCAST))) == "replayed"


def test_restarted_sender_is_received_at_once_and_its_earlier_incarnation_is_not() -> None:
    receiver, before = secured(2), secured(1, life=0)
    old, older = before.protect(frame()), [before.protect(frame()) for _ in range(3)]
    assert opened(receiver, old) == frame()
    assert opened(receiver, secured(1, life=1).protect(frame())) == frame()
    assert {refusal(receiver, psdu) for psdu in older} == {"replayed"}


# --- nonces -------------------------------------------------------------------------------------------------


def counter(psdu: bytes) -> int:
    return int.from_bytes(psdu[10:14], "little")


def test_frame_counter_ranges_of_incarnations_do_not_overlap() -> None:
    assert [counter(secured(1, life=life).protect(frame())) for life in (0, 1, LIVES_MAX - 1)] == [
        0,
        FRAMES_MAX,
        (LIVES_MAX - 1) * FRAMES_MAX,
    ]
    with pytest.raises(ValueError, match="256 starts in one run: begin a new run"):
        secured(1, life=LIVES_MAX)


@pytest.mark.parametrize(("life", "frames"), [(0, FRAMES_MAX), (LIVES_MAX - 1, FRAMES_MAX - 1)])
def test_incarnation_with_exhausted_frame_counter_sends_nothing(life: int, frames: int) -> None:
    one = secured(1, life=life)
    one._counter += frames - 1  # as after so many frames
    assert counter(one.protect(frame())) == life * FRAMES_MAX + frames - 1 < 0xFFFF_FFFF
    assert one.used_up
    with pytest.raises(ValueError, match="start the robot again"):
        one.protect(frame())


def test_a_station_whose_counter_is_used_up_confirms_a_failure_and_stays_silent() -> None:
    one = secured(1)
    one._counter = FRAMES_MAX - 1
    speaker = station(1, security=one)
    assert not speaker.mute
    for handle in (1, 2):
        speaker.request(0, b"x", None, handle)
    out = speaker.advance(SECOND, 0.0, 0.0)
    assert [(what.handle, what.status) for what in out if not isinstance(what, Announcement)] == [
        (2, "access_failure"),
        (1, "ok"),
    ]
    assert speaker.counters.access_failed == 1
    assert speaker.mute


def test_every_run_lab_and_host_has_a_key_of_its_own() -> None:
    keys = [
        run_key(KEY, "robots", "dash", 1),
        run_key(KEY, "robots", "dash", 2),
        run_key(KEY, "robots", "das", 1),
        run_key(KEY, "simulator", "dash", 1),
        run_key(OTHER_KEY, "robots", "dash", 1),
        KEY,
    ]
    assert len(set(keys)) == len(keys)
    assert {len(key) for key in keys} == {16}
    assert keys[0] == run_key(KEY, "robots", "dash", 1)


# --- stations -----------------------------------------------------------------------------------------------


def heard_by_a_victim(
    psdus: list[bytes], security: Security | None, *, apart: int = 10 * MS
) -> tuple[Ether, list[bytes]]:
    """Let a stranger transmit `psdus` at station 2; return the ether and what the node got."""
    ether = Ether([(0, 0)], secure=lambda address: security)
    victim = ether.stations[0]
    for k, psdu in enumerate(psdus):
        start = (k + 1) * apart
        ether.at(
            start,
            lambda start=start, k=k, psdu=psdu: victim.hear(
                Announcement(77, k, 0, start, start + airtime(len(psdu)), 0.0, 3.0, 0.0, psdu)
            ),
        )
    ether.run(len(psdus) * apart + SECOND)
    return ether, [received.payload for received in ether.received(0)]


def counts(ether: Ether) -> dict[str, int]:
    return {name: value for name, value in ether.stations[0].counters.as_dict().items() if value}


def test_altered_truncated_or_foreign_secured_frames_never_reach_the_node() -> None:
    to = 0
    body = secured(1).protect(frame(to=to))[:-FCS_OCTETS]
    flipped = [
        closed((int.from_bytes(body, "little") ^ 1 << bit).to_bytes(len(body), "little"))
        for bit in range(8 * len(body))
    ]
    mine = [psdu for psdu in flipped if psdu[3:7] == b"\x07\x00\x00\x00"]
    assert len(mine) == 8 * (len(body) - 4)
    cut = [closed(body[:length]) for length in range(9, len(body))]
    strange = [
        secured(1, key=OTHER_KEY).protect(frame(to=to)),
        secured(1, level=Level.ENC_MIC_32).protect(frame(to=to)),
        encode_data(frame(to=to)),
    ]
    attack = mine + cut + strange
    ether, node = heard_by_a_victim([*attack, closed(body), closed(body)], secured(0), apart=600 * MS)
    assert node == [b"hello"], "the true frame, once"
    found = counts(ether)
    assert found["replayed"] == 1, "the true frame again, long after"
    assert sum(found.get(name, 0) for name in REFUSED) == len(attack) + 1


def test_a_secured_frame_means_nothing_to_a_station_without_security() -> None:
    ether, node = heard_by_a_victim([secured(1).protect(frame(to=0))], None)
    assert node == []
    assert counts(ether)["unsecured"] == 1


def test_a_repeat_of_the_last_frame_is_a_duplicate_and_acknowledged_while_an_older_one_is_a_replay() -> None:
    sender = secured(1)
    first, second = (sender.protect(frame(to=0, sequence=k)) for k in (8, 9))
    ether, node = heard_by_a_victim([first, second, second, first], secured(0))
    assert node == [b"hello"] * 2
    found = counts(ether)
    assert (found["duplicates"], found["replayed"]) == (1, 1)
    assert found["acknowledgements"] == 4, "the standard acknowledges before it looks at security"


def test_the_last_frame_repeated_after_the_time_of_its_attempts_is_a_replay() -> None:
    psdu = secured(1).protect(frame(to=0))
    ether, node = heard_by_a_victim([psdu, psdu], secured(0), apart=DUPLICATE_WINDOW + 10 * MS)
    assert node == [b"hello"]
    assert counts(ether)["replayed"] == 1


def test_a_forged_frame_does_not_make_the_true_one_of_its_number_a_duplicate() -> None:
    forged = secured(1, key=OTHER_KEY).protect(frame(to=0))
    ether, node = heard_by_a_victim([forged, secured(1).protect(frame(to=0))], secured(0))
    assert node == [b"hello"]
    assert counts(ether)["forged"] == 1


def test_stations_with_one_key_talk_and_one_with_another_key_is_deaf_and_unheard() -> None:
    keys = (KEY, KEY, OTHER_KEY)
    ether = Ether([(0, 0), (3, 0), (0, 3)], secure=lambda address: secured(address, key=keys[address]))
    for who in range(3):
        ether.send((who + 1) * 100 * MS, who, b"from %d" % who)
        ether.send((who + 1) * 100 * MS + 50 * MS, who, b"to the next", to=(who + 1) % 3, handle=1)
    ether.run(2 * SECOND)
    assert [r.payload for r in ether.received(0)] == [b"from 1"]
    assert [r.payload for r in ether.received(1)] == [b"from 0", b"to the next"]
    assert ether.received(2) == []
    assert [one.counters.forged for one in ether.stations] == [2, 1, 3]


def test_a_retransmission_repeats_the_octets_of_its_frame() -> None:
    ether = Ether([(0, 0)], secure=secured)
    ether.send(0, 0, b"nobody answers", to=5)
    ether.run(SECOND)
    tries = [what.psdu for what in ether.announced(0)]
    assert len(tries) == 4
    assert len(set(tries)) == 1


def test_an_acknowledgement_is_as_short_as_ever() -> None:
    ether = Ether([(0, 0), (3, 0)], secure=secured)
    ether.send(0, 0, b"x", to=1)
    ether.run(SECOND)
    assert [len(what.psdu) for what in ether.announced(1, acks=True)] == [5]
    assert ether.announced(1, acks=True)[0].attempt & ACK_ATTEMPT


def test_a_payload_beyond_the_limit_is_refused_with_the_limit_in_the_message() -> None:
    speaker = station(1, security=secured(1))
    assert speaker.payload_max == 103
    with pytest.raises(ValueError, match="payload of 104 octets: split it into pieces of at most 103"):
        speaker.request(0, bytes(104), None, 0)


def test_a_station_without_a_key_loads_no_cryptography() -> None:
    code = (
        "import sys; from random import Random; from rmr.radio.station import Station;"
        "Station(1, 7, 5, Random(1)).request(0, b'x', None, 0);"
        "print([name for name in sys.modules if name.startswith(('cryptography', 'cffi'))])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
