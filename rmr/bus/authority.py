"""The CA of a lab's operator: a folder with its key, what it has issued, and an index of that.

    ca.key, ca.pem        key and certificate of the CA
    issued/WHO.key, .pem  key and newest certificate of each holder
    index.json            all certificates ever issued: holder, serial number, validity, when it was revoked

Nobody but the owner can read the folder. A certificate that is issued again replaces the one before in the folder. The
one before stays valid until it expires, so that processes can be given the new one in any order. All certificates of a
holder are revoked together; those that are issued after that carry the next number in their subject.
"""

import fcntl
import ipaddress
import json
import os
import re
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from io import BytesIO
from pathlib import Path
from typing import Any, Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from rmr.base.file_errors import naming
from rmr.base.ids import listed, spelled
from rmr.bus.certificates import (
    CA_FILE,
    CERTIFICATE_FILE,
    INDEX_FILE,
    KEY_FILE,
    LISTENERS,
    MEMBERS_FILE,
    REVOKED_FILE,
    URI_SCHEME,
    CertificateError,
    Holder,
    openness,
    parsed,
)

CA_KEY_FILE: Final = "ca.key"
ISSUED_FOLDER: Final = "issued"

CA_DAYS: Final = 3650
LEAF_DAYS: Final = 365
"""Validity of the CA and of what it issues, where no other is asked for."""

EARLIER: Final = timedelta(minutes=5)
"""How long before it is issued a certificate is valid: clocks of hosts may differ by that."""

HOST: Final = re.compile(r"[A-Za-z0-9]([A-Za-z0-9_.-]{0,251}[A-Za-z0-9])?")
NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,31}")
"""Names of hosts, and of operators and viewers."""

SUBJECT_LENGTH_MAX: Final = 56
"""Longest name of a holder: X.509 allows 64 characters, of which a number may take some."""


@dataclass(frozen=True, slots=True)
class Issued:
    """One certificate of the index."""

    who: str
    generation: int
    serial: str
    """Serial number, in hexadecimal."""
    valid_from: str
    valid_until: str
    revoked: str | None = None
    """When it was revoked. All instants are in ISO form."""

    def state(self, newest: "Issued", now: datetime) -> str:
        """Return how it stands at the instant `now`, where `newest` is the newest certificate of its holder."""
        if self.revoked is not None:
            return "revoked"
        if now > datetime.fromisoformat(self.valid_until):
            return "expired"
        if now < datetime.fromisoformat(self.valid_from):
            return "not yet valid"
        return "valid" if newest == self else "replaced, still valid"


def holder(role: str, name: str = "") -> Holder:
    """Return the holder that words of a person name. Raises ValueError, which says what to write."""
    if role == "robot":
        name = spelled(listed(name))
    elif role == "router":
        name = check_host(name)
    elif role in {"operator", "viewer"} and not NAME.fullmatch(name):
        raise ValueError(f"{name!r:.60} cannot be a name: letters, digits, '-', '_' and '.', 32 at most")
    found = Holder.read(f"{role}/{name}" if name else role)
    if len(found.subject) > SUBJECT_LENGTH_MAX:
        raise ValueError(f"{found.subject!r:.80} is too long: {SUBJECT_LENGTH_MAX} characters at most")
    return found


def check_host(name: str) -> str:
    """Return the name or address of a host in its usual form. Raises ValueError."""
    try:
        return str(ipaddress.ip_address(name.strip("[]")))
    except ValueError:
        if not HOST.fullmatch(name):
            raise ValueError(f"{name!r:.60} is no name or address of a host") from None
    return name.lower()


