"""`rmr router` as real processes: routers that wait for each other, are joined, and say what keeps them apart."""

import signal
import socket

import pytest
from process_tools import Stage, free_endpoint

from rmr.bus.secret import make_secret

pytestmark = pytest.mark.slow


@pytest.fixture
def stage(tmp_path):
    stage = Stage(tmp_path)
    make_secret(tmp_path / "secret")
    make_secret(tmp_path / "other")
    yield stage
    stage.end()
    assert not any("Traceback" in started.said() for started in stage.started)


def router(stage, listen, *options, secret="secret"):
    """Start a router."""
    given = () if secret is None else ("--secret", stage.folder / secret)
    return stage.start("rmr_deploy.router", "--listen", listen, *options, *given)


def test_router_waits_for_another_joins_it_and_says_who_is_connected_until_it_is_told_to_end(stage):
    first, second = free_endpoint(), free_endpoint()
    waits = router(stage, second, "--connect", first)
    waits.wait_for(f"waiting for the router at {first}")
    waited_for = router(stage, first)
    waits.wait_for(f"joined the router at {first}")
    secret = ("--secret", stage.folder / "secret")
    world = stage.world("--connect", first, "--when-ready", *secret)
    for robot in (1, 2):
        stage.start("rmr_agent.main", "--id", robot, stage.folder / "idle.rbc", "--connect", second, *secret)
    world.wait_for("lab time runs")
    waits.wait_for("connected: 1 router, 2 processes")
    waited_for.wait_for("connected: 1 router, 1 process\n")
    waited_for.send(signal.SIGTERM)
    assert waited_for.exit_code() == 0
    waits.wait_for(f"lost the router at {first}")
    waits.wait_for(f"waiting for the router at {first}", times=2)
    router(stage, first)
    waits.wait_for(f"joined the router at {first}", times=2)
    waits.send(signal.SIGINT)
    assert waits.exit_code() == 0


def test_routers_that_name_each_other_are_joined_and_both_say_so(stage):
    ends = free_endpoint(), free_endpoint()
    for listen, connect in (ends, reversed(ends)):
        router(stage, listen, "--connect", connect)
    for started, other in zip(stage.started, reversed(ends), strict=True):
        started.wait_for(f"joined the router at {other}")


@pytest.mark.parametrize(
    ("secret", "says"),
    [
        ("other", "does not let this process in: it has another secret than the one in "),
        (None, "does not let this process in: it has a secret, so name the file with --secret "),
    ],
)
def test_router_that_another_does_not_let_in_ends_and_says_why(stage, secret, says):
    first = free_endpoint()
    router(stage, first).wait_for("a router at")
    refused = router(stage, free_endpoint(), "--connect", first, secret=secret)
    assert refused.exit_code() == 1
    assert f"rmr router: {first} {says}" in refused.said()


def test_router_goes_on_when_another_comes_back_with_another_secret(stage):
    first = free_endpoint()
    before = router(stage, first)
    goes_on = router(stage, free_endpoint(), "--connect", first)
    goes_on.wait_for("joined the router at")
    before.send(signal.SIGTERM)
    assert before.exit_code() == 0
    between = router(stage, first, secret="other")
    goes_on.wait_for("it has another secret than the one in ")
    between.send(signal.SIGTERM)
    assert between.exit_code() == 0
    router(stage, first)
    goes_on.wait_for("joined the router at", times=2)


def test_router_whose_address_is_in_use_says_by_what(stage):
    first = free_endpoint()
    router(stage, first).wait_for("a router at")
    second = router(stage, first)
    assert second.exit_code() == 1
    assert f"{first} is in use: a world or router with a secret runs there" in second.said()
    with socket.create_server(("127.0.0.1", 0)) as foreign:
        third = router(stage, f"tcp/127.0.0.1:{foreign.getsockname()[1]}")
        assert third.exit_code() == 1
    assert "is in use: " in third.said()


def test_router_is_not_joined_to_itself(stage):
    first = free_endpoint()
    alone = router(stage, first, "--connect", first)
    assert alone.exit_code() == 1
    assert f"{first} is this router itself: name that of another host with --connect" in alone.said()


def test_router_waits_for_a_host_that_does_not_exist_and_says_so(stage):
    waits = router(stage, free_endpoint(), "--connect", "tcp/no-such-host.invalid:17447")
    waits.wait_for("waiting for the router at tcp/no-such-host.invalid:17447: there is no host no-such-host.invalid")
    waits.send(signal.SIGTERM)
    assert waits.exit_code() == 0


def test_router_beyond_loopback_needs_a_secret_or_is_opened(stage):
    closed = router(stage, "tcp/0.0.0.0:1", secret=None)
    assert closed.exit_code() == 2
    assert "name a secret with --secret FILE" in closed.said()
    listen = free_endpoint().replace("127.0.0.1", "0.0.0.0")
    opened = router(stage, listen, "--open", secret=None)
    opened.wait_for(f"open: whoever reaches {listen}, on any machine, can drive the robots and end the run")


def test_router_that_joins_others_needs_a_secret_that_is_there(stage):
    missing = router(stage, free_endpoint(), "--connect", free_endpoint(), secret="none")
    assert missing.exit_code() == 2
    assert "none: No such file or directory" in missing.said()
    assert not (stage.folder / "none").exists()
