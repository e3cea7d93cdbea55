"""The sensed facts that every robot provides: `at`, `pose`, `peer`, `neighbor`, `range`, `turn`, `leads`, ...

The robot states what holds; this module tells the virtual machine what has changed, and only for predicates that
the program uses.
"""

from collections.abc import Iterable

from rmr.base.time import Instant
from rmr.base.values import Value
from rmr.bytecode.conform import conforms
from rmr.bytecode.program import Kind, Program
from rmr.vm.machine import Machine
from rmr.vm.provenance import SENSED

Args = tuple[Value, ...]


class SensedFacts:
    """Mirrors what a robot senses into its virtual machine."""

    def __init__(self, program: Program, machine: Machine) -> None:
        self._machine = machine
        self._index = {
            p.name: i
            for i, p in enumerate(program.predicates)
            if p.kind is Kind.SENSED or (p.provided and p.kind is not Kind.ACTION)
        }
        self._types = {name: program.predicates[i].types for name, i in self._index.items()}
        self._held: dict[str, dict[Args, None]] = {}
        self.changed: Instant = 0
        """When a fact came or went last."""

    def used(self, name: str) -> bool:
        """Return whether the program reads `name`."""
        return name in self._index

    def holds(self, name: str, args: Args) -> bool:
        """Return whether the fact is held now."""
        return args in self._held.get(name, ())

    def of(self, name: str) -> list[Args]:
        """Return the facts of `name` held now, oldest first."""
        return list(self._held.get(name, ()))

    def add(self, now: Instant, name: str, args: Args) -> None:
        """State that a fact holds."""
        held = self._held.setdefault(name, {})
        if args in held:
            return
        held[args] = None
        self.changed = now
        if name in self._index:
            self._machine.insert(now, self._index[name], args, SENSED)

    def drop(self, now: Instant, name: str, args: Args) -> None:
        """State that a fact holds no more."""
        held = self._held.get(name)
        if held is None or args not in held:
            return
        del held[args]
        self.changed = now
        if name in self._index:
            self._machine.withdraw(now, self._index[name], args, SENSED)

    def take_over(self, now: Instant, other: "SensedFacts") -> None:
        """State what holds by `other`, of another program, but for the robot's part in schedules: groups end."""
        for name, held in other._held.items():
            # Facts about the robot's part in the schedules of groups.
            for args in held if name not in {"turn", "leads"} else ():
                self.add(now, name, args)

    def replace(self, now: Instant, name: str, facts: Iterable[Args]) -> None:
        """State that exactly `facts` hold of `name`."""
        wanted = dict.fromkeys(facts)
        held = self._held.get(name, {})
        if list(held) == list(wanted):
            return
        for args in list(held):
            if args not in wanted:
                self.drop(now, name, args)
        for args in wanted:
            self.add(now, name, args)

    def tell(self, now: Instant, facts: Iterable[tuple[str, Args]]) -> None:
        """State that exactly `facts` hold of their predicates; one that the program cannot hold is left out."""
        by_name: dict[str, list[Args]] = {}
        for name, args in facts:
            types = self._types.get(name, ())
            fits = name in self._index and len(types) == len(args) and all(map(conforms, args, types))
            by_name.setdefault(name, []).extend([args] if fits else [])
        for name, told in by_name.items():
            self.replace(now, name, told)
