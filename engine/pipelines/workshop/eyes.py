"""What is seen of what is really there: by the camera of the scene, by that of the hand, and by a look at a goal."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from engine.kernels.rigid import inverse, transform
from engine.model.geometry import Floats
from engine.model.vision import DepthImage
from engine.pipelines.placing.looking import KNOWN, Looked, camera_of, camera_pose, depth_image, look
from engine.pipelines.placing.yard import Spot, Yard
from engine.pipelines.workshop.shop import Workshop
from engine.stages.geometry import transforms
from engine.stages.geometry.world.model import World
from engine.stages.vision.images import Sensor, disturbed, rendered
from kb.model.cell import Placement
from kb.model.scene import Scene

NEAR_M = 0.4  # how far above a part the camera of the hand looks at it
ABOVE_M = 0.6  # how far above a goal it looks
TAKEN_PX = 30  # pixels of something unknown that make a goal occupied


@dataclass
class Eyes:
    """The cameras of a workshop. Each look has errors of its own."""

    shop: Workshop
    seed: int = 0
    looks: int = 0

    def look(self, yard: Yard, spots: Mapping[str, Spot], part: str) -> Looked:
        """A part, in an image of the scene's camera; the other parts are known to be where they are believed."""
        return self._looked(self.shop.scene, yard, spots, part)

    def look_near(self, yard: Yard, spots: Mapping[str, Spot], part: str) -> Looked:
        """The same from near by, above where the part is believed."""
        return self._looked(_above(self.shop.scene, yard.pose(part, spots[part]), NEAR_M), yard, spots, part)

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
        """The look to go on with: a new one from where the one before was, else that one, because it shows more of the scene."""
        same = np.abs(looked.T_world_camera - before.T_world_camera).max() < 1e-9
        return looked if same else before

    def _looked(self, scene: Scene, yard: Yard, spots: Mapping[str, Spot], part: str) -> Looked:
        image = self._image(scene)
        return look(scene, _believed(yard, spots), (part,), 0, image.depth)

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
    return replace(scene, camera=replace(scene.camera, placement=placed))
