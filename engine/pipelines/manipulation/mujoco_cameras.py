"""Cameras of the MuJoCo scene, the target that the arm shows them, and the driver `workshop`."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import inverse, transform
from cellwright.engine.model.vision import DepthImage
from cellwright.engine.pipelines.manipulation.assembly_moves import AssemblyYard, PartSpot
from cellwright.engine.pipelines.manipulation.camera_calibration import (
    TARGET_HOLD,
    held_target,
    target_holds,
)
from cellwright.engine.pipelines.manipulation.camera_cell import (
    CAMERA_OPTIONS,
    CameraCell,
    RunCamera,
    Shows,
    asked_for_scene,
    seeing_of,
)
from cellwright.engine.pipelines.manipulation.camera_optics import CameraErrors, CameraOptics
from cellwright.engine.pipelines.manipulation.carry_paths import gross_motion
from cellwright.engine.pipelines.manipulation.mujoco_cell import MujocoCell
from cellwright.engine.pipelines.manipulation.part_grasps import HAND_BODY, ArmReach, with_hand
from cellwright.engine.pipelines.manipulation.scene_camera import (
    KNOWN_SIGMAS,
    SceneView,
    camera_of,
    camera_pose,
    depth_image,
    look_for_parts,
)
from cellwright.engine.pipelines.simulators import HiddenCell, Simulator, fault_base, settings_of
from cellwright.engine.ports import DriverSetup
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.vision.sensor_images import DepthSensor, disturb_image, render_depths
from cellwright.kb.model.cell_model import Placement
from cellwright.kb.model.part_scene import Scene

SHOWING_PAUSE_S = 0.3


@dataclass(frozen=True, eq=False)
class TargetShowing:
    """What the arm of a shop does with the target of a scene. Somebody clamps it in the hand, and
    takes it away in the end.

    Friction alone would let it creep while it is shown, by some millimetres in a minute."""

    shop: MujocoCell

    def __call__(
        self, scene: Scene, joints: Sequence[Floats]
    ) -> Iterator[tuple[Floats, GeometricWorld]]:
        """For each of some joint values (k,) that the arm gets to: what its joints read, and the
        world then.

        Ways are planned in what is believed: other parts may be where nobody knows.
        """
        shop, target, home = self.shop, scene.target, self.shop.q
        holds = target_holds(scene, target)
        believed = held_target(scene, target, shop.world())
        own = frozenset(frozenset((target, body)) for body in (HAND_BODY,))
        reach = ArmReach(believed, shop.arm, own)
        lay = shop.pose(target)
        fastened = False
        for q in joints:
            if not self._go(reach, q):
                continue
            if not fastened:
                self._take_up(scene)
                fastened = True
            yield self._as_it_is(scene, holds.grasps[holds.grasp_of[TARGET_HOLD]].opening)
        self._go(reach, home)
        if fastened:
            shop.clamp(target, False)
            shop.open_wide()
            shop.stage.put(
                target, GeometricWorld.of(shop.stage.world.cell).put(target, "world", lay)
            )
        shop.permit()
        shop.wait(SHOWING_PAUSE_S)

    def _take_up(self, scene: Scene) -> None:
        """The target comes between the fingers, and is clamped there."""
        shop, holds = self.shop, target_holds(scene, scene.target)
        shop.open_for(holds.grasps[holds.grasp_of[TARGET_HOLD]].opening)
        shop.stage.put(
            scene.target, held_target(scene, scene.target, shop.stage.actual(shop.stage.world))
        )
        shop.close()
        shop.clamp(scene.target, True)
        shop.wait(SHOWING_PAUSE_S)

    def _go(self, reach: ArmReach, goal: Floats) -> bool:
        """Whether the arm gets to some joint values (k,)."""
        shop, world = self.shop, reach.world
        now, goal_configuration = (world.moved(shop.arm, q).configuration for q in (shop.q, goal))
        motion = gross_motion(reach, now, goal_configuration)
        if motion is None:
            return False
        first = world.first_carriers[shop.arm]
        shop.permit(shop.scene.target)
        shop.follow(motion.path[:, first : first + len(goal)], carries=True)
        return True

    def _as_it_is(self, scene: Scene, opening: Sequence[float]) -> tuple[Floats, GeometricWorld]:
        """What the joints read, and the bodies as they are, the hand among them."""
        shop = self.shop
        q = shop.stage.actual(shop.stage.world).configurations[shop.arm]
        goal_world = shop.world().moved(shop.arm, q)
        return q, with_hand(goal_world, scene, target_holds(scene, scene.target).jaws, opening)


NO_ERRORS = CameraErrors()
LOOK_ABOVE_PART_M = 0.4  # how far above a part the camera of the hand looks at it
LOOK_ABOVE_GOAL_M = 0.6  # how far above a goal it looks
TAKEN_PX = 30  # pixels of something unknown that make a goal occupied


@dataclass
class WorkshopCameras:
    """The cameras of a workshop.

    That of the scene may have been knocked since it was calibrated; that of the hand is as it
    should be.
    """

    shop: MujocoCell
    seed: int = 0
    knock: CameraErrors = NO_ERRORS
    looks: int = 0

    @cached_property
    def seeing(self) -> RunCamera:
        """The camera of the scene: what is believed of it, and how it is."""
        scene = self.shop.scene
        return RunCamera(
            scene,
            CameraOptics.of(scene, self.knock),
            self.shop.world,
            TargetShowing(self.shop),
            self.seed,
        )

    def look(self, yard: AssemblyYard, spots: Mapping[str, PartSpot], *parts: str) -> SceneView:
        """Parts, in an image of the scene's camera; the other ones are known to be where they
        are believed.
        """
        return look_for_parts(
            self.seeing.scene, _believed_world(yard, spots), parts, 0, self.seeing.image()
        )

    def look_near(self, yard: AssemblyYard, spots: Mapping[str, PartSpot], part: str) -> SceneView:
        """The same from near by, above where the part is believed."""
        scene = _scene_above(self.shop.scene, yard.pose(part, spots[part]), LOOK_ABOVE_PART_M)
        return look_for_parts(
            scene, _believed_world(yard, spots), (part,), 0, self._image(scene).depth
        )

    def goal_is_taken(self, yard: AssemblyYard, spots: Mapping[str, PartSpot], part: str) -> bool:
        """Whether something that nobody knows is where a part belongs."""
        scene, goal = (
            _scene_above(self.shop.scene, yard.goals[part], LOOK_ABOVE_GOAL_M),
            yard.goals[part],
        )
        believed, camera = _believed_world(yard, spots), camera_of(scene)
        image = self._image(scene)
        known_depth = depth_image(scene, believed, camera, {part, *scene.clutter}).depth
        strange = (image.depth > 0) & (
            np.abs(image.depth - known_depth) > KNOWN_SIGMAS * max(image.noise_m, 1e-6)
        )
        T = inverse(camera_pose(scene, believed)) @ goal
        own = render_depths([(yard.site.solids[part], T)], camera)[1] >= 0
        return int((strange & own).sum()) > TAKEN_PX

    def wide(self, looked: SceneView, before: SceneView) -> SceneView:
        """The look to go on with: a new one by the scene's camera, else the one before, because
        it shows more of the scene.
        """
        own = camera_pose(self.seeing.scene, GeometricWorld.of(self.seeing.scene.cell))
        same = np.abs(looked.T_world_camera - own).max() < 1e-9
        return looked if same else before

    def _image(self, scene: Scene) -> DepthImage:
        self.looks += 1
        sensor = DepthSensor(scene.camera.noise_m, scene.camera.dropouts)
        shown = depth_image(scene, self.shop.world(), camera_of(scene))
        return disturb_image(shown, sensor, self.seed * 1000 + self.looks)


def _believed_world(yard: AssemblyYard, spots: Mapping[str, PartSpot]) -> GeometricWorld:
    world = yard.site.world
    for name, spot in spots.items():
        world = world.put(name, "world", yard.pose(name, spot))
    return world


def _scene_above(scene: Scene, T_world_part: Floats, height_m: float) -> Scene:
    """The scene with its camera straight above a place, looking down."""
    at = transform(np.diag([1.0, -1.0, -1.0]), T_world_part[:3, 3] + [0.0, 0.0, height_m])
    placed = Placement("world", transforms.to_pose(at))
    return replace(scene, camera=replace(scene.camera, placement=placed), calibrated=None)


def workshop_simulator(setup: DriverSetup) -> Simulator:
    """The cell of a scene for a run.

    Options: those of the simulator, `scene`, and those of its camera. Raises `InvalidInput`.
    """
    settings = settings_of(setup, CAMERA_OPTIONS)
    asked_for_scene(setup)
    seeing = seeing_of(setup.options, setup.seed, _in_physics)
    cell = HiddenCell(setup.problem, fault_base(setup.problem), settings.injections, setup.seed)
    return Simulator(CameraCell(cell, seeing), settings)


def _in_physics(scene: Scene) -> tuple[Shows, Callable[[], GeometricWorld]]:
    shop = MujocoCell(scene)
    return TargetShowing(shop), shop.world
