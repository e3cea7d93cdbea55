"""The table of rights against a real router: what it allows arrives, and nothing else does.

All sessions are zenoh's own, with real certificates, as an attacker would open them. A witness with the keys of a
router, which may do everything, is at the other end. What does not arrive is not waited for: on one connection messages
keep their order, and callbacks are called at once, so it is enough that one which was sent later has come.
"""

import asyncio
import json
import time
from contextlib import ExitStack, contextmanager

import pytest
import zenoh
from bus_star import free_endpoint
from bus_star import until as eventually
from zenoh.handlers import Callback

from rmr.bus import wire
from rmr.bus.authority import Authority, holder, write_bundle
from rmr.bus.certificates import ROLES, read_certificate
from rmr.bus.keys import ROBOT_ROLE, WORLD, Keys
from rmr.bus.middleware import NotAdmittedError, _client_settings, _open, open_client, router_settings
from rmr.bus.rights import RIGHTS, VERBS
from rmr.bus.session import open_bus
from rmr.radio.air import Announcement
from rmr.radio.cells import grid_of
from rmr.radio.frame import DataFrame, encode_data
from rmr.radio.phy import RadioConfig, airtime
from rmr_agent.local_air import LocalAir

pytestmark = pytest.mark.medium

LAB = "rmr/bench/"
ROUTER = "router/127.0.0.1"
HOLDERS = {"robot": "robot/1", "world": "world", "router": ROUTER, "operator": "operator/ann", "viewer": "viewer/bob"}
"""Role -> who plays it here."""

KEYS = (
    *(
        "radio/0/-1",
        "call/1",
        "call/2",
        "body/1/sense",
        "body/2/sense",
        "body/1/act",
        "body/2/act",
        "clock",
        "map/1",
        "map/2",
    ),
    *("disturbances", "silence", "hosts/a", "truth", "ops/1/status", "ops/2/status", "ops/world/status", "ops/1/stop"),
    *(
        "ops/2/stop",
        "ops/world/stop",
        "load/1",
        "load/2",
        "load/operator/1",
        "load/operator/2",
        "alive/robot/1",
        "alive/robot/2",
    ),
    *("alive/world/0", "echo/robot/1/x", "echo/robot/2/x", "echo/world/0/x", "echo/operator/0/x", "echo/viewer/0/x"),
    *("alive/robot", "body/1", "other", "ops/1/status/more"),
)
"""A key of each kind, of robot 1 and of another one, and some that no part of rmr uses."""

_OF = Keys("bench")
USED = [
    key.removeprefix(LAB)
    for key in (
        *(
            _OF.radio(0, 0, "1"),
            _OF.call(1, "1"),
            _OF.sense(1),
            _OF.act(1),
            _OF.acts,
            _OF.clock,
            _OF.map(1),
            _OF.disturbances,
        ),
        *(
            _OF.silence,
            _OF.host("a"),
            _OF.order("a"),
            _OF.look("a"),
            _OF.truth,
            _OF.status(1),
            _OF.status(WORLD),
            _OF.statuses,
            _OF.stop(1),
            _OF.stop(WORLD),
        ),
        *(_OF.load(1), _OF.answers(1), _OF.alive(ROBOT_ROLE, 1), _OF.alive(ROBOT_ROLE, "*"), _OF.world_alive),
        *(_OF.echo(role, 1 if role == "robot" else 0, "x") for role in ROLES if role != "router"),
    )
]
"""The keys that rmr has."""

CELLS = [(role, verb) for role in RIGHTS for verb in VERBS]


class Lab:
    """Keys of one CA, and sessions with them; all are closed in the end."""

    def __init__(self, folder):
        self.folder = folder
        self.ca = Authority.begin(folder / "ca")
        for who in (*HOLDERS.values(), "robot/2", "robot/3-4"):
            self.ca.issue(holder(*who.split("/", 1)))
        self.open = ExitStack()

    def keys(self, who):
        """Return the certificate of `who` as it is bundled now."""
        out = self.folder / f"{who.replace('/', '-')}-{time.monotonic_ns()}"
        write_bundle(self.ca.bundle(holder(*who.split("/", 1))), out)
        return read_certificate(out)

    def router(self, *connect, who=ROUTER, changed=lambda settings: settings):
        """Open a router with the settings of one of rmr, or `changed` ones; return its endpoint."""
        endpoint = free_endpoint().replace("tcp/", "tls/")
        self.open.callback(_open(changed(router_settings(endpoint, connect, self.keys(who)))).close)
        return endpoint

    def session(self, endpoint, who, mode="client"):
        config = zenoh.Config()
        for key, value in (_client_settings(endpoint, self.keys(who)) | {"mode": mode}).items():
            config.insert_json5(key, json.dumps(value))
        opened = zenoh.open(config)
        self.open.callback(opened.close)
        return opened


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    lab = Lab(tmp_path_factory.mktemp("rights"))
    with lab.open:
        yield lab


