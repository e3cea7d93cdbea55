"""Keys among real processes: who has the lab's is let in, all others are told why not, the revoked do nothing."""

import json
import shutil
import signal
import socket
import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh
from launched import LABS, Launched
from process_tools import Stage, free_endpoint, wait_until

from rmr.bus import admission, authority
from rmr.bus.authority import Authority, holder, write_bundle
from rmr.bus.certificates import CERTIFICATE_FILE, read_certificate
from rmr.bus.middleware import router_settings
from rmr.bytecode.layout import split
from rmr_deploy.sign import signed

pytestmark = pytest.mark.slow

HOLDERS = ("world", "robot/1", "robot/2", "router/127.0.0.1", "operator/ann", "viewer/bob")


class Lab:
    """A stage with a CA, and a folder with the keys of each process."""

    def __init__(self, folder: Path):
        self.folder = folder
        (folder / "stage").mkdir()
        self.stage = Stage(folder / "stage", free_endpoint().replace("tcp/", "tls/"))
        self.ca = Authority.begin(folder / "ca")
        for who in HOLDERS:
            self.issue(who)
        for who in ("world", "router/127.0.0.1"):  # whose folders name all others
            self.bundle(who)
        self.sign()

    def sign(self):
        """Sign the program of the robots, as they run no other."""
        program = self.stage.folder / "idle.rbc"
        program.write_bytes(signed(program.read_bytes(), self.keys("operator/ann"), anew=True))

    def issue(self, who, days=365):
        """Issue a certificate, and write the folder of its process."""
        role, _, name = who.partition("/")
        self.ca.issue(holder(role, name), days=days)
        return self.bundle(who)

    def bundle(self, who):
        """Write the folder of a process; return it."""
        role, _, name = who.partition("/")
        out = self.keys(who)
        shutil.rmtree(out, ignore_errors=True)
        write_bundle(self.ca.bundle(holder(role, name)), out)
        return out

    def keys(self, who):
        return self.folder / who.replace("/", "-")

    def world(self, *options):
        """Start the world of a lab with security mtls."""
        lab = self.stage.folder / "lab.yaml"
        lab.write_text(lab.read_text() + "bus: {security: mtls}\n")
        return self.stage.world("--keys", self.keys("world"), *options)

    def router(self, *options, listen=None):
        where = ("--listen", listen or self.stage.endpoint)
        return self.stage.start("rmr_deploy.router", *where, "--keys", self.keys("router/127.0.0.1"), *options)

    def robot(self, robot, *options, keys=None, connect=None):
        where = ("--connect", connect or self.stage.endpoint, "--keys", keys or self.keys(f"robot/{robot}"))
        return self.stage.start("rmr_agent.main", "--id", robot, self.stage.folder / "idle.rbc", *where, *options)

    def refused(self, *words, code=1):
        """Start a process that is refused; return the one line that it says."""
        started = self.stage.start(*words)
        assert started.exit_code() == code, started.said()
        line, *others = started.said().splitlines()
        assert not others, started.said()
        return line


@pytest.fixture
def lab(tmp_path):
    lab = Lab(tmp_path)
    yield lab
    lab.stage.end()
    assert not any("Traceback" in started.said() for started in lab.stage.started)


def agent(lab, *options):
    return ("rmr_agent.main", "--id", 1, lab.stage.folder / "idle.rbc", *options)


# --- a lab with keys


def test_processes_with_keys_are_one_lab_through_routers(lab):
    other = free_endpoint().replace("tcp/", "tls/")
    first = lab.router()
    second = lab.router("--connect", lab.stage.endpoint, listen=other)
    second.wait_for("joined the router at")
    world = lab.world("--connect", lab.stage.endpoint, "--when-ready")
    lab.robot(1)
    lab.robot(2, connect=other)
    world.wait_for("lab time runs")
    first.wait_for("connected: 1 router, 2 processes")


