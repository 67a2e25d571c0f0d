"""Random scenes for localisation: six parts of the kinds of Handey's figures, and worse, on a
table, partly hidden.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply, rotation, transform, translation
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.vision import DepthCamera, DepthImage
from cellwright.engine.stages.geometry.shapes.facet_solids import make_solid, triangulate_polygon
from cellwright.engine.stages.vision.part_localisation import KnownScene
from cellwright.engine.stages.vision.sensor_images import DepthSensor, disturb_image, render_depths

CAMERA = DepthCamera.viewing(640, 480, 0.6, 1.0)  # 1 m above the table
T_CAMERA_WORLD = transform(np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 1.0))
FLOOR = np.array([0.0, 0.0, -1.0, -1.0])
SENSOR = DepthSensor(0.001, 0.01)
HIDDEN = 0.5  # at most, of what would be seen of the part alone
LEANING = 0.3  # of the parts
Polygon = list[tuple[float, float]]


def prism(name: str, polygon: Polygon, height: float) -> Solid:
    """The prism over a polygon, counter-clockwise, about the middle of its corners."""
    flat = np.array(polygon) - np.mean(polygon, axis=0)
    low = np.column_stack([flat, np.full(len(flat), -height / 2)])
    high = low + np.array([0.0, 0.0, height])
    up = np.array([0.0, 0.0, 1.0])
    surfaces = [
        ("top", triangulate_polygon(high, up)),
        ("bottom", triangulate_polygon(low[::-1], -up)),
    ]
    for n in range(len(flat)):
        m = (n + 1) % len(flat)
        side = np.array([low[n], low[m], high[m], high[n]])
        normal = np.cross(side[1] - side[0], side[2] - side[1])
        surfaces.append(
            (f"side_{n + 1}", triangulate_polygon(side, normal / np.linalg.norm(normal)))
        )
    return make_solid(name, surfaces)


def _block(r: Callable[[float, float], float]) -> tuple[Polygon, float]:
    a, b = r(60, 150), r(40, 90)
    return [(0, 0), (a, 0), (a, b), (0, b)], r(40, 60)


def _ell(r: Callable[[float, float], float]) -> tuple[Polygon, float]:
    a, b, t = r(80, 140), r(60, 100), r(25, 35)
    return [(0, 0), (a, 0), (a, t), (t, t), (t, b), (0, b)], r(40, 60)


def _tee(r: Callable[[float, float], float]) -> tuple[Polygon, float]:
    a, b, t = r(80, 120), r(60, 100), r(30, 40)
    right, left = (a + t) / 2, (a - t) / 2
    return [(0, 0), (a, 0), (a, t), (right, t), (right, b), (left, b), (left, t), (0, t)], r(40, 50)


def _wedge(r: Callable[[float, float], float]) -> tuple[Polygon, float]:
    return [(0, 0), (r(70, 120), 0), (0, r(50, 80))], r(40, 70)


def _house(r: Callable[[float, float], float]) -> tuple[Polygon, float]:
    a, b, c = r(50, 80), r(40, 60), r(20, 30)
    return [(0, 0), (a, 0), (a, b), (a / 2, b + c), (0, b)], r(50, 100)


def _step(r: Callable[[float, float], float]) -> tuple[Polygon, float]:
    a, b = r(60, 100), r(50, 80)
    return [(0, 0), (a, 0), (a, b / 2), (a / 2, b / 2), (a / 2, b), (0, b)], r(40, 80)


def _hexagon(r: Callable[[float, float], float]) -> tuple[Polygon, float]:
    a = r(60, 90) / 2
    corners = [(a * np.cos(k * np.pi / 3), a * np.sin(k * np.pi / 3)) for k in range(6)]
    return [(float(x), float(y)) for x, y in corners], r(40, 60)


def _channel(r: Callable[[float, float], float]) -> tuple[Polygon, float]:
    a, b, t = r(80, 120), r(50, 80), r(22, 30)
    return [(0, 0), (a, 0), (a, b), (a - t, b), (a - t, t), (t, t), (t, b), (0, b)], r(40, 60)


KINDS = {
    "block": _block,
    "ell": _ell,
    "tee": _tee,
    "wedge": _wedge,
    "house": _house,
    "step": _step,
    "hexagon": _hexagon,
    "channel": _channel,
}


@dataclass(frozen=True)
class Trial:
    """An image, what is known of it, the part to be found, and where it is (None: nowhere).

    `seen` is its visible share.
    """

    image: DepthImage
    ground: KnownScene
    part: Solid
    T_camera_part: Floats | None
    seen: float


def slab(x: float, y: float, z: float) -> Solid:
    """A block."""
    return prism("slab", [(0, 0), (x, 0), (x, y), (0, y)], z)


TABLE = (slab(2.0, 2.0, 0.1), T_CAMERA_WORLD @ translation(0, 0, -0.05))
EMPTY = render_depths([TABLE], CAMERA)[0].depth


def trial(seed: int, present: bool = True) -> Trial:
    """A scene of six parts, the first of which is to be found; it is taken away unless
    `present`.
    """
    random = np.random.default_rng(seed)
    parts = _laid(random)
    cover = _cover(random, *parts[0]) if random.random() < 0.6 else []
    seen = _seen(parts, cover)
    if seen < 1 - HIDDEN:
        cover, seen = [], _seen(parts, [])
    things = [*parts[0 if present else 1 :], *cover]
    image = disturb_image(_view(things), SENSOR, seed)
    known = np.abs(image.depth - EMPTY) < 4 * SENSOR.noise_m
    target, T = parts[0]
    return Trial(
        image, KnownScene(known, (FLOOR,)), target, T_CAMERA_WORLD @ T if present else None, seen
    )


def _view(things: list[tuple[Solid, Floats]]) -> DepthImage:
    return render_depths([TABLE, *((each, T_CAMERA_WORLD @ T) for each, T in things)], CAMERA)[0]


def _seen(parts: list[tuple[Solid, Floats]], cover: list[tuple[Solid, Floats]]) -> float:
    """The share of the first part's picture that other things leave."""
    placed = [(each, T_CAMERA_WORLD @ T) for each, T in [*parts, *cover]]
    alone = (render_depths(placed[:1], CAMERA)[1] == 0).sum()
    return float((render_depths(placed, CAMERA)[1] == 0).sum() / max(alone, 1))


