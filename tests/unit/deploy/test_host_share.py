"""`rmr up --here HOST`: what one host starts, and each mistake about hosts in one sentence, before anything starts."""

import asyncio
import json
import shutil
from pathlib import Path

import pytest
from command_runner import invoke

from rmr.bus import wire
from rmr.bus.authority import Authority, holder, write_bundle
from rmr.bus.secret import make_secret, read_secret
from rmr_deploy.host_company import GONE_S, HostCompany
from rmr_deploy.host_share import difference
from rmr_deploy.preparation import (
    RunPlan,
    RunRefusedError,
    agent_command,
    endpoint_of,
    make_plan,
    router_command,
    world_command,
)
from rmr_deploy.run_options import RunOptions
from rmr_deploy.run_outcome import RunOutcome, read_befell
from rmr_deploy.up import command

pytestmark = pytest.mark.medium

CORRIDOR = Path(__file__).parents[3] / "deploy" / "labs" / "corridor"
HOSTS = """\
hosts:
  a: {address: 10.0.0.5, world: true, robots: 1}
  b: {robots: 2-3}
  c: {robots: 4-6}
  relay: {router: true}
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "hosts.yaml").write_text(HOSTS)
    make_secret(tmp_path / "secret")
    return tmp_path


def plan(folder, here, run=None, **options) -> RunPlan:
    """Return the plan of a host with the secret that all share."""
    told = {"lab": CORRIDOR, "hosts": folder / "hosts.yaml", "here": here, "folder": folder / (run or here or "none")}
    return make_plan(RunOptions(**told | {"secret": folder / "secret"} | options), color=False)


def refused(folder, here="b", **options):
    """Return exit code and sentence of a host that is refused, with the folder left out."""
    with pytest.raises(RunRefusedError) as caught:
        plan(folder, here, **options)
    return caught.value.exit_code, str(caught.value).replace(f"{folder}/", "").rstrip("\n")


def test_the_host_of_the_world_starts_it_for_all_and_its_own_robots(folder):
    made = plan(folder, "a")
    assert (made.has_world, made.robots, made.process_robots) == (True, (1,), [(1,)])
    assert endpoint_of(made) == "tcp/127.0.0.1:17447"
    words = router_command(made, made.share)
    assert words[words.index("--listen") + 1] == "tcp/0.0.0.0:17447"
    assert "--open" not in words
    words = world_command(made, endpoint_of(made))
    assert words[words.index("--connect") + 1] == "tcp/127.0.0.1:17447"
    assert "--listen" not in words
    assert read_secret(made.secret).password == read_secret(folder / "secret").password


def test_another_host_starts_its_robots_alone_and_connects_to_that_of_the_world(folder):
    made = plan(folder, "c", processes=2)
    assert (made.has_world, made.process_robots) == (False, [(4,), (5, 6)])
    words = agent_command(made, (4,), endpoint_of(made))
    assert words[words.index("--connect") + 1] == "tcp/10.0.0.5:17447"
    assert not (made.folder / "record" / "launcher.mcap").exists(), "a recording has it once"


def test_an_open_world_says_so_and_has_no_secret(folder, capsys):
    made = plan(folder, "a", secret=None, opened=True)
    said = "rmr up: open: whoever reaches tcp/10.0.0.5:17447 can drive the robots and end the run\n"
    assert capsys.readouterr().err == said
    assert "--open" in router_command(made, made.share)
    assert "--open" not in world_command(made, endpoint_of(made))
    assert not made.secret.exists()
    assert made.credentials is None
    assert "--secret" not in agent_command(made, (1,), endpoint_of(made))


def test_the_host_of_the_world_makes_the_secret(folder, capsys):
    made = plan(folder, "a", secret=folder / "new")
    assert read_secret(folder / "new").password == read_secret(made.secret).password
    assert "copy it to the other hosts" in capsys.readouterr().err


def test_a_router_that_is_reached_by_loopback_listens_there_alone(folder):
    text = "hosts:\n  a: {address: 127.0.0.1, world: true}\n  b: {robots: 1-6, router: false}\n"
    (folder / "hosts.yaml").write_text(text)
    made = plan(folder, "a")
    words = router_command(made, made.share)
    assert words[words.index("--listen") + 1] == "tcp/127.0.0.1:17447"


@pytest.mark.parametrize(
    ("options", "code", "sentence"),
    [
        ({"here": "d"}, 2, "rmr up: hosts.yaml has no host d: its hosts are a, b, c, relay"),
        ({"here": None}, 2, "rmr up: which host is this machine? Name one of a, b, c, relay with --here"),
        (
            {"here": None, "hosts": None},
            2,
            "rmr up: --secret goes with --here HOST, which names this machine's share of the lab",
        ),
        ({"hosts": None}, 2, f"rmr up: {CORRIDOR}/lab.yaml has no hosts: name a file that has with --hosts FILE"),
        ({"hosts": Path("nowhere.yaml")}, 3, "nowhere.yaml: cannot be read: No such file or directory"),
        (
            {"here": "relay"},
            2,
            "rmr up: host relay has neither the world nor robots, so there is nothing to start; rmr router starts a "
            "router there",
        ),
        ({"robots": 2}, 2, "rmr up: --robots goes without --here: the hosts have all robots of the lab"),
        ({"seed": 7}, 2, "rmr up: --seed goes with the host of the world, a, not with b"),
        ({"keep_going": True}, 2, "rmr up: --keep-going goes with the host of the world, a, not with b"),
        ({"opened": True}, 2, "rmr up: --open goes without --secret: name one of them"),
        (
            {"secret": None},
            2,
            "rmr up: whoever reaches tcp/10.0.0.5:17447, from other machines, too, could drive the robots: name a "
            "secret that all hosts share with --secret FILE, which the world's host makes if it does not exist, or "
            "allow that with --open; or give the lab keys (bus: {security: mtls})",
        ),
        (
            {"secret": Path("gone")},
            2,
            "rmr up: gone: no such file: copy the secret of host a there, which makes it with --secret FILE",
        ),
    ],
)
def test_mistakes_are_told_before_anything_starts(folder, options, code, sentence):
    assert refused(folder, **options) == (code, sentence)


def test_a_robot_that_two_hosts_of_a_file_claim_is_told_with_its_place(folder):
    (folder / "hosts.yaml").write_text("hosts:\n  a: {world: true, robots: 1-4}\n  b: {robots: 4-6}\n")
    assert refused(folder) == (3, "hosts.yaml:3:15: hosts.b.robots: robot 4 is on host a already (line 2)")


def test_a_secret_that_others_may_read_is_refused_and_leaves_nothing(folder):
    (folder / "secret").chmod(0o644)
    assert refused(folder)[0] == 3
    assert not (folder / "b" / "secret").exists()


def test_words_of_the_command_line_reach_the_run(folder):
    words = [str(CORRIDOR), "--hosts", str(folder / "hosts.yaml"), "--here", "d", "--open", "--wait-hosts", "7"]
    answer = invoke(command(), words, name="rmr up")
    assert (answer.exit_code, answer.stdout) == (2, "")
    assert "has no host d: its hosts are a, b, c, relay" in answer.stderr


# --- keys


def lab_with_keys(folder):
    lab = folder / "lab"
    shutil.copytree(CORRIDOR, lab)
    with (lab / "lab.yaml").open("a") as file:
        file.write("bus: {security: mtls}\n")
    return lab


def test_a_lab_with_keys_takes_the_bundles_of_a_host_and_tells_which_is_missing(folder):
    lab = lab_with_keys(folder)
    ca = Authority.begin(folder / "ca")
    keys = folder / "keys"
    keys.mkdir(0o700)
    for who in ("operator/ann", "robot/2", "robot/3"):
        ca.issue(holder(*who.split("/")))
    told = {"lab": lab, "secret": None}
    assert refused(folder, **told)[1].endswith("of its CA (rmr keys init) with --keys, or of this host's keys")
    assert refused(folder, **told, keys=keys)[1] == (
        "keys/operator: no such folder; where the CA is: rmr keys bundle CA operator/NAME -o operator; then copy it "
        "here"
    )
    write_bundle(ca.bundle(holder("operator", "ann")), keys / "operator")
    write_bundle(ca.bundle(holder("robot", "2")), keys / "robot-2")
    write_bundle(ca.bundle(holder("robot", "2")), keys / "robot-3")
    shutil.rmtree(folder / "b")
    assert "robot/2" in refused(folder, **told, keys=keys)[1], "these are not the keys of robot 3"
    shutil.rmtree(keys / "robot-3")
    write_bundle(ca.bundle(holder("robot", "3")), keys / "robot-3")
    shutil.rmtree(folder / "b")
    made = plan(folder, "b", **told, keys=keys)
    assert sorted(path.name for path in made.secret.parent.iterdir()) == ["operator", "robots-2", "robots-3"]
    assert endpoint_of(made) == "tls/10.0.0.5:17447"


def test_a_secret_goes_without_keys(folder):
    lab = lab_with_keys(folder)
    told = refused(folder, lab=lab, keys=folder)
    assert told == (2, "rmr up: --secret goes without `security: mtls` of the lab, whose hosts have keys")


# --- what hosts tell each other


class OneBus:
    """A bus on which one launcher is alone: what it says is kept, and what others say is handed to it."""

    run = 1

    def __init__(self):
        self.said = []
        self.served = {}
        self.replies = {}

    def subscribe(self, _key, handler):
        self.handler = handler

    def serve(self, key, answer):
        self.served[key] = answer

    async def ask(self, key, body, _timeout_s):
        """Return the reply that was put under the order, if any."""
        reply = self.replies.get((key, body.request))
        return [] if reply is None else [(wire.Envelope(wire.OPERATOR_ID, 2, 1, reply), 0)]

    def ordered(self, key, request, sender=wire.OPERATOR_ID):
        """Return the answer to a request on `key`; None where there is none."""
        reply = self.served[key](wire.Envelope(sender, 2, 1, wire.HostOrder(request)), 0)
        return None if reply is None else (reply.host, json.loads(reply.answer))

    def publish(self, key, body):
        self.said.append((key, body))

    def hear(self, body, run=2, sender=wire.OPERATOR_ID):
        self.handler("", wire.Envelope(sender, run, 1, body))


@pytest.fixture
def company(folder):
    runs = iter(range(9))

    def make(here):
        made = plan(folder, here, run=f"run-{next(runs)}")
        bus = OneBus()
        orders = []

        def perform(request):
            orders.append(request)
            return "robot 2 is dead" if request["robot"] == 2 else "" if request["robot"] == 3 else None

        company = HostCompany(made, made.share, bus, perform, lambda request: {"asked": request})
        company.orders = orders
        return company, bus

    return make


def told(company_of, here):
    """Return what the launcher of `here` says."""
    company, bus = company_of(here)
    company.tell("waiting")
    return bus.said[-1][1]


def test_a_host_with_the_same_lab_takes_part(company):
    b, bus = company("b")
    assert (b.hub, b.refusal(), b.settled) == (None, "", False)
    bus.hear(told(company, "a"))
    assert b.refusal() == ""
    assert bus.said == []


def test_another_program_and_another_version_are_named_with_both(company):
    b, bus = company("b")
    a = told(company, "a")
    other = tuple((what, {"rmr": "9.9", "program": "deadbeef"}.get(what, value)) for what, value in a.made_of)
    bus.hear(a._replace(made_of=other))
    own = dict(a.made_of)
    assert b.refusal() == (
        f"host b has another lab than host a: rmr {own['rmr']} here, 9.9 there; program {own['program']} here, "
        "deadbeef there; give both the same files and the same rmr"
    )


def test_a_robot_that_two_hosts_claim_by_different_files_is_named(company):
    b, bus = company("b")
    shares = (("a", (1,)), ("b", (2,)), ("c", (3, 4, 5, 6)), ("relay", ()))
    bus.hear(told(company, "a")._replace(shares=shares))
    assert b.refusal() == (
        "robot 3 is on host b by the hosts of host b, and on host c by those of host a: give both the same file of "
        "hosts"
    )


def test_a_host_more_is_a_difference():
    same = {"a": (), "b": (1,)}
    assert difference((), (), same, {**same, "x": ()}, "b", "a").startswith("the hosts are a, b by the file of host b")


def test_a_host_that_takes_part_already_is_told_to_the_second_one(company):
    b, bus = company("b")
    own = told(company, "b")
    bus.hear(own, run=OneBus.run)
    assert b.refusal() == "", "its own words"
    bus.hear(own._replace(state="left"), run=7)
    assert b.refusal() == "", "it has left"
    bus.hear(own, run=7)
    assert b.refusal() == "host b takes part already: another rmr up --here b runs"


def test_a_robot_in_the_name_of_a_launcher_is_not_heard(company):
    a, bus = company("a")
    bus.hear(told(company, "b"), sender=2)
    assert a.missing() == ["b (robots 2-3)", "c (robots 4-6)"]


def test_what_became_of_the_robots_of_other_hosts(company, monkeypatch):
    a, bus = company("a")
    b, c = told(company, "b"), told(company, "c")
    bus.hear(b._replace(gone=((3, "died"), (4, "died"))))
    bus.hear(c)
    assert a.missing() == []
    assert a.lost(started=True) == {3: "died"}, "robot 4 is not of host b"
    bus.hear(c._replace(state="left", reason="interrupted"))
    assert a.lost(started=True) == {3: "died", 4: "stopped", 5: "stopped", 6: "stopped"}
    assert a.lost(started=False) == {3: "died"}, "host c may come again"
    assert a.reasons() == {"c": "interrupted"}
    assert a.missing() == ["c (robots 4-6)"]
    bus.hear(c)
    assert a.lost(started=True) == {3: "died"}, "it is back"
    monkeypatch.setattr("rmr_deploy.host_company.GONE_S", -GONE_S)
    assert a.lost(started=True) == dict.fromkeys((2, 3, 4, 5, 6), "died")


def test_a_second_launcher_in_the_name_of_a_host_changes_nothing_until_the_first_one_has_left(company):
    a, bus = company("a")
    b = told(company, "b")
    bus.hear(b, run=2)
    bus.hear(b._replace(state="left"), run=3)
    assert a.lost(started=True) == {}
    bus.hear(b._replace(state="left"), run=2)
    bus.hear(b._replace(state="running", folder="again"), run=3)
    assert a.lost(started=True) == {}
    assert a.folders == {"b": [b.folder, "again"]}


def test_a_robot_that_a_person_has_killed_has_died_and_ends_no_run(company):
    a, bus = company("a")
    bus.hear(told(company, "b")._replace(gone=((2, "killed"), (3, "died"))))
    assert a.lost(started=True) == {2: "died", 3: "died"}
    assert a.killed() == {2}


def test_an_order_is_carried_out_by_the_launcher_of_the_robots_host_and_answered(company):
    b, bus = company("b")
    key = "rmr/corridor/hosts/b/order"
    answers = [bus.ordered(key, json.dumps({"do": "kill", "robot": robot}).encode()) for robot in (2, 3, 9)]
    assert answers == [("b", {"refused": "robot 2 is dead"}), ("b", {"refused": ""}), None]
    assert [bus.ordered(key, octets) for octets in (b"{", b"[]", b"[" * 4096)] == [None] * 3
    assert bus.ordered(key, b'{"do": "kill", "robot": 2}', sender=1) is None
    assert [order["robot"] for order in b.orders] == [2, 3, 9]


def test_a_question_is_answered_and_one_whose_answer_is_too_long_is_refused(company):
    _, bus = company("b")
    key = "rmr/corridor/hosts/b/look"
    assert bus.ordered(key, b'{"do": "status"}') == ("b", {"told": {"asked": {"do": "status"}}})
    refused = ("b", {"refused": "host b has more to tell than fits an answer"})
    assert bus.ordered(key, json.dumps({"do": "x" * wire.MESSAGE_OCTETS_MAX}).encode()) == refused


def test_an_order_to_another_host_is_answered_by_it_or_by_its_silence(company):
    a, bus = company("a")
    b = told(company, "b")

    async def ask(host, robot):
        return await a.order(host, {"do": "kill", "robot": robot})

    for octets, robot in ((b'{"refused": "robot 2 is dead"}', 2), (b"{", 3)):
        request = json.dumps({"do": "kill", "robot": robot}).encode()
        bus.replies["rmr/corridor/hosts/b/order", request] = wire.HostAnswer("b", octets)
    assert asyncio.run(ask("c", 4)) == "host c is not there"
    bus.hear(b)
    assert asyncio.run(ask("b", 2)) == "robot 2 is dead"
    assert asyncio.run(ask("b", 3)) == "", "what is no answer refuses nothing"
    assert asyncio.run(ask("b", 1)) == "host b does not answer: whether it was carried out is not known"


def test_news_are_told_at_once_and_the_same_again_after_a_while(company, monkeypatch):
    b, bus = company("b")
    b.tell("waiting")
    b.tell("waiting")
    b.tell("running", {3: "died"})
    assert [(body.state, body.gone) for _, body in bus.said] == [("waiting", ()), ("running", ((3, "died"),))]
    monkeypatch.setattr("rmr_deploy.host_company.TELL_S", 0.0)
    b.tell("running", {3: "died"})
    assert len(bus.said) == 3
    assert bus.said[0][0] == "rmr/corridor/hosts/b"


@pytest.mark.parametrize("octets", [b"", b"{", b"[]", b"[1, 2, 3]", b"[[], [], []]", b"[" * 4096, b"null"])
def test_what_befell_robots_elsewhere_is_nothing_where_it_is_not_understood(octets):
    assert read_befell(octets) == ([], [], {})


def test_what_befell_robots_elsewhere_has_times_and_exit_codes():
    outcome = RunOutcome(faults=[{"at": 1.0, "kill": 2}, {"from": 1.0, "to": 2.0, "stall": 3}], ended={"robot-2": -9})
    outcome.note_lives("restart", [2], 1.5)
    told = read_befell(outcome.befell())
    assert told == (outcome.faults, [{"at": 1.5, "restart": 2}], {"robot-2": -9})
    entries = [{"at": "soon", "kill": 1}, {"kill": 1}, {"at": 1.0, "to": 2.0}, 7, {"at": 2.0, "kill": 1}]
    assert read_befell(json.dumps([entries, [], {"robot-1": "x"}]).encode()) == ([entries[-1]], [], {})