def test_up_hands_keys_to_its_processes_and_takes_them_back_at_the_end(lab, tmp_path):
    folder = tmp_path / "dash"
    shutil.copytree(LABS / "dash", folder)
    with (folder / "lab.yaml").open("a") as file:
        file.write("bus: {security: mtls}\n")
    for robot in (1, 2, 3):
        lab.ca.issue(holder("robot", str(robot)))
    launched = Launched(folder, tmp_path, "--keys", str(lab.ca.folder))
    try:
        launched.running()
        assert launched.endpoint.startswith("tls/127.0.0.1:")
        holders = {str(read_certificate(one).holder) for one in (launched.folder / "keys").iterdir()}
        assert holders == {"world", "operator/ann", "robot/1", "robot/2", "robot/3"}
        fault = lab.stage.start("rmr_deploy.fault", "list", "--run", launched.folder)
        assert fault.exit_code() == 0, fault.said()
        assert launched.wait() == 0, launched.out + launched.err
        assert not (launched.folder / "keys").exists()
        assert not (launched.folder / "secret").exists()
    finally:
        launched.clean_up()


def test_the_address_of_a_lab_is_in_use_by_what_its_keys_show(lab):
    lab.world().wait_for("lab bench, 2 robots")
    again = lab.router()
    assert again.exit_code() == 1
    assert "is in use: the world of lab bench runs there" in again.said()


def test_operators_and_viewers_are_let_in_for_what_they_do(lab):
    lab.world().wait_for("lab bench, 2 robots")
    fault = ("rmr_deploy.fault", "list", "--connect", lab.stage.endpoint, "--keys")
    assert lab.stage.start(*fault, lab.keys("operator/ann")).exit_code() == 0
    said = lab.refused(*fault, lab.keys("viewer/bob"), code=3)
    assert said.endswith("the keys of viewer/bob, where those of operator are needed; issue them with rmr keys issue")


def test_robots_with_keys_run_signed_programs_alone_and_an_operator_who_loads_one_signs_it(lab):
    unsigned = lab.stage.folder / "unsigned.rbc"
    unsigned.write_bytes(split((lab.stage.folder / "idle.rbc").read_bytes()).program)
    where = ("--connect", lab.stage.endpoint, "--keys")
    said = lab.refused("rmr_agent.main", "--id", 1, unsigned, *where, lab.keys("robot/1"), code=3)
    assert f"{unsigned}: it is not signed, as all programs of this robot must be: rmr sign PROG.rbc --keys DIR" in said
    lab.world().wait_for("lab bench, 2 robots")
    robots = [lab.robot(robot) for robot in (1, 2)]
    for robot in robots:
        robot.wait_for("is in lab bench")
    assert lab.stage.start("rmr_deploy.load", unsigned, *where, lab.keys("operator/ann")).exit_code() == 0
    for robot in robots:
        robot.wait_for("runs program")


# --- refused


def test_a_process_without_keys_is_refused_in_one_sentence(lab):
    lab.world().wait_for("lab bench, 2 robots")
    config = lab.stage.folder / "lab.yaml"
    said = lab.refused("rmr_world.main", "--config", config, "--listen", free_endpoint(), code=3)
    assert said.startswith(
        "lab bench has `security: mtls`: name the folder with the keys of this process with --keys DIR"
    )
    plain = lab.stage.endpoint.replace("tls/", "tcp/")
    said = lab.refused(*agent(lab, "--connect", plain))
    assert f"{plain} lets in processes with keys alone: connect to {lab.stage.endpoint} with --keys DIR" in said
    wrong = lab.stage.start(*agent(lab, "--connect", lab.stage.endpoint))
    assert wrong.exit_code() == 2
    assert f"{lab.stage.endpoint} needs keys: name their folder with --keys DIR" in wrong.said()


def test_the_keys_of_another_robot_or_role_are_refused(lab):
    said = lab.refused(*agent(lab, "--connect", lab.stage.endpoint, "--keys", lab.keys("robot/2")), code=3)
    assert "the keys of robot/2, where those of robot/1 are needed" in said
    said = lab.refused("rmr_deploy.router", "--keys", lab.keys("robot/2"), code=3)
    assert "the keys of robot/2, where those of router or world are needed" in said


def foreign(lab, who="robot/1"):
    """Return the keys that another CA has issued to `who`."""
    role, _, name = who.partition("/")
    other = Authority.begin(lab.folder / "other")
    other.issue(holder(role, name))
    write_bundle(other.bundle(holder(role, name)), lab.folder / "foreign")
    return lab.folder / "foreign"