def _laid(random: np.random.Generator) -> list[tuple[Solid, Floats]]:
    """Six parts on the table, none in another one, some of them leaning."""
    found: list[tuple[Solid, Floats]] = []
    outlines: list[Floats] = []
    for name in random.permutation(list(KINDS))[:6]:
        polygon, height = KINDS[str(name)](lambda low, high: float(random.uniform(low, high)))
        part = prism(str(name), [(x / 1000, y / 1000) for x, y in polygon], height / 1000)
        for _ in range(200):
            T = _lying(random, part)
            T[:2, 3] = random.uniform(-0.19, 0.19), random.uniform(-0.13, 0.13)
            outline = apply(T, part.vertices)[:, :2]
            if all(separate(outline, other) for other in outlines):
                found.append((part, T))
                outlines.append(outline)
                break
    return found


def _lying(random: np.random.Generator, part: Solid) -> Floats:
    """A pose on the table: on a face of the hull, or leaning by up to 30 degrees."""
    normals = ConvexHull(np.unique(np.round(part.vertices, 9), axis=0)).equations[:, :3]
    normal = normals[random.integers(len(normals))]
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    R = np.stack([across, np.cross(-normal, across), -normal])
    R = rotation((0, 0, 1), random.uniform(-np.pi, np.pi)) @ R
    if random.random() < LEANING:
        angle = random.uniform(0, 2 * np.pi)
        axis = np.array([np.cos(angle), np.sin(angle), 0.0])
        R = rotation(axis, random.uniform(0, np.radians(30))) @ R
    T = transform(R, np.zeros(3))
    T[2, 3] = -apply(T, part.vertices)[:, 2].min()
    return T


def separate(one: Floats, other: Floats, by: float = 1e-3) -> bool:
    """Whether the hulls of two sets of points (n, 2) are so far apart (m) along one of their
    edges' normals.
    """
    for points in (one, other):
        for normal in ConvexHull(points).equations[:, :2]:
            if (one @ normal).min() > (other @ normal).max() + by:
                return True
            if (other @ normal).min() > (one @ normal).max() + by:
                return True
    return False


def _cover(random: np.random.Generator, part: Solid, T: Floats) -> list[tuple[Solid, Floats]]:
    """A plate above a part that hides some of it from one side."""
    points = apply(T, part.vertices)
    angle, share = random.uniform(0, 2 * np.pi), random.uniform(0.1, 0.5)
    along, across = (
        np.array([np.cos(angle), np.sin(angle)]),
        np.array([-np.sin(angle), np.cos(angle)]),
    )
    heights = points[:, :2] @ along
    begins = heights.max() - share * np.ptp(heights)
    plate = slab(0.3, 0.3, 0.01)
    middle = along * (begins + 0.15) + across * (points[:, :2] @ across).mean()
    return [(plate, transform(rotation((0, 0, 1), angle), (*middle, points[:, 2].max() + 0.03)))]
