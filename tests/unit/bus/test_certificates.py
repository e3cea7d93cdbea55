"""The CA of a lab and the certificates of its processes: what is issued, read, and refused in one sentence."""

import json
import re
import stat
import tarfile
from datetime import UTC, datetime, timedelta
from io import BytesIO
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from rmr.bus.authority import EARLIER, Authority, check_host, holder, write_bundle
from rmr.bus.certificates import (
    CertificateError,
    Holder,
    check_keys,
    credentials_path,
    default_endpoint,
    read_certificate,
)
from rmr.entry.command_line import CommandLineError

ROBOT = holder("robot", "4")
WORLD = holder("world")


@pytest.fixture
def ca(tmp_path):
    return Authority.begin(tmp_path / "ca")


@pytest.fixture
def bundled(ca, tmp_path):
    """Return a function that issues a certificate and returns the folder of its process."""

    def bundle(who, **options):
        ca.issue(who, **options)
        out = tmp_path / f"{str(who).replace('/', '-')}-{len(list(tmp_path.iterdir()))}"
        write_bundle(ca.bundle(who), out)
        return out

    return bundle


def certificate_in(folder, name="cert.pem"):
    return x509.load_pem_x509_certificate((folder / name).read_bytes())


def refused(folder, **when):
    with pytest.raises(CertificateError) as error:
        read_certificate(folder, **when)
    assert "\n" not in str(error.value)
    return str(error.value)


# --- holders


@pytest.mark.parametrize(
    "subject", ["robot/4", "robot/1-3", "world", "router/a.b", "operator/ann", "viewer/x", "robot/4#2"]
)
def test_a_holder_reads_back_as_its_subject(subject):
    assert Holder.read(subject).subject == subject


@pytest.mark.parametrize(
    "subject",
    ["", "robot", "robot/", "robot/x", "robot/3,2", "robot/70000", "world/0", "boss/1", "robot/4#1", "robot/4#x"],
)
def test_what_names_nobody_is_no_holder(subject):
    with pytest.raises(ValueError, match=r"names nobody|there is no robot|is no id"):
        Holder.read(subject)


def test_the_ids_of_several_robots_are_those_of_one_process():
    assert holder("robot", "3,1-2").robots == (1, 2, 3)
    assert str(holder("robot", "3,1-2")) == "robot/1-3"


@pytest.mark.parametrize("name", ["a b", "", "-a", "a/b", "a#2", "*.b", "ü", "a" * 300])
def test_a_host_or_name_with_strange_characters_is_refused(name):
    with pytest.raises(ValueError, match="no name or address of a host"):
        check_host(name)
    with pytest.raises(ValueError, match="cannot be a name"):
        holder("operator", name)


def test_a_host_has_one_form_whatever_way_it_is_written():
    assert check_host("[FE80:0::1]") == "fe80::1"
    assert check_host("Host-A.Example") == "host-a.example"


def test_a_name_that_fits_no_certificate_is_refused():
    with pytest.raises(ValueError, match="too long: 56 characters"):
        holder("router", "a" * 60)


# --- what is issued


def test_a_certificate_says_who_its_holder_is_in_its_subject_and_in_a_uri(bundled):
    certificate = certificate_in(bundled(ROBOT))
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert certificate.subject.rfc4514_string() == "CN=robot/4"
    assert [name.value for name in names] == ["rmr:robot/4"]
    assert certificate.public_key().curve.name == "secp256r1"


def test_only_a_router_or_the_world_may_listen(bundled):
    for who in (ROBOT, WORLD, holder("router", "a"), holder("operator", "o"), holder("viewer", "v")):
        usage = certificate_in(bundled(who)).extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        assert ExtendedKeyUsageOID.CLIENT_AUTH in usage
        assert (ExtendedKeyUsageOID.SERVER_AUTH in usage) == (who.role in {"router", "world"})


def test_a_router_is_reached_under_its_host_those_that_were_named_and_loopback(bundled):
    certificate = certificate_in(bundled(holder("router", "a.example"), hosts=("10.1.2.3", "a")))
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["a.example", "a", "localhost"]
    assert list(map(str, names.get_values_for_type(x509.IPAddress))) == ["10.1.2.3", "127.0.0.1", "::1"]


def test_validity_begins_a_little_earlier_and_never_ends_after_the_cas(bundled, ca):
    days = certificate_in(bundled(ROBOT, days=7))
    assert days.not_valid_after_utc - days.not_valid_before_utc == timedelta(days=7) + EARLIER
    longest = certificate_in(bundled(ROBOT, days=36500))
    assert longest.not_valid_after_utc == certificate_in(ca.folder, "ca.pem").not_valid_after_utc


