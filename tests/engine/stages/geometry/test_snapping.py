"""A point that is picked on a body goes to its face, to the nearest edge, or to the middle of a
hole.
"""

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry.shapes.hulls import hull_triangles
from cellwright.engine.stages.geometry.shapes.part_shapes import shape_cores
from cellwright.engine.stages.geometry.shapes.snapping import SnapTo, snap_point
from cellwright.kb.model.body_shapes import Box, Hole, PlacedShape, Plate, Pose

SIZE = (0.4, 0.3, 0.02)
PLATE = (PlacedShape(Plate(SIZE, (Hole((0.1, 0.05), 0.04),)), Pose()),)
BOX = (PlacedShape(Box(SIZE), Pose()),)
TENTH_MM = 1e-4


def corners_of(shapes: tuple[PlacedShape, ...]) -> Floats:
    pieces = [core.vertices for placed in shapes for core in shape_cores(placed.shape)]
    return np.concatenate([each[hull_triangles(each)] for each in pieces])


def on_surface(count: int = 40) -> list[Floats]:
    """Points on the surface of the block, with what is outward there."""
    random, half = np.random.default_rng(7), np.array(SIZE) / 2
    found = []
    for _ in range(count):
        point, axis, side = (
            random.uniform(-half, half),
            random.integers(3),
            random.choice([-1.0, 1.0]),
        )
        point[axis] = side * half[axis]
        found.append(np.array([point, side * np.eye(3)[axis]]))
    return found


def test_a_point_on_a_face_stays_with_the_outward_normal() -> None:
    corners = corners_of(BOX)
    for point, outward in on_surface():
        found = snap_point(corners, BOX, point, SnapTo.FACE)
        assert found is not None
        assert found.point == pytest.approx(point, abs=TENTH_MM)
        assert found.normal == pytest.approx(outward, abs=1e-9)


def test_a_point_beside_the_face_comes_back_to_it() -> None:
    corners = corners_of(BOX)
    for point, outward in on_surface():
        found = snap_point(corners, BOX, point + 1e-5 * outward, SnapTo.FACE)
        assert found is not None
        assert found.point == pytest.approx(point, abs=TENTH_MM)


def test_the_nearest_edge_is_that_of_the_block_and_not_of_a_triangle() -> None:
    corners, half = corners_of(BOX), np.array(SIZE) / 2
    for point, outward in on_surface():
        found = snap_point(corners, BOX, point, SnapTo.EDGE, reach_m=1.0)
        assert found is not None
        across = [n for n in range(3) if not outward[n]]
        away = {n: half[n] - abs(point[n]) for n in across}
        nearest = min(away, key=lambda n: away[n])
        wanted = point.copy()
        wanted[nearest] = np.copysign(half[nearest], point[nearest])
        assert np.linalg.norm(found.point - point) == pytest.approx(away[nearest], abs=TENTH_MM)
        assert found.point == pytest.approx(wanted, abs=TENTH_MM) or len(set(away.values())) == 1


def test_the_seams_between_the_pieces_of_a_plate_are_no_edges() -> None:
    found = snap_point(
        corners_of(PLATE), PLATE, np.array([-0.1, 0.09, 0.01]), SnapTo.EDGE, reach_m=1.0
    )
    assert found is not None
    assert found.point == pytest.approx([-0.1, 0.15, 0.01], abs=TENTH_MM)


def test_a_hole_gives_its_middle_and_its_width_on_the_side_that_was_picked() -> None:
    for z in (0.01, -0.01):
        found = snap_point(corners_of(PLATE), PLATE, np.array([0.15, 0.05, z]), SnapTo.HOLE)
        assert found is not None
        assert found.point == pytest.approx([0.1, 0.05, z])
        assert found.normal == pytest.approx([0.0, 0.0, np.sign(z)])
        assert found.bore_m == pytest.approx(0.08)


def test_what_is_not_near_is_not_found() -> None:
    point = np.array([-0.1, 0.0, 0.01])
    assert snap_point(corners_of(PLATE), PLATE, point, SnapTo.HOLE) is None
    assert snap_point(corners_of(PLATE), PLATE, point, SnapTo.EDGE, reach_m=0.01) is None
