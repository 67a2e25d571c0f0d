"""Which of several parts is seen, by the relations between its faces, and where it is.

Each face that is seen is one facet of the part, or belongs to something else. This is a constraint search (Grimson & Lozano-Perez,
"Model-based recognition and localization from sparse range or tactile data", 1984; faces as in Magee & Nathan 1985): a face is
no larger than its facet; two faces have the angle between their facets, and as parallel ones the distance; no two points of them
are farther apart than the facets' are. Three facets that are not parallel settle the pose. Two leave a shift along both, which the ends
of the larger face settle; one tells too little. The whole image betters the pose, and checks it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from engine.kernels.rigid import transform
from engine.model.geometry import Floats, Truths
from engine.model.ranging import Recognised, Recognising, Sight, Unrecognised
from engine.model.vision import DepthImage
from engine.stages.vision.faces import Face, faces_of, faces_seen, farthest, independent
from engine.stages.vision.hypotheses import Model, inside
from engine.stages.vision.images import rendered
from engine.stages.vision.localisation import same
from engine.stages.vision.outlines import axes_of
from engine.stages.vision.refinement import View, refined

LEAST_RANK = 2  # directions that faces must span
FACES = 8  # that are interpreted, the largest
ANGLE_RAD, LENGTH_M, AREA = np.radians(4.0), 0.004, 1.15  # what relations may differ by
SPANS = 0.25  # singular value of normals: less is no direction of its own
TRIED = 40  # interpretations of one part that are checked against the image, those with the most pixels first
NEAR = 5.0  # of the noise: so near to the part, a pixel shows it
SHOWN = 0.85  # of what a face shows must lie in its facet
THROUGH, EXPLAINED = (
    0.03,
    0.35,
)  # shares of the part's picture: that the image looks through it, and that shows it
AHEAD = 0.03  # of its pixels: so much better must the best part explain the image


@dataclass(frozen=True, slots=True)
class Pairing:
    """A face that is seen and the facet that it is taken for."""

    seen: Face
    facet: Face


Interpretation = tuple[Pairing, ...]


def recognised(models: Mapping[str, Model], image: DepthImage, known: Truths) -> Recognising:
    """The part that explains the image best, and all poses in which it does; else why none does."""
    seen = faces_seen(image, known)[:FACES]
    if not seen:
        return Unrecognised("there is no plane face in the image")
    found: list[Sight] = []
    loose: list[str] = []
    for name, model in sorted(models.items()):
        interpretations = list(interpretations_of(seen, faces_of(model.solid)))
        found += _sights(name, model, interpretations, image, known)
        if interpretations and max(_rank(each) for each in interpretations) < LEAST_RANK:
            loose.append(name)
    if not found:
        return Unrecognised(_why(len(seen), loose))
    best = max(found, key=lambda each: each.pixels)
    as_good = [each for each in found if each.pixels >= (1.0 - AHEAD) * best.pixels]
    others = sorted({each.part for each in as_good} - {best.part})
    if others:
        told = " or ".join(sorted([best.part, *others]))
        return Unrecognised(f"it may be {told}: what is seen is alike", tuple(as_good))
    model = models[best.part]
    poses: list[Floats] = []
    for each in sorted(as_good, key=lambda each: -each.pixels):
        if not any(same(model, T, each.T_eye_part) for T in poses):
            poses.append(each.T_eye_part)
    return Recognised(best, tuple(poses), tuple(best.T_eye_part @ S for S in model.symmetries))


def _why(faces: int, loose: Sequence[str]) -> str:
    if loose:
        told = ", ".join(loose)
        return f"too few faces are seen to tell more than that it may be {told}: look from where two or three meet"
    return f"no part explains two or three of the {faces} faces that are seen; if one is there, look from where two of its faces meet"


def interpretations_of(seen: Sequence[Face], facets: Sequence[Face]) -> Iterator[Interpretation]:
    """All ways to take some of the faces for facets so that all relations hold, which cannot be extended by a later face."""

    def extended(n: int, so_far: Interpretation) -> Iterator[Interpretation]:
        if n == len(seen):
            if so_far:
                yield so_far
            return
        taken = {id(each.facet) for each in so_far}
        fits = False
        for facet in facets:
            pairing = Pairing(seen[n], facet)
            if id(facet) in taken or not _holds(pairing, so_far):
                continue
            fits = True
            yield from extended(n + 1, (*so_far, pairing))
        # A face may belong to something else; where it fits, only as long as few are left out.
        if not fits or n - len(so_far) < 2:
            yield from extended(n + 1, so_far)

    yield from extended(0, ())


def _holds(new: Pairing, so_far: Interpretation) -> bool:
    """Whether a face can be a facet, beside those that are taken already."""
    return new.seen.area_m2 <= AREA * new.facet.area_m2 and all(_related(new, each) for each in so_far)


def _related(one: Pairing, other: Pairing) -> bool:
    """Whether two faces stand to each other as their facets do."""
    seen, model = (_angle(a.normal, b.normal) for a, b in ((one.seen, other.seen), (one.facet, other.facet)))
    if abs(seen - model) > ANGLE_RAD:
        return False
    if model < ANGLE_RAD or model > np.pi - ANGLE_RAD:
        side = 1.0 if model < 1.0 else -1.0
        # The planes' offsets differ by what one is above the other, at the points of one of them.
        gap = float((other.seen.points @ one.seen.normal).mean()) - one.seen.offset_m
        wanted = side * other.facet.offset_m - one.facet.offset_m
        if abs(gap - wanted) > LENGTH_M:
            return False
    apart = farthest(one.seen.points, other.seen.points)
    return apart <= farthest(one.facet.points, other.facet.points) + 2 * LENGTH_M


def _angle(one: Floats, other: Floats) -> float:
    return float(np.arccos(np.clip(one @ other, -1.0, 1.0)))


def _rank(each: Interpretation) -> int:
    return independent([pairing.facet.normal for pairing in each], SPANS)


def _sights(
    name: str,
    model: Model,
    interpretations: Sequence[Interpretation],
    image: DepthImage,
    known: Truths,
) -> list[Sight]:
    """The poses of a part that interpretations give and the image confirms."""
    settled = [each for each in interpretations if _rank(each) >= LEAST_RANK]
    view = View(image, known)
    settled.sort(key=lambda each: -sum(pairing.seen.pixels for pairing in each))
    found: list[Sight] = []
    for each in settled[:TRIED]:
        T = posed(each)
        if T is None or any(same(model, T, other.T_eye_part) for other in found):
            continue
        if all(_within(T, pairing, model) for pairing in each):
            T, _ = refined(model, view, T)
            sight = _checked(name, model, T, len(each), image, known)
            found += [sight] if sight is not None else []
    return found


def posed(pairings: Interpretation) -> Floats | None:
    """The pose (4, 4) that brings facets onto the faces: a rotation by their normals (Wahba's problem), then a shift.

    None if the faces' normals are those of the mirrored part.
    """
    weights = np.array([float(each.seen.pixels) for each in pairings])
    seen = np.array([each.seen.normal for each in pairings])
    own = np.array([each.facet.normal for each in pairings])
    U, _, Vt = np.linalg.svd((seen * weights[:, None]).T @ own)
    R = U @ np.diag([1.0, 1.0, float(np.linalg.det(U @ Vt))]) @ Vt
    if (np.arccos(np.clip((seen * (own @ R.T)).sum(axis=1), -1.0, 1.0)) > ANGLE_RAD).any():
        return None
    offsets = np.array([each.seen.offset_m - each.facet.offset_m for each in pairings])
    rows, wanted = seen * np.sqrt(weights)[:, None], offsets * np.sqrt(weights)
    if independent(list(own), SPANS) < 3:
        along = np.linalg.svd(seen)[2][2]
        largest = max(pairings, key=lambda each: each.seen.pixels)
        rows = np.concatenate([rows, along[None]])
        wanted = np.append(
            wanted, _middle(largest.seen.points @ along) - _middle(largest.facet.points @ R.T @ along)
        )
    shift, *_ = np.linalg.lstsq(rows, wanted, rcond=None)
    return transform(R, np.asarray(shift, float))


def _middle(along: Floats) -> float:
    return float(along.min() + along.max()) / 2.0


def _within(T: Floats, pairing: Pairing, model: Model) -> bool:
    """Whether the points of a face lie inside its facet, with the part at a pose."""
    facet = model.solid.facets[pairing.facet.number]
    axes = axes_of(facet.normal)[:, :2]
    own = (pairing.seen.points - T[:3, 3]) @ T[:3, :3]
    return bool(inside(own @ axes, facet.edges @ axes).mean() >= SHOWN)


def _checked(
    name: str, model: Model, T: Floats, faces: int, image: DepthImage, known: Truths
) -> Sight | None:
    """What the whole image says of a pose: None if it looks through the part, or hardly shows it."""
    expected = rendered([(model.solid, T)], image.camera)[0].depth
    there = (expected > 0) & (image.depth > 0)
    if not there.any():
        return None
    deeper = image.depth - expected
    limit = NEAR * image.noise_m
    shows = there & (np.abs(deeper) < limit + _slack(expected)) & ~known
    through = there & (deeper > limit + LENGTH_M)
    if through.sum() > THROUGH * there.sum() or shows.sum() < EXPLAINED * there.sum():
        return None
    return Sight(name, T, int(shows.sum()), float(shows.sum() / there.sum()), faces)


def _slack(expected: Floats) -> Floats:
    """How much a depth may differ (h, w) because a face leans: what the next pixel differs by."""
    down, right = np.gradient(expected)
    found: Floats = np.minimum(np.hypot(down, right), LENGTH_M)
    return found
