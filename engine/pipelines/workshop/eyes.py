"""What is seen of what is really there: by the camera of the scene, by that of the hand, and by a look at a goal."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.rigid import inverse, transform
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.vision import DepthImage
from cellwright.engine.pipelines.placing.looking import (
    KNOWN,
    Looked,
    camera_of,
    camera_pose,
    depth_image,
    look,
)
from cellwright.engine.pipelines.placing.optics import Errors, Optics
from cellwright.engine.pipelines.placing.seeing import Seeing
from cellwright.engine.pipelines.placing.yard import Spot, Yard
from cellwright.engine.pipelines.workshop.shop import Workshop
from cellwright.engine.pipelines.workshop.showing import Showing
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.vision.images import Sensor, disturbed, rendered
from cellwright.kb.model.cell import Placement
from cellwright.kb.model.scene import Scene

NO_ERRORS = Errors()
NEAR_M = 0.4  # how far above a part the camera of the hand looks at it
ABOVE_M = 0.6  # how far above a goal it looks
TAKEN_PX = 30  # pixels of something unknown that make a goal occupied


@dataclass
class Eyes:
    """The cameras of a workshop. That of the scene may have been knocked since it was calibrated; that of the hand is as it should be."""

    shop: Workshop
    seed: int = 0
    knock: Errors = NO_ERRORS
    looks: int = 0

    @cached_property
    def seeing(self) -> Seeing:
        """The camera of the scene: what is believed of it, and how it is."""
        scene = self.shop.scene
        return Seeing(scene, Optics.of(scene, self.knock), self.shop.world, Showing(self.shop), self.seed)

    def look(self, yard: Yard, spots: Mapping[str, Spot], *parts: str) -> Looked:
        """Parts, in an image of the scene's camera; the other ones are known to be where they are believed."""
        return look(self.seeing.scene, _believed(yard, spots), parts, 0, self.seeing.image())

    def look_near(self, yard: Yard, spots: Mapping[str, Spot], part: str) -> Looked:
        """The same from near by, above where the part is believed."""
        scene = _above(self.shop.scene, yard.pose(part, spots[part]), NEAR_M)
        return look(scene, _believed(yard, spots), (part,), 0, self._image(scene).depth)

    def goal_is_taken(self, yard: Yard, spots: Mapping[str, Spot], part: str) -> bool:
        """Whether something that nobody knows is where a part belongs."""
        scene, goal = _above(self.shop.scene, yard.goals[part], ABOVE_M), yard.goals[part]
        believed, camera = _believed(yard, spots), camera_of(scene)
        image = self._image(scene)
        known = depth_image(scene, believed, camera, {part, *scene.clutter}).depth
        strange = (image.depth > 0) & (np.abs(image.depth - known) > KNOWN * max(image.noise_m, 1e-6))
        T = inverse(camera_pose(scene, believed)) @ goal
        own = rendered([(yard.site.solids[part], T)], camera)[1] >= 0
        return int((strange & own).sum()) > TAKEN_PX

    def wide(self, looked: Looked, before: Looked) -> Looked:
        """The look to go on with: a new one by the scene's camera, else the one before, because it shows more of the scene."""
        own = camera_pose(self.seeing.scene, World.of(self.seeing.scene.cell))
        same = np.abs(looked.T_world_camera - own).max() < 1e-9
        return looked if same else before

    def _image(self, scene: Scene) -> DepthImage:
        self.looks += 1
        sensor = Sensor(scene.camera.noise_m, scene.camera.dropouts)
        shown = depth_image(scene, self.shop.world(), camera_of(scene))
        return disturbed(shown, sensor, self.seed * 1000 + self.looks)


def _believed(yard: Yard, spots: Mapping[str, Spot]) -> World:
    world = yard.site.world
    for name, spot in spots.items():
        world = world.put(name, "world", yard.pose(name, spot))
    return world


def _above(scene: Scene, T_world_part: Floats, height_m: float) -> Scene:
    """The scene with its camera straight above a place, looking down."""
    at = transform(np.diag([1.0, -1.0, -1.0]), T_world_part[:3, 3] + [0.0, 0.0, height_m])
    placed = Placement("world", transforms.to_pose(at))
    return replace(scene, camera=replace(scene.camera, placement=placed), calibrated=None)
