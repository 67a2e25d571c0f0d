"""Where a part may be in a depth image: plane regions matched with facets, and symmetries."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.rigid import apply, inverse, transform
from cellwright.engine.model.geometry import Facet, Solid
from cellwright.engine.model.vision import DepthImage
from cellwright.engine.stages.vision.kernels.samples import Samples, seen
from cellwright.engine.stages.vision.plane_regions import PlaneRegion, StraightEdges, axes_of

SAME_SHARE = 1e-4  # of the size
LIKE_M, LIKE, MOST = (
    0.003,
    0.6,
    6,
)  # how near points must be to a facet, which share of them must be, and how many poses are given
DIFFERENT_POSES = 0.02  # entries of poses that differ by less are of one pose


def solid_symmetries(solid: Solid) -> tuple[Floats, ...]:
    """All poses (4, 4) of a solid in its own frame in which it looks the same, the identity first.

    Each maps one edge of the first facet to an edge of some facet. Those that map all vertices to
    vertices are right.
    """
    points = np.unique(np.round(solid.vertices, 9), axis=0)
    size = float(np.ptp(points, axis=0).max())
    anchor = solid.facets[0]
    back = inverse(_edge_frame(anchor, 0))
    length = _edge_length(anchor, 0)
    symmetries_entry: list[Floats] = [np.eye(4)]
    for facet in solid.facets:
        if len(facet.edges) != len(anchor.edges):
            continue
        for n in range(len(facet.edges)):
            T = _edge_frame(facet, n) @ back
            if abs(_edge_length(facet, n) - length) > SAME_SHARE * size or not _onto_itself(
                points, T, SAME_SHARE * size
            ):
                continue
            if all(np.abs(T - earlier).max() > 10 * SAME_SHARE for earlier in symmetries_entry):
                symmetries_entry.append(T)
    return tuple(symmetries_entry)


def partial_symmetries(
    solid: Solid, known: tuple[Floats, ...], points: Floats, normals: Floats
) -> tuple[Floats, ...]:
    """Poses (4, 4) in which most of some points (n, 3) on a solid, with their normals, lie on its
    facets' planes, except for those that are known. The likest come first.

    What tells such a pose from the true one may be hidden. Each maps an edge of the largest facet
    onto the line of another edge, beginning at one of its ends.
    """
    anchor = max(
        solid.facets,
        key=lambda facet_entry: float(np.linalg.norm(np.ptp(facet_entry.edges, axis=(0, 1)))),
    )
    back = inverse(_edge_frame(anchor, 0))
    planes = np.array([facet.normal for facet in solid.facets])
    offsets = np.array([facet.offset for facet in solid.facets])
    candidates: list[tuple[float, Floats]] = []
    for facet in solid.facets:
        for n in range(len(facet.edges)):
            T = _edge_frame(facet, n) @ back
            near = (np.abs(apply(T, points) @ planes.T - offsets) < LIKE_M) & (
                normals @ T[:3, :3].T @ planes.T > 1 - 1e-3
            )
            share = float(near.any(axis=1).mean())
            earlier_poses = [*known, *(pose for _, pose in candidates)]
            if share > LIKE and all(
                np.abs(T - earlier).max() > DIFFERENT_POSES for earlier in earlier_poses
            ):
                candidates.append((share, T))
    return tuple(T for _, T in sorted(candidates, key=lambda pair: -pair[0])[:MOST])


def _edge_frame(facet: Facet, n: int) -> Floats:
    """The frame (4, 4) at the start of an edge: along it, to the inside, outwards."""
    along = facet.edges[n, 1] - facet.edges[n, 0]
    along = along / np.linalg.norm(along)
    R = np.stack([along, np.cross(facet.normal, along), facet.normal], axis=1)
    return transform(R, facet.edges[n, 0])


def _edge_length(facet: Facet, n: int) -> float:
    return float(np.linalg.norm(facet.edges[n, 1] - facet.edges[n, 0]))


def _onto_itself(points: Floats, T: Floats, within: float) -> bool:
    moved = apply(T, points)
    apart = np.linalg.norm(moved[:, None] - points[None], axis=2)
    return bool((apart.min(axis=1) < within).all())


MAX_TILT_RAD = np.radians(6)
LENGTH_M = 0.004
INSIDE_SHARE = 0.85
SEEN_THROUGH_SHARE = 0.2
DEPTH_STEP_SIGMAS = 4.0  # of the noise
FEW_POINTS = 0.5  # points
MIN_FACING_COSINE = 0.35  # cosine: of a flatter surface, the next pixel already lies much deeper


@dataclass(frozen=True, eq=False)
class PartModel:
    """A part as it is looked for: its facets with their edges, its symmetries, and points on it."""

    solid: Solid

    @cached_property
    def symmetries(self) -> tuple[Floats, ...]:
        """The poses in which it looks the same."""
        return solid_symmetries(self.solid)

    @cached_property
    def likenesses(self) -> tuple[Floats, ...]:
        """Poses in which much of it looks the same, but not all of it, the likest first."""
        return partial_symmetries(self.solid, self.symmetries, *self.samples)

    @cached_property
    def facets(self) -> list[int]:
        """The numbers of the facets that no symmetry maps to an earlier one."""
        distinct_facets: list[int] = []
        for n, facet in enumerate(self.solid.facets):
            if not any(self._alike(facet, self.solid.facets[k]) for k in distinct_facets):
                distinct_facets.append(n)
        return distinct_facets

    def _alike(self, facet: Facet, second: Facet) -> bool:
        """Whether a symmetry maps a facet to another one."""
        middle, to = (
            facet.edges.reshape(-1, 3).mean(axis=0),
            second.edges.reshape(-1, 3).mean(axis=0),
        )
        return any(
            np.abs(T[:3, :3] @ middle + T[:3, 3] - to).max() < 1e-6
            and T[:3, :3] @ facet.normal @ second.normal > 1 - 1e-6
            for T in self.symmetries
        )

    @cached_property
    def axes(self) -> list[Floats]:
        """For each facet, two axes on it and its normal, as columns (3, 3)."""
        return [axes_of(facet.normal) for facet in self.solid.facets]

    @cached_property
    def edges(self) -> list[Floats]:
        """For each facet, its edges (e, 2, 2) on its plane."""
        return [
            facet.edges @ axes[:, :2]
            for facet, axes in zip(self.solid.facets, self.axes, strict=True)
        ]

    @cached_property
    def lines(self) -> list[StraightEdges]:
        """For each facet, its edges as lines."""
        return [_lines_of(edges) for edges in self.edges]

    @cached_property
    def ends(self) -> Floats:
        """The edges of all facets (e, 2, 3), each as two ends, every one once."""
        every = np.concatenate([facet.edges for facet in self.solid.facets])
        key = np.round(np.sort(every.reshape(len(every), 2, 3), axis=1), 9).reshape(len(every), 6)
        distinct_ends: Floats = every[np.sort(np.unique(key, axis=0, return_index=True)[1])]
        return distinct_ends

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


def _lines_of(edges: Floats) -> StraightEdges:
    along = edges[:, 1] - edges[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    ends = np.einsum("eki,ei->ek", edges, along)
    return StraightEdges(normal, (edges[:, 0] * normal).sum(axis=1), ends)


def pose_hypotheses(
    model: PartModel, regions: list[PlaneRegion], image: DepthImage, most: int
) -> Floats:
    """The likeliest poses T_camera_part (h, 4, 4), at most `most`, the likeliest first.

    Each match of a region with a facet has its turn: what speaks for a pose counts the less, the
    more others of the same match come before it. A part of which little is seen would else stand
    behind all the ways in which a larger thing could be a part like it.
    """
    poses, worth = [np.zeros((0, 4, 4))], [np.zeros(0)]
    for region in regions:
        for n in model.facets:
            turn, shift = _edge_matches(region.lines, model.lines[n])
            turn, shift = _covering_facets(turn, shift, region, model.edges[n])
            if len(turn):
                candidates = _region_poses(turn, shift, region, model, n)
                poses.append(candidates)
                worth.append(_worth_by_rank(_hypothesis_worth(candidates, model, image)))
    every, value = np.concatenate(poses), np.concatenate(worth)
    order = np.argsort(-value, kind="stable")[:most]
    chosen: Floats = every[order[value[order] > 0]]
    return chosen


def _worth_by_rank(worth: Floats) -> Floats:
    """What speaks for poses of one match (h,), divided by their rank among them.

    One for which nothing speaks or against counts a little.
    """
    rank = np.empty(len(worth))
    rank[np.argsort(-worth, kind="stable")] = np.arange(1, len(worth) + 1)
    return (worth + FEW_POINTS) / rank


def _edge_matches(seen: StraightEdges, edges: StraightEdges) -> tuple[Floats, Floats]:
    """Turns (h,) and shifts (h, 2) on the plane that bring edges of a facet onto seen ones."""
    if not len(seen.offset):
        return np.zeros(0), np.zeros((0, 2))
    angle = _normal_angle(seen.normal)[:, None] - _normal_angle(edges.normal)[None]
    i, k = (indices.reshape(-1) for indices in np.indices(angle.shape))
    turn = angle.reshape(-1)
    first, second = np.triu_indices(len(turn), 1)
    square = np.abs(_cross_2d(seen.normal[i[first]], seen.normal[i[second]])) > np.sin(
        np.radians(20)
    )
    same = np.abs(np.mod(turn[first] - turn[second] + np.pi, 2 * np.pi) - np.pi) < MAX_TILT_RAD
    keep = square & same
    first, second = first[keep], second[keep]
    turns = turn[first] + (np.mod(turn[second] - turn[first] + np.pi, 2 * np.pi) - np.pi) / 2
    shifts = _line_intersection(
        seen.normal[i[first]],
        seen.normal[i[second]],
        seen.offset[i[first]] - edges.offset[k[first]],
        seen.offset[i[second]] - edges.offset[k[second]],
    )
    within = _within_edges(seen, i[first], edges, k[first], shifts) & _within_edges(
        seen, i[second], edges, k[second], shifts
    )
    more_turns, more_shifts = _one_edge(seen, edges, i, k, turn)
    return np.concatenate([turns[within], more_turns]), np.concatenate(
        [shifts[within], more_shifts]
    )


def _normal_angle(normal: Floats) -> Floats:
    return np.arctan2(normal[:, 1], normal[:, 0])


def _cross_2d(first: Floats, second: Floats) -> Floats:
    crosses: Floats = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    return crosses


def _line_intersection(n: Floats, m: Floats, a: Floats, b: Floats) -> Floats:
    """The shifts (h, 2) t with n . t = a and m . t = b."""
    return (
        np.stack([a * m[:, 1] - b * n[:, 1], n[:, 0] * b - m[:, 0] * a], axis=1)
        / _cross_2d(n, m)[:, None]
    )


def _within_edges(
    seen: StraightEdges, i: Longs, edges: StraightEdges, k: Longs, shift: Floats
) -> Truths:
    """Whether seen edges i lie within the facet's edges k, after a shift."""
    ends = seen.ends[i] - (seen.along[i] * shift).sum(axis=1)[:, None]
    slack = LENGTH_M
    is_within: Truths = (ends[:, 0] > edges.ends[k, 0] - slack) & (
        ends[:, 1] < edges.ends[k, 1] + slack
    )
    return is_within


