"""Signed programs: an operator signs byte-code, and robots run what an operator of their CA has signed, nothing else.

The key is the one that the operator is let in with (`rmr.bus.certificates`), and its certificate goes with the
program: a robot needs the certificate of the CA alone to judge it, also over the radio. What is signed are the exact
octets of the program (ECDSA on P-256 with SHA-256), behind `CONTEXT`: a signature that the key has made for TLS is
none of a program.

Trust is judged when a robot is to take a program: when it starts, and when it is loaded. A program that runs goes on
when the certificate of its signer expires.
"""

import stat
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rmr.bus.certificates import (
    CA_FILE,
    CERTIFICATE_FILE,
    FILE_OCTETS_MAX,
    KEY_FILE,
    REVOKED_FILE,
    CertificateError,
    Holder,
    holder_of,
    holders_in,
    out_of_date,
    parsed,
    read_certificate,
    read_file,
)

if TYPE_CHECKING:
    from cryptography import x509

CONTEXT: Final = b"rmr program\0"
"""What stands before the octets that are signed."""

SIGNER: Final = "operator"
"""The role whose holders may sign: they load programs, too."""

WHICH: Final = f"--trust names {CA_FILE} of the folder of a CA, or of a process's keys"

HOW: Final = "rmr sign PROG.rbc --keys DIR"


def signed_by(folder: Path, program: bytes) -> tuple[bytes, bytes]:
    """Return the certificate in `folder`, which is an operator's, and its signature of `program`.

    Raises CertificateError.
    """
    from cryptography.hazmat.primitives import hashes, serialization  # noqa: PLC0415 - heavy, and used with keys alone
    from cryptography.hazmat.primitives.asymmetric import ec  # noqa: PLC0415

    read_certificate(folder).check_role(SIGNER)
    certificate = parsed(read_file(folder, CERTIFICATE_FILE), folder / CERTIFICATE_FILE)
    key = serialization.load_pem_private_key(read_file(folder, KEY_FILE), None)
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise CertificateError(f"{folder / KEY_FILE}: no key of rmr keys issue")
    signature = key.sign(CONTEXT + program, ec.ECDSA(hashes.SHA256()))
    return certificate.public_bytes(serialization.Encoding.DER), signature


def signer_of(certificate: bytes) -> tuple[Holder, datetime]:
    """Return whom the certificate of a signature that was just made names, and until when it is valid."""
    from cryptography import x509  # noqa: PLC0415 - heavy, and used with keys alone

    found = x509.load_der_x509_certificate(certificate)
    return holder_of(found), found.not_valid_after_utc


@dataclass(frozen=True, slots=True)
class Trust:
    """Whose programs a robot runs: those of the operators of a CA, but for the revoked."""

    file: Path
    """The certificate of the CA."""
    ca: "x509.Certificate"
    revoked: tuple[Holder, ...] = ()

    def problem(self, program: bytes, certificate: bytes, signature: bytes, now: datetime | None = None) -> str:
        """Return why `program` is not to be run at the instant `now`, and what to do; nothing where it may be.

        What matters stands first: over the radio the end of a longer text is lost.
        """
        from cryptography import x509  # noqa: PLC0415 - heavy, and used with keys alone
        from cryptography.exceptions import InvalidSignature  # noqa: PLC0415
        from cryptography.hazmat.primitives import hashes  # noqa: PLC0415
        from cryptography.hazmat.primitives.asymmetric import ec  # noqa: PLC0415

        if not signature:
            return f"it is not signed, as all programs of this robot must be: {HOW}, with an operator's keys"
        try:
            found = x509.load_der_x509_certificate(certificate)
            holder = holder_of(found)
            key = found.public_key()
        except Exception:  # noqa: BLE001, RUF100 - whatever others have put there
            return f"its signature has no certificate of rmr keys: sign it anew with {HOW}"
        now = now or datetime.now(UTC)
        try:
            found.verify_directly_issued_by(self.ca)
        except Exception:  # noqa: BLE001, RUF100 - another name, another algorithm, another signature: all of them foreign
            return f"its signer is of another CA than {self.file}: sign it with an operator's keys of that one"
        wrong = out_of_date(found, f"its signer {holder}", f"issue it anew, and sign with {HOW}", now)
        if wrong := wrong or out_of_date(self.ca, "its CA", "make a new one, and all keys with it", now):
            return wrong
        if holder.role != SIGNER:
            return f"it is signed by {holder}, who may not sign programs: an {SIGNER} may, with {HOW}"
        if holder in self.revoked:
            return f"its signer {holder} is revoked: have it signed by another {SIGNER}, with {HOW}"
        try:
            if not isinstance(key, ec.EllipticCurvePublicKey):
                raise InvalidSignature
            key.verify(signature, CONTEXT + program, ec.ECDSA(hashes.SHA256()))
        except InvalidSignature:
            return f"its signature by {holder} is of another program, or was changed: sign it anew with {HOW}"
        return ""


def read_trust(path: Path) -> Trust:
    """Return the trust in the CA whose certificate is in the file `path`, or in the folder of a process's keys.

    A list of revoked holders beside it counts. Raises CertificateError.
    """
    from cryptography import x509  # noqa: PLC0415 - heavy, and used with keys alone

    file = path / CA_FILE if path.is_dir() else path
    ca = parsed(_unchanged(file), file)
    try:
        is_ca = ca.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    except x509.ExtensionNotFound:
        is_ca = False
    if not is_ca:
        raise CertificateError(f"{file}: no certificate of a CA; {WHICH}")
    revoked = file.with_name(REVOKED_FILE)
    return Trust(file, ca, holders_in(_unchanged(revoked), revoked) if revoked.exists() else ())


def _unchanged(file: Path) -> bytes:
    """Return the octets of a file that all may read, and nobody else may change. Raises CertificateError."""
    try:
        with file.open("rb") as opened:
            octets = opened.read(FILE_OCTETS_MAX)
        for path in (file.parent, file):
            if stat.S_IMODE(path.stat().st_mode) & 0o022 and not path.stat().st_mode & stat.S_ISVTX:
                raise CertificateError(f"{path}: other users may change it; run: chmod go-w {path}")
    except OSError as error:
        raise CertificateError(f"{file}: {error.strerror}; {WHICH}") from None
    return octets
