"""The secret of a bus: its file, and who gets a session with it and without."""

import asyncio
import contextlib
import os
import socket
import stat
import threading

import pytest
from bus_star import free_endpoint, until, until_heard

from rmr.bus import session, wire
from rmr.bus.endpoint import BusError
from rmr.bus.middleware import NobodyThereError, NotAdmittedError, open_router
from rmr.bus.secret import SecretError, make_secret, read_secret
from rmr.bus.session import open_bus, open_when_there


@pytest.fixture
def secret(tmp_path):
    make_secret(tmp_path / "secret")
    return read_secret(tmp_path / "secret")


@pytest.fixture
def other(tmp_path):
    make_secret(tmp_path / "other")
    return read_secret(tmp_path / "other")


# --- the file ------------------------------------------------------------------------------------------------


def test_secret_file_is_readable_by_its_owner_only_and_each_is_new(secret, other):
    assert stat.S_IMODE(secret.file.stat().st_mode) == 0o600
    assert len(secret.password) == 64
    assert secret.password != other.password
    with pytest.raises(FileExistsError):
        make_secret(secret.file)


def test_secret_file_stays_private_under_a_permissive_umask(tmp_path):
    before = os.umask(0)
    try:
        make_secret(tmp_path / "secret")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "secret").stat().st_mode) == 0o600


def test_secret_shows_no_password(secret):
    assert secret.password not in repr(secret)
    assert secret.password not in secret.router_id()


def test_router_id_proves_the_secret_and_is_one_that_zenoh_accepts(secret, other):
    router = secret.router_id()
    assert secret.is_known_to(router)
    assert not other.is_known_to(router)
    assert not any(
        secret.is_known_to(wrong) for wrong in ("1234", router[:-1], f"2{router[1:]}", f"1{router[::-1][1:]}")
    )
    assert (len(router), router[0]) == (32, "1")


def test_routers_of_one_secret_have_different_ids_and_a_named_one_always_the_same(secret):
    assert secret.router_id() != secret.router_id() != secret.router_id("lab/a") != secret.router_id("lab/b")
    assert secret.router_id("lab/a") == secret.router_id("lab/a")
    assert secret.is_known_to(secret.router_id("lab/a"))


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o644])
def test_secret_file_that_others_may_read_or_change_is_refused(secret, mode):
    secret.file.chmod(mode)
    with pytest.raises(SecretError, match="other users may read or change this secret; run: chmod 600 "):
        read_secret(secret.file)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "rmr",
        "rmr:",
        ":0123456789abcdef",
        "rmr:tooshort",
        "a:0123456789abcdef\nb:0123456789abcdef\n",
        "ä:" + 16 * "x",
    ],
)
def test_secret_file_that_holds_no_secret_is_refused_and_not_shown(tmp_path, text):
    file = tmp_path / "secret"
    file.write_text(text)
    file.chmod(0o600)
    with pytest.raises(SecretError, match="expected one line NAME:PASSWORD") as caught:
        read_secret(file)
    assert "0123456789abcdef" not in str(caught.value)


def test_secret_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(SecretError, match="nothing: No such file or directory"):
        read_secret(tmp_path / "nothing")
    with pytest.raises(SecretError, match="Is a directory"):
        read_secret(tmp_path)


# --- sessions ------------------------------------------------------------------------------------------------


def with_router(secret, scene):
    """Run `scene(router, endpoint)` with a router that has `secret`."""

    async def play():
        endpoint = free_endpoint()
        router = open_bus(wire.WORLD_ID, listen=endpoint, secret=secret)
        try:
            await scene(router, endpoint)
        finally:
            router.close()

    asyncio.run(play())


def test_client_with_the_secret_publishes_queries_and_sees_liveliness(secret):
    async def scene(router, endpoint):
        heard, alive = [], []
        router.subscribe("rmr/x/ops/1/status", lambda _, message: heard.append(message.sender))
        router.serve("rmr/x/clock", lambda *_: wire.Clock("waiting", 0, 0))
        router.declare_alive("rmr/x/alive/world/0")
        one = open_bus(1, connect=endpoint, secret=secret)
        one.watch_alive("rmr/x/alive/**", lambda key, _: alive.append(key))
        one.publish("rmr/x/ops/1/status", wire.Stop("x"))
        assert len(await one.ask("rmr/x/clock", wire.AskClock(), 2.0)) == 1
        await until(lambda: (heard, alive) == ([1], ["rmr/x/alive/world/0"]))
        one.close()

    with_router(secret, scene)


def test_client_without_the_secret_or_with_another_gets_no_session_and_one_sentence(secret, other):
    async def scene(_router, endpoint):
        with pytest.raises(NotAdmittedError, match=r"it has a secret, so name the file with --secret"):
            open_bus(1, connect=endpoint)
        with pytest.raises(NotAdmittedError, match=r"it has another secret than the one in .*other"):
            open_bus(1, connect=endpoint, secret=other)

    with_router(secret, scene)


def test_client_with_a_secret_does_not_use_a_router_without_one(secret):
    async def scene(_router, endpoint):
        with pytest.raises(NotAdmittedError, match=r"has no secret: start it with --secret .*, or this"):
            open_bus(1, connect=endpoint, secret=secret)

    with_router(None, scene)


