"""Grasps of a part by a hand with three fingers that close one by one.

The hand comes along the normal of a facet. Its fingers meet the part in a section below this facet. A grasp is stable if the
friction cones of the three contacts close it by force (Nguyen 1988): they can balance any force and torque, pressing hard enough.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog, nnls

from cellwright.engine.kernels.rigid import transform
from cellwright.engine.model.geometry import Floats, Longs
from cellwright.engine.model.grasping import Grasp, ThreeFingers
from cellwright.engine.model.solid import Solid
from cellwright.engine.stages.grasping.blocks import meet
from cellwright.engine.stages.grasping.grasps import GRAVITY

EDGES = 8  # of the pyramid that stands for a friction cone
CLOSED = 1e-6  # forces or torques, of a pressing force, that count as none
SAME = 1e-6  # of a cosine: normals that differ less are one
MOST = 120  # grasps, whose margins are computed
AMPLE = 100.0  # the largest margin that is told


def three_finger_grasps(
    solid: Solid, hand: ThreeFingers, inset_m: float, mass_kg: float, centre: Floats, turns: int
) -> list[Grasp]:
    """Grasps that are closed by force and touch the part with their fingers alone; those first that hold its weight best.

    The fingers meet the part `inset_m` below a facet. `centre` (3,) is the centre of mass.
    """
    found: list[tuple[Grasp, Floats]] = []
    for normal in _normals(solid):
        height = float((solid.vertices @ normal).max()) - inset_m
        segments, owner = _section(solid, normal, height)
        for grasp, contacts in _across(solid, hand, (normal, height), (segments, owner), centre, turns):
            if not meet(grasp.T_part_hand, *hand.blocks(grasp.opening), solid.corners)[0]:
                found.append((grasp, contacts))
    found.sort(key=lambda pair: float(np.linalg.norm(pair[1][:3].mean(axis=0) - centre)))
    held = [_weighed(hand, grasp, contacts, mass_kg, centre) for grasp, contacts in found[:MOST]]
    return sorted(
        (each for each in held if each.torque_margin >= 1.0), key=lambda each: -round(each.torque_margin, 6)
    )


def _normals(solid: Solid) -> list[Floats]:
    """The different normals of the facets."""
    kept: list[Floats] = []
    for facet in solid.facets:
        if not any(facet.normal @ each > 1 - SAME for each in kept):
            kept.append(facet.normal)
    return kept


def _section(solid: Solid, normal: Floats, height: float) -> tuple[Floats, Longs]:
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


def _across(
    solid: Solid,
    hand: ThreeFingers,
    plane: tuple[Floats, float],
    section: tuple[Floats, Longs],
    centre: Floats,
    turns: int,
) -> Iterator[tuple[Grasp, Floats]]:
    """Grasps in a section that are closed by force, with their contacts (6, 3): three points, and three normals out of the part."""
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
            made = _closed(solid, hand, T, section, spread, centre)
            if made is not None:
                yield made


def _closed(
    solid: Solid,
    hand: ThreeFingers,
    T: Floats,
    section: tuple[Floats, Longs],
    spread: float,
    centre: Floats,
) -> tuple[Grasp, Floats] | None:
    """The grasp of a hand at a pose, if its fingers meet the part without sliding, and close it by force."""
    begins, outwards = hand.ways(spread)
    flat = ((section[0] - T[:3, 3]) @ T[:3, :3])[:, :, :2]
    ways, names, points, normals = [], [], [], []
    for begin, outward in zip(begins, outwards, strict=True):
        way, number = _outermost(flat, begin, outward)
        if number < 0 or way < 0.0:
            return None
        facet = solid.facets[int(section[1][number])]
        direction = T[:3, :2] @ outward
        if facet.normal @ direction < 1 / np.sqrt(1 + hand.friction**2):
            return None
        ways.append(way)
        names.append(facet.name)
        points.append(T[:3, 3] + T[:3, :2] @ (begin + way * outward))
        normals.append(facet.normal)
    width = ways[0] + max(ways[1:])
    contacts = np.array([*points, *normals])
    if (
        width > hand.opening_m
        or _jammed(contacts, hand.thick_m)
        or not closes(contacts, centre, hand.friction)
    ):
        return None
    grasp = Grasp(tuple(names), width, T[None], np.ones(1, dtype=bool), 0.0, (*ways, spread))
    return grasp, contacts


def _jammed(contacts: Floats, thick_m: float) -> bool:
    """Whether two of the fingers would be in each other's place."""
    tips = contacts[:3] + contacts[3:] * thick_m / 2
    return any(float(np.linalg.norm(tips[a] - tips[b])) < thick_m for a, b in ((0, 1), (0, 2), (1, 2)))


