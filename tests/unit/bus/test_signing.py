"""Signed programs: whose signature a robot takes, and what it says of every other one."""

import json
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from rmr.bus.authority import Authority, holder, write_bundle
from rmr.bus.certificates import CertificateError
from rmr.bus.signing import CONTEXT, read_trust, signed_by

PROGRAM = b"the octets of a program"
ANN = holder("operator", "ann")


class Signers:
    """A CA, and the folders of those whom it has issued keys."""

    def __init__(self, folder):
        self.folder = folder
        self.ca = Authority.begin(folder / "ca")

    def keys(self, who, name):
        self.ca.issue(who)
        write_bundle(self.ca.bundle(who), self.folder / name)
        return self.folder / name

    @property
    def trust(self):
        return read_trust(self.ca.folder / "ca.pem")


@pytest.fixture
def signers(tmp_path):
    return Signers(tmp_path)


def signed_with(keys, program=PROGRAM):
    """Return what a program of one's own signs, which asks nobody's role."""
    key = serialization.load_pem_private_key((keys / "key.pem").read_bytes(), None)
    certificate = x509.load_pem_x509_certificate((keys / "cert.pem").read_bytes())
    return certificate.public_bytes(serialization.Encoding.DER), key.sign(CONTEXT + program, ec.ECDSA(hashes.SHA256()))


def test_what_an_operator_has_signed_is_trusted_under_the_ca_of_the_robots_keys_too(signers):
    signature = signed_by(signers.keys(ANN, "ann"), PROGRAM)
    assert signers.trust.problem(PROGRAM, *signature) == ""
    robot = signers.keys(holder("robot", "1"), "robot-1")
    assert read_trust(robot).problem(PROGRAM, *signature) == ""


def test_what_nobody_has_signed_is_refused_with_what_to_do(signers):
    assert "rmr sign PROG.rbc --keys DIR, with an operator's keys" in signers.trust.problem(PROGRAM, b"", b"")


def test_every_octet_of_the_program_is_signed(signers):
    signature = signed_by(signers.keys(ANN, "ann"), PROGRAM)
    for place in range(len(PROGRAM)):
        other = bytearray(PROGRAM)
        other[place] ^= 1
        assert "operator/ann is of another program" in signers.trust.problem(bytes(other), *signature)
    assert "is of another program" in signers.trust.problem(PROGRAM + b"\0", *signature)
    assert "is of another program" in signers.trust.problem(PROGRAM[:-1], *signature)


@pytest.mark.parametrize("who", ["robot/1", "viewer/v", "world", "router/a"])
def test_who_is_no_operator_may_not_sign(signers, who):
    keys = signers.keys(holder(*who.split("/")), "keys")
    with pytest.raises(CertificateError, match=f"the keys of {who}, where those of operator are needed"):
        signed_by(keys, PROGRAM)
    told = signers.trust.problem(PROGRAM, *signed_with(keys))
    assert (
        told == f"it is signed by {who}, who may not sign programs: an operator may, with rmr sign PROG.rbc --keys DIR"
    )


def test_an_operator_of_another_ca_is_foreign(signers, tmp_path):
    (tmp_path / "other").mkdir()
    other = Signers(tmp_path / "other")
    told = signers.trust.problem(PROGRAM, *signed_by(other.keys(ANN, "ann"), PROGRAM))
    assert told.startswith(f"its signer is of another CA than {signers.ca.folder}/ca.pem: sign it with")


def test_a_certificate_that_an_operator_has_issued_himself_is_foreign(signers):
    """Its key is no CA's, though its own certificate is good."""
    keys = signers.keys(ANN, "ann")
    own = x509.load_pem_x509_certificate((keys / "cert.pem").read_bytes())
    key = serialization.load_pem_private_key((keys / "key.pem").read_bytes(), None)
    forged = (
        x509.CertificateBuilder()
        .subject_name(own.subject)
        .issuer_name(own.subject)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(own.not_valid_before_utc)
        .not_valid_after(own.not_valid_after_utc)
        .add_extension(
            x509.SubjectAlternativeName([x509.UniformResourceIdentifier("rmr:operator/eve")]), critical=False
        )
        .sign(key, hashes.SHA256())
        .public_bytes(serialization.Encoding.DER)
    )
    signature = key.sign(CONTEXT + PROGRAM, ec.ECDSA(hashes.SHA256()))
    assert signers.trust.problem(PROGRAM, forged, signature).startswith("its signer is of another CA than ")