def test_keys_of_another_ca_are_told(lab):
    lab.world().wait_for("lab bench, 2 robots")
    waits = agent(lab)[:-1]  # without a program: it would take none that this lab's operator has signed
    said = lab.refused(*waits, "--connect", lab.stage.endpoint, "--keys", foreign(lab))
    assert f"what listens at {lab.stage.endpoint} is no router of this lab: " in said
    assert "the certificate of world is of another CA than the one in ca.pem" in said


def test_a_listener_reached_under_another_name_is_told_with_the_names_that_it_has(lab):
    lab.stage.endpoint = lab.stage.endpoint.replace("127.0.0.1", "0.0.0.0")
    lab.world().wait_for("lab bench, 2 robots")
    elsewhere = lab.stage.endpoint.replace("0.0.0.0", "127.0.0.2")
    said = lab.refused(*agent(lab, "--connect", elsewhere, "--keys", lab.keys("robot/1")))
    assert (
        "its certificate is for localhost, 127.0.0.1, ::1 and not for 127.0.0.2; issue it with --host 127.0.0.2" in said
    )


def test_what_speaks_no_tls_is_told(lab):
    plain = lab.stage.endpoint.replace("tls/", "tcp/")
    lab.stage.start("rmr_deploy.router", "--listen", plain).wait_for("a router at")
    said = lab.refused(*agent(lab, "--connect", lab.stage.endpoint, "--keys", lab.keys("robot/1")))
    assert f"what listens at {lab.stage.endpoint} has no keys: start it with --keys, too" in said


def test_a_listener_that_takes_the_certificate_for_a_foreign_one_is_quoted(lab):
    """The robot knows both CAs, as while they are exchanged, and the router the new one alone."""
    own = lab.keys("robot/1")
    keys = foreign(lab, "router/127.0.0.1")
    lab.stage.start("rmr_deploy.router", "--listen", lab.stage.endpoint, "--keys", keys).wait_for("a router at")
    host, port = lab.stage.endpoint.removeprefix("tls/").split(":")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(keys / "ca.pem")
    context.load_cert_chain(own / "cert.pem", own / "key.pem")
    with socket.create_connection((host, int(port))) as plain, context.wrap_socket(plain, server_hostname=host) as tls:
        said = admission._alert(tls)
    assert said == "has another CA than this process: take the keys of both from one rmr keys init"


