"""What a flood of one sender costs the others of a lab: processor time and late ticks, with the bounds and without.

    python tests/bench/flood.py [--seconds S] [--rate N]

The corridor as processes on loopback: a world and six robots. Another process speaks as robot 6 on the radio's
keys and wheel commands, N messages a second. Taken in turn: no flood, a flood with the bounds of `rmr.bus.rates`, and
one where the bounds are a thousand million times as wide.
"""

import argparse
import asyncio
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rmr.bus import wire
from rmr.bus.keys import Keys
from rmr.bus.session import open_when_there
from rmr.radio.air import Announcement
from rmr.radio.frame import encode_ack
from rmr.radio.phy import airtime

sys.path.insert(0, str(Path(__file__).parent))

from hosts import free_endpoint

ROOT = Path(__file__).parents[2]
LAB = ROOT / "deploy" / "labs" / "corridor"
ROBOTS = range(1, 7)
WIDE = "import rmr.bus.rates as r; r.RATES.update({k: r.Rate(10**12, 10**12, '') for k in r.RATES});"
FLOOD_AS = 6


def start(bounds: bool, module: str, *words: str, errors: Path) -> subprocess.Popen[bytes]:
    """Start a program of rmr, with the bounds or with wide ones."""
    code = f"import sys; {'' if bounds else WIDE} from {module} import main; main({list(words)!r})"
    with errors.open("ab") as stream:
        return subprocess.Popen([sys.executable, "-c", code], stdout=stream, stderr=stream)


def used_s(process: subprocess.Popen[bytes]) -> float:
    """Return the processor time of a process so far, s."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def flood(endpoint: str, rate: int, seconds: float) -> tuple[int, dict[int, wire.Status]]:
    """Speak as one robot, and listen to the statuses of all; return how often it spoke, and the newest statuses."""
    bus = await open_when_there(FLOOD_AS, endpoint, lambda: None)
    operator = bus.seat(wire.OPERATOR_ID)
    keys = Keys("corridor")
    newest: dict[int, wire.Status] = {}

    def take(_key: str, message: wire.Envelope) -> None:
        if isinstance(message.body, wire.Status):
            newest[message.sender] = message.body

    operator.subscribe(keys.statuses, take, whole=True)
    begun = time.monotonic()
    said = 0
    frame = wire.Air(Announcement(FLOOD_AS, 0, 0, 0, airtime(5), 0.5, 0.5, 0.0, encode_ack(1)))
    while (now := time.monotonic() - begun) < seconds:
        while said < rate * now:
            for x in range(3):
                bus.publish(keys.radio(x, 0), frame)
            bus.publish(keys.act(FLOOD_AS), wire.Act(0.0, 0.0, 0))
            said += 4
            if said % 400 == 0:
                break
        await asyncio.sleep(0.001)
    bus.close()
    operator.close()
    return said, newest


def trial(name: str, bounds: bool, rate: int, seconds: float) -> None:
    """Print a row."""
    endpoint = free_endpoint()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        program = folder / "corridor.rbc"
        compile_ = "from rmr.cli import compile_main; compile_main()"
        subprocess.run([sys.executable, "-c", compile_, str(LAB / "corridor.rmr"), "-o", str(program)], check=True)
        config = ("--config", str(LAB / "lab.yaml"), "--listen", endpoint, "--when-ready")
        started = [start(bounds, "rmr_world.main", *config, errors=folder / "world")]
        for robot in ROBOTS:
            words = ("--id", str(robot), "--connect", endpoint, str(program))
            started.append(start(bounds, "rmr_agent.main", *words, errors=folder / "robots"))
        try:
            deadline = time.monotonic() + 60
            while "lab time runs" not in (folder / "world").read_text() and time.monotonic() < deadline:
                time.sleep(0.05)
            before = [used_s(each) for each in started]
            said, newest = asyncio.run(flood(endpoint, rate, seconds))
            after = [used_s(each) for each in started]
        finally:
            for each in reversed(started):
                each.send_signal(signal.SIGTERM)
            for each in started:
                each.wait(20)
    spent = [end - begin for begin, end in zip(before, after, strict=True)]
    others = spent[1:FLOOD_AS]
    parts = {who: status.report for who, status in newest.items() if who in ROBOTS and who != FLOOD_AS}
    late = sum(part.get("ticks_late", 0) for part in parts.values())
    ticks = sum(part.get("ticks", 0) for part in parts.values())
    world = newest[wire.WORLD_ID].report if wire.WORLD_ID in newest else {}
    excess = sum(n for part in (*parts.values(), world) for _, n in part.get("bus", {}).get("excess", ()))
    robot = sum(others) / len(others)
    print(
        f"{name:16} said {said / seconds:7.0f}/s  world {100 * spent[0] / seconds:5.1f} %  "
        f"robot {100 * robot / seconds:5.1f} %  late {late} of {ticks}  world's late {world.get('ticks_late')}  "
        f"dropped {excess}",
        flush=True,
    )


def main() -> None:
    """Take all trials."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--rate", type=int, default=20_000)
    options = parser.parse_args()
    trial("no flood", True, 0, options.seconds)
    trial("flood, bounded", True, options.rate, options.seconds)
    trial("flood, unbounded", False, options.rate, options.seconds)


if __name__ == "__main__":
    main()
