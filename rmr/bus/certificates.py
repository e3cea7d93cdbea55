"""Certificates: who a process of a lab is, as TLS proves it on both ends of each connection of its bus.

A certificate names its holder in one form: ``robot/4`` (or ``robot/1-3``: a process with three robots), ``world``,
``router/HOST``, ``operator/NAME``, ``viewer/NAME``. That is the common name of its subject, and behind ``rmr:`` a URI
among its alternative names. A certificate that is issued after earlier ones of its holder were revoked has a number:
``robot/4#2``. Only those of a router or the world may listen: robots, operators and viewers are clients alone.

A process has its own in a private folder, with its key and the certificate of the CA (`rmr.bus.authority`). Who listens
has the list of revoked ones there, too. What is wrong with the folder is said in one sentence, before it is used.
"""

import os
import stat
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rmr.base.ids import listed, spelled
from rmr.bus.endpoint import DEFAULT_ENDPOINT, DEFAULT_TLS_ENDPOINT, BusError, is_tls
from rmr.bus.rights import access_control
from rmr.bus.secret import Secret, read_secret
from rmr.entry.command_line import CommandLineError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cryptography import x509

CA_FILE: Final = "ca.pem"
CERTIFICATE_FILE: Final = "cert.pem"
KEY_FILE: Final = "key.pem"
REVOKED_FILE: Final = "revoked.txt"
MEMBERS_FILE: Final = "members.txt"
"""Files of a process's folder; the last two are in that of a listener alone."""

INDEX_FILE: Final = "index.json"
"""What is issued, in the folder of a CA: none for a process."""

LISTENERS: Final = ("world", "router")
"""Roles whose holders may listen."""

ROLES: Final = ("robot", *LISTENERS, "operator", "viewer")

URI_SCHEME: Final = "rmr:"

FILE_OCTETS_MAX: Final = 1 << 20
"""Greatest size of a file with a certificate, a key or a list."""


KEYS_VARIABLE: Final = "RMR_KEYS"
"""Environment variable with the folder of a process's keys, where no option names it."""


class CertificateError(BusError):
    """A folder or file has no certificate that can be used; the message says what is wrong and what to do."""


@dataclass(frozen=True, slots=True)
class Holder:
    """Whom a certificate names."""

    role: str
    name: str = ""
    """The ids of robots, the host of a router, the name of a person; empty: the world."""
    generation: int = 1
    """How often certificates of this holder have been issued after earlier ones were revoked, from 1."""

    def __str__(self) -> str:
        return f"{self.role}/{self.name}" if self.name else self.role

    @property
    def subject(self) -> str:
        """The common name of the certificate."""
        return str(self) if self.generation == 1 else f"{self}#{self.generation}"

    @property
    def robots(self) -> tuple[int, ...]:
        """The ids of the robots that it may be."""
        return listed(self.name) if self.role == "robot" else ()

    @classmethod
    def read(cls, subject: str) -> "Holder":
        """Return the holder that `subject` names. Raises ValueError."""
        who, numbered, number = subject.partition("#")
        role, slash, name = who.partition("/")
        if role not in ROLES or (role == "world") == bool(slash and name):
            raise ValueError(
                f"{subject!r:.60} names nobody: expected world, or one of robot/4, router/HOST, operator/NAME"
            )
        if numbered and not (number.isascii() and number.isdecimal() and 1 < int(number) < 10**6):
            raise ValueError(f"{subject!r:.60} names nobody: a number follows the #")
        holder = cls(role, name, int(number) if numbered else 1)
        if role == "robot" and spelled(holder.robots) != name:
            raise ValueError(f"{subject!r:.60} names nobody: write robot/{spelled(holder.robots)}")
        return holder


def moment(instant: datetime) -> str:
    """Return an instant as people read it."""
    return f"{instant.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"


def openness(path: Path) -> str:
    """Return what to do about a folder or file that other users can read or change; nothing where they cannot."""
    mode = path.stat().st_mode
    if not stat.S_IMODE(mode) & 0o077:
        return ""
    right = "700" if stat.S_ISDIR(mode) else "600"
    return f"{path}: other users may read or change it; run: chmod {right} {path}"


