"""Whether there is room for a part at a pose: it may touch other bodies, but not be inside them."""

from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.placing.answers import NotPlaced
from cellwright.engine.pipelines.placing.task import Task
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.world.scenes import free_scene_of

PRESSED_M = 0.002  # errors of what was found; what is deeper is no touch


def no_room(task: Task, T_world_part: Floats) -> NotPlaced | None:
    """What is said where a part would be inside another body at a pose; None if it would not."""
    checker = geometry_backend().checker(free_scene_of(task.world, task.part))
    deepest = next(iter(checker.contacts(T_world_part, 0.0)), None)
    if deepest is None or deepest.distance_m > -PRESSED_M:
        return None
    other = deepest.second if deepest.first == task.part else deepest.first
    depth = -1000 * deepest.distance_m
    reason = f"at its goal {task.part} would be {depth:.1f} mm inside {other}"
    return NotPlaced("room", reason, f"move {other} away, or relate {task.part} otherwise")