def test_a_certificate_that_has_expired_or_is_not_valid_yet_is_refused_with_both_times(signers):
    signature = signed_by(signers.keys(ANN, "ann"), PROGRAM)
    now = datetime.now(UTC)
    late = signers.trust.problem(PROGRAM, *signature, now + timedelta(days=400))
    assert late.startswith("the certificate of its signer operator/ann has expired at 20")
    assert f"and here it is {now + timedelta(days=400):%Y-%m-%d}" in late
    assert "issue it anew, and sign with rmr sign" in late
    early = signers.trust.problem(PROGRAM, *signature, now - timedelta(days=1))
    assert "signer operator/ann is valid from 20" in early
    assert early.endswith("set the clocks of the two machines")


def test_an_expired_ca_is_refused_though_its_operators_are_not(signers, tmp_path):
    """A CA lives longer than what it issues: the clock is asked of a certificate that was cut for the test."""
    signature = signed_by(signers.keys(ANN, "ann"), PROGRAM)
    trust = signers.trust
    ca = trust.ca
    key = serialization.load_pem_private_key((signers.ca.folder / "ca.key").read_bytes(), None)
    short = (
        x509.CertificateBuilder()
        .subject_name(ca.subject)
        .issuer_name(ca.subject)
        .public_key(ca.public_key())
        .serial_number(2)
        .not_valid_before(ca.not_valid_before_utc)
        .not_valid_after(ca.not_valid_before_utc + timedelta(minutes=1))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .sign(key, hashes.SHA256())
    )
    file = tmp_path / "short.pem"
    file.write_bytes(short.public_bytes(serialization.Encoding.PEM))
    assert "the certificate of its CA has expired at" in read_trust(file).problem(PROGRAM, *signature)


def test_a_revoked_operator_is_refused_by_robots_that_have_the_list_and_his_new_keys_are_not(signers):
    before = signed_by(signers.keys(ANN, "ann"), PROGRAM)
    signers.ca.revoke(ANN)
    robot = signers.keys(holder("robot", "1"), "robot-1")
    assert read_trust(robot).problem(PROGRAM, *before).startswith("its signer operator/ann is revoked: ")
    again = signed_by(signers.keys(ANN, "again"), PROGRAM)
    assert read_trust(robot).problem(PROGRAM, *again) == ""


@pytest.mark.parametrize("place", range(3))
def test_damaged_signatures_are_refused_in_a_sentence_and_never_a_traceback(signers, place):
    certificate, signature = signed_by(signers.keys(ANN, "ann"), PROGRAM)
    parts = [certificate, signature]
    for cut in (1, len(parts[place % 2]) // 2):
        broken = list(parts)
        broken[place % 2] = broken[place % 2][:-cut] if place < 2 else b"\xff" * cut
        told = signers.trust.problem(PROGRAM, *broken)
        assert told
        assert "\n" not in told


# --- what is trusted


def test_what_is_no_certificate_of_a_ca_is_no_trust(signers, tmp_path):
    keys = signers.keys(ANN, "ann")
    for path, says in (
        (keys / "cert.pem", "no certificate of a CA"),
        (keys / "key.pem", "no certificate in PEM form"),
        (tmp_path / "none.pem", "No such file or directory; --trust names ca.pem"),
    ):
        with pytest.raises(CertificateError, match=says):
            read_trust(path)


def test_a_ca_that_other_users_may_exchange_is_refused_and_one_that_they_may_read_is_not(signers, tmp_path):
    open_ = tmp_path / "open"
    open_.mkdir(mode=0o755)
    (open_ / "ca.pem").write_bytes((signers.ca.folder / "ca.pem").read_bytes())
    (open_ / "ca.pem").chmod(0o644)
    read_trust(open_ / "ca.pem")
    (open_ / "ca.pem").chmod(0o666)
    with pytest.raises(CertificateError, match=r"other users may change it; run: chmod go-w .*ca\.pem"):
        read_trust(open_ / "ca.pem")
    (open_ / "ca.pem").chmod(0o644)
    open_.chmod(0o777)
    with pytest.raises(CertificateError, match=r"other users may change it; run: chmod go-w .*open$"):
        read_trust(open_ / "ca.pem")


def test_a_list_of_revoked_that_cannot_be_read_is_refused_and_not_passed_over(signers):
    robot = signers.keys(holder("robot", "1"), "robot-1")
    (robot / "revoked.txt").write_text(json.dumps({"operator": "ann"}))
    with pytest.raises(CertificateError, match="names nobody"):
        read_trust(robot)