@dataclass(frozen=True, slots=True)
class Certificate:
    """A process's certificate, judged as good when it was read."""

    folder: Path
    holder: Holder
    revoked: tuple[Holder, ...] = ()
    """Whom a listener lets do nothing: members, or former ones."""
    members: tuple[Holder, ...] = ()
    """Whom a listener lets do what their roles may (`rmr.bus.rights`), unless they are revoked."""

    def client_settings(self) -> dict[str, Any]:
        """Return the settings of zenoh for whoever connects, by key."""
        tls = "transport/link/tls"
        return {
            f"{tls}/root_ca_certificate": str(self.folder / CA_FILE),
            f"{tls}/enable_mtls": True,
            f"{tls}/verify_name_on_connect": True,
            f"{tls}/close_link_on_expiration": True,
            f"{tls}/connect_certificate": str(self.folder / CERTIFICATE_FILE),
            f"{tls}/connect_private_key": str(self.folder / KEY_FILE),
        }

    def router_settings(self, _name: str = "", *, joins: bool = False) -> dict[str, Any]:
        """Return the settings of zenoh for a router, by key: it takes TLS alone, and members do what they may.

        `joins`: it connects to other listeners, too.
        """
        tls = "transport/link/tls"
        members = {one.subject: (one.role, one.robots) for one in self.members if one not in self.revoked}
        return {
            **self.client_settings(),
            "transport/link/protocols": ["tls"],
            f"{tls}/listen_certificate": str(self.folder / CERTIFICATE_FILE),
            f"{tls}/listen_private_key": str(self.folder / KEY_FILE),
            **access_control(members, joins=joins),
        }

    def denies(self, subject: str) -> str:
        """Return why this listener lets one with that subject do nothing, as a clause; nothing where it has rights."""
        if subject in {one.subject for one in self.revoked}:
            return "with a revoked certificate"
        return "" if subject in {one.subject for one in self.members} else f"and not in {MEMBERS_FILE}"

    def check_role(self, *roles: str, robots: tuple[int, ...] = ()) -> None:
        """Raise CertificateError unless the holder has one of `roles`, and is all of `robots`."""
        if self.holder.role not in roles or not set(robots) <= set(self.holder.robots):
            wanted = [f"robot/{spelled(robots)}"] if robots else list(roles)
            raise CertificateError(
                f"{self.folder}: the keys of {self.holder}, where those of {' or '.join(wanted)} are needed; "
                "issue them with rmr keys issue"
            )


Credentials = Secret | Certificate
"""What a process shows to be let in."""


def read_credentials(path: Path | None) -> Credentials | None:
    """Return the certificate in a folder, or the secret in a file. Raises CertificateError, SecretError."""
    if path is None:
        return None
    return read_certificate(path) if path.is_dir() else read_secret(path)


def check_keys(credentials: Credentials | None, *roles: str, of: str | None = None) -> None:
    """Raise CertificateError for keys of another role, or none where those of a lab `of` this name are needed."""
    if isinstance(credentials, Certificate):
        credentials.check_role(*roles)
    elif of is not None:
        raise CertificateError(
            f"lab {of} has `security: mtls`: name the folder with the keys of this process with --keys DIR, "
            "which rmr keys bundle writes"
        )


def secret_file(path: Path | None) -> Path | None:
    """Return `path` unless it is a folder of keys, which `read_certificate` judges."""
    return None if path is not None and path.is_dir() else path


def credentials_path(secret: Path | None, keys: Path | None, endpoints: "Sequence[str | None]" = ()) -> Path | None:
    """Return the file of --secret, or the folder of --keys or `KEYS_VARIABLE`, for `endpoints` that a person named.

    The environment counts where neither a secret nor an endpoint without TLS is named. Raises CommandLineError.
    """
    named = [endpoint for endpoint in endpoints if endpoint is not None]
    plain = [endpoint for endpoint in named if not is_tls(endpoint)]
    if keys is None and secret is None and not plain and os.environ.get(KEYS_VARIABLE):
        keys = Path(os.environ[KEYS_VARIABLE])
    if keys is None and len(plain) < len(named):
        tls = next(filter(is_tls, named))
        raise CommandLineError(f"{tls} needs keys: name their folder with --keys DIR, which rmr keys bundle writes")
    if keys is not None and secret is not None:
        raise CommandLineError("--keys goes without --secret: a process is let in by the one or by the other")
    if keys is not None and plain:
        raise CommandLineError(f"--keys goes with an endpoint tls/HOST:PORT, not with {plain[0]}")
    if secret is not None and secret.is_dir():
        raise CommandLineError(f"--secret: {secret}: Is a directory; a folder of keys is named with --keys")
    if keys is not None and not keys.is_dir():
        raise CommandLineError(f"--keys: there is no folder {keys}; rmr keys bundle writes it")
    return secret if keys is None else keys.absolute()


def default_endpoint(credentials: Path | None) -> str:
    """Return where a world listens by default, for whoever is let in by the folder or file `credentials`."""
    return DEFAULT_TLS_ENDPOINT if credentials is not None and credentials.is_dir() else DEFAULT_ENDPOINT


def holder_of(certificate: "x509.Certificate") -> Holder:
    """Return whom `certificate` names. Raises ValueError for one that rmr has not issued."""
    from cryptography import x509  # noqa: PLC0415 - heavy, and used with keys alone

    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        raise ValueError("it has no alternative names") from None
    for uri in names.get_values_for_type(x509.UniformResourceIdentifier):
        if uri.startswith(URI_SCHEME):
            return Holder.read(uri.removeprefix(URI_SCHEME))
    raise ValueError(f"no name of it begins with {URI_SCHEME}")