def test_everything_that_is_written_is_private(ca, bundled):
    folder = bundled(WORLD)
    for root in (ca.folder, folder):
        for path in (root, *root.rglob("*")):
            assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0


def test_a_bundle_has_what_one_process_needs_and_nothing_else(bundled):
    of_robot = ["ca.pem", "cert.pem", "key.pem", "revoked.txt"]
    assert sorted(path.name for path in bundled(ROBOT).iterdir()) == of_robot
    of_operator = ["ca.pem", "cert.pem", "key.pem"]
    assert sorted(path.name for path in bundled(holder("operator", "ann")).iterdir()) == of_operator
    of_listener = ["ca.pem", "cert.pem", "key.pem", "members.txt", "revoked.txt"]
    assert sorted(path.name for path in bundled(WORLD).iterdir()) == of_listener


FILES = ("ca.pem", "cert.pem", "key.pem", "revoked.txt")


def test_a_bundle_may_be_an_archive_which_is_private_with_what_is_in_it(ca, tmp_path):
    ca.issue(ROBOT)
    write_bundle(ca.bundle(ROBOT), tmp_path / "4.tar")
    assert stat.S_IMODE((tmp_path / "4.tar").stat().st_mode) == 0o600
    with tarfile.open(fileobj=BytesIO((tmp_path / "4.tar").read_bytes())) as tar:
        assert {(one.name, one.mode) for one in tar} == {(name, 0o600) for name in FILES}
        (tmp_path / "own").mkdir(0o700)
        tar.extractall(tmp_path / "own", filter="data")
    assert read_certificate(tmp_path / "own").holder == ROBOT


def test_a_bundle_does_not_replace_what_is_there(ca, tmp_path):
    ca.issue(ROBOT)
    (tmp_path / "out").mkdir()
    with pytest.raises(CertificateError, match="it exists"):
        write_bundle(ca.bundle(ROBOT), tmp_path / "out")


def test_issuing_again_is_rotation_both_are_good(ca, bundled):
    first, second = bundled(ROBOT), bundled(ROBOT)
    assert read_certificate(first).holder == read_certificate(second).holder == ROBOT
    assert certificate_in(first).serial_number != certificate_in(second).serial_number
    assert (first / "key.pem").read_bytes() != (second / "key.pem").read_bytes()
    newest = ca.index()[-1]
    now = datetime.fromisoformat(newest.valid_from) + EARLIER
    assert [one.state(newest, now) for one in ca.index()] == ["replaced, still valid", "valid"]
    assert newest.state(newest, now + timedelta(days=400)) == "expired"
    assert newest.state(newest, now - timedelta(days=1)) == "not yet valid"


def test_revoked_are_all_certificates_until_then_and_none_after(ca, bundled):
    bundled(WORLD), bundled(WORLD)
    assert ca.revoke(WORLD) == 2
    with pytest.raises(CertificateError, match="all certificates of world are revoked already"):
        ca.revoke(WORLD)
    with pytest.raises(CertificateError, match="world has no certificate; issue one with rmr keys issue"):
        ca.bundle(WORLD)
    after = read_certificate(bundled(WORLD))
    assert (after.holder.subject, after.revoked) == ("world#2", (WORLD,))
    assert ca.revoke(WORLD) == 1
    assert read_certificate(bundled(WORLD)).revoked == (WORLD, Holder("world", "", 2))


def test_members_are_all_who_are_not_revoked_and_whoever_follows_them(ca, bundled):
    """A listener need not be told when one is issued a certificate anew after a revocation."""
    robots = holder("robot", "1-2")
    for who in (ROBOT, ROBOT, robots):
        ca.issue(who)
    assert ca.members() == ["robot/1-2", "robot/1-2#2", "robot/4", "robot/4#2"]
    ca.revoke(ROBOT)
    assert ca.members() == ["robot/1-2", "robot/1-2#2", "robot/4#2"]
    ca.issue(ROBOT)
    listener = read_certificate(bundled(WORLD))
    assert [one.subject for one in listener.members] == [*ca.members()]
    assert ca.members() == ["robot/1-2", "robot/1-2#2", "robot/4#2", "robot/4#3", "world", "world#2"]
    assert listener.denies("robot/4") == "with a revoked certificate"
    assert listener.denies("robot/4#2") == ""
    assert listener.denies("robot/5") == "and not in members.txt"


def test_nobody_can_be_bundled_or_revoked_who_has_no_certificate(ca):
    for act in (ca.bundle, ca.revoke):
        with pytest.raises(CertificateError, match=r"robot/4 has no certificate; issue one with .* --robot 4"):
            act(ROBOT)


