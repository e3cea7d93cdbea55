"""Real processes for tests: started with a lifeline and ended by their ids, so that none is left whatever happens."""

import asyncio
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from rmr.bus import wire
from rmr.bus.keys import Keys
from rmr.bus.process import LIFELINE
from rmr.bus.session import open_when_there
from rmr.bytecode import codec
from rmr.bytecode.program import Base, Kind, Predicate, Program, Type
from rmr.lang.compiler import compile_source

LAB = """\
lab: bench
program: idle.rbc
arena: {size: [1.0, 1.0]}
areas: {home: {at: [0.5, 0.5]}}
robots: [{id: 1, pose: [0.2, 0.2, 0deg]}, {id: 2, pose: [0.8, 0.8, 0deg]}]
facts: ["due(@1, 25)"]
finish: due(R, 25.0)
"""

PATIENCE_S = 60.0
"""How long a claim may take to come true on a busy machine."""


def idle_program(*actions):
    """Return byte-code that knows `due` and declares `actions`, and does nothing."""
    predicates = [Predicate("due", Kind.PERSISTENT, (Type(Base.FLOAT),))]
    predicates += [Predicate(name, Kind.ACTION, ()) for name in actions]
    return codec.encode(Program(tuple(predicates)), debug=True)


def failing_program():
    """Return byte-code that knows `due` and begins with the action `blink`."""
    source = "type !due(robot, float).\ntype action blink(robot).\nstart(R).\nstart(R) -o blink(R).\n"
    program = compile_source(source).program
    assert program is not None
    return codec.encode(program, debug=False)


def free_endpoint():
    """Return an endpoint on loopback that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class Started:
    """One process under test, its standard error in a file."""

    def __init__(self, command, errors, lifeline=None, before=()):
        """`before` are words before the command, such as those that run it on another host."""
        self.errors = errors
        environment = os.environ | ({LIFELINE: str(lifeline)} if lifeline is not None else {})
        with errors.open("wb") as stream:
            self.process = subprocess.Popen(
                [*before, sys.executable, "-m", *command],
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=stream,
                env=environment,
                pass_fds=() if lifeline is None else (lifeline,),
            )

    def said(self):
        """Return what it has written."""
        return self.errors.read_text()

    def wait_for(self, text, times=1):
        """Wait until it has written `text` that often."""
        wait_until(lambda: self.said().count(text) >= times, lambda: f"{text!r} in {self.said()!r}")

    def exit_code(self):
        """Wait for its end and return its exit code."""
        return self.process.wait(PATIENCE_S)

    def send(self, number):
        """Send it a signal."""
        self.process.send_signal(number)

    def end(self):
        """End it if it still runs."""
        if self.process.poll() is None:
            self.send(signal.SIGCONT)
            self.process.kill()
        self.process.wait(PATIENCE_S)


def wait_until(claim, what=lambda: "it"):
    """Wait until `claim()` is true, `PATIENCE_S` at most."""
    end = time.monotonic() + PATIENCE_S
    while not claim():
        assert time.monotonic() < end, f"never came: {what()}"
        time.sleep(0.01)


class Stage:
    """A folder with a lab and byte-code, an endpoint, and the processes started in it."""

    def __init__(self, folder: Path, endpoint: str | None = None):
        self.folder = folder
        self.endpoint = endpoint or free_endpoint()
        self.started = []
        (folder / "lab.yaml").write_text(LAB)
        (folder / "idle.rbc").write_bytes(idle_program())

    def start(self, *command, **how):
        """Start a process."""
        started = Started([str(word) for word in command], self.folder / f"{len(self.started)}.err", **how)
        self.started.append(started)
        return started

    def world(self, *options, **how):
        """Start the world."""
        where = () if "--connect" in options else ("--listen", self.endpoint)
        return self.start("rmr_world.main", "--config", self.folder / "lab.yaml", *where, *options, **how)

    def agent(self, robot, *options, program="idle.rbc", **how):
        """Start a robot; without a `program` it waits for one."""
        where = ("--connect", self.endpoint)
        words = () if program is None else (self.folder / program,)
        return self.start("rmr_agent.main", "--id", robot, *words, *where, *options, **how)

    def end(self):
        """End everything that was started."""
        for started in self.started:
            started.end()

    def statuses(self, claim, ask_to_stop=()):
        """Listen to all statuses until `claim(newest by sender)` is true and return them; stop some at first."""
        return asyncio.run(self._statuses(claim, ask_to_stop))

    async def _statuses(self, claim, ask_to_stop):
        bus = await open_when_there(wire.OPERATOR_ID, self.endpoint, lambda: None)
        keys, newest = Keys("bench"), {}
        bus.subscribe(keys.statuses, lambda _key, message: newest.__setitem__(message.sender, message.body))
        for who in ask_to_stop:
            bus.publish(keys.stop(who), wire.Stop("enough"))
        end = time.monotonic() + PATIENCE_S
        try:
            while not claim(newest):
                assert time.monotonic() < end, f"never came: {newest}"
                await asyncio.sleep(0.01)
        finally:
            bus.close()
        return newest