def open_handed(settings):
    """Let a router send everything to everybody: then all depends on what it takes."""
    messages = sorted({message for forms in VERBS.values() for _, message in forms})
    rule = {"id": "all", "permission": "allow", "flows": ["egress"], "messages": messages, "key_exprs": ["**"]}
    policies = [one | {"rules": [*one["rules"], "all"]} for one in settings["access_control/policies"]]
    rules = [*settings["access_control/rules"], rule]
    return settings | {"access_control/rules": rules, "access_control/policies": policies}


@pytest.fixture(scope="module", params=["as it is", "sends all"])
def ends(lab, request):
    """Return the session of each role, and that of the witness, at one router."""
    endpoint = lab.router() if request.param == "as it is" else lab.router(changed=open_handed)
    return {role: lab.session(endpoint, who) for role, who in HOLDERS.items()}, lab.session(endpoint, ROUTER)


def allowed(role, verb, robot="1"):
    """Return the keys of `KEYS` that the table allows, by zenoh's own judgement of what a wild card includes."""
    rows = [zenoh.KeyExpr(row.replace("{n}", robot)) for row in RIGHTS[role].get(verb, ())]
    return {key for key in KEYS if any(row.includes(zenoh.KeyExpr(key)) for row in rows)}


def until(claim):
    end = time.monotonic() + 10
    while not claim():
        assert time.monotonic() < end
        time.sleep(0.002)


def short(sample):
    return str(sample.key_expr).removeprefix(LAB)


def noting(got):
    """Return a callback that puts the keys of samples into `got`, at once and in order."""
    return Callback(lambda sample: got.append(short(sample)), indirect=False)


def ear(session, key, got):
    return session.declare_subscriber(key, noting(got))


def say(session, key, payload):
    session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)  # else a busy machine loses some


class Mark:
    """A key that `speaker` may put and `listener` hears: what was sent before it has come, or never will."""

    def __init__(self, speaker, listener, role):
        self.heard = []
        self.speaker = speaker
        self.key = f"{LAB}echo/{role}/{1 if role == 'robot' else 0}/mark"
        heard = self.heard
        self.ear = listener.declare_subscriber(
            self.key, Callback(lambda sample: heard.append(sample.payload.to_string()), indirect=False)
        )
        until(lambda: say(speaker, self.key, "known") or "known" in self.heard)

    def wait(self):
        """Wait until all that was sent before, on both ways, has come."""
        say(self.speaker, self.key, "now")
        until(lambda: "now" in self.heard)


@contextmanager
def marked(speaker, listener, role):
    mark = Mark(speaker, listener, role)
    try:
        yield mark
    finally:
        mark.ear.undeclare()


@contextmanager
def declared(things):
    things = list(things)
    try:
        yield
    finally:
        for thing in things:
            thing.undeclare()


def puts(actor, witness, role):
    got = []
    with (
        declared([ear(witness, "rmr/**", got)]),
        marked(actor, witness, role) as mark,
    ):
        for key in KEYS:
            say(actor, LAB + key, b"")
        mark.wait()
        return {key for key in got if not key.endswith("/mark")}


def hears(actor, witness, role):
    got = []
    ears = (ear(actor, LAB + key, got) for key in KEYS)
    with declared(ears), marked(witness, actor, role) as mark:
        for key in KEYS:
            say(witness, LAB + key, b"")
        mark.wait()
        return set(got)


def answered(client, server, mark, wanted):
    """Return the keys on which `client` gets an answer of `server`; `mark` goes the way of the question."""
    arrived, replies = [], []

    def answer(query):
        arrived.append(short(query))
        query.reply(query.key_expr, b"yes")

    with (
        declared(server.declare_queryable(LAB + key, Callback(answer, indirect=False)) for key in KEYS),
        mark() as passed,
    ):
        for key in KEYS:
            client.get(LAB + key, lambda reply: replies.append(short(reply.ok)) if reply.ok else None, timeout=5)
        passed.wait()
        until(lambda: set(replies) >= wanted)
        assert set(arrived) == set(replies)
        return set(replies)


def asks(actor, witness, role):
    return answered(actor, witness, lambda: marked(actor, witness, role), allowed(role, "asks"))


def serves(actor, witness, role):
    return answered(witness, actor, lambda: marked(witness, actor, role), allowed(role, "serves"))


def lives(actor, witness, role):
    got = []
    watcher = witness.liveliness().declare_subscriber("rmr/**", noting(got), history=True)
    with declared([watcher]), declared(actor.liveliness().declare_token(LAB + key) for key in KEYS):
        with marked(actor, witness, role) as mark:
            mark.wait()
        until(lambda: set(got) >= allowed(role, "lives"))
        return set(got)


