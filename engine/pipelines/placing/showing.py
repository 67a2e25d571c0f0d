"""How the arm shows a target to the camera that is calibrated: where it holds it, and at which joint values."""

from collections.abc import Iterator

import numpy as np

from cellwright.engine.kernels.rigid import inverse, rotation, transform, turned
from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.placing.holding import Holds, Reach, holds_of, with_hand
from cellwright.engine.pipelines.placing.looking import camera_of, camera_pose
from cellwright.engine.stages.geometry.shapes.solids import solid_of
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.vision.images import rendered
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.cell import BodyKind
from cellwright.kb.model.scene import Scene

LEAN_RAD = 0.6  # how far the hand leans at most, about each axis
HOLD = 0  # the number of the hold with which the target is held: any serves
SEEN = 0.6  # the share of the target that the hand must leave to be seen
DRAWN = 60  # poses of the hand that are tried for each that is wanted


def target_holds(scene: Scene, target: str) -> Holds:
    """The holds of a target. Raises `InvalidInput` if there is none."""
    bodies = scene.cell.bodies
    parts = [name for name, body in bodies.items() if body.kind is BodyKind.PART and body.shapes]
    if target not in parts:
        raise InvalidInput([unknown_name("part", target, parts, Source("TARGET"))])
    holds = holds_of(scene, solid_of(bodies[target]))
    if not len(holds.poses):
        message, hint = f"the hand cannot hold {target}", "take a part with two opposite faces"
        raise InvalidInput([Diagnostic(Source("TARGET"), "K005", message, hint)])
    return holds


def held_target(scene: Scene, target: str, world: World) -> World:
    """A world in which the hand holds the target."""
    holds = target_holds(scene, target)
    opening = holds.grasps[holds.grasp_of[HOLD]].opening
    held = with_hand(world, scene, holds.jaws, opening)
    return held.put(target, f"{scene.hand.arm}.tool", inverse(holds.poses[HOLD]))


def shown(scene: Scene, target: str, number: int, random: np.random.Generator) -> tuple[Floats, ...]:
    """Joint values (k,) that touch nothing, and with which the camera sees the target well; up to `number` of them."""
    return tuple(_free_poses(scene, held_target(scene, target, World.of(scene.cell)), target, number, random))


def _free_poses(
    scene: Scene, held: World, target: str, number: int, random: np.random.Generator
) -> Iterator[Floats]:
    """Joint values (k,) with which the target is seen and nothing is touched; the hand lies across the camera's axis."""
    arm, found = scene.hand.arm, 0
    own = frozenset(frozenset((target, name)) for name in held.cell.bodies if name not in scene.cell.bodies)
    reach = Reach(held, arm, own)
    T_camera = camera_pose(scene, held)
    for _ in range(DRAWN * number):
        if found == number:
            return
        hand = _drawn(scene, T_camera, random)
        qs = reach.configurations(hand, held.configuration)
        if len(qs) and _shows(scene, held, target, qs[0]):
            found += 1
            yield qs[0]


def _drawn(scene: Scene, T_camera: Floats, random: np.random.Generator) -> Floats:
    """A pose of the hand before the camera, across its axis."""
    distance, half = scene.camera.distance_m, scene.camera.view_m / 2
    aside = random.uniform(-0.4, 0.4, 2) * half
    at = np.array([*aside, random.uniform(0.65, 0.9) * distance])  # in the camera's frame
    turn = rotation((0.0, 0.0, 1.0), random.uniform(-np.pi, np.pi))
    roll = rotation((0.0, 0.0, 1.0), random.uniform(-np.pi, np.pi))
    across = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    lean = turned(random.uniform(-LEAN_RAD, LEAN_RAD, 3))
    return T_camera @ transform(turn @ lean @ across @ roll, at)


def _shows(scene: Scene, held: World, target: str, q: Floats) -> bool:
    """Whether enough of the target is seen, and all of it lies in the picture."""
    world, camera = held.moved(scene.hand.arm, q), camera_of(scene)
    T = inverse(camera_pose(scene, world))
    bodies = [body for body in world.cell.bodies.values() if body.shapes]
    placed = [(solid_of(body), T @ world.pose("world", body.name)) for body in bodies]
    owner = rendered(placed, camera)[1]
    mine = next(n for n, body in enumerate(bodies) if body.name == target)
    alone = rendered([placed[mine]], camera)[1] == 0
    inside = not (alone[0].any() or alone[-1].any() or alone[:, 0].any() or alone[:, -1].any())
    return bool(inside and alone.any() and (owner == mine).sum() >= SEEN * alone.sum())
