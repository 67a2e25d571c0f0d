"""Region trees against a comparison of all pairs: a UR5 among scattered blocks, on one core.

python benchmarks/regions.py [BODIES ...]
"""

import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import product

os.environ["CELLWRIGHT_THREADS"] = "1"

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import CollisionScene, ConvexPiece
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.region_checker import RegionChecker
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.arm_file import bundled_arms, load_arm
from cellwright.kb.model.cell_model import Cell, MountedArm

CUBE = np.array(list(product((-0.5, 0.5), repeat=3)))
RUNS = 3


def block(name: str, spread: float, rng: np.random.Generator) -> ConvexPiece:
    """A block of 2 to 10 cm, turned, within `spread` metres along each axis."""
    axis = rng.normal(size=3)
    R = transforms.rotation(axis / np.linalg.norm(axis), float(rng.uniform(0, 3)))
    T = transforms.transform(R, rng.uniform(-spread, spread, 3))
    return ConvexPiece(name, 0, T, CUBE * rng.uniform(0.02, 0.1, 3), 0.0, box=True)


def scattered(bodies: int, spread: float) -> tuple[CollisionScene, Floats]:
    """A scene, and 2,000 configurations."""
    rng = np.random.default_rng(1)
    world = GeometricWorld.of(
        Cell("scattered", {"ur5": MountedArm(load_arm(bundled_arms()["ur5"]))})
    )
    bare = collision_scene_of(world)
    blocks = [block(f"block_{n}", spread, rng) for n in range(bodies)]
    moving = [n for n, piece in enumerate(bare.pieces) if piece.carrier]
    cross = np.array(list(product(moving, range(len(bare.pieces), len(bare.pieces) + bodies))))
    scene = replace(bare, pieces=(*bare.pieces, *blocks), pairs=np.concatenate([bare.pairs, cross]))
    return scene, world.models["ur5"].random(2000, rng)


def rate(ask: Callable[[], object], count: int) -> float:
    """Answers per second of processor time: the best of some runs."""
    ask()
    best = float("inf")
    for _ in range(RUNS):
        start = time.process_time()
        ask()
        best = min(best, time.process_time() - start)
    return count / best


def row(bodies: int, spread: float) -> str:
    """The rates of both for one scene, and what it costs to move one of its bodies."""
    scene, q = scattered(bodies, spread)
    by_pairs, by_tree = BuiltinChecker(scene), RegionChecker(scene)
    pairs, tree = (
        rate(lambda: by_pairs.collides(q), len(q)),
        rate(lambda: by_tree.collides(q), len(q)),
    )
    few = rate(lambda: by_pairs.clearance(q[:100]), 100)
    many = rate(lambda: by_tree.clearance(q[:100]), 100)
    step = transforms.translation(0.01, 0, 0)
    moved = 1e3 / rate(lambda: by_tree.tree.moved("block_7", step).hierarchy, 1)
    return (
        f"{bodies:6} {spread:6.1f} {pairs:18,.0f} {tree:9,.0f} {tree / pairs:5.2f}"
        f" {few:19,.0f} {many:9,.0f} {many / few:5.2f} {moved:10.2f}"
    )


def main() -> None:
    """Print a row for each number of bodies and each spread."""
    print(
        "bodies spread  collides: pairs/s    tree/s ratio  clearance: pairs/s    tree/s ratio  "
        "moved: ms"
    )
    for bodies, spread in product(
        [int(each) for each in sys.argv[1:]] or (1000, 3000, 10_000), (0.8, 4.0)
    ):
        print(row(bodies, spread), flush=True)


if __name__ == "__main__":
    main()