def watches(actor, witness, role):
    got = []

    def watcher(key):
        return actor.liveliness().declare_subscriber(LAB + key, noting(got), history=True)

    with declared(witness.liveliness().declare_token(LAB + key) for key in KEYS), declared(map(watcher, KEYS)):
        with marked(witness, actor, role) as mark:
            mark.wait()
        until(lambda: set(got) >= allowed(role, "watches"))
        return set(got)


@pytest.mark.parametrize(("role", "verb"), CELLS, ids=map("-".join, CELLS))
def test_what_a_role_may_do_arrives_and_what_it_may_not_does_not(ends, role, verb):
    actors, witness = ends
    tried = {"puts": puts, "hears": hears, "asks": asks, "serves": serves, "lives": lives, "watches": watches}
    assert tried[verb](actors[role], witness, role) == allowed(role, verb)


def test_the_table_names_no_key_that_rmr_does_not_have():
    assert set(RIGHTS) == set(ROLES)
    rows = {row.replace("{n}", "1") for verbs in RIGHTS.values() for keys in verbs.values() for row in keys} - {"**"}
    assert [row for row in rows if not any(zenoh.KeyExpr(row).includes(zenoh.KeyExpr(key)) for key in USED)] == []
    assert [key for key in USED if not any(zenoh.KeyExpr(row).includes(zenoh.KeyExpr(key)) for row in rows)] == []


@pytest.mark.parametrize(("key", "wanted"), [("body/1/act", "body/*/act"), ("ops/1/status", "ops/*/status")])
def test_who_may_put_one_key_is_told_that_all_of_them_are_wanted(ends, key, wanted):
    """A publisher that is declared, as those of rmr are, sends nothing else but its first messages."""
    actors, _ = ends
    got = []
    publisher = actors["robot"].declare_publisher(LAB + key)
    with declared([publisher, ear(actors["world"], LAB + wanted, got)]):
        until(lambda: publisher.put(b"") or len(got) > 20)


# --- attackers


def test_wild_cards_reach_no_more_than_keys(lab, ends):
    """A robot and a viewer say, hear, ask and watch everything at once."""
    actors, witness = ends
    wide = ("**", "rmr/**", "rmr/bench/**", "rmr/*/body/*/act", "rmr/bench/ops/*/stop", "rmr/ben$*/clock")
    said, heard = [], []

    def hear(sample):
        if sample.payload.to_string() == "theirs":  # zenoh hands a session what it says itself
            heard.append(short(sample))

    everything = ear(witness, "rmr/**", said)
    asked = witness.declare_queryable("rmr/bench/disturbances", lambda query: query.reply(query.key_expr, b"told"))
    token = witness.liveliness().declare_token("rmr/bench/alive/robot/7")
    with declared([everything, asked, token]):
        for role in ("robot", "viewer"):
            actor = actors[role]
            heard.clear()
            ears = [actor.declare_subscriber(key, Callback(hear, indirect=False)) for key in wide]
            with declared(ears), marked(witness, actor, role) as to, marked(actor, witness, role) as fro:
                for key in wide:
                    say(actor, key, b"mine")
                    actor.delete(key)
                    assert [one for one in actor.get(key, timeout=0.3) if one.ok] == []
                for key in KEYS:
                    say(witness, LAB + key, b"theirs")
                to.wait(), fro.wait()
            seen = {short(reply.ok) for reply in actor.liveliness().get("rmr/**", timeout=0.3) if reply.ok}
            assert seen == set()
            # Where the router lets all through on its way out, the wide ears are still not there.
            assert {key for key in heard if not key.endswith("/mark")} <= allowed(role, "hears"), role
    assert {key for key in said if not key.endswith("/mark")} <= set(KEYS)


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_a_robot_that_poses_as_a_router_has_no_more_rights_than_a_robot(lab, mode):
    endpoint = lab.router()
    witness, robot, good = (lab.session(endpoint, *who) for who in ((ROUTER,), ("robot/2", mode), ("robot/1",)))
    got = []
    with (
        declared([ear(witness, "rmr/**", got)]),
        marked(good, witness, "robot") as mark,
    ):
        for _ in range(50):
            for key in KEYS:
                say(robot, LAB + key, b"")
            time.sleep(0.01)
        mark.wait()
    said = {key for key in got if not key.endswith("/mark")}
    assert said == (allowed("robot", "puts", "2") if mode == "peer" else set())  # routers are joined in another way


def test_who_is_not_among_the_members_has_no_rights(lab):
    endpoint = lab.router()
    lab.ca.issue(holder("operator", "eve"))
    eve, witness, good = (lab.session(endpoint, who) for who in ("operator/eve", ROUTER, "operator/ann"))
    got = []
    with (
        declared([ear(witness, "rmr/**", got)]),
        marked(good, witness, "operator") as mark,
    ):
        for _ in range(50):
            for key in KEYS:
                say(eve, LAB + key, b"")
            time.sleep(0.01)
        mark.wait()
    assert {key for key in got if not key.endswith("/mark")} == set()


