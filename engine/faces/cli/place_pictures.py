"""The pictures of `cellwright place`: one of each stage."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cellwright.engine.formats.report.depth_picture import Hands
    from cellwright.engine.pipelines.placing.answers import PlaceAnswer, Placed
    from cellwright.engine.pipelines.placing.looking import Looked
    from cellwright.engine.pipelines.placing.task import Manner, Task
    from cellwright.kb.model.scene import Scene

BLOCKS = {
    2: ("finger", "finger", "cross-piece", "sensor"),
    3: ("finger", "finger", "finger", "palm", "sensor"),
}


def draw(
    scene: "Scene", part: str, found: "PlaceAnswer", looked: "Looked", manner: "Manner", folder: Path
) -> Iterator[Path]:
    """Write the pictures of an answer into a folder, and tell their files."""
    from cellwright.engine.pipelines.placing.answers import Placed

    folder.mkdir(parents=True, exist_ok=True)
    yield _written(folder / "depth.png", _depth(scene, part, looked, edges=True))
    if not isinstance(found, Placed):
        return
    yield _written(folder / "grasps.png", _depth(scene, part, looked, _hands(found, looked)))
    task = _task(scene, part, found, looked, manner)
    yield _written(folder / "plane.svg", _plane(scene, task, found).encode())
    yield _written(folder / "placements.svg", _placements(task, found).encode())
    yield _written(folder / "preview.gltf", _film(scene, part, found).encode())


def _written(file: Path, content: bytes) -> Path:
    file.write_bytes(content)
    return file


def _depth(scene: "Scene", part: str, looked: "Looked", hands: "Hands" = (), edges: bool = False) -> bytes:
    from cellwright.engine.formats.report.depth_picture import picture
    from cellwright.engine.pipelines.placing.looking import edges_of
    from cellwright.engine.stages.geometry.shapes.solids import solid_of

    best = looked.sightings[part].best
    shown = edges_of(looked) if edges else ()
    parts = [(solid_of(scene.cell.bodies[part]), best.T_camera_part)] if best else []
    return picture(looked.image, parts, hands, shown)


def _hands(found: "Placed", looked: "Looked") -> "Hands":
    """Where the hand can take the part, and where it does."""
    from cellwright.engine.kernels.rigid import inverse

    T = inverse(looked.T_world_camera) @ found.T_world_part
    first = found.carries[0]
    chosen = [(T @ first.T_part_hand, first.grasp.width_m, True)]
    return [*chosen, *((T @ pose, width, False) for pose, width in found.possible)]


def _task(scene: "Scene", part: str, found: "Placed", looked: "Looked", manner: "Manner") -> "Task":
    from cellwright.engine.pipelines.placing.site import Site
    from cellwright.engine.stages.geometry.world.model import World

    site = Site.of(scene, World.of(scene.cell), looked, {part: found.T_world_part}, manner)
    return site.task(part, (found.T_world_part, found.T_world_goal))


def _plane(scene: "Scene", task: "Task", found: "Placed") -> str:
    from cellwright.engine.formats.report.plane_picture import picture
    from cellwright.engine.pipelines.placing.approaching import plane_of, way_in

    plane = plane_of(task, found.carries[0])
    return picture(plane, way_in(task.world, scene, found.carries[0]), BLOCKS[scene.hand.fingers])


def _placements(task: "Task", found: "Placed") -> str:
    from cellwright.engine.formats.report.placements_svg import picture
    from cellwright.engine.pipelines.placing.resting import resting

    return picture(resting(task, found), task.part)


def _film(scene: "Scene", part: str, found: "Placed") -> str:
    from cellwright.engine.formats.report.film import as_gltf
    from cellwright.engine.pipelines.workshop.preview import shots

    return as_gltf(list(shots(scene, part, found)))
