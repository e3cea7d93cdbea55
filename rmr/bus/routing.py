"""A router without a world: it carries messages between whoever is connected, and takes part in no lab.

zenoh does all of it on threads of its own; here is only who is connected.
"""

from collections.abc import Sequence
from typing import Any

import zenoh

from rmr.bus.middleware import open_router
from rmr.bus.secret import Secret


class Router:
    """A router that listens, and joins others as soon as they are there. Its methods may be called on any thread."""

    def __init__(self, listen: str, connect: Sequence[str], secret: Secret | None) -> None:
        """Open it. Raises BusError as `open_router`."""
        self._session: Any = open_router(listen, connect, secret)
        self.id = str(self._session.info.zid())

    def connected(self) -> dict[str, bool]:
        """Return the ids of all that are connected, and whether each is a router."""
        return {str(each.zid): each.whatami == zenoh.WhatAmI.ROUTER for each in self._session.info.transports()}

    def close(self) -> None:
        """End it; whoever is connected loses it at once."""
        self._session.close()
