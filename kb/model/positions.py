"""Where the places of a cell are, as far as no arm moves them. Lengths are in metres."""

import math

from cellwright.kb.model.cell import WORLD, Cell, Placement
from cellwright.kb.model.shapes import Pose, Vector


def position(cell: Cell, place: str, frame: str = WORLD) -> Vector | None:
    """The point of a place in a frame of the cell; None if there is no such place, or if an arm moves one of them."""
    if place not in cell.places:
        return None
    at = cell.places[place].placement
    own, theirs = _to_world(cell, at), () if frame == WORLD else _chain(cell, frame)
    if own is None or theirs is None:
        return None
    point = (0.0, 0.0, 0.0)
    for pose in own:
        point = _outwards(pose, point)
    for pose in reversed(theirs):
        point = _inwards(pose, point)
    return point


def is_fixed(cell: Cell, frame: str) -> bool:
    """Whether a cell has a frame of this name that no arm moves."""
    return frame == WORLD or _chain(cell, frame) is not None


def _to_world(cell: Cell, at: Placement) -> tuple[Pose, ...] | None:
    """The poses that lead from a placement to the world, the innermost first."""
    above = () if at.parent == WORLD else _chain(cell, at.parent)
    return None if above is None else (at.pose, *above)


def _chain(cell: Cell, frame: str) -> tuple[Pose, ...] | None:
    """The poses that lead from a frame to the world; None if the frame moves, or if there is none of its name."""
    owner, _, part = frame.partition(".")
    if frame in cell.frames:
        return _to_world(cell, cell.frames[frame])
    if owner in cell.arms:
        return _to_world(cell, cell.arms[owner].base) if part == "base" else None
    if owner not in cell.bodies or (part and part not in cell.bodies[owner].features):
        return None
    below = _to_world(cell, cell.bodies[owner].placement)
    if below is None or not part:
        return below
    return (cell.bodies[owner].features[part], *below)


def _outwards(pose: Pose, point: Vector) -> Vector:
    """A point in a frame, seen from the parent of the frame: R = Rz(yaw) Ry(pitch) Rx(roll), then the position."""
    x, y, z = point
    roll, pitch, yaw = pose.rpy_rad
    y, z = _turned(y, z, roll)
    z, x = _turned(z, x, pitch)
    x, y = _turned(x, y, yaw)
    a, b, c = pose.position_m
    return (x + a, y + b, z + c)


def _inwards(pose: Pose, point: Vector) -> Vector:
    """A point in the parent of a frame, seen from the frame."""
    x, y, z = (value - own for value, own in zip(point, pose.position_m, strict=True))
    roll, pitch, yaw = pose.rpy_rad
    x, y = _turned(x, y, -yaw)
    z, x = _turned(z, x, -pitch)
    y, z = _turned(y, z, -roll)
    return (x, y, z)


def _turned(first: float, second: float, angle: float) -> tuple[float, float]:
    """Two coordinates after a turn from the first axis to the second one."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * first - sine * second, sine * first + cosine * second
