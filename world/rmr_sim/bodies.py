"""Whether the robots of a run need bodies: a program that neither drives nor senses runs the same without them.

Robots without bodies stay at their starts and have no wheels, no localisation and no hellos. Their nodes are called
only when something happens, so that a thousand of them cost no more than their messages.
"""

from collections.abc import Mapping

from rmr.bytecode.program import Kind, Program
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import Handler
from rmr_world.lab import Lab

SENSED_BY_BODIES = frozenset({"at", "pose", "obstacle", "neighbor", "range", "silent"})
"""Facts that need a body. Neighbors are known from hellos, which carry a position."""


def needs_bodies(lab: Lab, program: Program, handlers: Mapping[str, Handler]) -> bool:
    """Return whether anything in the run may depend on wheels or senses.

    A user's handlers may use both. An effect on a sensed predicate holds only while nothing senses it.
    """
    if lab.finish_pattern is not None and lab.finish_pattern.name in SENSED_BY_BODIES:
        return True
    for predicate in program.predicates:
        if predicate.kind is Kind.SENSED and predicate.name in SENSED_BY_BODIES:
            return True
        if predicate.kind is Kind.ACTION:
            provided = None if predicate.name in handlers else PROVIDED.get(predicate.name)
            if provided is None or provided.wheels or provided.at_once:
                return True
            effects = (*predicate.effects, *predicate.else_effects)
            if any(program.predicates[effect.predicate].kind is Kind.SENSED for effect in effects):
                return True
    return False