def outsider(endpoint, keys):
    """Open a session as any program with these files can. Raises ZError where it is refused."""
    config = zenoh.Config()
    settings = {} if keys is None else read_certificate(keys).client_settings()
    for key, value in {
        "mode": "client",
        "listen/endpoints": [],
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 500,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        **settings,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def test_zenoh_itself_gets_no_session_without_a_certificate_of_the_ca(lab):
    lab.world().wait_for("lab bench, 2 robots")
    plain = lab.stage.endpoint.replace("tls/", "tcp/")
    for endpoint, keys in ((plain, None), (lab.stage.endpoint, None), (lab.stage.endpoint, foreign(lab))):
        with pytest.raises(zenoh.ZError, match="Unable to connect"):
            outsider(endpoint, keys)
    outsider(lab.stage.endpoint, lab.keys("viewer/bob")).close()


def test_a_robot_cannot_take_the_place_of_a_router(lab):
    """Its certificate has neither the usage of a server nor the name of a host: TLS refuses it, and says so."""
    settings = router_settings(lab.stage.endpoint, (), read_certificate(lab.keys("router/127.0.0.1")))
    robot = lab.keys("robot/2")
    config = zenoh.Config()
    for key, value in settings.items():
        files = {"listen_certificate": "cert.pem", "listen_private_key": "key.pem"}
        name = files.get(key.rpartition("/")[2])
        config.insert_json5(key, json.dumps(value if name is None else str(robot / name)))
    with zenoh.open(config):
        with pytest.raises(zenoh.ZError, match="Unable to connect"):
            outsider(lab.stage.endpoint, lab.keys("robot/1"))
        said = lab.refused(*agent(lab, "--connect", lab.stage.endpoint, "--keys", lab.keys("robot/1")))
    assert "it has the certificate of robot/2, which may not listen" in said


# --- revoked


def revoke(lab, who):
    role, _, name = who.partition("/")
    lab.ca.revoke(holder(role, name))
    lab.bundle("router/127.0.0.1")


def test_a_revoked_robot_is_told_and_one_that_was_issued_anew_is_let_in(lab):
    revoke(lab, "robot/1")
    router = lab.router()
    lab.world("--connect", lab.stage.endpoint).wait_for("lab bench, 2 robots")
    said = lab.refused(*agent(lab, "--connect", lab.stage.endpoint, "--keys", lab.keys("robot/1")))
    assert f"{lab.stage.endpoint} lets robot/1 in, but carries nothing of it: its certificate is revoked there" in said
    router.wait_for("robot/1 is connected with a revoked certificate: nothing of it is carried")
    lab.robot(2).wait_for("robot 2 is in lab bench")
    lab.issue("robot/1")
    lab.robot(1).wait_for("robot 1 is in lab bench")


def test_who_was_issued_keys_after_the_bundle_of_a_router_is_told(lab):
    router = lab.router()
    router.wait_for("a router at")
    keys = lab.issue("operator/eve")
    said = lab.refused("rmr_deploy.fault", "list", "--connect", lab.stage.endpoint, "--keys", keys)
    assert f"{lab.stage.endpoint} lets operator/eve in, but carries nothing of it: " in said
    assert "holder was not known yet when the keys of what listens were bundled" in said
    router.wait_for("operator/eve is connected and not in members.txt: nothing of it is carried")


def test_a_process_with_less_rights_than_its_role_ends_with_one_sentence(lab):
    """A zenohd, say, whose rules somebody has changed: all may do what a viewer may."""
    settings = router_settings(lab.stage.endpoint, (), read_certificate(lab.keys("router/127.0.0.1")))
    rules = [rule["id"] for rule in settings["access_control/rules"] if rule["id"].startswith("viewer/")]
    policies = [one | {"rules": rules} for one in settings["access_control/policies"]]
    config = zenoh.Config()
    for key, value in (settings | {"access_control/policies": policies}).items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config):
        where = ("--connect", lab.stage.endpoint, "--keys")
        for who, words in (("operator/ann", ("rmr_deploy.fault", "list")), ("robot/1", agent(lab))):
            said = lab.refused(*words, *where, lab.keys(who))
            assert f"lets {who} in, but it may not act in this lab; its rights are those of viewer: " in said


def test_a_router_that_has_not_the_new_list_still_carries_the_revoked(lab):
    """The limit that the page tells: the list is read when the router starts."""
    router = lab.router()
    lab.world("--connect", lab.stage.endpoint).wait_for("lab bench, 2 robots")
    revoke(lab, "robot/1")
    robot = lab.robot(1)
    robot.wait_for("robot 1 is in lab bench")
    router.send(signal.SIGTERM)
    assert router.exit_code() == 0
    lab.router()
    robot.wait_for("carries nothing of it: its certificate is revoked there")


def test_a_revoked_session_can_neither_say_nor_hear_anything(lab):
    """Not even one that might do everything: a router's."""
    lab.issue("router/b")
    revoke(lab, "router/b")
    lab.router().wait_for("a router at")
    heard = []
    good_keys = lab.keys("router/127.0.0.1")
    with outsider(lab.stage.endpoint, good_keys) as good, outsider(lab.stage.endpoint, lab.keys("router/b")) as bad:
        ears = [
            each.declare_subscriber("rmr/**", lambda s, who=who: heard.append((who, str(s.key_expr))))
            for who, each in (("good", good), ("bad", bad))
        ]
        serves = [
            each.declare_queryable(f"rmr/{who}", lambda query, who=who: query.reply(f"rmr/{who}", b"x"))
            for who, each in (("good", good), ("bad", bad))
        ]
        tokens = [each.liveliness().declare_token(f"rmr/alive/{who}") for who, each in (("good", good), ("bad", bad))]
        with outsider(lab.stage.endpoint, good_keys) as witness:
            ears.append(witness.declare_subscriber("rmr/**", lambda s: heard.append(("witness", str(s.key_expr)))))

            def told():
                bad.put("rmr/from/bad", b"")
                good.put("rmr/from/good", b"")
                return ("witness", "rmr/from/good") in heard

            wait_until(told)
            asked = {
                (who, name)
                for who, each in (("bad", bad), ("witness", witness))
                for name in ("good", "bad")
                if list(each.get(f"rmr/{name}", timeout=0.5)) and who != name
            }
            alive = {str(reply.ok.key_expr) for reply in witness.liveliness().get("rmr/**", timeout=0.5)}
            seen = {str(reply.ok.key_expr) for reply in bad.liveliness().get("rmr/**", timeout=0.5)}
        for each in (*ears, *serves, *tokens):
            each.undeclare()
    assert ("witness", "rmr/from/good") in heard
    assert not {one for one in heard if one[1] == "rmr/from/bad" and one[0] != "bad"}
    assert ("bad", "rmr/from/good") not in heard
    assert asked == {("witness", "good")}
    assert alive == {"rmr/alive/good"}
    assert "rmr/alive/good" not in seen


