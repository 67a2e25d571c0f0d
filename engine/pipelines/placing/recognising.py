"""Which parts of a scene its camera sees."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.ranging import Recognised
from cellwright.engine.model.vision import DepthImage
from cellwright.engine.pipelines.placing.looking import KNOWN, camera_of, camera_pose, depth_image, floor
from cellwright.engine.stages.geometry.shapes.solids import solid_of
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.vision.hypotheses import Model
from cellwright.engine.stages.vision.images import Sensor, disturbed
from cellwright.engine.stages.vision.localisation import Ground
from cellwright.engine.stages.vision.recognition import recognised
from cellwright.kb.diagnostics import InvalidInput, Source, unknown_name
from cellwright.kb.model.cell import BodyKind
from cellwright.kb.model.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What was recognised, in which image, among which parts."""

    answer: Recognised
    image: DepthImage
    models: Mapping[str, Model]


def recognised_in(scene: Scene, parts: Sequence[str], seed: int, given: Floats | None = None) -> Seen:
    """The parts that are seen in an image: one `given` (height, width) in metres, else one made from the scene.

    `parts` are the candidates; without them all parts of the scene are. All other bodies stand where the scene says. Raises `InvalidInput`.
    """
    world, camera = World.of(scene.cell), camera_of(scene)
    own = [name for name, body in scene.cell.bodies.items() if body.kind is BodyKind.PART]
    for name in parts:
        if name not in own:
            raise InvalidInput([unknown_name("part", name, own, Source(scene.name))])
    if given is None:
        sensor = Sensor(scene.camera.noise_m, scene.camera.dropouts)
        image = disturbed(depth_image(scene, world, camera), sensor, seed)
    else:
        image = DepthImage(camera, given, scene.camera.noise_m)
    without = depth_image(scene, world, camera, {*own, *scene.clutter}).depth
    known = (without > 0) & (np.abs(image.depth - without) < KNOWN * max(scene.camera.noise_m, 1e-6))
    models = {name: Model(solid_of(scene.cell.bodies[name])) for name in parts or own}
    ground = Ground(known, (floor(scene, world, camera_pose(scene, world)),))
    return Seen(recognised(models, image, ground), image, models)