def _outermost(flat: Floats, begin: Floats, outward: Floats) -> tuple[float, int]:
    """How far along a ray in the plane the last of some segments (s, 2, 2) is, and its number; -1 if it meets none."""
    across = np.array([-outward[1], outward[0]])
    offset, along = (flat - begin) @ across, (flat - begin) @ outward
    crossing = (offset[:, 0] > 0) != (offset[:, 1] > 0)
    if not crossing.any():
        return 0.0, -1
    rise = np.where(crossing, offset[:, 1] - offset[:, 0], 1.0)
    at = along[:, 0] - offset[:, 0] * (along[:, 1] - along[:, 0]) / rise
    best = int(np.argmax(np.where(crossing, at, -np.inf)))
    return float(at[best]), best


def wrenches(contacts: Floats, centre: Floats, friction: float) -> Floats:
    """Forces and torques about the centre (6, 3 EDGES) along the edges of the friction cones, each with a normal force of 1.

    Torques are in units of a force at the distance of the farthest contact.
    """
    points, normals = contacts[:3] - centre, contacts[3:]
    reach = max(float(np.linalg.norm(points, axis=1).max()), 1e-9)
    angles = np.arange(EDGES) * 2 * np.pi / EDGES
    found = []
    for point, normal in zip(points, normals, strict=True):
        one = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        one /= np.linalg.norm(one)
        other = np.cross(normal, one)
        forces = -normal + friction * (np.outer(np.cos(angles), one) + np.outer(np.sin(angles), other))
        found.append(np.concatenate([forces, np.cross(point, forces) / reach], axis=1))
    return np.concatenate(found).T


def closes(contacts: Floats, centre: Floats, friction: float) -> bool:
    """Whether three contacts close a part by force: their wrenches span all, and cancel out with a weight above 0 each."""
    W = wrenches(contacts, centre, friction)
    if np.linalg.matrix_rank(W, tol=CLOSED) < 6:
        return False
    _, rest = nnls(W, -W.sum(axis=1))
    return bool(rest < CLOSED)


def _weighed(hand: ThreeFingers, grasp: Grasp, contacts: Floats, mass_kg: float, centre: Floats) -> Grasp:
    """The grasp with how many times its weight it holds, whichever way this pulls, while no finger presses more than it can."""
    W = wrenches(contacts, centre, hand.friction)
    margin = min(
        _held(W, hand.force_n, sign * axis * mass_kg * GRAVITY) for axis in np.eye(3) for sign in (1, -1)
    )
    return replace(grasp, torque_margin=min(margin, AMPLE))


def _held(W: Floats, force_n: float, weight: Floats) -> float:
    """By which factor a weight (3,) may grow until the fingers cannot balance it."""
    count = W.shape[1]
    balance = np.column_stack([W, np.concatenate([weight, np.zeros(3)])])
    presses = np.zeros((3, count + 1))
    for n in range(3):
        presses[n, n * EDGES : (n + 1) * EDGES] = 1.0
    aim = np.zeros(count + 1)
    aim[-1] = -1.0
    found = linprog(
        aim, A_ub=presses, b_ub=np.full(3, force_n), A_eq=balance, b_eq=np.zeros(6), method="highs"
    )
    return float(found.x[-1]) if found.status == 0 else 0.0
