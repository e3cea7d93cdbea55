"""The key of a lab's radio, read by the programs that start all of its robots: the launcher and the simulator.

The world server does not read it: it publishes the security level only, for the bus is clear text.
"""

from rmr.radio.key_file import KeyFileError, read_key
from rmr.radio.security import UNSECURED
from rmr_world.finding import LabError
from rmr_world.lab import Lab


def radio_key(lab: Lab) -> bytes | None:
    """Return the key that secures the lab's radio; None if the radio is open.

    Raises LabError when the lab names no key file, or one that holds no key.
    """
    if lab.radio.security == UNSECURED:
        return None
    if lab.key_file is None:
        raise _wrong(lab, "security", f"{lab.radio.security} needs a key: name its file in radio.key_file")
    try:
        return read_key(lab.key_file)
    except KeyFileError as error:
        raise _wrong(lab, "key_file", str(error)) from None


def _wrong(lab: Lab, part: str, message: str) -> LabError:
    return LabError([lab.error(("radio", part), message)])
