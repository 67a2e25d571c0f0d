"""The pose of one part in a depth image, or the reason why it is not found."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import apply, difference
from cellwright.engine.model.vision import (
    DepthImage,
    LocatedPart,
    NotLocated,
    PoseHypothesis,
    Sighting,
)
from cellwright.engine.stages.vision.plane_regions import PlaneRegion, regions_of
from cellwright.engine.stages.vision.pose_hypotheses import PartModel, pose_hypotheses
from cellwright.engine.stages.vision.pose_refinement import (
    ImageView,
    judge_pose,
    picture_part,
    refine_pose,
    settle_pose,
)

MAX_POSES_TRIED, MAX_POSES_IMPROVED, MAX_POSES_REFINED = (
    30,
    14,
    5,
)  # hypotheses that are looked at, bettered a little, and brought to the best pose
HOPELESS_SHARE = 0.01  # of what speaks for the best pose: so little is not refined any more
NEAR_M, NEAR_RAD = 0.006, np.radians(8)  # hypotheses this near to each other become one
BELOW_M = 0.004
UNSOUND_SHARE = 0.005  # of the share that agrees, and a tenth of the share of the outline
UNSOUND_PX = 0.5  # that a piece of the outline is farther off
MAX_GAP_M = 0.006  # how far above what carries it a part may seem to be
RING_PX = 12
# the share of a part's surroundings that must be as high as the part's lower side, if it is above
# the floor
MIN_CARRIED_SHARE = 0.15


@dataclass(frozen=True, slots=True)
class BeliefDemands:
    """What a hypothesis must show to be believed: shares, pixels, and by how much its evidence is
    ahead, at least and as a share of it.

    The share is there because errors of neighbouring pixels are not independent: many pixels tell
    less than their number says. `within_m` is the standard deviation of its place in the direction
    that is told least. `off_px` is how far a piece of an edge may be off on average; less than a
    pixel, because between two pixels nothing is seen.
    """

    agreeing: float = 0.99
    seen: float = 0.4
    edged: float = 0.88
    off_px: float = 0.6
    pixels: int = 250
    ahead: float = 40.0
    ahead_share: float = 0.002
    within_m: float = 0.0006


@dataclass(frozen=True, slots=True, eq=False)
class KnownScene:
    """What is known of the scene: where the image shows nothing new (height, width), and planes
    that nothing is below.

    A plane is a unit normal and an offset (4,) in the camera's frame: above it is normal . x >
    offset.
    """

    known: Truths
    floors: tuple[Floats, ...] = ()


def locate_in_image(
    model: PartModel, image: DepthImage, ground: KnownScene, demands: BeliefDemands | None = None
) -> Sighting:
    """The pose of a part in an image; else the reason why it is not found."""
    view = ImageView(image, ground.known)
    sighted = part_sightings(model, view, regions_of(image, ground.known))
    if not sighted:
        return NotLocated("nothing in the image has edges like those of the part")
    final = [
        (hypothesis, covariance)
        for hypothesis, covariance in sighted
        if may_stand(model, hypothesis.T_camera_part, view, ground)
    ]
    return _decide_pose(model, final, demands or BeliefDemands())


def part_sightings(
    model: PartModel, view: ImageView, regions: Sequence[PlaneRegion], more: Sequence[Floats] = ()
) -> list[tuple[PoseHypothesis, Floats]]:
    """The poses of a part that the plane regions of an image suggest, or that are given besides, as
    well as they fit the image.

    Each comes with its covariance (6, 6).
    """
    begun = [*more, *pose_hypotheses(model, list(regions), view.image, MAX_POSES_TRIED * 4)]
    apart = [
        T
        for _, T in _order_poses(
            model, view, _distinct_poses(begun, model, MAX_POSES_TRIED + len(more)), unrefined_worth
        )[:MAX_POSES_IMPROVED]
    ]
    nearer = _order_poses(model, view, [refine_pose(model, view, T, 2)[0] for T in apart])
    alike = [refine_pose(model, view, T @ S, 2)[0] for _, T in nearer[:1] for S in model.likenesses]
    nearer = sorted([*nearer, *_order_poses(model, view, alike)], key=lambda pair: -pair[0])
    hopeful = [T for value, T in nearer if value > HOPELESS_SHARE * nearer[0][0]]
    final: list[tuple[PoseHypothesis, Floats]] = []
    for T in _distinct_poses(hopeful, model, MAX_POSES_REFINED):
        pose, covariance = settle_pose(model, view, T)
        hypothesis = judge_pose(model, view, pose, closely=True)
        final += [(hypothesis, covariance)] if hypothesis is not None else []
    return final


def may_stand(model: PartModel, T: Floats, view: ImageView, ground: KnownScene) -> bool:
    """Whether a part may be at a pose: no corner of it is below a floor, and it rests on one or
    on something that is seen.
    """
    return not below_floor(model, T, ground) and _rests_on_something(model, T, view, ground)


def _order_poses(
    model: PartModel,
    view: ImageView,
    poses: Sequence[Floats],
    value: Callable[[PoseHypothesis], float] | None = None,
) -> list[tuple[float, Floats]]:
    """The poses of a part in the picture with what speaks for them, those first for which most
    does.
    """
    value = value or hypothesis_worth
    valued = [
        (value(hypothesis), T)
        for T in poses
        if (hypothesis := judge_pose(model, view, T)) is not None
    ]
    return sorted(valued, key=lambda pair: -pair[0])


def hypothesis_worth(hypothesis: PoseHypothesis) -> float:
    """How much speaks for a hypothesis: the pixels that show it, much less where some
    contradict it or its outline.
    """
    return hypothesis.pixels * hypothesis.agreeing**30 * hypothesis.edged**6


def unrefined_worth(hypothesis: PoseHypothesis) -> float:
    """How much speaks for a pose that is not refined: where it is a little off, more of it is
    contradicted than of a wrong one that is larger than what it hides.
    """
    return hypothesis.pixels * hypothesis.agreeing**4 * hypothesis.edged


def _decide_pose(
    model: PartModel, final: list[tuple[PoseHypothesis, Floats]], demands: BeliefDemands
) -> Sighting:
    """The best hypothesis, if it shows what is demanded, and if no other pose that is as sound
    has as much evidence.
    """
    if not final:
        return NotLocated(
            "the part would lie below the floor, or rest on nothing, wherever it could be"
        )
    sure = [pair for pair in final if not doubt_reason(pair[0], demands)] or final
    first = max(sure, key=lambda pair: hypothesis_worth(pair[0]))[0]
    sure = [pair for pair in sure if _as_sound(pair[0], first)]
    best, covariance = max(sure, key=lambda pair: pair[0].evidence)
    alternatives = [
        hypothesis
        for hypothesis, _ in final
        if not same_pose(model, best.T_camera_part, hypothesis.T_camera_part)
    ]
    rivals = [alternative for alternative in alternatives if _as_sound(alternative, first)]
    second = max(rivals or alternatives, key=lambda alternative: alternative.evidence, default=None)
    reason = doubt_reason(best, demands)
    needed = max(demands.ahead, demands.ahead_share * best.evidence)
    if not reason and rivals and second is not None and best.evidence - second.evidence < needed:
        reason = "two poses explain the image equally well"
    least = float(np.sqrt(max(np.linalg.eigvalsh(covariance[:3, :3])[-1], 0.0)))
    if not reason and least > demands.within_m:
        reason = (
            "nothing that is seen tells where it lies along one direction: give or take "
            f"{1000 * least:.1f} mm"
        )
    if reason:
        return NotLocated(reason, best, second)
    poses = tuple(best.T_camera_part @ S for S in model.symmetries)
    return LocatedPart(best, covariance, poses, second)


def _as_sound(first: PoseHypothesis, second: PoseHypothesis) -> bool:
    """Whether a hypothesis is contradicted hardly more than another one."""
    return (
        first.agreeing > second.agreeing - UNSOUND_SHARE
        and first.edged > second.edged - 10 * UNSOUND_SHARE
        and first.off_px < second.off_px + UNSOUND_PX
    )


def doubt_reason(best: PoseHypothesis, demands: BeliefDemands) -> str:
    """Why a hypothesis is not believed; empty if it is."""
    if best.pixels < demands.pixels or best.seen < demands.seen:
        return (
            f"too little of the part would be seen: {best.pixels} pixels, {best.seen:.0%} of "
            "its picture"
        )
    if best.agreeing < demands.agreeing:
        return f"the image shows through the part: only {best.agreeing:.0%} of it agrees"
    if best.edged < demands.edged:
        return f"the outline does not end where the part would: only {best.edged:.0%} of it does"
    if best.off_px > demands.off_px:
        return (
            "the surface ends elsewhere than the part would: a piece of an edge is "
            f"{best.off_px:.1f} pixels off"
        )
    return ""


def same_pose(model: PartModel, first: Floats, second: Floats) -> bool:
    """Whether two poses are nearly one, except for symmetries."""
    for S in model.symmetries:
        metres, radians = difference(first @ S, second)
        if metres < NEAR_M and radians < NEAR_RAD:
            return True
    return False


def _distinct_poses(poses: Iterable[Floats], model: PartModel, most: int) -> list[Floats]:
    """The first of those poses that are nearly one."""
    distinct: list[Floats] = []
    for T in poses:
        if len(distinct) >= most:
            break
        if not distinct or not _near_any(np.array(distinct), T, model):
            distinct.append(T)
    return distinct


def _near_any(distinct: Floats, T: Floats, model: PartModel) -> bool:
    for S in model.symmetries:
        symmetric = T @ S
        metres = np.linalg.norm(distinct[:, :3, 3] - symmetric[:3, 3], axis=1)
        cosine = (np.einsum("nij,ij->n", distinct[:, :3, :3], symmetric[:3, :3]) - 1) / 2
        if ((metres < NEAR_M / 2) & (cosine > np.cos(NEAR_RAD / 2))).any():
            return True
    return False


def below_floor(model: PartModel, T: Floats, ground: KnownScene) -> bool:
    """Whether a corner of a part at a pose is below a floor."""
    points = apply(T, model.solid.vertices)
    return any(bool((points @ floor[:3] - floor[3] < -BELOW_M).any()) for floor in ground.floors)


def _rests_on_something(model: PartModel, T: Floats, view: ImageView, ground: KnownScene) -> bool:
    """Whether a part may rest on a floor, or on something that is seen beside it.

    What it hides wholly does not count.
    """
    points = apply(T, model.solid.vertices)
    heights = [points @ floor[:3] - floor[3] for floor in ground.floors]
    if not heights or min(float(height.min()) for height in heights) < MAX_GAP_M:
        return True
    seen = picture_part(model, view.image, T, RING_PX)
    if seen is None:
        return False
    mask = seen.owner >= 0
    ring = ndimage.binary_dilation(mask, iterations=RING_PX) & ~ndimage.binary_dilation(
        mask, iterations=2
    )
    v, u = np.nonzero(ring)
    depth = view.image.depth[v + seen.v0, u + seen.u0]
    around = (
        view.image.camera.rays((u + seen.u0).astype(float), (v + seen.v0).astype(float))
        * depth[:, None]
    )[depth > 0]
    return any(
        bool(
            (np.abs(around @ floor[:3] - floor[3] - height.min()) < MAX_GAP_M).mean()
            > MIN_CARRIED_SHARE
        )
        for floor, height in zip(ground.floors, heights, strict=True)
        if len(around)
    )
