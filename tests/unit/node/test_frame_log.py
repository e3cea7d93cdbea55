"""The log of a robot's transmissions: requests, attempts and outcomes put together."""

import json

from rmr.node.frame_log import FrameLog
from rmr.node.payloads import PayloadKind
from rmr.radio.air import ACK_ATTEMPT, Announcement, Confirmed
from rmr.radio.frame import BROADCAST, DataFrame, encode_ack, encode_data
from rmr.radio.phy import airtime

MS = 10**6


def sent(sequence: int, start: int, *, destination: int = 2, attempt: int = 0) -> Announcement:
    frame = DataFrame(7, destination, 1, sequence, destination != BROADCAST, bytes([PayloadKind.FACT, 0]))
    psdu = encode_data(frame)
    return Announcement(1, sequence, attempt, start, start + airtime(len(psdu)), 0.0, 0.0, 0.0, psdu)


def logged(steps) -> list[dict]:
    """Return the frames that are written while `steps` are taken with a log."""
    found: list[dict] = []
    log = FrameLog(1, lambda _at, make: found.append(json.loads(make())))
    steps(log)
    return found


def test_a_unicast_that_is_acknowledged_at_its_second_attempt_is_written_twice():
    def steps(log):
        log.requested(MS, bytes([PayloadKind.FACT, 0]), 5)
        log.announced(sent(9, 2 * MS))
        log.announced(sent(9, 6 * MS, attempt=1))
        log.confirmed(8 * MS, Confirmed(5, "ok"))

    first, second = logged(steps)
    assert first == {
        "source": 1,
        "destination": 2,
        "kind": "fact",
        "octets": 13,
        "handle": 5,
        "asked_s": 0.001,
        "start_s": 0.002,
        "end_s": 0.002608,
        "attempt": 0,
        "outcome": None,
    }
    assert (second["attempt"], second["outcome"], second["asked_s"], second["start_s"]) == (1, "ok", 0.001, 0.006)


def test_a_broadcast_has_no_destination_and_an_outcome_of_its_own():
    def steps(log):
        log.requested(0, bytes([PayloadKind.HELLO]), 1)
        log.announced(sent(1, MS, destination=BROADCAST))
        log.confirmed(2 * MS, Confirmed(1, "ok"))

    [frame] = logged(steps)
    assert (frame["destination"], frame["kind"], frame["outcome"]) == (None, "hello", "broadcast")


def test_a_request_that_never_got_access_is_written_without_a_transmission():
    def steps(log):
        log.requested(MS, b"\x01", 1)
        log.confirmed(5 * MS, Confirmed(1, "access_failure"))

    [frame] = logged(steps)
    assert (frame["kind"], frame["start_s"], frame["end_s"], frame["outcome"]) == ("job", None, None, "access_failure")


def test_a_request_refused_by_a_full_queue_leaves_the_order_of_the_others():
    def steps(log):
        for handle in (1, 2, 3):
            log.requested(handle * MS, bytes([PayloadKind.FACT]), handle)
        log.confirmed(3 * MS, Confirmed(3, "access_failure"))
        log.announced(sent(1, 4 * MS))
        log.confirmed(6 * MS, Confirmed(1, "no_ack"))
        log.announced(sent(2, 7 * MS))
        log.confirmed(9 * MS, Confirmed(2, "ok"))

    assert [(frame["handle"], frame["outcome"]) for frame in logged(steps)] == [
        (3, "access_failure"),
        (1, "no_ack"),
        (2, "ok"),
    ]


def test_an_acknowledgement_is_a_transmission_without_a_request():
    psdu = encode_ack(4)
    ack = Announcement(1, 4, ACK_ATTEMPT | 2, MS, MS + airtime(len(psdu)), 0.0, 0.0, 0.0, psdu)
    [frame] = logged(lambda log: log.announced(ack))
    assert (frame["kind"], frame["handle"], frame["asked_s"], frame["attempt"]) == ("ack", None, None, 2)


def test_what_is_on_the_air_when_the_radio_is_switched_off_is_written_without_an_outcome():
    def steps(log):
        log.requested(0, bytes([PayloadKind.FACT]), 1)
        log.announced(sent(1, MS))
        log.end()
        log.requested(9 * MS, bytes([PayloadKind.FACT]), 1)
        log.announced(sent(1, 10 * MS))
        log.confirmed(12 * MS, Confirmed(1, "ok"))

    assert [(frame["asked_s"], frame["outcome"]) for frame in logged(steps)] == [(0.0, None), (0.009, "ok")]
