"""What a simulated robot uses of the run around it: time, world, radio, and who calls it when.

`Simulation` is the one host. It is a base class, not a protocol, so that the compiled modules call it directly.
"""

import heapq
from typing import Any

from rmr.base.kernel import Kernel
from rmr.base.time import Instant
from rmr.node.node import Node
from rmr.radio.ether import Ether
from rmr.radio.network import Network
from rmr.radio.phy import NETWORK
from rmr.radio.security import LEVELS, Security, run_key
from rmr_world.lab import Lab
from rmr_world.physics import World


class RobotHost:
    """The shared parts of one run."""

    def __init__(self, lab: Lab, seed: int, key: bytes | None) -> None:
        """`key` is the key of the lab's radio, if that is secured."""
        self.lab = lab
        self.seed = seed
        self.kernel = Kernel()
        self.world = World(lab, seed)
        self.radio = lab.radio.config
        chance = seed if lab.radio.seed is None else lab.radio.seed
        medium = Network if self.radio.mode == NETWORK else Ether
        self.ether: Ether | Network = medium(self.kernel, self.radio, chance, lab.pan)
        self.frame_end: Instant = 0
        """Instant at which the next tick begins."""
        self._key = None if key is None else run_key(key, "simulator", lab.name, seed)
        self._trace: list[dict[str, Any]] = []
        self.loads: list[dict[str, Any]] = []
        """What became of the loads of programs (`rmr_sim.program_loads`), as the report has it."""
        self.switches: list[tuple[int, Instant, int, bool]] = []
        """Changes of program: robot, instant, digest of the new one, whether it came later than to the others."""
        self._calls: list[tuple[Instant, int]] = []
        """Heap of wake-up times beyond the present tick, with the index of the robot: of robots without bodies only."""

    @property
    def now(self) -> Instant:
        """Virtual time."""
        return self.kernel.now

    def security(self, robot: int, incarnation: int) -> Security | None:
        """Return the frame security of one incarnation of `robot`, from 0; None if the radio is open."""
        level = LEVELS[self.lab.radio.security]
        if level is None:
            return None
        assert self._key is not None, "a lab whose radio is secured comes with its key"
        return Security(level, self._key, robot, incarnation)

    def call(self, robot: int, when: Instant) -> None:
        """Call the robot of index `robot`, which has no body, in the tick of `when`."""
        heapq.heappush(self._calls, (when, robot))

    def take_trace(self, node: Node) -> None:
        """Move the entries of a node's trace to the trace of the run: a node keeps only the newest ones."""
        self._trace += node.trace_log
        node.trace_log.clear()

    def new_entries(self, since: int) -> list[dict[str, Any]]:
        """Return the entries of the trace of the run that have come after the first `since`."""
        return self._trace[since:]

    def sort_out(self) -> None:
        """Take note that a robot is now served otherwise than before (killed, stalled, slow, or served again)."""
        raise NotImplementedError
