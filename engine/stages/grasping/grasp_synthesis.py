"""Grasps of a part by parallel jaws or by three fingers: where they touch and what they hold.

A triangle may be a line or a point: what is seen of an unknown thing is a line of sight that is
blocked.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog, nnls

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.rigid import rotation, transform
from cellwright.engine.model.geometry import Facet, Solid
from cellwright.engine.model.manipulation_values import Grasp, ParallelJaws, ThreeFingers
from cellwright.engine.stages.grasping.kernels.meeting import Blocks, meeting


def blocks_meet(T: Floats, middles: Floats, halves: Floats, triangles: Floats) -> Truths:
    """Whether any triangle (m, 3, 3) meets any of the blocks, for each pose (n, 4, 4) of their
    frame (n,).

    Blocks have middles (b, 3) and half extents (b, 3) along the frame's axes. What only touches
    does not meet.
    """
    blocks = Blocks(np.ascontiguousarray(middles), np.ascontiguousarray(halves))
    return meeting(blocks, np.ascontiguousarray(T), np.ascontiguousarray(triangles))


GRASP_TURNS = 72
PARALLEL_TOLERANCE = 1e-6
MIN_PAD_SHARE = 0.6  # of a pad must lie on each of the two facets
GRAVITY_M_S2 = 9.81
THINNEST_M = 0.002


def jaw_grasps(
    solid: Solid,
    jaws: ParallelJaws,
    inset_m: float,
    mass_kg: float,
    centre: Floats,
    turns: int = GRASP_TURNS,
) -> list[Grasp]:
    """All grasps that touch the part on its two facets alone, at some turn; those first that hold
    the weight best.

    A grasp point lies `inset_m` inside a convex edge, at its middle. `centre` (3,) is the centre of
    mass.
    """
    grasps_found: list[Grasp] = []
    seen: list[tuple[Floats, Floats]] = []
    for facet in solid.facets:
        for point in _edge_points(facet, inset_m):
            for opposite in solid.facets:
                width = facet.offset + opposite.offset
                if (
                    facet.normal @ opposite.normal > PARALLEL_TOLERANCE - 1
                    or not THINNEST_M < width <= jaws.opening_m
                ):
                    continue
                middle = point - facet.normal * width / 2
                if _already_taken(seen, middle, facet.normal) or not _pads_held(
                    facet, opposite, point, width, jaws.pad_m
                ):
                    continue
                if not _see_each_other(solid, facet, opposite, point, width):
                    continue
                seen.append((middle, facet.normal))
                grasps_found.append(
                    _grasp_at(solid, jaws, (facet, opposite), middle, width, mass_kg, centre, turns)
                )
    holding = [grasp for grasp in grasps_found if grasp.free.any() and grasp.torque_margin >= 1.0]
    return sorted(holding, key=lambda grasp: -grasp.torque_margin)


def _edge_points(facet: Facet, inset_m: float) -> list[Floats]:
    """The points inside the convex edges of a facet."""
    edge_points = []
    for (a, b), convex in zip(facet.edges, facet.convex, strict=True):
        if convex:
            inwards = np.cross(facet.normal, b - a)
            edge_points.append((a + b) / 2 + inset_m * inwards / np.linalg.norm(inwards))
    return edge_points


def _already_taken(seen: Sequence[tuple[Floats, Floats]], middle: Floats, normal: Floats) -> bool:
    """Whether the same two points were taken from the other facet already."""
    return any(
        np.abs(m - middle).max() < 1e-9 and abs(n @ normal) > 1 - PARALLEL_TOLERANCE
        for m, n in seen
    )


def _pads_held(facet: Facet, opposite: Facet, point: Floats, width: float, pad_m: float) -> bool:
    """Whether enough of a round pad lies on both facets."""
    across = np.cross(facet.normal, np.eye(3)[int(np.argmin(np.abs(facet.normal)))])
    across /= np.linalg.norm(across)
    along = np.cross(facet.normal, across)
    angle, radius = np.arange(12) * np.pi / 6, np.array([0.0, 0.45, 0.9])[:, None] * pad_m / 2
    x, y = (radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()
    pad = point + np.outer(x, across) + np.outer(y, along)
    on = within_facet(facet, pad) & within_facet(opposite, pad - facet.normal * width)
    return bool(
        within_facet(facet, point[None])[0]
        and within_facet(opposite, (point - facet.normal * width)[None])[0]
        and on.mean() >= MIN_PAD_SHARE
    )


def within_facet(facet: Facet, points: Floats) -> Truths:
    """Whether points (n, 3) of a facet's plane lie inside its edges (n,)."""
    across = np.cross(facet.normal, np.eye(3)[int(np.argmin(np.abs(facet.normal)))])
    axes = np.stack(
        [across / np.linalg.norm(across), np.cross(facet.normal, across / np.linalg.norm(across))],
        axis=1,
    )
    (x0, y0), (x1, y1) = np.moveaxis(facet.edges @ axes, 0, 2)
    x, y = (points @ axes).T[:, :, None]
    crosses = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    is_within: Truths = (crosses & (x < x0 + (y - y0) * (x1 - x0) / rise)).sum(axis=1) % 2 == 1
    return is_within