def test_client_does_not_use_a_router_that_accepts_every_password(secret, monkeypatch):
    """A program that took the world's port: it cannot check a password, and its id is not derived from the secret."""
    with monkeypatch.context() as patch:
        patch.setattr(type(secret), "router_id", lambda *_: "1234")

        async def scene(_router, endpoint):
            patch.undo()
            with pytest.raises(
                NotAdmittedError, match=r"does not know the secret in .*: it is no world or router of this lab"
            ):
                open_bus(1, connect=endpoint, secret=secret)

        with_router(secret, scene)


def test_waiting_client_that_is_refused_gives_up_after_its_timeout(secret, monkeypatch):
    monkeypatch.setattr(session, "REFUSED_PATIENCE_S", 0.2)

    async def scene(_router, endpoint):
        with pytest.raises(NotAdmittedError):
            await open_when_there(1, endpoint, lambda: None)

    with_router(secret, scene)


def test_client_waits_for_a_router_that_does_not_answer_yet(secret):
    async def play():
        endpoint = free_endpoint()
        routers = []

        def waiting():
            if not routers:
                routers.append(open_bus(wire.WORLD_ID, listen=endpoint, secret=secret))

        one = await open_when_there(1, endpoint, waiting, secret)
        one.close()
        routers[0].close()

    asyncio.run(play())


@pytest.mark.medium
def test_process_that_accepts_and_says_nothing_is_not_taken_for_a_refusal():
    """Such as a world that is stopped: a client waits for it."""

    async def play():
        with socket.create_server(("127.0.0.1", 0)) as silent:
            with pytest.raises(NobodyThereError) as caught:
                open_bus(1, connect=f"tcp/127.0.0.1:{silent.getsockname()[1]}")
            assert not isinstance(caught.value, NotAdmittedError)

    asyncio.run(play())


def test_program_that_is_no_router_is_not_taken_for_a_refusal():
    """Such as the proxy of a container whose world has not started yet: it accepts, and closes."""

    async def play():
        with socket.create_server(("127.0.0.1", 0)) as foreign:

            def serve():
                with contextlib.suppress(OSError):
                    while True:
                        connection, _ = foreign.accept()
                        with connection:
                            connection.recv(1 << 16)
                            connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

            threading.Thread(target=serve, daemon=True).start()
            with pytest.raises(NobodyThereError) as caught:
                open_bus(1, connect=f"tcp/127.0.0.1:{foreign.getsockname()[1]}")
            assert not isinstance(caught.value, NotAdmittedError)
            foreign.shutdown(socket.SHUT_RDWR)

    asyncio.run(play())


def test_client_returns_by_itself_to_a_new_router_with_the_same_secret(secret):
    async def play():
        endpoint = free_endpoint()
        router = open_bus(wire.WORLD_ID, listen=endpoint, secret=secret)
        one = open_bus(1, connect=endpoint, secret=secret)
        await until(lambda: one.connected)
        router.close()
        await until(lambda: not one.connected)
        router = open_bus(wire.WORLD_ID, listen=endpoint, secret=secret)
        await until(lambda: one.connected)
        one.close()
        router.close()

    asyncio.run(play())


def test_client_refused_on_reconnect_is_reported_once(secret, monkeypatch):
    monkeypatch.setattr(session, "REFUSED_PATIENCE_S", 0.1)

    async def play():
        endpoint, told = free_endpoint(), []
        router = open_bus(wire.WORLD_ID, listen=endpoint)
        one = open_bus(1, connect=endpoint)
        watching = asyncio.ensure_future(session.watch_admission(one, endpoint, None, told.append))
        await until(lambda: one.connected)
        router.close()
        await until(lambda: not one.connected)
        await asyncio.sleep(0.3)
        assert told == [], "nobody is there: that is no refusal"
        router = open_bus(wire.WORLD_ID, listen=endpoint, secret=secret)
        await until(lambda: told)
        await asyncio.sleep(0.3)
        assert len(told) == 1
        assert told[0].startswith(f"{endpoint} does not let this process in: it has a secret")
        watching.cancel()
        one.close()
        router.close()

    asyncio.run(play())


def test_password_does_not_travel_in_clear(secret):
    """What crosses a connection while a client opens its session, recorded between the two."""

    async def scene(_router, endpoint):
        seen, (host, port) = bytearray(), endpoint.removeprefix("tcp/").split(":")
        with socket.create_server(("127.0.0.1", 0)) as between:

            def pump(source, sink):
                with contextlib.suppress(OSError), source:
                    while data := source.recv(1 << 16):
                        seen.extend(data)
                        sink.sendall(data)

            def serve():
                client, _ = between.accept()
                router = socket.create_connection((host, int(port)))
                for ends in ((client, router), (router, client)):
                    threading.Thread(target=pump, args=ends, daemon=True).start()

            threading.Thread(target=serve, daemon=True).start()
            one = open_bus(1, connect=f"tcp/127.0.0.1:{between.getsockname()[1]}", secret=secret)
            await until(lambda: one.connected)
            one.close()
        assert secret.user.encode() in seen
        assert secret.password.encode() not in seen

    with_router(secret, scene)


def test_not_admitted_is_an_error_of_the_bus():
    assert issubclass(NotAdmittedError, BusError)


# --- routers that are joined -----------------------------------------------------------------------------------


def test_routers_of_one_secret_join_and_a_client_of_each_hears_the_other(secret):
    async def play():
        first, second = free_endpoint(), free_endpoint()
        later = open_router(second, [first], secret)
        router = open_router(first, (), secret)
        one, two = (open_bus(n, connect=at, secret=secret) for n, at in ((1, first), (2, second)))
        try:
            await until_heard(one, two)
        finally:
            for opened in (one, two, later, router):
                opened.close()

    asyncio.run(play())
