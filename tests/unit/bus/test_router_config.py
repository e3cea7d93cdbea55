"""`rmr router config`: what it prints makes zenoh the router that `rmr router` would be."""

import asyncio
import json

import pytest
import zenoh
from bus_star import free_endpoint, until_heard
from command_runner import invoke

from rmr.bus.authority import Authority, holder, write_bundle
from rmr.bus.certificates import read_certificate
from rmr.bus.middleware import NotAdmittedError, open_router
from rmr.bus.secret import make_secret, read_secret
from rmr.bus.session import open_bus
from rmr_deploy.router import command

CONNECT = "tcp/10.0.0.1:17447"


@pytest.fixture
def secret(tmp_path):
    make_secret(tmp_path / "secret")
    return read_secret(tmp_path / "secret")


def config(*words):
    """Return exit code, standard output and standard error."""
    answer = invoke(command(), ["config", *map(str, words)], name="rmr router")
    return answer.exit_code, answer.stdout, answer.stderr


def test_configuration_has_host_and_routers_and_is_the_same_each_time(secret):
    words = ("corridor", "--host", "b", "--connect", CONNECT, "--connect", "tcp/c:1", "--secret", secret.file)
    code, printed, said = config(*words)
    assert (code, said) == (0, "")
    document = json.loads(printed)
    assert document["mode"] == "router"
    assert document["listen"]["endpoints"] == ["tcp/b:17447"]
    assert document["connect"]["endpoints"] == [CONNECT, "tcp/c:1"]
    assert document["transport"]["auth"]["usrpwd"]["dictionary_file"] == str(secret.file)
    assert secret.is_known_to(document["id"])
    assert config(*words)[1] == printed
    assert json.loads(config("corridor", "--host", "c", "--secret", secret.file)[1])["id"] != document["id"]


def test_configuration_holds_no_password_where_the_router_connects_to_none(secret):
    assert secret.password not in config("corridor", "--host", "b", "--secret", secret.file)[1]


@pytest.mark.real
def test_a_zenoh_router_with_the_configuration_joins_ours_and_lets_in_who_knows_the_secret(secret, tmp_path):
    async def play():
        first, second = free_endpoint(), free_endpoint()
        ours = open_router(first, (), secret)
        printed = config("corridor", "--host", "b", "--listen", second, "--connect", first, "--secret", secret.file)[1]
        (tmp_path / "router-b.json5").write_text(printed)
        theirs = zenoh.open(zenoh.Config.from_file(tmp_path / "router-b.json5"))
        one, two = open_bus(1, connect=first, secret=secret), open_bus(2, connect=second, secret=secret)
        try:
            await until_heard(one, two)
        finally:
            for opened in (one, two, theirs, ours):
                opened.close()

    asyncio.run(play())


@pytest.mark.real
def test_a_zenoh_router_with_the_configuration_of_keys_joins_ours_and_lets_a_revoked_robot_do_nothing(tmp_path):
    ca = Authority.begin(tmp_path / "ca")
    ca.issue(holder("robot", "3"))
    write_bundle(ca.bundle(holder("robot", "3")), tmp_path / "3")
    ca.revoke(holder("robot", "3"))
    others = holder("router", "b"), holder("robot", "1"), holder("operator", "2")
    for who in others:
        ca.issue(who)
    for who in others:
        write_bundle(ca.bundle(who), tmp_path / who.name)
    router, *robots = (read_certificate(tmp_path / name) for name in "b123")

    async def play():
        first, second = (free_endpoint().replace("tcp/", "tls/") for _ in range(2))
        words = ("--listen", second, "--connect", first, "--keys", tmp_path / "b")
        code, printed, _ = config("corridor", "--host", "b", *words)
        assert (code, config("corridor", "--host", "b", *words)[1]) == (0, printed)
        (tmp_path / "router-b.json5").write_text(printed)
        ours = open_router(first, (), router)
        theirs = zenoh.open(zenoh.Config.from_file(tmp_path / "router-b.json5"))
        one = open_bus(1, connect=first, secret=robots[0])
        two = open_bus(2, connect=second, secret=robots[1])
        try:
            await until_heard(one, two)
            with pytest.raises(NotAdmittedError, match="lets robot/3 in, but carries nothing of it"):
                open_bus(3, connect=second, secret=robots[2])
        finally:
            for opened in (one, two, theirs, ours):
                opened.close()

    asyncio.run(play())
    assert json.loads(config("corridor", "--host", "b", "--keys", tmp_path / "b")[1])["listen"] == {
        "endpoints": ["tls/b:17447"]
    }


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("corridr", "--host", "a", "--open"), 2, "there is no corridr; did you mean 'corridor'?"),
        (("corridor",), 2, "config needs a lab and its host"),
        (("--host", "a"), 2, "config needs a lab and its host"),
        (("corridor", "--host", "a b", "--open"), 2, "--host: 'a b' is no name or address of a host"),
        (
            ("corridor", "--host", "a"),
            2,
            "whoever reaches tcp/a:17447, from other machines, too, could drive the robots",
        ),
        (("corridor", "--host", "a", "--secret", "none"), 2, "none: No such file or directory"),
        (("corridor", "--host", "a", "--open", "--log", "x"), 2, "--log goes without config"),
    ],
)
def test_configuration_that_cannot_be_is_refused_in_one_sentence(words, code, says):
    found, printed, said = config(*words)
    assert (found, printed) == (code, "")
    assert says in said


def test_lab_that_is_invalid_is_refused_with_its_mistake(tmp_path):
    (tmp_path / "lab.yaml").write_text("lab: x\nrobots: 3\n")
    code, printed, said = config(tmp_path, "--host", "127.0.0.1")
    assert (code, printed) == (3, "")
    assert "lab.yaml:" in said
