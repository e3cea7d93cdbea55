"""Clients of the WebSocket: what they get, many of them, and those that do not read."""

import json
import socket
import time
from contextlib import ExitStack

import pytest
from served_page import ROBOTS, FilledSource, heard, served

from rmr_view.broadcast import QUEUED_MAX, EntryBatch, PageClient


def poses(i):
    return {robot: (robot + 0.001 * i, 1.0, 0.5) for robot in ROBOTS}


@pytest.fixture
def source():
    return FilledSource()


@pytest.fixture
def browser(source):
    with served(source) as browser:
        yield browser


def test_client_gets_the_present_at_once_and_then_what_is_new(source, browser):
    source.history.add_poses(1.0, poses(0))
    source.history.add_entries("trace", [{"t": 0.5, "robot": 1, "what": "asks"}])
    with browser.follow() as following:
        assert heard(following, "clock") == {"type": "clock", "t": 1.0, "end_s": 1.0, "running": True, "speed": 1.0}
        assert heard(following, "poses")["robots"]["3"] == [3.0, 1.0, 0.5]
        source.history.add_entries("trace", [{"t": 1.1, "robot": 1, "what": "at", "area": "exit"}])
        assert [entry["t"] for entry in heard(following, "trace")["entries"]] == [1.1]
        source.history.add_poses(1.2, poses(5))
        source.history.add_estimate(1.2, 2, (2.0, 1.0, 0.1))
        assert heard(following, "poses")["t"] == 1.2
        source.speed = 4.0
        assert heard(following, "clock")["speed"] == 4.0


def test_end_of_the_run_is_told_with_the_report_to_present_and_later_clients(source, browser):
    with browser.follow() as following:
        heard(following, "clock")
        source.report = {"finished": True}
        source.live = False
        while heard(following, "clock")["running"]:
            pass
        assert heard(following, "end") == {"type": "end", "report": {"finished": True}}
    with browser.follow() as later:
        assert heard(later, "end")["report"] == {"finished": True}


@pytest.mark.slow
def test_a_hundred_clients_follow_at_once(source, browser):
    with ExitStack() as stack:
        followers = [stack.enter_context(browser.follow(close_timeout=0.1)) for _ in range(100)]
        source.history.add_poses(2.0, poses(1))
        source.history.add_entries("frames", [{"t": 2.0, "source": 1}])
        for following in followers:
            while heard(following, "poses")["t"] != 2.0:
                pass
        for following in followers[:50]:
            following.socket.shutdown(socket.SHUT_RDWR)  # without a closing handshake
        source.history.add_poses(3.0, poses(2))
        for following in followers[50:]:
            while heard(following, "poses")["t"] != 3.0:
                pass
    assert browser.fetch("/api/run")[0] == 200


@pytest.mark.slow
def test_client_that_never_reads_is_sent_nothing_more_and_others_go_on(source, browser):
    deaf = socket.create_connection(("127.0.0.1", browser.port))
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.sendall(
        f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{browser.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    with deaf, browser.follow() as following:
        heard(following, "clock")
        wide = "x" * 2_000
        for i in range(20):
            source.history.add_entries("log", [{"t": float(i), "message": wide}] * 500)
            source.history.add_poses(float(i), poses(i))
            while heard(following, "poses")["t"] != i:
                pass
        began = time.process_time()
        source.history.add_poses(100.0, poses(3))
        while heard(following, "poses")["t"] != 100.0:
            pass
        assert time.process_time() - began < 5.0


async def waiting(client):
    return [json.loads(text) for text in await client.next_messages()]


def batch(first, size):
    entries = [{"t": float(first + i)} for i in range(size)]
    return EntryBatch("trace", json.dumps({"type": "trace", "entries": entries}), size, float(first))


@pytest.fixture
def client():
    return PageClient()


def run(coroutine):
    import asyncio

    return asyncio.run(coroutine)


def test_newest_poses_replace_those_that_wait(client):
    for i in range(1000):
        client.put_newest("poses", json.dumps({"t": i}))
    assert run(waiting(client)) == [{"t": 999}]


def test_entries_beyond_the_bound_are_dropped_and_the_client_is_told_from_when(client):
    for first in range(0, QUEUED_MAX + 500, 500):
        client.put_entries(batch(first, 500))
    assert run(waiting(client)) == [{"type": "lost", "kind": "trace", "begin_s": 0.0}]
    client.put_entries(batch(9000, 3))
    assert [len(message["entries"]) for message in run(waiting(client))] == [3]


def test_end_is_never_dropped(client):
    client.put_last(json.dumps({"type": "end"}))
    for first in range(0, 4 * QUEUED_MAX, 500):
        client.put_entries(batch(first, 500))
    assert run(waiting(client))[-1] == {"type": "end"}
