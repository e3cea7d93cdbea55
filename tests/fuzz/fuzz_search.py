"""Draws programs that look for a goal over a map of facts, the same way again and again: what a rotor is for."""

from dataclasses import replace

from fuzz_programs import INTS, KINDS, OUTER, Lively, value_of
from program_maker import FLOAT, INT, OPEN, ROBOT, STRING, here

from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    SELF,
    Atom,
    Base,
    Conjunct,
    Constant,
    DeriveFact,
    InitialFact,
    InitialGoal,
    Instruction,
    Kind,
    Mode,
    Predicate,
    Program,
    Rule,
    Slot,
    Type,
)
from rmr.lang.lower.goal_paths import with_leads

PLACES = [INT, INT, FLOAT, OPEN, ROBOT, STRING, Type(Base.SYMBOL, "area")]
"""What places may be."""

NOWHERE: dict[Base, Value] = {
    Base.INT: 99,
    Base.FLOAT: 99.0,
    Base.OPEN: Symbol("z"),
    Base.ROBOT: Robot(99),
    Base.STRING: "z",
    Base.SYMBOL: Symbol("z"),
}
"""A place to which no door leads, by the type of places."""


class Searching(Lively):
    """A drawn program with a rule that goes from place to place, ``place(A), door(A, B) -o place(B)``, in any order."""

    def declared(self) -> list[Predicate]:
        self.place = self.rng.choice(PLACES)
        kind = self.rng.choice(KINDS)
        doors = Predicate("door", kind, (self.place, self.place, *[FLOAT] * self.chance(0.2)))
        return [Predicate("place", Kind.TEMPORARY, (self.place,)), doors, *super().declared()]

    def walk(self) -> Rule:
        """The rule; sometimes it looks at more, or derives more."""
        bound = here() | {1: self.place, 2: self.place}
        doors = self.bare[1]
        mode = Mode.KEEP if doors.kind is Kind.TEMPORARY else Mode.READ
        measured = [Slot(3)] * (len(doors.types) - 2)
        bound |= dict.fromkeys([slot.index for slot in measured], FLOAT)
        body: list[Conjunct] = [
            Atom(0, (Slot(1),), Mode.CONSUME),
            Atom(1, (Slot(1), Slot(2), *measured), mode),
        ]
        self.rng.shuffle(body)
        self.manner = (Mode.KEEP, Mode.CONSUME)
        if self.chance(0.3):
            body.append(self.atom(OUTER, bound))
        body += self.conditions(OUTER, bound, 0.2)
        if self.chance(0.2):
            body.append(self.absent(bound))
        heads = [DeriveFact(0, SELF, ((Instruction(Op.LOAD, 2),),)), *[self.item(bound)] * self.chance(0.2)]
        return Rule(12, tuple(body), tuple(heads))

    def around(self) -> list[InitialFact]:
        """The robot's place, and doors from there."""
        places = [self.rng.choice(INTS) if self.place == INT else value_of(self.rng, self.place) for _ in range(3)]
        pairs = [(one, other) for one in places for other in places]
        measured = [1.0] * (len(self.bare[1].types) - 2)
        doors = [InitialFact(1, None, (*pair, *measured)) for pair in self.rng.sample(pairs, k=self.rng.randint(3, 6))]
        return [InitialFact(0, None, (places[0],)), *doors]

    def program(self) -> Program:
        drawn = super().program()
        goals = [replace(goal, leads=None) for goal in drawn.goals]
        wanted = InitialGoal(0, None, (Constant(NOWHERE[self.place.base]),))
        program = replace(
            drawn,
            facts=(*self.around(), *drawn.facts),
            goals=(wanted, *goals),
            rules=(self.walk(), *drawn.rules[:2]),
            debug=None,
        )
        return with_leads(program) if self.chance(0.5) else program
