"""How sure it is where a part will be: what is doubted of its pose, seen, taken and brought to its goal."""

from collections.abc import Iterable

import numpy as np

from engine.model.geometry import Floats
from engine.pipelines.placing.answers import Placed


def at_goal(placed: Placed) -> Floats:
    """The covariance (6, 6) of a displacement (m) and a turn (rad) at the goal, about the part's origin along the world's axes.

    The part keeps its error in the hand. Jaws that close on two faces take away the displacement along their way, and the turns
    that these faces do not allow.
    """
    own = _turned(placed.sighting.covariance, placed.sighting.best.T_camera_part[:3, :3].T)
    held = after_grasps(own, (carry.T_part_hand[:3, 0] for carry in placed.carries))
    return _turned(held, placed.T_world_goal[:3, :3])


def after_grasps(covariance: Floats, closing: Iterable[Floats]) -> Floats:
    """The covariance (6, 6) in the part's frame after jaws have closed along some directions (3,) of that frame."""
    for x in closing:
        keep = np.zeros((6, 6))
        keep[:3, :3], keep[3:, 3:] = np.eye(3) - np.outer(x, x), np.outer(x, x)
        covariance = keep @ covariance @ keep.T
    return covariance


def _turned(covariance: Floats, R: Floats) -> Floats:
    """The covariance (6, 6) along other axes."""
    both = np.kron(np.eye(2), R)
    found: Floats = both @ covariance @ both.T
    return found
