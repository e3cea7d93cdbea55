"""Processes that speak the bus like a world and robots but do nothing else: what a launcher sees, in seconds.

    python standin.py world --listen ENDPOINT ...
    python standin.py robot --id N --connect ENDPOINT --lab NAME ...

How a robot behaves stands in the environment: ``STANDIN_<id>`` is one of the words of `BEHAVIOURS`.
``STANDIN_READY`` is a file that is there once the launcher has found all robots ready.
"""

import argparse
import asyncio
import os
import signal
import sys
from pathlib import Path

from rmr.base.time import seconds
from rmr.bus import wire
from rmr.bus.keys import WORLD, Keys
from rmr.bus.process import Ending, handle_signals, hold_lifeline
from rmr.bus.secret import read_secret
from rmr.bus.session import open_bus, open_when_there

BEHAVIOURS = {
    "finish": "holds the finish fact soon",
    "refuse": "does not like its program: exit code 3",
    "crash": "ends with exit code 1 once all robots run",
    "roam": "never finishes",
    "deaf": "never finishes and does not leave when asked, nor at SIGTERM",
    "stall": "finishes as soon as the file of STANDIN_RELEASE is there",
    "late": "is ready as soon as the file of STANDIN_RELEASE is there, and never finishes",
    "mute": "says nothing at all",
}

PERIOD_S = 0.05


def report(number: int, finished: bool) -> dict:
    jobs = [{"name": "crossing", "job": "at(@1, exit)", "start_s": 0.0, "finish_s": 0.3, "deadline_s": 9.0}]
    return {
        "finish_s": 0.3 if finished else None,
        "assertions": [{**job, "met": True, "cause": None} for job in jobs] if finished else [],
        "schedules": [{"event": "crossing(exit)", "leader": 1, "term": 1, "order": [1, 2], "formed_s": 0.1}],
        "facts": [f"waiting(@{number})"],
        "bus": {"lost": 0, "malformed": 0},
    }


async def robot(options: argparse.Namespace, ending: Ending) -> None:
    behaviour = os.environ.get(f"STANDIN_{options.id}", "finish")
    if behaviour == "refuse":
        print(f"robot {options.id}: no handler for action blink", file=sys.stderr)
        sys.exit(3)
    if behaviour == "deaf":
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().remove_signal_handler(number)
            signal.signal(number, signal.SIG_IGN)
    bus = await open_when_there(options.id, options.connect, lambda: None, read_secret(options.secret))
    keys = Keys(options.lab)

    def stop(_key: str, _message: wire.Envelope) -> None:
        if behaviour != "deaf":
            ending.ask("told to")

    bus.subscribe(keys.stop(options.id), stop)
    while behaviour == "late" and not Path(os.environ["STANDIN_RELEASE"]).exists() and not ending.asked:
        await asyncio.sleep(PERIOD_S)
    turn = 0
    while not ending.asked:
        await asyncio.sleep(PERIOD_S)
        turn += 1
        released = behaviour == "stall" and Path(os.environ["STANDIN_RELEASE"]).exists()
        finished = released or (behaviour == "finish" and turn > 6)
        state = "ready" if turn < 3 else "finished" if finished else "running"
        if behaviour == "crash" and turn > 6 and Path(os.environ["STANDIN_READY"]).exists():
            print("robot: the wheels came off", file=sys.stderr)
            os._exit(1)
        if behaviour != "mute":
            said = wire.Status(
                state, f"turn {turn}", finished, False, seconds(turn * PERIOD_S), report(options.id, finished)
            )
            bus.publish(keys.status(options.id), said)
    final = wire.Status("stopped", "", finished, True, seconds(turn * PERIOD_S), report(options.id, finished))
    bus.publish(keys.status(options.id), final)
    await asyncio.sleep(PERIOD_S)
    bus.close()


async def world(options: argparse.Namespace, ending: Ending) -> None:
    bus = open_bus(wire.WORLD_ID, listen=options.listen, secret=read_secret(options.secret))
    keys = Keys(os.environ["STANDIN_LAB"])
    bus.subscribe(keys.stop(WORLD), lambda _key, _message: ending.ask("told to"))
    await ending.wait()
    ways = ((1, 0.0, 0.0, 0.0, 1.5), (2, 0.0, 0.0, 0.0, 1.7))
    bus.publish(keys.truth, wire.Truth(seconds(1.0), ways, 0, 0.02, 0, True))
    await asyncio.sleep(PERIOD_S)
    bus.close()


async def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("role")
    parser.add_argument("--id", type=int)
    parser.add_argument("--connect")
    parser.add_argument("--listen")
    parser.add_argument("--lab")
    parser.add_argument("--secret", type=Path)
    options, _ = parser.parse_known_args()
    ending = Ending()
    handle_signals(ending)
    hold_lifeline()
    await (robot if options.role == "robot" else world)(options, ending)
    os._exit(0)


if __name__ == "__main__":
    asyncio.run(main())