def test_robots_with_keys_transmit_in_their_own_name_alone(lab):
    """Also two in one process, whose session does not bring them what they say themselves."""
    endpoint, grid, keys = lab.router(), grid_of(RadioConfig(), speed_mps=0.2), Keys("bench")
    frame = encode_data(DataFrame(7, 1, 3, 0, False, b"hello"))

    def announced(robot):
        return Announcement(robot, 0, 0, 0, airtime(len(frame)), 0.0, 0.5, 0.5, frame)

    async def play():
        first = open_bus(1, connect=endpoint, secret=lab.keys("robot/1"))
        third = open_bus(3, connect=endpoint, secret=lab.keys("robot/3-4"))
        buses = {1: first, 3: third, 4: third.seat(4)}
        heard = {robot: [] for robot in buses}

        def air(robot, bus):
            return LocalAir(bus, keys, grid, lambda _, said: heard[robot].append((said.sender, said.run)), robot)

        airs = {robot: air(robot, bus) for robot, bus in buses.items()}
        try:
            for one in airs.values():
                one.move(0.5, 0.5)

            def all_heard():
                for robot, one in airs.items():
                    one.publish(announced(robot))
                return all(len(set(speakers)) == 2 for speakers in heard.values())

            await eventually(all_heard)
            assert {robot: {who for who, _ in heard[robot]} for robot in heard} == {1: {3, 4}, 3: {1, 4}, 4: {1, 3}}
            # As robot 3, on the key of robot 1 and on that of robot 3.
            forged = wire.encode(3, 1, 1, wire.Air(announced(3)))

            def forge():
                for speaker in ("3", "1"):
                    first._session.put(keys.radio(*grid.cell_of(0.5, 0.5), speaker), forged)
                return third.losses.malformed

            await eventually(forge)
            assert third.losses.malformed_last == "not of the sender whose key it came on"
            assert [robot for robot in heard if (3, 1) in heard[robot]] == []
        finally:
            for bus in buses.values():
                bus.close()

    asyncio.run(play())


# --- admission


@pytest.mark.parametrize("who", [*HOLDERS.values(), "robot/3-4"])
def test_a_process_with_all_rights_of_its_role_is_let_in(lab, who):
    open_client(lab.router(), lab.keys(who)).close()


def acting_as(subject, *parts):
    """Return the change of a router's settings that lets `subject` do what the rules for `parts` allow, and no more."""

    def changed(settings):
        ids = [rule["id"] for rule in settings["access_control/rules"] if rule["id"].split(" ")[0] in parts]
        assert ids
        policies = [
            one | {"rules": ids} if one["subjects"] == [subject] else one for one in settings["access_control/policies"]
        ]
        return settings | {"access_control/policies": policies}

    return changed


@pytest.mark.parametrize(
    ("who", "parts", "rights"),
    [
        ("operator/ann", ["viewer/0"], "viewer"),
        ("world", ["operator/0"], "operator"),
        ("robot/3-4", ["robot/3"], "robot/3"),
        ("robot/1", ["viewer/0"], "viewer"),
        ("viewer/bob", ["world/0", "operator/0"], "world, operator"),
    ],
)
def test_a_process_that_may_do_less_than_its_role_is_told_whose_rights_it_has(lab, who, parts, rights):
    endpoint = lab.router(changed=acting_as(who, *parts))
    with pytest.raises(NotAdmittedError) as refused:
        open_client(endpoint, lab.keys(who))
    said = f"{endpoint} lets {who} in, but it may not act in this lab; its rights are those of {rights}: start what"
    assert str(refused.value).startswith(said)


def test_a_process_that_may_do_nothing_is_told_that(lab):
    endpoint = lab.router(changed=acting_as("viewer/bob", "robot/2"))
    with pytest.raises(NotAdmittedError, match="lets viewer/bob in, but carries nothing of it: its certificate is"):
        open_client(endpoint, lab.keys("viewer/bob"))


# --- several routers


@pytest.mark.parametrize("first", [ROUTER, "world"])
@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("role", ["robot", "viewer"])
def test_rights_are_the_same_through_two_routers_or_a_world_that_is_one(lab, first, verb, role):
    near = lab.router(who=first)
    far = lab.router(near)
    actor, witness = lab.session(far, HOLDERS[role]), lab.session(near, ROUTER)
    tried = {"puts": puts, "hears": hears, "asks": asks, "serves": serves, "lives": lives, "watches": watches}
    assert tried[verb](actor, witness, role) == allowed(role, verb)
