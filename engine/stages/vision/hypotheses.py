"""Where a part may be: plane regions matched with facets, and edges of the region with edges of the facet.

This is the interpretation tree of Grimson & Lozano-Perez (1985) on edges, two levels deep. A pair of edges is matched with a
pair of the model's where the angle between them agrees, and where each seen edge lies within the model's edge. Two edges that
are not parallel settle the pose; one edge does where it is seen whole. All pairs are looked at together.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.rigid import transform
from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.solid import Facet, Solid
from cellwright.engine.model.vision import DepthImage
from cellwright.engine.stages.vision.kernels.samples import Samples, seen
from cellwright.engine.stages.vision.lines import Lines
from cellwright.engine.stages.vision.outlines import Region, axes_of
from cellwright.engine.stages.vision.symmetry import likenesses, symmetries

ANGLE = np.radians(6)
LENGTH_M = 0.004
INSIDE = 0.85
THROUGH = 0.2
STEP = 4.0  # of the noise
LITTLE = 0.5  # points
FACING = 0.35  # cosine: of a flatter surface, the next pixel already lies much deeper


@dataclass(frozen=True, eq=False)
class Model:
    """A part as it is looked for: its facets with their edges, its symmetries, and points on it."""

    solid: Solid

    @cached_property
    def symmetries(self) -> tuple[Floats, ...]:
        """The poses in which it looks the same."""
        return symmetries(self.solid)

    @cached_property
    def likenesses(self) -> tuple[Floats, ...]:
        """Poses in which much of it looks the same, but not all of it, the likest first."""
        return likenesses(self.solid, self.symmetries, *self.samples)

    @cached_property
    def facets(self) -> list[int]:
        """The numbers of the facets that no symmetry maps to an earlier one."""
        kept: list[int] = []
        for n, facet in enumerate(self.solid.facets):
            if not any(self._alike(facet, self.solid.facets[k]) for k in kept):
                kept.append(n)
        return kept

    def _alike(self, facet: Facet, other: Facet) -> bool:
        """Whether a symmetry maps a facet to another one."""
        middle, to = facet.edges.reshape(-1, 3).mean(axis=0), other.edges.reshape(-1, 3).mean(axis=0)
        return any(
            np.abs(T[:3, :3] @ middle + T[:3, 3] - to).max() < 1e-6
            and T[:3, :3] @ facet.normal @ other.normal > 1 - 1e-6
            for T in self.symmetries
        )

    @cached_property
    def axes(self) -> list[Floats]:
        """For each facet, two axes on it and its normal, as columns (3, 3)."""
        return [axes_of(facet.normal) for facet in self.solid.facets]

    @cached_property
    def edges(self) -> list[Floats]:
        """For each facet, its edges (e, 2, 2) on its plane."""
        return [facet.edges @ axes[:, :2] for facet, axes in zip(self.solid.facets, self.axes, strict=True)]

    @cached_property
    def lines(self) -> list[Lines]:
        """For each facet, its edges as lines."""
        return [_lines_of(edges) for edges in self.edges]

    @cached_property
    def ends(self) -> Floats:
        """The edges of all facets (e, 2, 3), each as two ends, every one once."""
        every = np.concatenate([facet.edges for facet in self.solid.facets])
        key = np.round(np.sort(every.reshape(len(every), 2, 3), axis=1), 9).reshape(len(every), 6)
        found: Floats = every[np.sort(np.unique(key, axis=0, return_index=True)[1])]
        return found

    @cached_property
    def samples(self) -> tuple[Floats, Floats]:
        """Points (s, 3) spread over the surface, and their normals."""
        random = np.random.default_rng(0)
        a, b, c = np.moveaxis(self.solid.corners, 1, 0)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        chosen = random.choice(len(area), 200, p=area / area.sum())
        u, v = random.random((2, 200, 1))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        normals = np.array([self.solid.facets[n].normal for n in self.solid.facet_of[chosen]])
        return a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen], normals


def _lines_of(edges: Floats) -> Lines:
    along = edges[:, 1] - edges[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    ends = np.einsum("eki,ei->ek", edges, along)
    return Lines(normal, (edges[:, 0] * normal).sum(axis=1), ends)


def hypotheses(model: Model, regions: list[Region], image: DepthImage, most: int) -> Floats:
    """The likeliest poses T_camera_part (h, 4, 4), at most `most`, the likeliest first.

    Each match of a region with a facet has its turn: what speaks for a pose counts the less, the more others of the same match come before it. A part of
    which little is seen would else stand behind all the ways in which a larger thing could be a part like it.
    """
    poses, worth = [np.zeros((0, 4, 4))], [np.zeros(0)]
    for region in regions:
        for n in model.facets:
            turn, shift = _matches(region.lines, model.lines[n])
            turn, shift = _covering(turn, shift, region, model.edges[n])
            if len(turn):
                found = _poses(turn, shift, region, model, n)
                poses.append(found)
                worth.append(_in_turn(_worth(found, model, image)))
    every, value = np.concatenate(poses), np.concatenate(worth)
    order = np.argsort(-value, kind="stable")[:most]
    chosen: Floats = every[order[value[order] > 0]]
    return chosen


def _in_turn(worth: Floats) -> Floats:
    """What speaks for poses of one match (h,), divided by their rank among them. One for which nothing speaks or against counts a little."""
    rank = np.empty(len(worth))
    rank[np.argsort(-worth, kind="stable")] = np.arange(1, len(worth) + 1)
    return (worth + LITTLE) / rank


def _matches(seen: Lines, edges: Lines) -> tuple[Floats, Floats]:
    """Turns (h,) and shifts (h, 2) on the plane that bring edges of a facet onto seen ones."""
    if not len(seen.offset):
        return np.zeros(0), np.zeros((0, 2))
    angle = _angle(seen.normal)[:, None] - _angle(edges.normal)[None]
    i, k = (each.reshape(-1) for each in np.indices(angle.shape))
    turn = angle.reshape(-1)
    first, second = np.triu_indices(len(turn), 1)
    square = np.abs(_cross(seen.normal[i[first]], seen.normal[i[second]])) > np.sin(np.radians(20))
    same = np.abs(np.mod(turn[first] - turn[second] + np.pi, 2 * np.pi) - np.pi) < ANGLE
    keep = square & same
    first, second = first[keep], second[keep]
    turns = turn[first] + (np.mod(turn[second] - turn[first] + np.pi, 2 * np.pi) - np.pi) / 2
    shifts = _meeting(
        seen.normal[i[first]],
        seen.normal[i[second]],
        seen.offset[i[first]] - edges.offset[k[first]],
        seen.offset[i[second]] - edges.offset[k[second]],
    )
    within = _within(seen, i[first], edges, k[first], shifts) & _within(
        seen, i[second], edges, k[second], shifts
    )
    more_turns, more_shifts = _one_edge(seen, edges, i, k, turn)
    return np.concatenate([turns[within], more_turns]), np.concatenate([shifts[within], more_shifts])


def _angle(normal: Floats) -> Floats:
    return np.arctan2(normal[:, 1], normal[:, 0])


def _cross(one: Floats, other: Floats) -> Floats:
    found: Floats = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return found


def _meeting(n: Floats, m: Floats, a: Floats, b: Floats) -> Floats:
    """The shifts (h, 2) t with n . t = a and m . t = b."""
    return np.stack([a * m[:, 1] - b * n[:, 1], n[:, 0] * b - m[:, 0] * a], axis=1) / _cross(n, m)[:, None]


def _within(seen: Lines, i: Longs, edges: Lines, k: Longs, shift: Floats) -> Truths:
    """Whether seen edges i lie within the facet's edges k, after a shift."""
    ends = seen.ends[i] - (seen.along[i] * shift).sum(axis=1)[:, None]
    slack = LENGTH_M
    found: Truths = (ends[:, 0] > edges.ends[k, 0] - slack) & (ends[:, 1] < edges.ends[k, 1] + slack)
    return found


