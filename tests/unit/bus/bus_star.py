"""Sessions on loopback for tests: a router and its clients in one process, and waiting for what comes."""

import asyncio
import socket

from rmr.bus import wire
from rmr.bus.session import open_bus
from rmr.radio.air import Announcement
from rmr.radio.frame import encode_ack
from rmr.radio.phy import airtime

FRAME = wire.Air(Announcement(1, 0, 0, 0, airtime(5), 0.0, 0.0, 0.0, encode_ack(1)))
"""Any frame."""


def free_endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


async def until(claim):
    async with asyncio.timeout(10):
        while not claim():
            await asyncio.sleep(0.002)


async def until_heard(speaker, listener):
    """Wait until `listener` has heard what `speaker` says again and again."""
    heard = []
    listener.subscribe("rmr/x/ops/1/status", lambda _, message: heard.append(message.sender))

    def told():
        speaker.publish("rmr/x/ops/1/status", wire.Stop("x"))
        return heard

    await until(told)


def on_a_star(scene, clients=2):
    """Run `scene(router, *clients)` and close everything."""

    async def play():
        endpoint = free_endpoint()
        buses = [open_bus(wire.WORLD_ID, listen=endpoint)]
        try:
            buses += [open_bus(client + 1, connect=endpoint) for client in range(clients)]
            await scene(*buses)
        finally:
            for bus in reversed(buses):
                bus.close()
                bus.close()

    asyncio.run(play())