def _one_edge(
    seen: StraightEdges, edges: StraightEdges, i: Longs, k: Longs, turn: Floats
) -> tuple[Floats, Floats]:
    """Turns and shifts from one edge each: its middle where it is seen whole, else one of its
    ends on that of the model.
    """
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


def _covering_facets(
    turn: Floats, shift: Floats, region: PlaneRegion, edges: Floats
) -> tuple[Floats, Floats]:
    """The turns and shifts after which the facet covers what is seen of the region."""
    if not len(turn):
        return turn, shift
    c, s = np.cos(turn), np.sin(turn)
    back = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)
    points = np.einsum("hij,hsj->hsi", back, region.inside[None] - shift[:, None])
    keep = inside_edges(points, edges).mean(axis=1) >= INSIDE_SHARE
    return turn[keep], shift[keep]


def inside_edges(points: Floats, edges: Floats) -> Truths:
    """Whether points (..., 2) lie inside the loops of edges (e, 2, 2): a ray to the right
    crosses an odd number of them.
    """
    (x0, y0), (x1, y1) = np.moveaxis(edges[:, 0], 1, 0), np.moveaxis(edges[:, 1], 1, 0)
    x, y = points[..., :1], points[..., 1:]
    crosses = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    is_inside: Truths = (crosses & (x < x0 + (y - y0) * (x1 - x0) / rise)).sum(axis=-1) % 2 == 1
    return is_inside