class Authority:
    """A CA in its folder. All methods raise CertificateError and OSError."""

    def __init__(self, folder: Path) -> None:
        """Take the CA in `folder`."""
        self.folder = folder
        if not (folder / INDEX_FILE).exists():
            raise CertificateError(f"{folder}: no folder of a CA; make one with rmr keys init {folder}")
        for path in (folder, folder / CA_KEY_FILE):
            if wrong := openness(path):
                raise CertificateError(wrong)

    @classmethod
    def begin(cls, folder: Path, days: int = CA_DAYS) -> "Authority":
        """Make a CA in `folder`, which is new or empty."""
        if folder.exists() and any(folder.iterdir()):
            other = "has a CA already" if (folder / INDEX_FILE).exists() else "is not empty"
            raise CertificateError(f"{folder}: the folder {other}; name a new one")
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if wrong := openness(folder):
            raise CertificateError(wrong)
        key = ec.generate_private_key(ec.SECP256R1())
        number = x509.random_serial_number()
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"rmr CA {number:040x}"[:15])])
        certificate = (
            _begun(name, key, number, _now() - EARLIER, _now() + timedelta(days=days))
            .issuer_name(name)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(key_cert_sign=True, crl_sign=True), critical=True)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
            .sign(key, hashes.SHA256())
        )
        (folder / ISSUED_FOLDER).mkdir(mode=0o700)
        _write(folder / CA_KEY_FILE, _key_octets(key))
        _write(folder / CA_FILE, certificate.public_bytes(serialization.Encoding.PEM))
        _write(folder / INDEX_FILE, _index_octets([]))  # the last: without it there is no CA
        return cls(folder)

    # --- what it does

    def issue(self, who: Holder, hosts: Sequence[str] = (), days: int = LEAF_DAYS) -> Issued:
        """Issue a certificate to `who`, a listener reachable under `hosts`, too; of the generation that is due."""
        with self._changing() as index:
            earlier = [one for one in index if one.who == str(who)]
            generation = max((one.generation + (one.revoked is not None) for one in earlier), default=1)
            who = replace(who, generation=generation)
            ca_key, ca = self._ca()
            begins = _now() - EARLIER
            ends = min(_now() + timedelta(days=days), ca.not_valid_after_utc)
            if ends <= _now():
                raise CertificateError(f"{self.folder}: the CA has expired; make another one with rmr keys init")
            key = ec.generate_private_key(ec.SECP256R1())
            number = x509.random_serial_number()
            name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, who.subject)])
            listens = [ExtendedKeyUsageOID.SERVER_AUTH] if who.role in LISTENERS else []
            certificate = (
                _begun(name, key, number, max(begins, ca.not_valid_before_utc), ends)
                .issuer_name(ca.subject)
                .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
                .add_extension(_usage(digital_signature=True), critical=True)
                .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH, *listens]), critical=False)
                .add_extension(x509.SubjectAlternativeName(_names(who, hosts)), critical=False)
                .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(ca_key.public_key()), critical=False)
                .sign(ca_key, hashes.SHA256())
            )
            valid = certificate.not_valid_before_utc.isoformat(), certificate.not_valid_after_utc.isoformat()
            issued = Issued(str(who), generation, f"{number:x}", *valid)
            index.append(issued)
            self._keep(index)  # before the files: what exists can be revoked
            key_file, file = self._files(who)
            _write(key_file, _key_octets(key))
            _write(file, certificate.public_bytes(serialization.Encoding.PEM))
        return issued

    def revoke(self, who: Holder) -> int:
        """Revoke all certificates that `who` has; return how many they are."""
        with self._changing() as index:
            held = [one for one in index if one.who == str(who) and one.revoked is None]
            if not held:
                known = any(one.who == str(who) for one in index)
                raise CertificateError(
                    f"{self.folder}: all certificates of {who} are revoked already" if known else self._nobody(who)
                )
            at = _now().isoformat()
            self._keep([replace(one, revoked=at) if one in held else one for one in index])
            for file in self._files(who):
                file.unlink(missing_ok=True)
        return len(held)

    def index(self) -> list[Issued]:
        """Return all certificates that were issued, in that order."""
        file = self.folder / INDEX_FILE
        try:
            return [Issued(**one) for one in json.loads(file.read_bytes())["issued"]]
        except (ValueError, TypeError, KeyError) as error:
            raise CertificateError(f"{file}: no index of certificates ({error}); restore it from a copy") from None

    def revoked(self) -> list[str]:
        """Return the subjects that are revoked."""
        revoked = [one for one in self.index() if one.revoked is not None]
        return sorted({replace(Holder.read(one.who), generation=one.generation).subject for one in revoked})

    def members(self) -> list[str]:
        """Return the subjects that are not revoked, and of each holder the one that follows when they are.

        So a listener lets in whoever is issued a certificate anew after it was revoked.
        """
        index = self.index()
        good = {(one.who, one.generation) for one in index if one.revoked is None}
        good |= {(one.who, one.generation + 1) for one in index}
        gone = {(one.who, one.generation) for one in index if one.revoked is not None}
        return sorted(replace(Holder.read(who), generation=number).subject for who, number in good - gone)

    def good(self, role: str, robots: Sequence[int] = ()) -> Holder:
        """Return a holder of `role`, of all of `robots`, that has a certificate: the one of no other robots first."""
        held = {one.who: Holder.read(one.who) for one in self.index() if one.revoked is None}
        fit = [who for who in held.values() if who.role == role and set(robots) <= set(who.robots)]
        if fit:
            return min(fit, key=lambda who: (len(who.robots), str(who)))
        word = f"--{role} {spelled(robots) if robots else 'NAME' * (role != 'world')}".strip()
        raise CertificateError(
            f"{self.folder}: no {role}{f' {spelled(robots)}' if robots else ''} has a certificate; issue one with "
            f"rmr keys issue {self.folder} {word}"
        )

    def bundle(self, who: Holder) -> dict[str, bytes]:
        """Return the files that a process of `who` needs, by name."""
        key_file, file = self._files(who)
        if not file.exists():
            raise CertificateError(self._nobody(who))
        if wrong := openness(key_file):
            raise CertificateError(wrong)
        files = {CA_FILE: self.folder / CA_FILE, CERTIFICATE_FILE: file, KEY_FILE: key_file}
        octets = {name: path.read_bytes() for name, path in files.items()}
        lists = {}
        if who.role in {"robot", *LISTENERS}:  # a robot runs no program that somebody revoked has signed
            lists[REVOKED_FILE] = self.revoked()
        if who.role in LISTENERS:
            lists[MEMBERS_FILE] = self.members()
        return octets | {name: "".join(f"{one}\n" for one in lists[name]).encode() for name in lists}

    # --- its folder

    @contextmanager
    def _changing(self) -> Iterator[list[Issued]]:
        """Give the index to one that changes it, while no other process does."""
        descriptor = os.open(self.folder, os.O_RDONLY)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            yield self.index()
        finally:
            os.close(descriptor)

    def _keep(self, index: Sequence[Issued]) -> None:
        _write(self.folder / INDEX_FILE, _index_octets(index))

    def _ca(self) -> tuple[ec.EllipticCurvePrivateKey, x509.Certificate]:
        file = self.folder / CA_KEY_FILE
        try:
            key = serialization.load_pem_private_key(file.read_bytes(), None)
        except (ValueError, TypeError):
            raise CertificateError(f"{file}: no private key; restore it from a copy") from None
        certificate = parsed((self.folder / CA_FILE).read_bytes(), self.folder / CA_FILE)
        if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
            raise CertificateError(f"{file}: not the key of {CA_FILE}; restore both from a copy")
        return key, certificate

    def _files(self, who: Holder) -> tuple[Path, Path]:
        stem = self.folder / ISSUED_FOLDER / str(who).replace("/", "-", 1)
        return Path(f"{stem}.key"), Path(f"{stem}.pem")

    def _nobody(self, who: Holder) -> str:
        word = f"--{who.role} {who.name}".strip()
        return f"{self.folder}: {who} has no certificate; issue one with rmr keys issue {self.folder} {word}"


