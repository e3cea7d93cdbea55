"""Sessions on loopback: a router and its clients in one process, each behind `Bus`."""

import asyncio
import contextlib
import os
import socket
import socketserver
import stat
import struct
import threading
import time

import pytest
from bus_star import FRAME, free_endpoint, on_a_star, until

from rmr.bus import endpoint as endpoint_module
from rmr.bus import middleware, wire
from rmr.bus.admission import why_no_session
from rmr.bus.endpoint import BusError, check_endpoint, host_problem
from rmr.bus.middleware import POOLS_VARIABLE, NobodyThereError, open_client, open_router
from rmr.bus.occupant import who_listens
from rmr.bus.secret import make_secret, read_secret
from rmr.bus.session import open_bus, open_when_there


def test_what_one_client_publishes_reaches_the_other_through_the_router_in_order():
    async def scene(_router, one, two):
        heard = []
        two.subscribe("rmr/x/body/*/act", lambda key, message: heard.append((key, message)))
        await until(lambda: one.publish("rmr/x/body/1/act", wire.Act(0.0, 0.0, 0)) or heard)
        heard.clear()
        for stamp in range(100):
            one.publish("rmr/x/body/1/act", wire.Act(0.1, -0.2, stamp))
        await until(lambda: sum(bool(message.body.v) for _, message in heard) >= 100)  # the first may come twice
        bodies = [message.body for _, message in heard if message.body.v]
        assert bodies == [wire.Act(0.1, -0.2, stamp) for stamp in range(100)]
        assert {(key, message.sender, message.run) for key, message in heard} == {("rmr/x/body/1/act", 1, one.run)}
        assert two.losses.lost == 0

    on_a_star(scene)


def test_client_does_not_receive_its_own_messages():
    async def scene(router, one):
        heard = {"router": [], "one": []}
        router.subscribe("rmr/x/radio/0/0", lambda _, message: heard["router"].append(message.sender))
        one.subscribe("rmr/x/radio/0/0", lambda _, message: heard["one"].append(message.sender))

        def both():
            for bus in (router, one):
                bus.publish("rmr/x/radio/0/0", FRAME)
            return heard["router"] and heard["one"]

        await until(both)
        assert set(heard["router"]) == {1}
        assert set(heard["one"]) == {wire.WORLD_ID}

    on_a_star(scene, clients=1)


def test_unsubscribed_callback_is_not_called_and_messages_meanwhile_are_not_counted_lost():
    async def scene(_router, one, two):
        key, heard, marks = "rmr/x/radio/-1/3", [], []
        two.subscribe("rmr/x/truth", lambda _, message: marks.append(message))
        withdraw = two.subscribe(key, lambda _, message: heard.append(message.number))
        await until(lambda: one.publish(key, FRAME) or heard)
        withdraw()
        withdraw()
        heard.clear()
        for _ in range(5):
            one.publish(key, FRAME)
        await until(lambda: one.publish("rmr/x/truth", wire.Stop("")) or marks)
        assert heard == []
        two.subscribe(key, lambda _, message: heard.append(message.number))
        await until(lambda: one.publish(key, FRAME) or heard)
        assert heard[0] > 6
        assert (two.losses.lost, two.losses.repeated) == (0, 0)

    on_a_star(scene)


def test_messages_queued_before_unsubscribe_are_dropped_and_leave_no_stream():
    async def scene(_router, one, two):
        key, heard, late, put = "rmr/x/radio/0/0", [], [], two._inbox.put
        two._inbox.put = lambda take, item, patience=0: late.append((take, item)) if busy else put(take, item)
        busy = False
        withdraw = two.subscribe(key, lambda _, message: heard.append(message))
        await until(lambda: one.publish(key, FRAME) or heard)
        busy = True  # as if the loop took nothing more into its inbox
        await until(lambda: one.publish(key, FRAME) or late)
        heard.clear()
        withdraw()
        for take, item in late:
            take(item, 0)
        assert heard == []
        assert (key, 1) not in two.losses._streams

    on_a_star(scene)


def test_retired_publisher_continues_its_sequence_numbers():
    async def scene(_router, one, two):
        heard = []
        two.subscribe("rmr/x/truth", lambda _, message: heard.append(message.number))
        await until(lambda: one.publish("rmr/x/truth", wire.Stop("")) or heard)
        one.retire("rmr/x/truth")
        one.retire("rmr/x/truth")
        last = heard[-1]
        await until(lambda: one.publish("rmr/x/truth", wire.Stop("")) or heard[-1] > last)
        assert heard == sorted(set(heard))
        assert (two.losses.lost, two.losses.repeated) == (0, 0)

    on_a_star(scene)


