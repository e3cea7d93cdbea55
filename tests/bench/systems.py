"""The engines that run a workload, each behind the same two calls: `once`, which is timed, and what came of it.

Every engine loads the facts in its own fastest way, and loading counts: a Rete network joins facts when it gets them.
What an engine does once for a program, reading and compiling it, does not count.
"""

import importlib.util
import re
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from workloads import Ending, Workload

from rmr.base.streams import Choices
from rmr.lang.compiler import compile_source
from rmr.vm.engines import new_machine
from rmr.vm.machine import Machine

clock: Callable[[], float] = time.process_time
"""Processor time of this process, in seconds."""

RMR, CLIPS, EXPERTA, DURABLE = "RMR", "CLIPS", "experta", "durable_rules"


class WrongResultError(Exception):
    """An engine did something else than it was to do: its time says nothing."""


@dataclass(frozen=True)
class Lap:
    """Processor time of one run, in seconds."""

    load: float
    """From nothing to all facts being there."""
    run: float
    """From there to the end."""

    @property
    def total(self) -> float:
        """Return both together, which is what engines are compared by."""
        return self.load + self.run


class System(ABC):
    """One engine with one workload."""

    name: str
    firings: int | None
    """Of the last run; None where the engine does not tell."""
    expected_firings: int | None
    """How many there must be; None where that is the engine's affair."""

    @abstractmethod
    def once(self) -> Lap:
        """Run the workload from the start, and say how long it took."""

    @abstractmethod
    def held(self, predicate: str) -> list[tuple[int, ...]]:
        """Return the facts of `predicate` at the end of the last run."""

    def checked(self, ending: Ending) -> None:
        """See that the last run did what it had to.

        Raises:
            WrongResultError: it did not.
        """
        for predicate, rows in ending.items():
            if sorted(self.held(predicate)) != rows:
                raise WrongResultError(f"{self.name}: the facts of {predicate} are wrong")
        if self.firings != (self.expected_firings or self.firings):
            raise WrongResultError(f"{self.name}: {self.firings} firings instead of {self.expected_firings}")


class RmrSystem(System):
    """This project's machine, as a node drives it: its budget of firings a run, its events taken away after each."""

    name = RMR

    def __init__(self, workload: Workload, **options: Any) -> None:
        self._options = options
        self._program = compiled(workload.source)
        self._machine: Machine | None = None
        self.expected_firings = workload.firings

    def once(self) -> Lap:
        """Run a new machine until it is quiescent."""
        self._machine = None
        began = clock()
        machine = new_machine(self._program, 1, Choices("bench"), **self._options)
        machine.start(0)
        loaded = clock()
        machine.run(0)
        machine.drain()
        while not machine.quiescent:
            machine.run(0)
            machine.drain()
        ended = clock()
        self._machine, self.firings = machine, machine.firings
        return Lap(loaded - began, ended - loaded)

    def held(self, predicate: str) -> list[tuple[int, ...]]:
        """Return the facts without the owner."""
        index = self._program.index(predicate)
        assert self._machine is not None
        assert index is not None
        return self._machine.held(index)  # type: ignore[return-value]


class ClipsSystem(System):
    """CLIPS in this process, through clipspy; the facts stand in `deffacts`, the quickest way in."""

    def __init__(self, workload: Workload, clips: ModuleType, strategy: str = "") -> None:
        self._env = clips.Environment()
        self._env.eval("(unwatch all)")
        for name, arity in workload.arity.items():
            self._env.build(f"(deftemplate {name} {' '.join(f'(slot s{k})' for k in range(arity))})")
        self._env.build(f"(deffacts start {' '.join(self._fact(name, row) for name, row in workload.facts)})")
        for rule in workload.clips.split("\n"):
            if rule.strip():
                self._env.build(rule)
        self._env.eval(f"(set-strategy {strategy or workload.strategy})")
        self.name = f"{CLIPS}, {strategy}" if strategy else CLIPS
        self.expected_firings = None if strategy else workload.clips_firings or workload.firings

    @staticmethod
    def _fact(name: str, row: tuple[int, ...]) -> str:
        return f"({name} {' '.join(f'(s{k} {value})' for k, value in enumerate(row))})"

    def once(self) -> Lap:
        """Reset, which asserts the facts, and run; what a former run has left is retracted before."""
        self._env.eval("(retract *)")
        began = clock()
        self._env.reset()
        loaded = clock()
        self.firings = self._env.run()
        ended = clock()
        return Lap(loaded - began, ended - loaded)

    def held(self, predicate: str) -> list[tuple[int, ...]]:
        """Return the slots' values, from a file: a fact that clipspy 1.0 hands to Python is never released, and slows
        all that follows.
        """
        with tempfile.NamedTemporaryFile("r") as file:
            self._env.eval(f'(save-facts "{file.name}" visible {predicate})')
            return [tuple(map(int, re.findall(r"\(s\d+ (-?\d+)\)", line))) for line in file]


def compiled(source: str) -> Any:
    """Return the program of an RMR source that has no mistake."""
    compilation = compile_source(source)
    assert compilation.program is not None, compilation.diagnostics
    return compilation.program


def installed(module: str) -> bool:
    """Tell whether an optional rival is there."""
    return importlib.util.find_spec(module) is not None
