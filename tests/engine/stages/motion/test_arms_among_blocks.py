"""Bundled arms among random blocks: a query ends with a path, or with a proof that there is
none.
"""

from pathlib import Path

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import Blocked, Moved, PathQuery
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.motion.path_planner import EARLY_BUDGET, plan_path
from cellwright.kb.loader.cell import load_cell
from tests.engine.stages.motion.conftest import finely


def among_blocks(
    folder: Path, arm: str, rng: np.random.Generator, count: int, limits: str = ""
) -> PlanningScene:
    """The ground of an arm on a stand, with blocks that keep off its base."""
    blocks = list[str]()
    while len(blocks) < count:
        x, y, z = rng.uniform([-1.0, -1.0, 0.0], [1.0, 1.0, 1.6])
        a, b, c = rng.uniform(0.05, 0.35, 3)
        if np.hypot(x, y) > 0.45:
            name = f"block_{len(blocks)}"
            blocks.append(
                f"  {name}: {{at: [{x}, {y}, {z}], shapes: [{{box: [{a}, {b}, {c}]}}]}}\n"
            )
    file = folder / "cell.yaml"
    head = f"cell: blocks\narms:\n  arm: {{model: {arm}, at: [0, 0, 0.7]{limits}}}\nfixtures:\n"
    file.write_text(head + "".join(blocks))
    return PlanningScene(BuiltinChecker(collision_scene_of(GeometricWorld.of(load_cell(file)))))


def free(ground: PlanningScene, rng: np.random.Generator, count: int) -> Floats:
    joints = ground.scene.joints
    q = rng.uniform(joints.lower, joints.upper, (50 * count, joints.count))
    found: Floats = q[ground.clearance(q) > 0.005][:count]
    return found


@pytest.mark.parametrize("arm", ["puma_560", "manutec_r3"])
@pytest.mark.parametrize("cells", [3, pytest.param(25, marks=pytest.mark.slow)])
def test_each_query_ends_with_a_path_or_a_proof(tmp_path: Path, arm: str, cells: int) -> None:
    paths = 0
    for seed in range(cells):
        rng = np.random.default_rng([18, seed])
        ground = among_blocks(tmp_path, arm, rng, 10)
        for start, goal in free(ground, rng, 8).reshape(4, 2, -1):
            answer = plan_path(ground, PathQuery(start, goal[None]))
            assert isinstance(answer, Moved) or (
                isinstance(answer, Blocked) and answer.severed is not None
            )
            if isinstance(answer, Moved):
                paths += 1
                assert answer.proved
                assert not ground.collides(finely(answer.path, 0.003)).any()
    assert paths >= 3 * cells


@pytest.mark.slow
def test_a_proof_is_found_before_the_whole_work_is_spent(tmp_path: Path) -> None:
    """The elbow of the UR5 turns all round, but not through the upper arm."""
    rng = np.random.default_rng(18)
    ground = among_blocks(tmp_path, "ur5", rng, 4)
    found = [
        answer
        for start, goal in free(ground, rng, 40).reshape(20, 2, -1)
        if isinstance(
            answer := plan_path(ground, PathQuery(start, goal[None], budget=100 * EARLY_BUDGET)),
            Blocked,
        )
    ]
    proofs = [each for each in found if each.severed is not None]
    assert proofs
    assert all(each.looked < 2 * EARLY_BUDGET for each in proofs)