# --- the folder of a CA


def test_a_folder_with_something_in_it_is_not_made_a_ca(ca, tmp_path):
    with pytest.raises(CertificateError, match="the folder has a CA already"):
        Authority.begin(ca.folder)
    (tmp_path / "other").mkdir(0o700)
    (tmp_path / "other" / "x").touch()
    with pytest.raises(CertificateError, match="the folder is not empty"):
        Authority.begin(tmp_path / "other")


def test_a_folder_that_has_no_ca_is_said(tmp_path):
    with pytest.raises(CertificateError, match="no folder of a CA; make one with rmr keys init"):
        Authority(tmp_path)


@pytest.mark.parametrize(("name", "right"), [("", "700"), ("ca.key", "600")])
def test_a_ca_that_others_can_read_is_refused(ca, name, right):
    path = ca.folder / name
    path.chmod(0o750)
    with pytest.raises(CertificateError, match=f"other users may read or change it; run: chmod {right} {path}"):
        Authority(ca.folder)


def test_a_new_ca_is_not_put_into_a_folder_that_others_can_read(tmp_path):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o755)
    with pytest.raises(CertificateError, match="run: chmod 700"):
        Authority.begin(tmp_path / "open")


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("index.json", "[", "no index of certificates"),
        ("index.json", '{"issued": [{"x": 1}]}', "no index of certificates"),
        ("ca.key", "nothing", "no private key"),
        ("ca.pem", "nothing", "no certificate in PEM form"),
    ],
)
def test_damaged_files_of_a_ca_are_said_and_nothing_is_issued(ca, name, text, says):
    (ca.folder / name).write_text(text)
    with pytest.raises(CertificateError, match=says):
        Authority(ca.folder).issue(ROBOT)
    assert not list((ca.folder / "issued").iterdir())


def test_the_key_of_another_ca_signs_nothing(ca, tmp_path):
    other = Authority.begin(tmp_path / "other")
    (ca.folder / "ca.key").write_bytes((other.folder / "ca.key").read_bytes())
    with pytest.raises(CertificateError, match=r"not the key of ca\.pem"):
        ca.issue(ROBOT)


# --- what a process reads


def test_a_process_knows_its_holder(bundled):
    assert read_certificate(bundled(holder("robot", "1-3"))).holder.robots == (1, 2, 3)


def test_an_expired_certificate_is_told_with_both_times(bundled):
    folder = bundled(ROBOT, days=1)
    ends = certificate_in(folder).not_valid_after_utc
    assert read_certificate(folder, now=ends).holder == ROBOT
    said = refused(folder, now=ends + timedelta(hours=2))
    assert f"the certificate of robot/4 has expired at {ends:%Y-%m-%d %H:%M:%S} UTC, " in said
    assert f"and here it is {ends + timedelta(hours=2):%Y-%m-%d %H:%M:%S} UTC; issue it anew" in said


def test_a_certificate_that_is_not_valid_yet_is_told_with_both_times(bundled):
    folder = bundled(ROBOT)
    begins = certificate_in(folder).not_valid_before_utc
    said = refused(folder, now=begins - timedelta(minutes=1))
    # The CA may have begun a second earlier, and is the one that is named then.
    assert re.search(r"valid from \S+ \S+ UTC only", said)
    assert f"and here it is {begins - timedelta(minutes=1):%Y-%m-%d %H:%M:%S} UTC" in said
    assert "set the clocks" in said


def test_an_expired_ca_is_told_as_such(bundled):
    assert "the certificate of the CA has expired" in refused(bundled(ROBOT), now=datetime(2200, 1, 1, tzinfo=UTC))


def test_a_certificate_of_another_ca_is_foreign(bundled, tmp_path):
    folder = bundled(ROBOT)
    other = Authority.begin(tmp_path / "other")
    (folder / "ca.pem").write_bytes((other.folder / "ca.pem").read_bytes())
    assert "the certificate of robot/4 is of another CA than the one in ca.pem" in refused(folder)


def test_a_listener_whose_own_certificate_is_revoked_is_told(ca, bundled):
    folder = bundled(WORLD)
    (folder / "revoked.txt").write_text("robot/1\nworld\n")
    assert "the certificate of world is revoked; issue it anew" in refused(folder)
    (folder / "revoked.txt").write_text("robot/1\nworld#2\n")
    assert read_certificate(folder).revoked == (holder("robot", "1"), Holder("world", "", 2))


