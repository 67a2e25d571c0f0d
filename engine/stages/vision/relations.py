"""Poses of a part from the relations between the plane faces that are seen.

Each face that is seen is one facet of the part, or belongs to something else. This is a constraint search (Grimson & Lozano-Perez,
"Model-based recognition and localization from sparse range or tactile data", 1984; faces as in Magee & Nathan 1985): a face is
no larger than its facet; two faces have the angle between their facets, and as parallel ones the distance; no two points of them
are farther apart than the facets' are. Three facets that are not parallel settle the pose. Two leave a shift along both, which the ends
of the larger face settle; one tells too little.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from cellwright.engine.kernels.rigid import transform
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.vision.faces import Face, faces_of, farthest, independent
from cellwright.engine.stages.vision.hypotheses import Model, inside
from cellwright.engine.stages.vision.outlines import axes_of

LEAST_RANK = 2  # directions that faces must span
ANGLE_RAD, LENGTH_M, AREA = np.radians(4.0), 0.004, 1.15  # what relations may differ by
SPANS = 0.25  # singular value of normals: less is no direction of its own
LEFT_OUT = 2  # faces that would fit and may belong to something else all the same
MOST = 400  # interpretations that begin with one face
SHOWN = 0.85  # of what a face shows must lie in its facet


@dataclass(frozen=True, slots=True)
class Pairing:
    """A face that is seen and the facet that it is taken for."""

    seen: Face
    facet: Face


Interpretation = tuple[Pairing, ...]


def related_poses(model: Model, seen: Sequence[Face]) -> list[Floats]:
    """Poses T_eye_part (4, 4) that two or more of the faces give, those first that explain most pixels."""
    facets = faces_of(model.solid)
    found = []
    for n in range(len(seen)):
        for each in islice(interpretations_of(seen[n:], facets), MOST):
            T = posed(each) if _rank(each) >= LEAST_RANK else None
            if T is not None and all(_within(T, pairing, model) for pairing in each):
                found.append((sum(pairing.seen.pixels for pairing in each), T))
    return [T for _, T in sorted(found, key=lambda pair: -pair[0])]


def interpretations_of(seen: Sequence[Face], facets: Sequence[Face]) -> Iterator[Interpretation]:
    """All ways to take the first face, and some of the others, for facets so that all relations hold."""

    def extended(n: int, so_far: Interpretation, left_out: int) -> Iterator[Interpretation]:
        if n == len(seen):
            yield so_far
            return
        taken, fits = {id(each.facet) for each in so_far}, False
        for facet in facets:
            pairing = Pairing(seen[n], facet)
            if id(facet) not in taken and _holds(pairing, so_far):
                fits = True
                yield from extended(n + 1, (*so_far, pairing), left_out)
        if so_far and left_out + fits <= LEFT_OUT:
            yield from extended(n + 1, so_far, left_out + fits)

    yield from extended(0, (), 0)


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
