"""Grasps of a part by parallel jaws: two for each locally convex edge, as Handey takes them (Mazer and others, 4.6.1)."""

from collections.abc import Sequence

import numpy as np

from cellwright.engine.kernels.rigid import rotation, transform
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.grasping import Grasp, ParallelJaws
from cellwright.engine.model.solid import Facet, Solid
from cellwright.engine.stages.grasping.blocks import meet

TURNS = 72
PARALLEL = 1e-6
HELD = 0.6  # of a pad must lie on each of the two facets
GRAVITY = 9.81
THINNEST_M = 0.002


def grasps(
    solid: Solid, jaws: ParallelJaws, inset_m: float, mass_kg: float, centre: Floats, turns: int = TURNS
) -> list[Grasp]:
    """All grasps that touch the part on its two facets alone, at some turn; those first that hold the weight best.

    A grasp point lies `inset_m` inside a convex edge, at its middle. `centre` (3,) is the centre of mass.
    """
    found: list[Grasp] = []
    seen: list[tuple[Floats, Floats]] = []
    for facet in solid.facets:
        for point in _points(facet, inset_m):
            for other in solid.facets:
                width = facet.offset + other.offset
                if facet.normal @ other.normal > PARALLEL - 1 or not THINNEST_M < width <= jaws.opening_m:
                    continue
                middle = point - facet.normal * width / 2
                if _known(seen, middle, facet.normal) or not _held(facet, other, point, width, jaws.pad_m):
                    continue
                if not _visible(solid, facet, other, point, width):
                    continue
                seen.append((middle, facet.normal))
                found.append(_grasp(solid, jaws, (facet, other), middle, width, mass_kg, centre, turns))
    held = [each for each in found if each.free.any() and each.torque_margin >= 1.0]
    return sorted(held, key=lambda each: -each.torque_margin)


def _points(facet: Facet, inset_m: float) -> list[Floats]:
    """The points inside the convex edges of a facet."""
    found = []
    for (a, b), convex in zip(facet.edges, facet.convex, strict=True):
        if convex:
            inwards = np.cross(facet.normal, b - a)
            found.append((a + b) / 2 + inset_m * inwards / np.linalg.norm(inwards))
    return found


def _known(seen: Sequence[tuple[Floats, Floats]], middle: Floats, normal: Floats) -> bool:
    """Whether the same two points were taken from the other facet already."""
    return any(np.abs(m - middle).max() < 1e-9 and abs(n @ normal) > 1 - PARALLEL for m, n in seen)


def _held(facet: Facet, other: Facet, point: Floats, width: float, pad_m: float) -> bool:
    """Whether enough of a round pad lies on both facets."""
    across = np.cross(facet.normal, np.eye(3)[int(np.argmin(np.abs(facet.normal)))])
    across /= np.linalg.norm(across)
    along = np.cross(facet.normal, across)
    angle, radius = np.arange(12) * np.pi / 6, np.array([0.0, 0.45, 0.9])[:, None] * pad_m / 2
    x, y = (radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()
    pad = point + np.outer(x, across) + np.outer(y, along)
    on = within(facet, pad) & within(other, pad - facet.normal * width)
    return bool(
        within(facet, point[None])[0]
        and within(other, (point - facet.normal * width)[None])[0]
        and on.mean() >= HELD
    )


def within(facet: Facet, points: Floats) -> Truths:
    """Whether points (n, 3) of a facet's plane lie inside its edges (n,)."""
    across = np.cross(facet.normal, np.eye(3)[int(np.argmin(np.abs(facet.normal)))])
    axes = np.stack(
        [across / np.linalg.norm(across), np.cross(facet.normal, across / np.linalg.norm(across))], axis=1
    )
    (x0, y0), (x1, y1) = np.moveaxis(facet.edges @ axes, 0, 2)
    x, y = (points @ axes).T[:, :, None]
    crosses = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    found: Truths = (crosses & (x < x0 + (y - y0) * (x1 - x0) / rise)).sum(axis=1) % 2 == 1
    return found


def _visible(solid: Solid, facet: Facet, other: Facet, point: Floats, width: float) -> bool:
    """Whether nothing but material lies between the two points: no facet crosses the line between them."""
    for each in solid.facets:
        slope = float(each.normal @ facet.normal)
        if each is facet or each is other or abs(slope) < PARALLEL:
            continue
        down = (float(each.normal @ point) - each.offset) / slope
        if 1e-9 < down < width - 1e-9 and within(each, (point - down * facet.normal)[None])[0]:
            return False
    return True


def _grasp(
    solid: Solid,
    jaws: ParallelJaws,
    facets: tuple[Facet, Facet],
    middle: Floats,
    width: float,
    mass_kg: float,
    centre: Floats,
    turns: int,
) -> Grasp:
    closing = facets[0].normal
    start = np.cross(closing, np.eye(3)[int(np.argmin(np.abs(closing)))])
    start /= np.linalg.norm(start)
    R = np.stack([closing, np.cross(start, closing), start], axis=1)
    poses = transform(rotation(closing, np.arange(turns) * 2 * np.pi / turns) @ R, middle)
    free = ~meet(poses, *jaws.blocks((width,)), solid.corners)
    arm = float(np.linalg.norm(np.cross(centre - middle, closing)))
    # Two round pads: each resists a torque of 2/3 of friction, force and radius, beside holding the weight.
    holds = 2 * jaws.friction * jaws.force_n
    share = min(1.0, mass_kg * GRAVITY / holds)
    torque = holds * jaws.pad_m / 3 * float(np.sqrt(1 - share**2))
    margin = torque / max(mass_kg * GRAVITY * arm, 1e-9) if share < 1 else 0.0
    return Grasp((facets[0].name, facets[1].name), width, poses, free, min(margin, 100.0))