def write_bundle(files: dict[str, bytes], out: Path) -> None:
    """Write the files of a bundle to `out`, a new folder, or a new archive where the name ends in ``.tar``.

    Raises CertificateError, OSError.
    """
    if out.exists():
        raise CertificateError(f"{out}: it exists; name another one, or remove it")
    if out.suffix != ".tar":
        with naming(out):
            out.mkdir(mode=0o700)
        for name, octets in files.items():
            _write(out / name, octets)
        return
    archive = BytesIO()
    with tarfile.open(fileobj=archive, mode="w") as tar:
        for name, octets in files.items():
            member = tarfile.TarInfo(name)
            member.size, member.mode = len(octets), 0o600
            tar.addfile(member, BytesIO(octets))
    _write(out, archive.getvalue())


def _now() -> datetime:
    return datetime.now(UTC).replace(microsecond=0)  # X.509 has whole seconds


def _begun(
    name: x509.Name, key: ec.EllipticCurvePrivateKey, number: int, begins: datetime, ends: datetime
) -> x509.CertificateBuilder:
    builder = x509.CertificateBuilder().subject_name(name).public_key(key.public_key()).serial_number(number)
    return builder.not_valid_before(begins).not_valid_after(ends)


def _usage(**uses: bool) -> x509.KeyUsage:
    names = "digital_signature content_commitment key_encipherment data_encipherment key_agreement"
    none: dict[str, Any] = dict.fromkeys(f"{names} key_cert_sign crl_sign encipher_only decipher_only".split(), False)
    return x509.KeyUsage(**none | uses)


def _names(who: Holder, hosts: Sequence[str]) -> list[x509.GeneralName]:
    """Return the alternative names: who it is, and for a listener the hosts."""
    names: list[x509.GeneralName] = [x509.UniformResourceIdentifier(f"{URI_SCHEME}{who.subject}")]
    if who.role in LISTENERS:
        own = [who.name] if who.role == "router" else []
        # By the last three the processes of its own machine reach a listener.
        for host in dict.fromkeys([*own, *hosts, "localhost", "127.0.0.1", "::1"]):
            try:
                names.append(x509.IPAddress(ipaddress.ip_address(host)))
            except ValueError:
                names.append(x509.DNSName(host))
    return names


def _key_octets(key: ec.EllipticCurvePrivateKey) -> bytes:
    form = serialization.PrivateFormat.PKCS8
    return key.private_bytes(serialization.Encoding.PEM, form, serialization.NoEncryption())


def _index_octets(index: Sequence[Issued]) -> bytes:
    return (json.dumps({"form": 1, "issued": [asdict(one) for one in index]}, indent=1) + "\n").encode()


def _write(path: Path, octets: bytes) -> None:
    """Write `octets` to `path`, readable by its owner only: all of them, or the file stays as it was."""
    beside = path.with_name(f".{path.name}.new")
    try:
        with naming(path), os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
            file.write(octets)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise
