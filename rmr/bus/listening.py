"""What every process that listens does, a world or a router: who may join, and who was refused.

Imports no zenoh, so that wrong usage costs little.
"""

import logging
from pathlib import Path

from rmr.bus.certificates import Credentials, read_credentials
from rmr.bus.endpoint import is_loopback
from rmr.bus.process import Throttle
from rmr.bus.secret import make_secret
from rmr.entry.command_line import CommandLineError

SAY_AGAIN_S = 5.0
"""How often a waiting process says why it waits, and one that refuses others how many they were."""

log = logging.getLogger("rmr")


def check_open(listen: str | None, *, secret: bool, opened: bool) -> None:
    """Raise CommandLineError for a bus that other machines could use without a secret, unless that is asked for."""
    beyond = listen is not None and not is_loopback(listen)
    if opened and (secret or not beyond):
        why = "--secret" if secret else "--listen beyond this machine alone"
        raise CommandLineError(f"--open goes {'without' if secret else 'with'} {why}")
    if beyond and not secret and not opened:
        raise CommandLineError(
            f"whoever reaches {listen}, from other machines, too, could drive the robots: name a secret with "
            "--secret FILE, which is made if it does not exist, or keys with --keys DIR, or allow that with --open"
        )


def warn_if_open(listen: str | None, *, opened: bool) -> None:
    """Tell what an `opened` bus allows."""
    if opened:
        log.warning("open: whoever reaches %s, on any machine, can drive the robots and end the run", listen)


def secret_of_listener(file: Path | None, *, makes: bool) -> Credentials | None:
    """Return the secret in `file`, None without one; where it `makes` a secret, one that is not there is made.

    A folder has a certificate instead. Raises CertificateError, SecretError, OSError.
    """
    if file is None:
        return None
    if makes and not file.exists():
        make_secret(file)
        log.info("made a new secret: %s", file)
    return read_credentials(file)


class Refused:
    """Tells of sessions that were refused: the first at once, then now and then how many they were."""

    def __init__(self) -> None:
        self._count = 0
        self._reason = ""
        self._say = Throttle(self._tell, SAY_AGAIN_S)

    def __call__(self, reason: str) -> None:
        """Count one more, for a reason of `rmr.bus.refusals.REASONS`."""
        self._count += 1
        self._reason = reason
        self._say()

    def _tell(self) -> None:
        log.warning("refused a process %s (attempts so far: %d)", self._reason, self._count)
