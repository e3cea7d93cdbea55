"""Fit of the robots: whether robots of this radius and speed can see each other early enough to stop.

docs/motion.md has the argument and the envelope of what it was tried with.
"""

from collections.abc import Iterator

from rmr.base.arena import ROUNDING_M
from rmr.base.motion_scale import least_view_depth, view_depth, way_to_stand
from rmr.bytecode.program import Program
from rmr_world.finding import Finding
from rmr_world.lab import Lab
from rmr_world.validate.lab_draft import LabDraft

RADIUS_M_MAX = 0.5
"""Greatest radius with which the rules of motion were tried, metres."""
SPEED_MPS_MAX = 1.0
"""Greatest speed with which they were without a contact, m/s. Smaller and slower robots have the margins of
the reference robot."""


def view_deep_enough(draft: LabDraft) -> Iterator[Finding]:
    """Two robots that drive towards each other can stop after they have seen each other."""
    depth = draft.spec.robot.view.depth
    shape = draft.arena.shape
    if depth is None or len(draft.robots) < 2 or not draft.robot_fits_arena:
        return
    least = least_view_depth(shape.radius, shape.speed)
    if depth < least:
        message = (
            f"at {shape.speed:g} m/s a robot needs {way_to_stand(shape.speed):.2f} m to stand, so two that meet touch "
            f"before both stand if they see {depth:g} m far; {least:.2f} m are the least, "
            f"{view_depth(shape.radius, shape.speed):.2f} m the default without this key"
        )
        yield draft.error(("robot", "view", "depth"), message)


def shape_in_envelope(lab: Lab, _program: Program) -> Iterator[Finding]:
    """Warn of robots that are larger or faster than those with which the rules of motion were tried."""
    shape = lab.arena.shape
    if len(lab.robots) < 2:
        return
    if shape.radius > RADIUS_M_MAX:
        message = f"what keeps robots apart was tried up to {RADIUS_M_MAX:g} m; try yours with rmr sim --seeds 1-100"
        yield lab.warning(("robot", "radius"), message)
    if shape.speed > SPEED_MPS_MAX:
        message = f"what keeps robots apart held up to {SPEED_MPS_MAX:g} m/s; try yours with rmr sim --seeds 1-100"
        yield lab.warning(("robot", "speed"), message)


def view_as_deep_as_needed(lab: Lab, _program: Program) -> Iterator[Finding]:
    """Warn of a view that leaves robots no time to notice each other before they have to brake as hard as they can."""
    shape = lab.arena.shape
    needed = view_depth(shape.radius, shape.speed)
    if len(lab.robots) > 1 and shape.view_depth < needed - ROUNDING_M:
        message = (
            f"two robots of {shape.radius:g} m and {shape.speed:g} m/s need {needed:.2f} m to notice each other and "
            "stop: leave the key out, or lower the speed"
        )
        yield lab.warning(("robot", "view", "depth"), message)


FILE_CHECKS = (view_deep_enough,)
"""The rules that need the lab file alone."""
CHECKS = (shape_in_envelope, view_as_deep_as_needed)
"""The lint of the robots of a lab."""
