"""Runs whose robots write provenance logs: `rmr eval` of a program, and simulated labs, in this process."""

import shlex
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from command_runner import invoke

import rmr.eval.ensemble
import rmr_sim.simulation
from rmr.base.time import Instant, seconds
from rmr.bytecode.program import Program
from rmr.commands.subcommands import command as main
from rmr.node.config import NodeConfig
from rmr.node.node import Node
from rmr.vm.provenance import ProvenanceLog
from rmr.why.absence import why_not
from rmr.why.mind_index import MindIndex
from rmr.why.past import Past, Variables
from rmr.why.question import question
from rmr.why.replayed_histories import variable_names
from rmr.why.why_answer import why
from rmr.why.why_text import absence_text, why_text
from rmr.why.why_tree import WhyAnswer
from rmr_sim.run_setup import Options, load


@dataclass
class Observed:
    """A run that is over."""

    logs: dict[int, list[ProvenanceLog]] = field(default_factory=dict)
    """Of each robot: those of its incarnations."""
    program: Program | None = None
    known_until: Instant = 0
    variables: Variables = ()

    @property
    def robots(self) -> list[int]:
        return sorted(self.logs)

    def minds(self, robot: int) -> list[MindIndex]:
        found: list[MindIndex] = []
        for epoch, log in enumerate(self.logs.get(robot, [])):
            begins = log.records[0].at if log.records else 0
            found.append(MindIndex(robot, epoch, self.program, begins, found[-1] if found else None))
            for record in log.records:
                found[-1].take(record)
        return found

    def node(self, config: NodeConfig, program: Program, *others: object) -> Node:
        """Make a node that writes a log."""
        self.program = program
        log = ProvenanceLog()
        self.logs.setdefault(config.robot, []).append(log)
        return Node(replace(config, provenance=log), program, *others)

    @property
    def past(self) -> Past:
        times = [log.records[-1].at for logs in self.logs.values() for log in logs if log.records]
        self.known_until = max([self.known_until, *times])
        return Past(self, self.variables)

    def why(self, text: str, at: float | None = None, **options: object) -> WhyAnswer:
        past = self.past
        asked = question(text, past.program, self.robots)
        return why(past, asked, None if at is None else seconds(at), **options)

    def text(self, text: str, at: float | None = None, **options: object) -> str:
        return why_text(self.why(text, at, **options))

    def why_not(self, text: str, at: float | None = None, **options: object) -> str:
        past = self.past
        asked = question(text, past.program, self.robots)
        return absence_text(why_not(past, asked, None if at is None else seconds(at), **options))


def evaluated(program: Path, arguments: str, monkeypatch: pytest.MonkeyPatch) -> tuple[Observed, str]:
    """Run `rmr eval` with `arguments`; return the run and the report."""
    observed = Observed()
    with monkeypatch.context() as patch:
        patch.setattr(rmr.eval.ensemble, "Node", observed.node)
        result = invoke(main, ["eval", str(program), *shlex.split(arguments)])
    return observed, result.stdout


def written(text: str, arguments: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Observed:
    """Run `rmr eval` on a program given as text."""
    path = folder / "a.rmr"
    path.write_text(text)
    observed = evaluated(path, arguments, monkeypatch)[0]
    if observed.program is not None:
        observed.variables = variable_names(observed.program, text, str(path))
    return observed


def simulated(lab: Path, monkeypatch: pytest.MonkeyPatch, seed: int | None = None, **options: object) -> Observed:
    """Run a lab in the simulator."""
    observed = Observed()
    with monkeypatch.context() as patch:
        patch.setattr(rmr_sim.simulation, "Node", observed.node)
        simulation = load(lab, Options(**options)).simulation(seed)
        simulation.run()
    observed.known_until = simulation.now
    return observed