def test_query_gets_a_reply_with_arrival_time_from_every_server():
    async def scene(router, one, two):
        def answer(message, arrived):
            return wire.Clock("running", arrived, message.sender)

        router.serve("rmr/a/clock", answer)
        two.serve("rmr/b/clock", answer)
        replies = []
        while len(replies) < 2:
            asked = time.monotonic_ns()
            replies = await one.ask("rmr/*/clock", wire.AskClock(), 1.0)
        assert {envelope.sender for envelope, _ in replies} == {wire.WORLD_ID, 2}
        assert [(envelope.body.state, envelope.body.stamp) for envelope, _ in replies] == [("running", 1)] * 2
        assert all(asked < envelope.body.arrived < received for envelope, received in replies)

    on_a_star(scene)


def test_query_without_server_returns_no_replies_at_once():
    async def scene(_router, one):
        async with asyncio.timeout(60.0):
            assert await one.ask("rmr/x/map/1", wire.AskMap(1, 1), 3600.0) == []

    on_a_star(scene, clients=1)


def test_unanswered_query_times_out():
    async def scene(router, one):
        router.serve("rmr/x/map/*", lambda message, arrived: None)
        await asyncio.sleep(0.05)
        assert await one.ask("rmr/x/map/1", wire.AskMap(1, 1), 0.2) == []

    on_a_star(scene, clients=1)


@pytest.mark.parametrize(
    ("key", "own", "forged"),
    [
        ("rmr/x/body/1/act", 1, 2),
        ("rmr/x/ops/1/status", 1, 2),
        ("rmr/x/ops/1/status", 1, wire.WORLD_ID),
        ("rmr/x/ops/world/status", wire.WORLD_ID, 1),
        ("rmr/x/load/operator/1", 1, 2),
    ],
)
def test_what_a_robot_says_on_its_own_key_in_the_name_of_another_is_counted_and_dropped(key, own, forged):
    """A router holds a robot with keys to its own keys of the bus, but does not read who it claims to be there."""

    async def scene(router, one):
        heard = []
        router.subscribe(f"{key.rpartition('/')[0]}/*" if "load" in key else key, lambda _, said: heard.append(said))
        raw = one._session
        say = {who: wire.encode(who, 7, 1, wire.Stop("")) for who in (own, forged)}
        await until(lambda: raw.put(key, say[forged]) or router.losses.malformed)
        assert router.losses.malformed_last == "not of the sender whose key it came on"
        await until(lambda: raw.put(key, say[own]) or heard)
        assert {message.sender for message in heard} == {own}

    on_a_star(scene, clients=1)


def test_who_asks_on_the_key_of_another_gets_no_answer_and_is_counted():
    async def scene(router, one, two):
        router.serve("rmr/x/map/*", lambda message, _: wire.Clock("running", message.sender, 0))
        answers = []
        while not answers:
            answers = await two.ask("rmr/*/map/2", wire.AskMap(2, 1), 1.0)
        assert [envelope.body.arrived for envelope, _ in answers] == [2]
        for key in ("rmr/x/map/2", "rmr/x/map/*", "rmr/x/**"):
            assert await one.ask(key, wire.AskMap(2, 1), 0.2) == []
        assert router.losses.malformed == 3
        assert router.losses.malformed_last == "not of the sender whose key it came on"

    on_a_star(scene)


def test_malformed_message_or_query_is_counted_and_dropped():
    async def scene(router, one):
        heard = []
        router.subscribe("rmr/x/truth", lambda _, message: heard.append(message))
        router.serve("rmr/x/map/*", lambda message, arrived: wire.Stop("never"))
        raw = one._session

        def disturb():
            raw.put("rmr/x/truth", b"\xc1 noise")
            return router.losses.malformed

        await until(disturb)
        before = router.losses.malformed
        raw.get("rmr/x/map/1", payload=b"noise", timeout=0.2)
        await until(lambda: router.losses.malformed > before)
        assert heard == []

    on_a_star(scene, clients=1)