def _one_edge(seen: Lines, edges: Lines, i: Longs, k: Longs, turn: Floats) -> tuple[Floats, Floats]:
    """Turns and shifts from one edge each: its middle where it is seen whole, else one of its ends on that of the model."""
    lacking = (edges.ends[k, 1] - edges.ends[k, 0]) - (seen.ends[i, 1] - seen.ends[i, 0])
    turns, shifts = [np.zeros(0)], [np.zeros((0, 2))]
    for share, keep in (
        (0.5, np.abs(lacking) < LENGTH_M),
        (0.0, lacking >= LENGTH_M),
        (1.0, lacking >= LENGTH_M),
    ):
        n, m = i[keep], k[keep]
        weights = np.array([1.0 - share, share])
        along, across = (seen.ends[n] - edges.ends[m]) @ weights, seen.offset[n] - edges.offset[m]
        turns.append(turn[keep])
        shifts.append(across[:, None] * seen.normal[n] + along[:, None] * seen.along[n])
    return np.concatenate(turns), np.concatenate(shifts)


def _covering(turn: Floats, shift: Floats, region: Region, edges: Floats) -> tuple[Floats, Floats]:
    """The turns and shifts after which the facet covers what is seen of the region."""
    if not len(turn):
        return turn, shift
    c, s = np.cos(turn), np.sin(turn)
    back = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)
    points = np.einsum("hij,hsj->hsi", back, region.inside[None] - shift[:, None])
    keep = inside(points, edges).mean(axis=1) >= INSIDE
    return turn[keep], shift[keep]


def inside(points: Floats, edges: Floats) -> Truths:
    """Whether points (..., 2) lie inside the loops of edges (e, 2, 2): a ray to the right crosses an odd number of them."""
    (x0, y0), (x1, y1) = np.moveaxis(edges[:, 0], 1, 0), np.moveaxis(edges[:, 1], 1, 0)
    x, y = points[..., :1], points[..., 1:]
    crosses = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    found: Truths = (crosses & (x < x0 + (y - y0) * (x1 - x0) / rise)).sum(axis=-1) % 2 == 1
    return found


def _poses(turn: Floats, shift: Floats, region: Region, model: Model, n: int) -> Floats:
    c, s = np.cos(turn), np.sin(turn)
    flat = np.zeros((len(turn), 3, 3))
    flat[:, 0, 0], flat[:, 0, 1], flat[:, 1, 0], flat[:, 1, 1], flat[:, 2, 2] = c, -s, s, c, 1.0
    R = region.axes @ flat @ model.axes[n].T
    height = np.full(len(turn), region.offset - model.solid.facets[n].offset)
    return transform(R, np.column_stack([shift, height]) @ region.axes.T)


def _worth(poses: Floats, model: Model, image: DepthImage) -> Floats:
    """How many points of the surface are seen where they should be, less twice those that are seen through (h,).

    Negative where more than a fifth of the points before nothing is seen through.
    """
    camera, (points, normals) = image.camera, model.samples
    samples = Samples(image.depth, np.array([camera.focal_px, *camera.centre_px]), points, normals, FACING)
    agree, through = seen(samples, np.ascontiguousarray(poses), STEP * image.noise_m)
    refused = through > THROUGH * np.maximum(agree + through, 1)
    found: Floats = np.where(refused, -1.0, agree - 2.0 * through)
    return found
