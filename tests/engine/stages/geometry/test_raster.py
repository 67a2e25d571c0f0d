"""What is seen at a pixel is the nearest triangle over its middle."""

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry.pictures.raster import fill, nearest


def looked_up(triangles: Floats, x: float, y: float) -> int:
    """The number of the triangle seen at a point, by solving for the point's shares in the
    corners.
    """
    best, depth = -1, -np.inf
    for n, corners in enumerate(triangles):
        system = np.vstack([corners[:, :2].T, np.ones(3)])
        if abs(np.linalg.det(system)) < 1e-9:
            continue
        shares = np.linalg.solve(system, [x, y, 1.0])
        z = float(shares @ corners[:, 2])
        if (shares >= -1e-12).all() and z > depth:
            best, depth = n, z
    return best


def test_every_pixel_shows_the_nearest_triangle() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        triangles = rng.uniform(-4.0, 16.0, (8, 3, 3))
        seen = nearest(triangles, 12, 9)
        wanted = [[looked_up(triangles, x + 0.5, y + 0.5) for x in range(12)] for y in range(9)]
        assert np.array_equal(seen, wanted)


def test_what_has_no_area_or_lies_outside_is_not_drawn() -> None:
    line = np.array([[1.0, 1.0, 0.0], [5.0, 5.0, 0.0], [9.0, 9.0, 0.0]])
    away = np.array([[-9.0, -9.0, 0.0], [-5.0, -9.0, 0.0], [-5.0, -5.0, 0.0]])
    assert (nearest(np.array([line, away, away + 90.0]), 10, 10) == -1).all()
    assert nearest(np.empty((0, 3, 3)), 4, 3).shape == (3, 4)


def test_values_are_put_where_triangles_are_and_the_rest_stays() -> None:
    corner = np.array([[[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [0.0, 4.0, 1.0]]])
    image = fill(np.ones((4, 4, 3)), corner, np.array([[0.5, 0.0, 0.0]]))
    assert image[0, 0].tolist() == [0.5, 0.0, 0.0]
    assert image[3, 3].tolist() == [1.0, 1.0, 1.0]
