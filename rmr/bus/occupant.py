"""Identifies the program that occupies the address at which a world or router is to listen, for an error message."""

from rmr.bus import wire
from rmr.bus.admission import why_no_session
from rmr.bus.certificates import Credentials
from rmr.bus.endpoint import BusError, is_tls
from rmr.bus.keys import ANY_LAB, Keys
from rmr.bus.middleware import NotAdmittedError
from rmr.bus.session import open_bus

ASK_S = 1.0
"""Limit for the answer of a world."""


async def who_listens(endpoint: str, credentials: Credentials | None = None) -> str:
    """Return who listens at `endpoint`, as far as a process with these `credentials` is told, and what to do."""
    for host in ("0.0.0.0", "[::]"):  # wildcard hosts: valid for listening, not for connecting
        endpoint = endpoint.replace(f"/{host}:", "/127.0.0.1:")
    try:
        bus = open_bus(wire.OPERATOR_ID, connect=endpoint, secret=credentials if is_tls(endpoint) else None)
    except NotAdmittedError as error:
        if is_tls(endpoint):
            return f"{error}; choose another --listen"
        return "a world or router with a secret runs there; end it, or choose another --listen"
    except BusError:
        return why_no_session(endpoint).removeprefix(": ") or "another program listens there; choose another --listen"
    try:
        question = wire.AskDisturbances("list", None)
        replies = await bus.ask(Keys(ANY_LAB).disturbances, question, ASK_S)
    finally:
        bus.close()
    labs = sorted({message.body.lab for message, _ in replies if isinstance(message.body, wire.Disturbances)})
    if labs:
        return f"the world of lab {', '.join(labs)} runs there; end it, or choose another --listen"
    return "a router without a world of rmr runs there; choose another --listen, or join it with --connect"
