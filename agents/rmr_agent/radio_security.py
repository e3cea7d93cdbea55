"""What secures a robot's frames: the lab's level, which the world tells, and its key, which only files hold.

Lab and robot must agree. A robot without a key in a secured lab would be deaf; one with a key in a lab that is said to
be open was perhaps told so by somebody who would like to listen. Neither starts.
"""

from rmr.bus import wire
from rmr.radio.security import LEVELS, UNSECURED, Security, run_key
from rmr_agent.bytecode import RefusedError


def make_security(robot: int, known: wire.Map, run: int, key: bytes | None) -> Security | None:
    """Return what secures `robot` in the run that the world tells of; None in an open lab. Raises RefusedError."""
    name = known.radio.get("security", UNSECURED)
    if not isinstance(name, str) or name not in LEVELS:
        raise RefusedError(f"its radio is secured in a way that this robot does not know ({name!r})")
    level = LEVELS[name]
    if level is None and key is None:
        return None
    if key is None:
        raise RefusedError(f"its radio is secured ({name}): start the robot with --radio-key and the file of its key")
    if level is None:
        raise RefusedError("its radio is not secured: start the robot without --radio-key, or give the lab a key_file")
    try:
        return Security(level, run_key(key, "robots", known.lab, run), robot, known.lives)
    except ValueError as error:
        raise RefusedError(f"robot {robot}: {error}") from None
