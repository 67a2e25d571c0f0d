"""Small cells for motions: planar arms of two or three links among blocks."""

from itertools import pairwise

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.model.geometry import CollisionScene, ConvexPiece, Joints
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene

CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


def block(name: str, middle: tuple[float, float], size: tuple[float, float]) -> ConvexPiece:
    """A block that stands in the plane."""
    return ConvexPiece(
        name, 0, transforms.translation(*middle, 0.0), CORNERS * (*size, 0.2), 0.0, box=True
    )


def arm_among(blocks: list[ConvexPiece], links: int = 2, length_m: float = 1.0) -> CollisionScene:
    """A planar arm of thin links, each turning about z by up to half a turn, among blocks."""
    origins = np.repeat(np.eye(4)[None], links, axis=0)
    origins[1:, 0, 3] = length_m
    joints = Joints(
        np.arange(links),
        origins,
        np.tile([0.0, 0.0, 1.0], (links, 1)),
        np.zeros(links, dtype=bool),
        np.full(links, -np.pi),
        np.full(links, np.pi),
    )
    ends = np.array([[0.0, 0.0, 0.0], [length_m, 0.0, 0.0]])
    arm = [ConvexPiece(f"link {n + 1}", n + 1, np.eye(4), ends, 0.03) for n in range(links)]
    pieces = (*arm, *blocks)
    pairs = [
        (i, j)
        for j in range(links, len(pieces))
        for i in range(j)
        if pieces[i].carrier != pieces[j].carrier  # a block in the hand moves with its link
    ]
    bodies = tuple(dict.fromkeys(piece.body for piece in pieces))
    return CollisionScene(
        joints, pieces, np.array(pairs, dtype=np.int64).reshape(-1, 2), bodies=bodies
    )


def random_ground(
    rng: np.random.Generator, blocks: int, links: int = 2, length_m: float = 1.0
) -> PlanningScene:
    """An arm among blocks at random places that are not on its base."""
    found: list[ConvexPiece] = []
    while len(found) < blocks:
        middle = rng.uniform(-2.0, 2.0, 2)
        if np.linalg.norm(middle) > 0.6:
            size = rng.uniform(0.1, 0.5, 2)
            found.append(block(f"block {len(found)}", (middle[0], middle[1]), (size[0], size[1])))
    return PlanningScene(BuiltinChecker(arm_among(found, links, length_m)))


def finely(path: Floats, step: float) -> Floats:
    """Configurations of a path that are at most `step` apart."""
    parts = [
        one
        + np.linspace(0.0, 1.0, int(np.linalg.norm(two - one) / step) + 2)[:, None] * (two - one)
        for one, two in pairwise(path)
    ]
    return np.concatenate(parts)


def touching(ground: PlanningScene, q: Floats) -> Truths:
    """Which configurations of a planar arm (n, k) have a point of a link in a block, by plain
    trigonometry.

    Points in the middle of a link are looked at, half its thickness apart, so what is told to touch
    does.
    """
    scene, hits = ground.scene, np.zeros(len(q), dtype=bool)
    links = [piece for piece in scene.pieces if piece.carrier]
    blocks = [piece for piece in scene.pieces if not piece.carrier]
    angles, start = np.cumsum(q, axis=1), np.zeros((len(q), 2))
    for n, link in enumerate(links):
        along, length = (
            np.stack([np.cos(angles[:, n]), np.sin(angles[:, n])], axis=1),
            link.vertices[1, 0],
        )
        for share in np.linspace(0.0, 1.0, int(length / link.radius_m) + 1):
            point = start + share * length * along
            for each in blocks:
                off = np.abs(point - each.T_carrier_piece[:2, 3]) - each.vertices.max(axis=0)[:2]
                hits |= np.linalg.norm(off.clip(min=0.0), axis=1) < link.radius_m - 1e-9
        start = start + length * along
    return hits


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(18)
