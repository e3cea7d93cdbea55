"""Foxglove live: channels, subscriptions, time, both sub-protocols, slow and hostile clients, a run under way."""

import asyncio
import json
import shutil
import signal
import struct
import subprocess
import sys
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from socket import SO_RCVBUF, SOL_SOCKET, create_server, socket

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from rmr.record.channels import CHANNELS, schema_of
from rmr.record.record_writer import RecordWriter
from rmr.record.recording import open_recording
from rmr.record.run_about import about_run
from rmr_sim.main import main as sim_main
from rmr_view import foxglove_server, view
from rmr_view.foxglove_server import (
    ADVERTISED,
    LAG_S,
    NUMBERS,
    FoxgloveClient,
    FoxgloveServer,
    LiveFeed,
    RecordedFeed,
    serve_foxglove,
)

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
V1 = "foxglove.websocket.v1"
SDK = "foxglove.sdk.v1"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a simulated run of the corridor."""
    folder = tmp_path_factory.mktemp("runs") / "corridor"
    assert sim_main([str(ROOT / "deploy/labs/corridor"), "--run", str(folder)]) == 0
    return folder


@asynccontextmanager
async def serving(feed):
    """Serve `feed` within the block; give the address and the server."""
    sock = create_server(("127.0.0.1", 0))
    server = FoxgloveServer(feed)
    task = asyncio.create_task(server.run(sock))
    try:
        yield f"ws://127.0.0.1:{sock.getsockname()[1]}", server
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


def client(address, protocol=SDK, **options):
    return connect(address, subprotocols=[protocol], compression=None, close_timeout=0.1, **options)


@contextmanager
def client_that_never_reads(address, request):
    """Connect with a small buffer, send `request`, and leave everything that comes in the socket."""
    with socket() as sock:
        sock.setsockopt(SOL_SOCKET, SO_RCVBUF, 4096)
        sock.connect(("127.0.0.1", int(address.rpartition(":")[2])))
        head = f"GET / HTTP/1.1\r\nHost: here\r\nSec-WebSocket-Protocol: {SDK}\r\nSec-WebSocket-Version: 13\r\n"
        upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
        frame = struct.pack(">BBHI", 0x81, 0x80 | 126, len(request), 0) + request.encode()
        sock.sendall((head + upgrade).encode() + frame)
        yield


def subscribing(*topics):
    wanted = [{"id": 100 + NUMBERS[topic], "channelId": NUMBERS[topic]} for topic in topics]
    return json.dumps({"op": "subscribe", "subscriptions": wanted})


async def told(connection, op):
    """Return the next message of the protocol with that word."""
    while True:
        message = await connection.recv()
        if isinstance(message, str) and json.loads(message)["op"] == op:
            return json.loads(message)


async def data_of(connection, count):
    """Return the next `count` messages of subscribed channels: topic, instant and content."""
    found = []
    while len(found) < count:
        message = await connection.recv()
        if isinstance(message, bytes) and message[0] == 1:
            _, subscription, at = struct.unpack_from("<BIQ", message)
            found.append((ADVERTISED[subscription - 100].topic, at, json.loads(message[13:])))
    return found


def played(run, speed=1000.0):
    return RecordedFeed(open_recording(run), speed)


@pytest.mark.parametrize("protocol", [V1, SDK])
def test_client_is_told_the_channels_with_their_schemas_under_either_protocol(run, protocol):
    async def check():
        async with serving(played(run)) as (address, _), client(address, protocol) as connection:
            assert connection.subprotocol == protocol
            info = await told(connection, "serverInfo")
            assert info["name"] == "rmr: corridor, simulated, seed 7"
            assert info["capabilities"] == ["time"]
            channels = (await told(connection, "advertise"))["channels"]
            assert [each["topic"] for each in channels] == [c.topic for c in CHANNELS if c.encoding == "json"]
            for each in channels:
                assert (each["schemaEncoding"], each["schema"].encode()) == schema_of(each["topic"])
                assert json.loads(each["schema"])["type"] == "object"

    asyncio.run(check())


def test_subscribed_channels_bring_every_message_of_the_recording_in_order_and_no_other(run):
    wanted = [(m.topic, m.at, m.data) for m in open_recording(run).messages(["/tf", "/trace"])]

    async def check():
        async with serving(played(run, 20.0)) as (address, _), client(address) as connection:
            await connection.send(subscribing("/tf", "/trace"))
            assert await data_of(connection, len(wanted)) == wanted

    asyncio.run(check())


def test_end_of_the_recording_is_told(run):
    async def check():
        async with serving(played(run)) as (address, _), client(address) as connection:
            await connection.send(subscribing("/tf"))
            assert "the run is over" in (await told(connection, "status"))["message"]

    asyncio.run(check())


def test_time_is_told_and_follows_the_recording(run):
    async def check():
        async with serving(played(run)) as (address, _), client(address) as connection:
            await connection.send(subscribing("/tf"))
            while True:
                message = await connection.recv()
                if isinstance(message, bytes) and message[0] == 2:
                    [at] = struct.unpack_from("<Q", message, 1)
                    if at > 20 * 10**9:
                        assert at <= open_recording(run).span[1]
                        return

    asyncio.run(check())


def test_late_subscriber_gets_the_scene_and_the_floor_which_are_written_once(run):
    async def check():
        async with serving(played(run)) as (address, _), client(address) as first:
            await first.send(subscribing("/tf"))
            await data_of(first, 50)
            async with client(address) as second:
                await second.send(subscribing("/scene", "/floor"))
                assert {topic for topic, _, _ in await data_of(second, 2)} == {"/scene", "/floor"}

    asyncio.run(check())


def test_recording_begins_anew_for_the_next_client_and_waits_for_one(run):
    async def check():
        async with serving(played(run)) as (address, _):
            for _ in range(2):
                async with client(address) as connection:
                    await connection.send(subscribing("/tf"))
                    [(_, at, _)] = await data_of(connection, 1)
                    assert at == 0

    asyncio.run(check())


def test_only_subscribed_messages_are_built(run, monkeypatch):
    built = []
    octets = foxglove_server._octets
    monkeypatch.setattr(foxglove_server, "_octets", lambda message: built.append(message.topic) or octets(message))

    async def check():
        async with serving(played(run)) as (address, _), client(address) as connection:
            await connection.send(subscribing("/trace"))
            await data_of(connection, 50)
            await connection.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [100 + NUMBERS["/trace"]]}))

    asyncio.run(check())
    assert set(built) == {"/trace"}


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("{", "cannot be read"),
        ("[]", "cannot be read"),
        ('"subscribe"', "cannot be read"),
        ("[" * 50_000, "cannot be read"),
        (b"\x01\x00\xff", "cannot be read"),
        ('{"op": "subscribe"}', "cannot be read"),
        ('{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": "x"}]}', "cannot be read"),
        ('{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}', "there is no channel 99"),
        ('{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 0}]}', "-1 is no number of a subscription"),
        ('{"op": "unsubscribe", "subscriptionIds": [[1]]}', "cannot be read"),
        ('{"op": "advertise", "channels": []}', "does not know the operation 'advertise'"),
    ],
)
def test_wrong_request_is_answered_and_the_next_one_served(run, request_, answer):
    async def check():
        async with serving(played(run)) as (address, _), client(address) as connection:
            await connection.send(request_)
            assert answer in (await told(connection, "status"))["message"]
            await connection.send(subscribing("/tf"))
            assert await data_of(connection, 1)

    asyncio.run(check())


@pytest.mark.parametrize(
    ("origin", "welcome"),
    [
        (None, True),
        ("file://", True),
        ("https://app.foxglove.dev", True),
        ("http://localhost:8080", True),
        ("https://evil.example", False),
        ("https://app.foxglove.dev.evil.example", False),
        ("http://localhost.evil.example", False),
        ("null", False),
    ],
)
def test_page_of_a_hostile_origin_is_refused(run, origin, welcome):
    async def check():
        async with serving(played(run)) as (address, _):
            if welcome:
                async with client(address, origin=origin) as connection:
                    assert await told(connection, "serverInfo")
            else:
                with pytest.raises(InvalidStatus):
                    await client(address, origin=origin)

    asyncio.run(check())


def test_client_without_the_protocol_is_refused(run):
    async def check():
        async with serving(played(run)) as (address, _):
            with pytest.raises(InvalidStatus):
                await connect(address)

    asyncio.run(check())


def test_clients_are_limited_and_the_rest_told_so(run, monkeypatch):
    monkeypatch.setattr(foxglove_server, "CLIENTS_MAX", 2)

    async def check():
        async with serving(played(run)) as (address, _), client(address) as one, client(address) as two:
            for each in (one, two):
                await told(each, "serverInfo")
            async with client(address) as third:
                with pytest.raises(ConnectionClosed, match="2 clients are connected already"):
                    await third.recv()
            await one.send(subscribing("/tf"))
            assert await data_of(one, 1)

    asyncio.run(check())


def test_slow_client_loses_its_oldest_messages_is_told_and_delays_nobody(run):
    topics = subscribing("/tf", "/frames", "/tf_estimates", "/trace")

    async def check():
        async with serving(played(run, 20.0)) as (address, server), client(address) as quick:
            with client_that_never_reads(address, topics):
                while not server._watched:
                    await asyncio.sleep(0.001)
                await quick.send(topics)
                while (await data_of(quick, 1))[0][1] < 20 * 10**9:
                    pass
                lagging = next(each for each in server._clients if each.dropped)
                assert len(lagging._queue) == foxglove_server.QUEUE_MAX

    asyncio.run(check())


def test_queue_of_a_client_drops_the_oldest_data_and_reports_the_number():
    class Connection:
        def __init__(self):
            self.sent = []
            self.open = asyncio.Event()

        async def send(self, message):
            await self.open.wait()
            self.sent.append(message)

    async def check():
        connection = Connection()
        lagging = FoxgloveClient(connection)
        for number in range(foxglove_server.QUEUE_MAX + 7):
            lagging.put(struct.pack("<I", number))
        sending = asyncio.create_task(lagging.send_all())
        connection.open.set()
        while not connection.sent or not isinstance(connection.sent[-1], str):
            await asyncio.sleep(0)
        sending.cancel()
        assert connection.sent[0] == struct.pack("<I", 7)
        assert json.loads(connection.sent[-1])["message"].startswith("7 messages were dropped")

    asyncio.run(check())


def test_run_under_way_is_followed_as_its_files_grow(run, tmp_path):
    (tmp_path / "record").mkdir()
    writer = RecordWriter(tmp_path / "record" / "world.mcap", about_run("corridor", "processes", 7, (1,), "world"))
    writer.write("/trace", 0, {"t": 0.0, "robot": 1, "what": "begun"})
    writer.flush()
    feed = LiveFeed(tmp_path)

    def due(wall_s):
        return [message.data["what"] for message in feed.due(wall_s)]

    assert due(100.0) == []
    assert due(100.0 + LAG_S) == ["begun"]
    for k in range(1, 4):
        writer.write("/trace", k * 10**9, {"t": float(k), "robot": 1, "what": str(k)})
    writer.flush()
    assert due(102.0) == []
    assert due(102.5 + 0.01) == ["1"]
    assert due(104.6) == ["2", "3"]
    writer.write("/trace", 100 * 10**9, {"t": 100.0, "robot": 1, "what": "ahead"})
    writer.flush()
    assert due(105.0) == []
    assert due(105.0 + LAG_S) == ["ahead"]
    assert not feed.over
    writer.close()
    shutil.copy(run / "run.mcap", tmp_path / "run.mcap")
    assert due(110.0) == []
    assert feed.over


def test_history_of_a_run_under_way_is_left_out_except_for_what_is_written_once(run, tmp_path):
    (tmp_path / "record").mkdir()
    shutil.copy(run / "run.mcap", tmp_path / "record" / "world.mcap")
    feed = LiveFeed(tmp_path)
    shown = [*feed.due(100.0), *feed.due(100.0 + LAG_S)]
    end = feed.recording.span[1]
    assert {message.topic for message in shown if message.at < end - 3.1e9} == {"/scene", "/floor"}
    assert {message.topic for message in shown} >= {"/tf", "/scene", "/floor"}


def test_live_run_is_served_to_clients(tmp_path):
    (tmp_path / "record").mkdir()
    writer = RecordWriter(tmp_path / "record" / "world.mcap", about_run("corridor", "processes", 7, (1,), "world"))
    writer.write("/trace", 0, {"t": 0.0, "robot": 1, "what": "begun"})
    writer.flush()

    async def check():
        async with serving(LiveFeed(tmp_path)) as (address, _), client(address) as connection:
            await connection.send(subscribing("/trace"))
            await told(connection, "advertise")
            writer.write("/trace", 10**9, {"t": 1.0, "robot": 1, "what": "news"})
            writer.flush()
            while (await data_of(connection, 1))[0][2]["what"] != "news":
                pass

    asyncio.run(check())
    writer.close()


def test_port_in_use_and_no_recording_are_told_in_one_sentence(run, tmp_path, capsys):
    with create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert serve_foxglove(run, live=False, port=port) == 1
        assert f"port {port}: Address already in use; name another one: --port" in capsys.readouterr().err
    assert serve_foxglove(tmp_path, live=False, port=0) == 3
    assert "no recording of a run" in capsys.readouterr().err
    assert serve_foxglove(tmp_path, live=True, port=0) == 3
    assert "no recording of a run" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--foxglove", "nowhere"], 2, "there is no nowhere"),
        (["--foxglove"], 1, "there is no run in ./runs, and none is under way"),
        (["--foxglove", "{run}", "--control"], 2, "these are about the page"),
        (["--foxglove", "{run}", "--speed", "0"], 2, "--speed"),
        (["{run}", "--speed", "2"], 2, "--speed is of a recording in Foxglove"),
    ],
)
def test_command_tells_what_foxglove_cannot_do(run, tmp_path, monkeypatch, capsys, words, code, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RMR_REGISTER", str(tmp_path / "register"))  # another test may run a lab
    assert view.command().main([word.format(run=run) for word in words], "rmr view") == code
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_command_prints_the_address_serves_and_ends_in_order(run, ending):
    command = [sys.executable, "-m", "rmr_view.view", "--foxglove", str(run), "--port", "0", "--speed", "100"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        address = process.stdout.readline().rpartition(" ")[2].strip()

        async def check():
            async with client(address) as connection:
                await connection.send(subscribing("/tf"))
                assert await data_of(connection, 3)
                process.send_signal(ending)
                with pytest.raises(ConnectionClosed):
                    await data_of(connection, 10_000)

        asyncio.run(check())
        assert process.wait(20) == 0
        assert process.stderr.read() == ""