def _see_each_other(
    solid: Solid, facet: Facet, opposite: Facet, point: Floats, width: float
) -> bool:
    """Whether nothing but material lies between the two points: no facet crosses the line
    between them.
    """
    for crossing in solid.facets:
        slope = float(crossing.normal @ facet.normal)
        if crossing is facet or crossing is opposite or abs(slope) < PARALLEL_TOLERANCE:
            continue
        down = (float(crossing.normal @ point) - crossing.offset) / slope
        if (
            1e-9 < down < width - 1e-9
            and within_facet(crossing, (point - down * facet.normal)[None])[0]
        ):
            return False
    return True


def _grasp_at(
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
    free = ~blocks_meet(poses, *jaws.blocks((width,)), solid.corners)
    arm = float(np.linalg.norm(np.cross(centre - middle, closing)))
    # Two round pads: each resists a torque of 2/3 of friction, force and radius, beside holding the
    # weight.
    holds = 2 * jaws.friction * jaws.force_n
    share = min(1.0, mass_kg * GRAVITY_M_S2 / holds)
    torque = holds * jaws.pad_m / 3 * float(np.sqrt(1 - share**2))
    margin = torque / max(mass_kg * GRAVITY_M_S2 * arm, 1e-9) if share < 1 else 0.0
    return Grasp((facets[0].name, facets[1].name), width, poses, free, min(margin, 100.0))


CONE_EDGES = 8  # of the pyramid that stands for a friction cone
CLOSED_TOLERANCE = 1e-6  # forces or torques, of a pressing force, that count as none
SAME_NORMAL_COSINE = 1e-6  # of a cosine: normals that differ less are one
MAX_GRASPS_WEIGHED = 120  # grasps, whose margins are computed
MAX_TOLD_MARGIN = 100.0  # the largest margin that is told


def three_finger_grasps(
    solid: Solid, hand: ThreeFingers, inset_m: float, mass_kg: float, centre: Floats, turns: int
) -> list[Grasp]:
    """Grasps that are closed by force and touch the part with their fingers alone; those first that
    hold its weight best.

    The fingers meet the part `inset_m` below a facet. `centre` (3,) is the centre of mass.
    """
    candidates: list[tuple[Grasp, Floats]] = []
    for normal in _facet_normals(solid):
        height = float((solid.vertices @ normal).max()) - inset_m
        segments, owner = _cut_surface(solid, normal, height)
        for grasp, contacts in _grasps_across(
            solid, hand, (normal, height), (segments, owner), centre, turns
        ):
            if not blocks_meet(grasp.T_part_hand, *hand.blocks(grasp.opening), solid.corners)[0]:
                candidates.append((grasp, contacts))
    candidates.sort(key=lambda pair: float(np.linalg.norm(pair[1][:3].mean(axis=0) - centre)))
    weighed = [
        _weigh_grasp(hand, grasp, contacts, mass_kg, centre)
        for grasp, contacts in candidates[:MAX_GRASPS_WEIGHED]
    ]
    return sorted(
        (grasp for grasp in weighed if grasp.torque_margin >= 1.0),
        key=lambda grasp_entry: -round(grasp_entry.torque_margin, 6),
    )


def _facet_normals(solid: Solid) -> list[Floats]:
    """The different normals of the facets."""
    normals: list[Floats] = []
    for facet in solid.facets:
        if not any(facet.normal @ earlier > 1 - SAME_NORMAL_COSINE for earlier in normals):
            normals.append(facet.normal)
    return normals


def _cut_surface(solid: Solid, normal: Floats, height: float) -> tuple[Floats, Longs]:
    """Where a plane cuts the surface: segments (s, 2, 3), and the facet of each (s,)."""
    above = solid.corners @ normal - height
    cut = (above > 0).any(axis=1) & (above <= 0).any(axis=1)
    segments = []
    for corners, up in zip(solid.corners[cut], above[cut], strict=True):
        ends = [
            corners[a] + (corners[b] - corners[a]) * up[a] / (up[a] - up[b])
            for a, b in ((0, 1), (1, 2), (2, 0))
            if (up[a] > 0) != (up[b] > 0)
        ]
        segments.append(ends[:2])
    return np.array(segments).reshape(-1, 2, 3), np.asarray(solid.facet_of)[cut]


def _grasps_across(
    solid: Solid,
    hand: ThreeFingers,
    plane: tuple[Floats, float],
    section: tuple[Floats, Longs],
    centre: Floats,
    turns: int,
) -> Iterator[tuple[Grasp, Floats]]:
    """Grasps in a section that are closed by force, with their contacts (6, 3): three points,
    and three normals out of the part.
    """
    normal, height = plane
    if not len(section[0]):
        return
    middle = centre + (height - centre @ normal) * normal
    start = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    start /= np.linalg.norm(start)
    side = np.cross(normal, start)
    for angle in np.arange(turns) * 2 * np.pi / turns:
        x = np.cos(angle) * start + np.sin(angle) * side
        T = transform(np.stack([x, np.cross(-normal, x), -normal], axis=1), middle)
        for spread in hand.spreads_rad:
            closed = _closed_grasp(solid, hand, T, section, spread, centre)
            if closed is not None:
                yield closed


def _closed_grasp(
    solid: Solid,
    hand: ThreeFingers,
    T: Floats,
    section: tuple[Floats, Longs],
    spread: float,
    centre: Floats,
) -> tuple[Grasp, Floats] | None:
    """The grasp of a hand at a pose, if its fingers meet the part without sliding, and close it
    by force.
    """
    begins, outwards = hand.ways(spread)
    flat = ((section[0] - T[:3, 3]) @ T[:3, :3])[:, :, :2]
    ways, names, points, normals = [], [], [], []
    for begin, outward in zip(begins, outwards, strict=True):
        distance, number = _outermost_hit(flat, begin, outward)
        if number < 0 or distance < 0.0:
            return None
        facet = solid.facets[int(section[1][number])]
        direction = T[:3, :2] @ outward
        if facet.normal @ direction < 1 / np.sqrt(1 + hand.friction**2):
            return None
        ways.append(distance)
        names.append(facet.name)
        points.append(T[:3, 3] + T[:3, :2] @ (begin + distance * outward))
        normals.append(facet.normal)
    width = ways[0] + max(ways[1:])
    contacts = np.array([*points, *normals])
    if (
        width > hand.opening_m
        or _fingers_collide(contacts, hand.thick_m)
        or not closes_by_force(contacts, centre, hand.friction)
    ):
        return None
    grasp = Grasp(tuple(names), width, T[None], np.ones(1, dtype=bool), 0.0, (*ways, spread))
    return grasp, contacts


def _fingers_collide(contacts: Floats, thick_m: float) -> bool:
    """Whether two of the fingers would be in each other's place."""
    tips = contacts[:3] + contacts[3:] * thick_m / 2
    return any(
        float(np.linalg.norm(tips[a] - tips[b])) < thick_m for a, b in ((0, 1), (0, 2), (1, 2))
    )


def _outermost_hit(flat: Floats, begin: Floats, outward: Floats) -> tuple[float, int]:
    """How far along a ray in the plane the last of some segments (s, 2, 2) is, and its number;
    -1 if it meets none.
    """
    across = np.array([-outward[1], outward[0]])
    offset, along = (flat - begin) @ across, (flat - begin) @ outward
    crossing = (offset[:, 0] > 0) != (offset[:, 1] > 0)
    if not crossing.any():
        return 0.0, -1
    rise = np.where(crossing, offset[:, 1] - offset[:, 0], 1.0)
    at = along[:, 0] - offset[:, 0] * (along[:, 1] - along[:, 0]) / rise
    best = int(np.argmax(np.where(crossing, at, -np.inf)))
    return float(at[best]), best


def contact_wrenches(contacts: Floats, centre: Floats, friction: float) -> Floats:
    """Forces and torques about the centre (6, 3 EDGES) along the edges of the friction cones, each
    with a normal force of 1.

    Torques are in units of a force at the distance of the farthest contact.
    """
    points, normals = contacts[:3] - centre, contacts[3:]
    reach = max(float(np.linalg.norm(points, axis=1).max()), 1e-9)
    angles = np.arange(CONE_EDGES) * 2 * np.pi / CONE_EDGES
    wrenches_entry = []
    for point, normal in zip(points, normals, strict=True):
        tangent = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        tangent /= np.linalg.norm(tangent)
        cotangent = np.cross(normal, tangent)
        forces = -normal + friction * (
            np.outer(np.cos(angles), tangent) + np.outer(np.sin(angles), cotangent)
        )
        wrenches_entry.append(np.concatenate([forces, np.cross(point, forces) / reach], axis=1))
    return np.concatenate(wrenches_entry).T


def closes_by_force(contacts: Floats, centre: Floats, friction: float) -> bool:
    """Whether three contacts close a part by force: their wrenches span all, and cancel out
    with a weight above 0 each.
    """
    W = contact_wrenches(contacts, centre, friction)
    if np.linalg.matrix_rank(W, tol=CLOSED_TOLERANCE) < 6:
        return False
    _, rest = nnls(W, -W.sum(axis=1))
    return bool(rest < CLOSED_TOLERANCE)


def _weigh_grasp(
    hand: ThreeFingers, grasp: Grasp, contacts: Floats, mass_kg: float, centre: Floats
) -> Grasp:
    """The grasp with how many times its weight it holds, whichever way this pulls, while no
    finger presses more than it can.
    """
    W = contact_wrenches(contacts, centre, hand.friction)
    margin = min(
        _max_weight_factor(W, hand.force_n, sign * axis * mass_kg * GRAVITY_M_S2)
        for axis in np.eye(3)
        for sign in (1, -1)
    )
    return replace(grasp, torque_margin=min(margin, MAX_TOLD_MARGIN))


def _max_weight_factor(W: Floats, force_n: float, weight: Floats) -> float:
    """By which factor a weight (3,) may grow until the fingers cannot balance it."""
    count = W.shape[1]
    balance = np.column_stack([W, np.concatenate([weight, np.zeros(3)])])
    presses = np.zeros((3, count + 1))
    for n in range(3):
        presses[n, n * CONE_EDGES : (n + 1) * CONE_EDGES] = 1.0
    aim = np.zeros(count + 1)
    aim[-1] = -1.0
    solution = linprog(
        aim, A_ub=presses, b_ub=np.full(3, force_n), A_eq=balance, b_eq=np.zeros(6), method="highs"
    )
    return float(solution.x[-1]) if solution.status == 0 else 0.0