# --- while it runs


def test_files_that_others_can_read_are_refused_by_every_program(lab):
    key = lab.keys("robot/1") / "key.pem"
    key.chmod(0o644)
    said = lab.refused(*agent(lab, "--keys", key.parent), code=3)
    assert said.endswith(f"{key}: other users may read or change it; run: chmod 600 {key}")
    lab.keys("world").chmod(0o750)
    config = lab.stage.folder / "lab.yaml"
    said = lab.refused("rmr_world.main", "--config", config, "--keys", lab.keys("world"), code=3)
    assert f"run: chmod 700 {lab.keys('world')}" in said


def test_another_program_is_told(lab):
    with socket.create_server(("127.0.0.1", 0)) as foreign_program:
        endpoint = f"tls/127.0.0.1:{foreign_program.getsockname()[1]}"
        waits = lab.robot(1, connect=endpoint)
        waits.wait_for(f"waiting for the world at {endpoint}: what listens there has not answered within 0.5 s")


def test_an_address_where_nobody_listens_is_waited_for(lab):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        nobody = f"tls/127.0.0.1:{probe.getsockname()[1]}"
        waits = lab.robot(1, connect=nobody)
        waits.wait_for(f"waiting for the world at {nobody}")
        assert waits.process.poll() is None


def soon_over(lab, monkeypatch, who, seconds):
    """Issue a certificate of a day that ends in so many seconds."""
    began = datetime.now(UTC).replace(microsecond=0) - timedelta(days=1) + timedelta(seconds=seconds)
    with monkeypatch.context() as patch:
        patch.setattr(authority, "_now", lambda: began)
        return lab.issue(who, days=1)


def test_a_robot_whose_certificate_expires_while_it_runs_loses_the_lab_and_says_why(lab, monkeypatch):
    with monkeypatch.context() as patch:  # its validity does not begin after that of what it issues
        patch.setattr(authority, "_now", lambda: datetime.now(UTC).replace(microsecond=0) - timedelta(days=2))
        lab.ca = Authority.begin(lab.folder / "old")
    lab.issue("operator/ann")
    lab.sign()
    lab.issue("robot/1")
    lab.issue("world")
    lab.world().wait_for("lab bench, 2 robots")
    keys = soon_over(lab, monkeypatch, "robot/1", 8)
    robot = lab.robot(1)
    robot.wait_for("robot 1 is in lab bench")
    robot.wait_for(f"{keys}: the certificate of robot/1 has expired at ")
    assert robot.process.poll() is None
    said = lab.refused(*agent(lab, "--connect", lab.stage.endpoint, "--keys", keys), code=3)
    assert "the certificate of robot/1 has expired at " in said


def test_the_ca_exchanged_under_running_processes_is_told_by_the_robot(lab):
    router = lab.router()
    world = lab.world("--connect", lab.stage.endpoint)
    robot = lab.robot(1)
    robot.wait_for("robot 1 is in lab bench")
    router.send(signal.SIGTERM)
    assert router.exit_code() == 0
    keys = foreign(lab, "router/127.0.0.1")
    lab.stage.start("rmr_deploy.router", "--listen", lab.stage.endpoint, "--keys", keys).wait_for("a router at")
    robot.wait_for("the certificate of router/127.0.0.1 is of another CA than the one in ca.pem")
    assert robot.process.poll() is None
    assert world.process.poll() is None
    assert (lab.keys("robot/1") / CERTIFICATE_FILE).exists()