@pytest.mark.parametrize(("name", "right"), [("", "700"), ("key.pem", "600")])
@pytest.mark.parametrize("bit", [0o040, 0o020, 0o004, 0o002])
def test_keys_that_others_can_read_or_change_are_refused(bundled, name, right, bit):
    path = bundled(ROBOT) / name
    path.chmod(int(right, 8) | bit)
    folder = path if path.is_dir() else path.parent
    assert refused(folder) == f"{path}: other users may read or change it; run: chmod {right} {path}"


@pytest.mark.parametrize("name", ["ca.pem", "cert.pem", "key.pem", "members.txt", "revoked.txt"])
def test_a_missing_file_is_named(bundled, name):
    folder = bundled(WORLD)
    (folder / name).unlink()
    assert refused(folder).startswith(f"{folder / name}: No such file or directory; ")


def test_a_missing_folder_is_named(tmp_path):
    assert refused(tmp_path / "x").startswith(f"{tmp_path / 'x'}: No such file or directory; a folder of keys is what")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("ca.pem", "no certificate in PEM form"),
        ("cert.pem", "no certificate in PEM form"),
        ("key.pem", "no private key"),
        ("revoked.txt", "'nothing' names nobody"),
        ("members.txt", "'nothing' names nobody"),
    ],
)
def test_a_damaged_file_is_named(bundled, name, says):
    folder = bundled(WORLD)
    (folder / name).write_text("nothing\n")
    said = refused(folder)
    assert said.startswith(f"{folder / name}: ")
    assert says in said


def test_the_key_of_another_certificate_is_refused(bundled):
    folder, other = bundled(ROBOT), bundled(ROBOT)
    (folder / "key.pem").write_bytes((other / "key.pem").read_bytes())
    assert "key.pem is not the key of cert.pem" in refused(folder)


def test_a_certificate_of_something_else_is_refused(bundled, ca):
    folder = bundled(ROBOT)
    (folder / "cert.pem").write_bytes((ca.folder / "ca.pem").read_bytes())
    assert "no certificate of rmr keys issue" in refused(folder)


def test_the_folder_of_a_ca_is_not_that_of_a_process(ca):
    assert "this is the folder of a CA; give a process its own: rmr keys bundle" in refused(ca.folder)


def test_the_index_holds_every_certificate_by_its_serial_number(ca, bundled):
    folders = [bundled(ROBOT), bundled(WORLD)]
    kept = json.loads((ca.folder / "index.json").read_text())["issued"]
    assert [one["who"] for one in kept] == ["robot/4", "world"]
    assert [int(one["serial"], 16) for one in kept] == [certificate_in(folder).serial_number for folder in folders]


# --- what the start of a process asks for


def rules(settings, subject):
    """Return the keys that the router of these settings allows one with this subject, by (flow, message)."""
    (policy,) = [one for one in settings["access_control/policies"] if one["subjects"] == [subject]]
    allowed = {}
    for rule in settings["access_control/rules"]:
        if rule["id"] in policy["rules"]:
            assert rule["permission"] == "allow"
            assert len(rule["messages"]) == len(rule["flows"]) == 1
            allowed.setdefault((rule["flows"][0], rule["messages"][0]), set()).update(rule["key_exprs"])
    return allowed


def test_a_router_lets_members_do_what_their_role_may_and_denies_all_else(ca, bundled):
    for who in (ROBOT, holder("robot", "1-2"), holder("viewer", "x")):
        ca.issue(who)
    ca.revoke(ROBOT)
    settings = read_certificate(bundled(WORLD)).router_settings()
    assert settings["transport/link/protocols"] == ["tls"]
    assert settings["access_control/enabled"] is True
    assert settings["access_control/default_permission"] == "deny"
    subjects = [one["cert_common_names"] for one in settings["access_control/subjects"]]
    others = [["robot/1-2"], ["robot/1-2#2"], ["robot/4#2"], ["viewer/x"], ["viewer/x#2"]]
    assert subjects == [*others, ["world"], ["world#2"]]
    pair = rules(settings, "robot/1-2")
    drives = {key for key in pair["ingress", "put"] if key.endswith("/act")}
    assert drives == {"rmr/*/body/1/act", "rmr/*/body/2/act"}
    assert "rmr/*/body/4/act" in rules(settings, "robot/4#2")["ingress", "put"]
    # What the world listens to is told as a whole, or robots would never send.
    assert "rmr/*/body/*/act" in pair["egress", "declare_subscriber"]
    assert rules(settings, "viewer/x")["ingress", "put"] == {"rmr/*/echo/viewer/0/*"}


