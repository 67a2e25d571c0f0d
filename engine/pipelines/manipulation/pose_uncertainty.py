"""Pose uncertainty of a part: seen, taken and brought to its goal."""

from collections.abc import Iterable

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.vision import LocatedPart
from cellwright.engine.pipelines.manipulation.place_answers import Carry, Placed

POSE_SIGMAS = 3.0  # standard deviations within which a pose is taken to be


def at_goal(placed: Placed) -> Floats:
    """The covariance (6, 6) of a displacement (m) and a turn (rad) at the goal, about the part's
    origin along the world's axes.

    The part keeps its error in the hand. Jaws that close on two faces take away the displacement
    along their way, and the turns that these faces do not allow.
    """
    return brought_covariance(placed.sighting, placed.carries, placed.T_world_goal)


def brought_covariance(
    sighting: LocatedPart, carries: Iterable[Carry], T_world_goal: Floats
) -> Floats:
    """The same covariance (6, 6) of a part that was seen, and is brought to a goal with some
    carries.
    """
    own = _turn_covariance(sighting.covariance, sighting.best.T_camera_part[:3, :3].T)
    in_hand = after_grasps(own, (carry.T_part_hand[:3, 0] for carry in carries))
    return _turn_covariance(in_hand, T_world_goal[:3, :3])


def within_m(covariance: Floats) -> float:
    """How far (m) a part may be from its goal, along the direction that is least sure: three
    standard deviations.
    """
    return POSE_SIGMAS * float(np.sqrt(max(np.linalg.eigvalsh(covariance[:3, :3])[-1], 0.0)))


def after_grasps(covariance: Floats, closing: Iterable[Floats]) -> Floats:
    """The covariance (6, 6) in the part's frame after jaws have closed along some directions
    (3,) of that frame.
    """
    for x in closing:
        keep = np.zeros((6, 6))
        keep[:3, :3], keep[3:, 3:] = np.eye(3) - np.outer(x, x), np.outer(x, x)
        covariance = keep @ covariance @ keep.T
    return covariance


def _turn_covariance(covariance: Floats, R: Floats) -> Floats:
    """The covariance (6, 6) along other axes."""
    both = np.kron(np.eye(2), R)
    turned: Floats = both @ covariance @ both.T
    return turned