def out_of_date(certificate: "x509.Certificate", whose: str, renewed: str, now: datetime) -> str:
    """Return why `certificate` is not valid at the instant `now`, and what to do (`renewed`); nothing where it is."""
    if now > certificate.not_valid_after_utc:
        since = f"has expired at {moment(certificate.not_valid_after_utc)}, and here it is {moment(now)}"
        return f"the certificate of {whose} {since}; {renewed}, or set the clock"
    if now < certificate.not_valid_before_utc:
        begins = f"is valid from {moment(certificate.not_valid_before_utc)} only, and here it is {moment(now)}"
        return f"the certificate of {whose} {begins}; set the clocks of the two machines"
    return ""


def problem(certificate: "x509.Certificate", ca: "x509.Certificate", now: datetime) -> str:
    """Return why `certificate` is not good under `ca` at the instant `now`, and what to do; nothing where it is."""
    wrong = out_of_date(ca, "the CA", "issue it anew with rmr keys init, and all others with it", now)
    wrong = wrong or out_of_date(certificate, str(holder_of(certificate)), "issue it anew with rmr keys issue", now)
    if wrong:
        return wrong
    try:
        certificate.verify_directly_issued_by(ca)
    except Exception:  # noqa: BLE001, RUF100 - another name, another algorithm, another signature: all of them foreign
        return (
            f"the certificate of {holder_of(certificate)} is of another CA than the one in {CA_FILE}; "
            "take both from one rmr keys bundle"
        )
    return ""


def read_certificate(folder: Path, now: datetime | None = None) -> Certificate:
    """Return the certificate in `folder`. Raises CertificateError where it cannot be used at the instant `now`."""
    from cryptography.hazmat.primitives import serialization  # noqa: PLC0415

    if (folder / INDEX_FILE).exists():
        raise CertificateError(
            f"{folder}: this is the folder of a CA; give a process its own: rmr keys bundle {folder} WHO -o DIR"
        )
    octets = {name: read_file(folder, name) for name in (CA_FILE, CERTIFICATE_FILE, KEY_FILE)}
    ca = parsed(octets[CA_FILE], folder / CA_FILE)
    certificate = parsed(octets[CERTIFICATE_FILE], folder / CERTIFICATE_FILE)
    try:
        holder = holder_of(certificate)
    except ValueError as error:
        raise CertificateError(f"{folder / CERTIFICATE_FILE}: no certificate of rmr keys issue ({error})") from None
    if wrong := problem(certificate, ca, now or datetime.now(UTC)):
        raise CertificateError(f"{folder}: {wrong}")
    try:
        key = serialization.load_pem_private_key(octets[KEY_FILE], None)
    except (ValueError, TypeError):
        raise CertificateError(f"{folder / KEY_FILE}: no private key, or one under a password") from None
    if key.public_key() != certificate.public_key():
        raise CertificateError(f"{folder}: {KEY_FILE} is not the key of {CERTIFICATE_FILE}; take both from one bundle")
    if holder.role not in LISTENERS:
        return Certificate(folder.absolute(), holder)
    revoked, members = (_holders(folder, name) for name in (REVOKED_FILE, MEMBERS_FILE))
    if holder in revoked:
        raise CertificateError(f"{folder}: the certificate of {holder} is revoked; issue it anew with rmr keys issue")
    return Certificate(folder.absolute(), holder, revoked, members)


def parsed(octets: bytes, file: Path) -> "x509.Certificate":
    """Return the certificate in the `octets` of `file`. Raises CertificateError."""
    from cryptography import x509  # noqa: PLC0415

    try:
        return x509.load_pem_x509_certificate(octets)
    except ValueError:
        raise CertificateError(f"{file}: no certificate in PEM form") from None


def _holders(folder: Path, name: str) -> tuple[Holder, ...]:
    """Return whom the lines of a file name. Raises CertificateError."""
    return holders_in(read_file(folder, name), folder / name)


def holders_in(octets: bytes, file: Path) -> tuple[Holder, ...]:
    """Return whom the lines in the `octets` of `file` name. Raises CertificateError."""
    try:
        return tuple(map(Holder.read, octets.decode(errors="replace").split()))
    except ValueError as error:
        raise CertificateError(f"{file}: {error}") from None


def read_file(folder: Path, name: str) -> bytes:
    """Return the octets of a file in `folder`. Raises CertificateError, also where others can read either."""
    file = folder / name
    try:
        wrong = openness(folder) or (openness(file) if name == KEY_FILE else "")
        with file.open("rb") as opened:
            octets = opened.read(FILE_OCTETS_MAX)
    except OSError as error:
        whole = file if folder.is_dir() else folder
        hint = "a folder of keys is what rmr keys bundle writes"
        raise CertificateError(f"{whole}: {error.strerror}; {hint}") from None
    if wrong:
        raise CertificateError(wrong)
    return octets