def test_liveliness_tokens_include_earlier_ones_and_vanish_with_their_session():
    async def scene(router, one, two):
        one.declare_alive("rmr/x/alive/robot/1")
        seen = {}
        await asyncio.sleep(0.05)
        router.watch_alive("rmr/x/alive/robot/*", seen.__setitem__)
        withdraw = two.declare_alive("rmr/x/alive/robot/2")
        await until(lambda: seen == {"rmr/x/alive/robot/1": True, "rmr/x/alive/robot/2": True})
        withdraw()
        one.close()
        await until(lambda: seen == {"rmr/x/alive/robot/1": False, "rmr/x/alive/robot/2": False})

    on_a_star(scene)


def test_a_client_knows_when_it_loses_its_router_and_when_another_takes_its_place():
    async def play():
        endpoint = free_endpoint()
        router = open_bus(wire.WORLD_ID, listen=endpoint)
        one = open_bus(1, connect=endpoint)
        changes, seen = [], []
        one.on_transport = changes.append
        await until(lambda: one.connected)
        one.declare_alive("rmr/x/alive/robot/1")
        router.close()
        await until(lambda: changes[-1:] == [False])
        router = open_bus(wire.WORLD_ID, listen=endpoint)
        router.watch_alive("rmr/x/alive/robot/*", lambda key, alive: seen.append((key, alive)))
        await until(lambda: changes[-1:] == [True])
        await until(lambda: seen == [("rmr/x/alive/robot/1", True)])
        one.close()
        router.close()

    asyncio.run(play())


@pytest.mark.parametrize("chosen", [None, "()"])
def test_processes_that_are_started_from_here_have_the_threads_that_the_user_chose(monkeypatch, chosen):
    monkeypatch.delenv(POOLS_VARIABLE, raising=False)
    if chosen is not None:
        monkeypatch.setenv(POOLS_VARIABLE, chosen)

    async def scene(_router, _one):
        assert os.environ.get(POOLS_VARIABLE) == chosen

    on_a_star(scene, clients=1)


def lingering():
    """Return for each TCP connection of this process how long the thread that closes it waits, in seconds."""
    found = []
    for number in map(int, os.listdir("/dev/fd")):
        with contextlib.suppress(OSError):
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                with socket.socket(fileno=os.dup(number)) as one, contextlib.suppress(OSError):
                    one.getpeername()
                    octets = one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
                    found += [struct.unpack("ii", octets)] if one.family == socket.AF_INET else []
    return found


def test_a_connection_that_is_dead_holds_no_thread_that_reads_from_others():
    async def scene(_router, _one, _two):
        await until(lambda: len(lingering()) == 4 and {on for on, _ in lingering()} == {0})

    before = os.listdir("/dev/fd")
    on_a_star(scene)
    assert len(os.listdir("/dev/fd")) <= len(before) + 8, "zenoh keeps some of its own, and none is left of each look"


def test_after_closing_nothing_is_sent_and_nothing_arrives():
    async def scene(router, one):
        heard = []
        router.subscribe("rmr/x/truth", lambda _, message: heard.append(message))
        one.close()
        one.publish("rmr/x/truth", wire.Stop("late"))
        await asyncio.sleep(0.05)
        assert heard == []

    on_a_star(scene, clients=1)


def test_second_router_at_the_same_endpoint_fails_with_address_in_use():
    async def play():
        endpoint = free_endpoint()
        router = open_bus(wire.WORLD_ID, listen=endpoint)
        with pytest.raises(BusError, match="is in use"):
            open_bus(wire.WORLD_ID, listen=endpoint)
        router.close()

    asyncio.run(play())


def test_client_waits_for_its_router_and_reports_each_failed_attempt():
    async def play():
        endpoint = free_endpoint()
        with pytest.raises(NobodyThereError, match="nobody listens"):
            open_bus(1, connect=endpoint)
        told, routers = [], []

        def waiting():
            told.append(1)
            if len(told) == 2:
                routers.append(open_bus(wire.WORLD_ID, listen=endpoint))

        one = await open_when_there(1, endpoint, waiting)
        assert (len(told), one.is_client, routers[0].is_client) == (2, True, False)
        one.close()
        routers[0].close()

    asyncio.run(play())


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:17447", "tcp/[::1]:7447", "udp/robot-host.local:1", "ws/a:65535"])
def test_an_endpoint_is_protocol_host_and_port(endpoint):
    assert check_endpoint(endpoint) == endpoint


@pytest.mark.parametrize(
    "endpoint",
    ["", "7447", "127.0.0.1:7447", "tcp/127.0.0.1", "tcp/:7447", "tcp/a:0", "tcp/a:65536", "xyz/a:1", "tcp/a:1/b"],
)
def test_anything_else_is_no_endpoint_and_the_message_shows_one(endpoint):
    with pytest.raises(BusError, match=r"for example tcp/127\.0\.0\.1:17447"):
        check_endpoint(endpoint)


def test_a_protocol_that_rmr_does_not_use_is_refused_in_one_sentence():
    with pytest.raises(BusError, match=r"does not use quic; write tls for an endpoint with keys, or tcp, udp or ws"):
        check_endpoint("quic/host:1")


def test_an_endpoint_of_tls_without_keys_is_refused_in_one_sentence():
    endpoint = check_endpoint("tls/127.0.0.1:7447")
    for opened in (lambda: open_router(endpoint), lambda: open_client(endpoint, None)):
        with pytest.raises(BusError, match=f"{endpoint} needs keys, and this process has none"):
            opened()


def test_unknown_host_is_reported():
    assert host_problem("tcp/no-such-host.invalid:1") == ": there is no host no-such-host.invalid"
    assert host_problem("tcp/127.0.0.1:1") == host_problem("tcp/[::1]:1") == host_problem("tcp/localhost:1") == ""


def test_host_that_the_system_looks_for_without_end_is_told_in_bounded_time_and_not_looked_for_twice(monkeypatch):
    over = threading.Event()
    monkeypatch.setattr(endpoint_module, "RESOLVE_S_MAX", 0.05)
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_: over.wait())
    try:
        with pytest.raises(NobodyThereError, match="nobody listens at tcp/lost:1: there is no host lost"):
            open_bus(1, connect="tcp/lost:1")
        with pytest.raises(BusError, match="cannot use tcp/lost-too:1: there is no host lost-too"):
            open_bus(wire.WORLD_ID, listen="tcp/lost-too:1")
        monkeypatch.setattr(endpoint_module, "RESOLVE_S_MAX", 3600.0)
        assert host_problem("tcp/lost:1") == ": there is no host lost"
    finally:
        over.set()


@pytest.mark.medium
def test_listener_on_an_endpoint_is_identified(tmp_path):
    async def play():
        endpoint = free_endpoint()
        router = open_bus(wire.WORLD_ID, listen=endpoint)
        try:
            assert (await who_listens(endpoint)).startswith("a router without a world of rmr runs there")
        finally:
            router.close()
        make_secret(tmp_path / "secret")
        router = open_bus(wire.WORLD_ID, listen=endpoint, secret=read_secret(tmp_path / "secret"))
        try:
            assert (
                await who_listens(endpoint)
                == "a world or router with a secret runs there; end it, or choose another --listen"
            )
        finally:
            router.close()
        with mail_server() as foreign:
            said = await who_listens(foreign)
        assert said == "a program listens there that does not answer as a world does; choose another endpoint"

    asyncio.run(play())


class Banner(socketserver.BaseRequestHandler):
    """Greets, as servers of mail do."""

    def handle(self):
        self.request.sendall(b"220 ready\r\n")


@contextlib.contextmanager
def mail_server():
    """Serve, at the endpoint that it yields, something that is not zenoh."""
    with socketserver.TCPServer(("127.0.0.1", 0), Banner) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"tcp/127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def test_an_address_that_is_not_this_machines_cannot_be_listened_on():
    async def play():
        with pytest.raises(BusError, match=r"cannot use tcp/192\.0\.2\.1:7447"):
            open_bus(wire.WORLD_ID, listen="tcp/192.0.2.1:7447")

    asyncio.run(play())


def test_the_session_follows_the_rules_of_the_star():
    router = middleware.router_settings("tcp/127.0.0.1:1", [], None)
    client = middleware._client_settings("tcp/127.0.0.1:1", None)
    assert router["mode"] == "router"
    assert client["mode"] == "client"
    for each in (router, client):
        assert each["scouting/multicast/enabled"] is False
        assert each["transport/link/tx/lease"] == 3000
        assert each["connect/exit_on_failure"] is False


@pytest.mark.medium
def test_what_listens_at_an_endpoint_is_called_another_program_only_if_it_answers_as_one():
    silent = "has not answered within 0.5 s; it is a world that is stopped or busy, or another program"
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        assert silent in why_no_session(endpoint)
        assert silent in asyncio.run(who_listens(endpoint))
    assert why_no_session(endpoint) == why_no_session("udp/127.0.0.1:1") == ""
    with mail_server() as foreign:
        assert "a program listens there that does not answer as a world does" in why_no_session(foreign)
