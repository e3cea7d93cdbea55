"""What one body is to a robot: whether it stands, and without an order, which of two goes first.

A body is in the robot's own frame, x ahead and y to the left, with its velocity over the ground in that frame.
"""

from typing import Final

from rmr.node.ports import SeenBody

STILL_MPS: Final = 0.03
"""A body slower than this stands."""
CREEPING_MPS: Final = 0.1
"""A body slower than this may stop at any moment: it manoeuvres."""


def gives_way_late(body: SeenBody) -> bool:
    """Return whether a robot without a place in the order goes before `body`: it comes from the left."""
    return body.y > 0.0 and body.vy < -STILL_MPS
