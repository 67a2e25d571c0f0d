"""Where a part is in a depth image, or why that cannot be said."""

from dataclasses import dataclass

import numpy as np

from engine.kernels.rigid import difference
from engine.model.geometry import Floats, Truths
from engine.model.vision import DepthImage, Hypothesis, Located, NotLocated, Sighting
from engine.stages.vision.hypotheses import Model, hypotheses
from engine.stages.vision.outlines import regions_of
from engine.stages.vision.refinement import judged, refined

TRIED, REFINED = 60, 6
NEAR_M, NEAR_RAD = 0.006, np.radians(8)  # hypotheses this near to each other become one
BELOW_M = 0.004


@dataclass(frozen=True, slots=True)
class Demands:
    """What a hypothesis must show to be believed: shares, pixels, and by how much it must be better than any other one."""

    agreeing: float = 0.93
    seen: float = 0.4
    edged: float = 0.75
    pixels: int = 250
    ahead: float = 0.06


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """What is known of the scene: where the image shows nothing new (height, width), and planes that nothing is below.

    A plane is a unit normal and an offset (4,) in the camera's frame: above it is normal . x > offset.
    """

    known: Truths
    floors: tuple[Floats, ...] = ()


def locate(model: Model, image: DepthImage, ground: Ground, demands: Demands | None = None) -> Sighting:
    """The pose of a part in an image; else the reason why it is not found."""
    regions = regions_of(image, ground.known)
    begun = hypotheses(model, regions, image, TRIED * 4)
    if not len(begun):
        return NotLocated("nothing in the image has edges like those of the part")
    inverse = np.where(image.depth > 0, 1.0 / np.where(image.depth > 0, image.depth, 1.0), 0.0)
    apart = _distinct(begun, model, TRIED)
    first = [(T, each) for T in apart if (each := judged(model, image, inverse, T)) is not None]
    first.sort(key=lambda pair: -worth(pair[1]))
    final: list[tuple[Hypothesis, Floats]] = []
    for T, _ in first[:REFINED]:
        pose, covariance = refined(model, image, inverse, T)
        each = judged(model, image, inverse, pose)
        if each is not None and not _below(model, pose, ground):
            final.append((each, covariance))
    return _decided(model, final, demands or Demands())


def worth(one: Hypothesis) -> float:
    """How much speaks for a hypothesis: the pixels that show it, less those that contradict it and the outline's share."""
    return one.pixels * (one.agreeing * (0.3 + 0.7 * one.edged)) ** 2


def _decided(model: Model, final: list[tuple[Hypothesis, Floats]], demands: Demands) -> Sighting:
    if not final:
        return NotLocated("the part would lie below the floor wherever it could be")
    final.sort(key=lambda pair: -worth(pair[0]))
    best, covariance = final[0]
    second = next((each for each, _ in final[1:] if not same(model, best.T_camera_part, each.T_camera_part)), None)
    reason = _doubt(best, second, demands)
    if reason:
        return NotLocated(reason, best, second)
    poses = tuple(best.T_camera_part @ S for S in model.symmetries)
    return Located(best, covariance, poses, second)


def _doubt(best: Hypothesis, second: Hypothesis | None, demands: Demands) -> str:
    """Why the best hypothesis is not believed; empty if it is."""
    if best.pixels < demands.pixels or best.seen < demands.seen:
        return f"too little of the part would be seen: {best.pixels} pixels, {best.seen:.0%} of its picture"
    if best.agreeing < demands.agreeing:
        return f"the image shows through the part: only {best.agreeing:.0%} of it agrees"
    if best.edged < demands.edged:
        return f"the outline does not end where the part would: only {best.edged:.0%} of it does"
    if second is not None and worth(second) > (1 - demands.ahead) * worth(best):
        return "two poses explain the image equally well"
    return ""


def same(model: Model, one: Floats, other: Floats) -> bool:
    """Whether two poses are nearly one, but for symmetries."""
    for S in model.symmetries:
        metres, radians = difference(one @ S, other)
        if metres < NEAR_M and radians < NEAR_RAD:
            return True
    return False


def _distinct(poses: Floats, model: Model, most: int) -> list[Floats]:
    """The first of those poses that are nearly one."""
    kept: list[Floats] = []
    for T in poses:
        if len(kept) >= most:
            break
        if not kept or not _near(np.array(kept), T, model):
            kept.append(T)
    return kept


def _near(kept: Floats, T: Floats, model: Model) -> bool:
    for S in model.symmetries:
        other = T @ S
        metres = np.linalg.norm(kept[:, :3, 3] - other[:3, 3], axis=1)
        cosine = (np.einsum("nij,ij->n", kept[:, :3, :3], other[:3, :3]) - 1) / 2
        if ((metres < NEAR_M / 2) & (cosine > np.cos(NEAR_RAD / 2))).any():
            return True
    return False


def _below(model: Model, T: Floats, ground: Ground) -> bool:
    points = model.solid.vertices @ T[:3, :3].T + T[:3, 3]
    return any(bool((points @ floor[:3] - floor[3] < -BELOW_M).any()) for floor in ground.floors)