def _region_poses(
    turn: Floats, shift: Floats, region: PlaneRegion, model: PartModel, n: int
) -> Floats:
    c, s = np.cos(turn), np.sin(turn)
    flat = np.zeros((len(turn), 3, 3))
    flat[:, 0, 0], flat[:, 0, 1], flat[:, 1, 0], flat[:, 1, 1], flat[:, 2, 2] = c, -s, s, c, 1.0
    R = region.axes @ flat @ model.axes[n].T
    height = np.full(len(turn), region.offset - model.solid.facets[n].offset)
    return transform(R, np.column_stack([shift, height]) @ region.axes.T)


def _hypothesis_worth(poses: Floats, model: PartModel, image: DepthImage) -> Floats:
    """How many points of the surface are seen where they should be, less twice those that are seen
    through (h,).

    Negative where more than a fifth of the points before nothing is seen through.
    """
    camera, (points, normals) = image.camera, model.samples
    samples = Samples(
        image.depth,
        np.array([camera.focal_px, *camera.centre_px]),
        points,
        normals,
        MIN_FACING_COSINE,
    )
    agree, through = seen(samples, np.ascontiguousarray(poses), DEPTH_STEP_SIGMAS * image.noise_m)
    refused = through > SEEN_THROUGH_SHARE * np.maximum(agree + through, 1)
    worths: Floats = np.where(refused, -1.0, agree - 2.0 * through)
    return worths
