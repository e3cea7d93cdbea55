"""Small labs for the simulator's tests: a room, some robots, a program given as text."""

from pathlib import Path
from textwrap import dedent
from typing import Any

from rmr_sim.run_setup import prepare
from rmr_sim.simulation import Simulation

LAB = """
lab: small
program: small.rmr
seed: 1
duration: {duration}
{finish}
arena: {{size: [{width}, {height}], cell: 0.05}}
areas:
  spot: {{at: [1.0, 0.5]}}
  box: {{box: [0.8, 0.8, 1.2, 1.2]}}
robots:
{robots}
facts: {facts}
radio: {{loss: {loss}{radio}}}
localisation: {{beacons: [[0, 0], [{width}, 0]], rate: 10, sigma: 0.005, dropout: {dropout}}}
faults: {faults}
"""


def small_lab(
    folder: Path,
    program: str,
    *,
    robots: int = 1,
    finish: str = "",
    duration: str = "20s",
    loss: float = 0.0,
    dropout: float = 0.0,
    facts: str = "[]",
    size: tuple[float, float] = (1.5, 1.5),
    seed: int = 1,
    actions: str = "",
    faults: str = "[]",
    radio: str = "",
    **options: Any,
) -> Simulation:
    """Return the simulation of `program` with robots 1.. along the bottom wall, each facing east.

    `options` are those of `prepare`.
    """
    poses = [f"  - {{id: {i + 1}, pose: [{0.2 + 0.3 * i}, 0.2, 0deg]}}" for i in range(robots)]
    text = LAB.format(
        duration=duration,
        finish=f"finish: {finish}" if finish else "",
        width=size[0],
        height=size[1],
        robots="\n".join(poses),
        facts=facts,
        loss=loss,
        dropout=dropout,
        faults=faults,
        radio=f", {radio}" if radio else "",
    )
    (folder / "lab.yaml").write_text(text)
    (folder / "small.rmr").write_text(dedent(program))
    file = None
    if actions:
        file = folder / "actions.py"
        file.write_text(dedent(actions))
    return prepare(folder, seed=seed, actions=file, **options)


def traced(simulation: Simulation, what: str) -> list[dict[str, Any]]:
    """Return the trace entries of one kind."""
    return [entry for entry in simulation.trace() if entry["what"] == what]