def test_whom_the_list_of_a_listener_revokes_is_no_member_of_it(ca, bundled):
    ca.issue(ROBOT)
    folder = bundled(WORLD)
    (folder / "revoked.txt").write_text("robot/4\n")
    settings = read_certificate(folder).router_settings()
    assert ["robot/4"] not in [one["cert_common_names"] for one in settings["access_control/subjects"]]


def test_a_world_has_the_rights_of_a_router_only_where_a_router_joins_it(bundled):
    """It may be one that listens, and carries messages between hosts."""
    listener = read_certificate(bundled(WORLD))
    assert rules(listener.router_settings(joins=True), "world")["ingress", "put"] == {"rmr/**"}
    assert "rmr/**" not in rules(listener.router_settings(), "world")["ingress", "put"]


def test_settings_name_files_of_the_folder_and_hold_no_key(bundled):
    folder = bundled(WORLD)
    settings = read_certificate(folder).router_settings()
    files = {value for value in settings.values() if str(value).startswith(str(folder))}
    assert files == {str(folder / name) for name in ("ca.pem", "cert.pem", "key.pem")}
    assert "PRIVATE" not in str(settings)


def test_keys_are_those_of_the_role_and_the_robots_that_a_program_needs(bundled):
    several, world = read_certificate(bundled(holder("robot", "1-3"))), read_certificate(bundled(WORLD))
    several.check_role("robot", robots=(2, 3))
    with pytest.raises(CertificateError, match=r"the keys of robot/1-3, where those of robot/3-4 are needed"):
        several.check_role("robot", robots=(3, 4))
    with pytest.raises(CertificateError, match="the keys of world, where those of operator or viewer are needed"):
        world.check_role("operator", "viewer")
    check_keys(world, "world", of="hall")
    check_keys(None, "world")
    with pytest.raises(CertificateError, match="lab hall has `security: mtls`: name the folder with the keys"):
        check_keys(None, "world", of="hall")


TLS, TCP = "tls/127.0.0.1:1", "tcp/127.0.0.1:1"


def test_a_secret_or_keys_are_taken_and_keys_of_the_environment_where_nothing_else_is_named(tmp_path, monkeypatch):
    file, folder = tmp_path / "secret", tmp_path / "keys"
    folder.mkdir()
    monkeypatch.delenv("RMR_KEYS", raising=False)
    assert credentials_path(None, None, [None]) is None
    assert credentials_path(file, None, [TCP]) == file
    assert credentials_path(None, folder, [TLS, None]) == folder
    monkeypatch.setenv("RMR_KEYS", str(folder))
    assert credentials_path(None, None, [None, None]) == credentials_path(None, None, [TLS]) == folder
    assert credentials_path(None, None, [TCP]) is None
    assert credentials_path(file, None, [None]) == file
    assert (default_endpoint(folder), default_endpoint(file)) == ("tls/127.0.0.1:17447", "tcp/127.0.0.1:17447")


@pytest.mark.parametrize(
    ("secret", "keys", "endpoint", "says"),
    [
        ("s", "k", None, "--keys goes without --secret"),
        (None, None, TLS, "tls/127.0.0.1:1 needs keys: name their folder with --keys DIR"),
        ("s", None, TLS, "tls/127.0.0.1:1 needs keys: name their folder with --keys DIR"),
        (None, "k", TCP, "--keys goes with an endpoint tls/HOST:PORT, not with tcp/127.0.0.1:1"),
        (None, "nowhere", TLS, "--keys: there is no folder nowhere; rmr keys bundle writes it"),
        ("k", None, None, "--secret: k: Is a directory; a folder of keys is named with --keys"),
    ],
)
def test_words_that_do_not_go_together_are_told(tmp_path, monkeypatch, secret, keys, endpoint, says):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RMR_KEYS", raising=False)
    (tmp_path / "k").mkdir()
    named = [None if each is None else Path(each) for each in (secret, keys)]
    with pytest.raises(CommandLineError) as error:
        credentials_path(*named, [endpoint])
    assert says in str(error.value)


def test_of_several_holders_a_process_is_given_the_keys_of_the_fewest_robots(ca):
    for name in ("1-6", "2-3", "2"):
        ca.issue(holder("robot", name))
    assert [ca.good("robot", ids).name for ids in ((2,), (2, 3), (1, 2))] == ["2", "2-3", "1-6"]
    with pytest.raises(CertificateError, match=r"no robot 7-8 has a certificate; issue one with .* --robot 7-8"):
        ca.good("robot", (7, 8))
    with pytest.raises(CertificateError, match=r"no world has a certificate; issue one with .* --world$"):
        ca.good("world")
    with pytest.raises(CertificateError, match=r"no operator has a certificate; issue one with .* --operator NAME"):
        ca.good("operator")
