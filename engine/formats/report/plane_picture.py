"""The grasp plane as a picture: what stands around, layer by layer, and the hand on its way in."""

from collections.abc import Iterator, Sequence

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.grasping.approach import GraspPlane

SIDE_PX, REACH_M = 640, 0.26
COLOURS = ("#c2452d", "#2d6fc2", "#2e8b57", "#8a5a9e", "#b8860b")
STYLE = "text{font:13px sans-serif;fill:#222}"


def picture(plane: GraspPlane, way: Floats, names: Sequence[str]) -> str:
    """The SVG of a plane, seen along the closing direction, with the hand at some poses (n, 3) of its way and at the grasp.

    Obstacles and blocks of the hand have the colour of their layer: `names` are those of the blocks.
    """
    layers = plane.layers()
    parts = [
        _obstacle(point, COLOURS[n % len(COLOURS)])
        for n, (_, _, points) in enumerate(layers)
        for point in _thinned(points)
    ]
    parts += [
        _block(pose, middle, half, COLOURS[n % len(COLOURS)], 1.0 if at == len(way) - 1 else 0.35)
        for at, pose in enumerate(way)
        for n, (middle, half, _) in enumerate(layers)
    ]
    points = " ".join(f"{u:.1f},{v:.1f}" for u, v in map(_pixel, way[:, :2]))
    parts.append(f'<polyline points="{points}" fill="none" stroke="#222" stroke-width="2"/>')
    legend = "".join(
        f'<rect x="12" y="{12 + 18 * n}" width="12" height="12" fill="{COLOURS[n % len(COLOURS)]}"/>'
        f'<text x="30" y="{23 + 18 * n}">{name} and what it could meet</text>'
        for n, name in enumerate(names)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIDE_PX} {SIDE_PX}" width="{SIDE_PX}" height="{SIDE_PX}">'
        f'<style>{STYLE}</style><rect width="100%" height="100%" fill="white"/>{"".join(parts)}{legend}</svg>\n'
    )


def _thinned(points: Floats) -> Iterator[Floats]:
    """One point of each place of the picture."""
    near = points[(np.abs(points) < REACH_M).all(axis=1)]
    if len(near):
        yield from near[np.unique(np.rint(near / 0.003), axis=0, return_index=True)[1]]


def _pixel(at: Floats) -> tuple[float, float]:
    """Where a place (2,) is in the picture: the hand comes from above."""
    scale = SIDE_PX / (2 * REACH_M)
    return SIDE_PX / 2 + scale * float(at[0]), SIDE_PX * 0.68 + scale * float(at[1])


def _obstacle(point: Floats, colour: str) -> str:
    u, v = _pixel(point)
    return f'<circle cx="{u:.1f}" cy="{v:.1f}" r="1.6" fill="{colour}" fill-opacity="0.55"/>'


def _block(pose: Floats, middle: Floats, half: Floats, colour: str, opacity: float) -> str:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    corners = middle + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    turned = corners @ np.array([[c, s], [-s, c]]) + pose[:2]
    points = " ".join(f"{u:.1f},{v:.1f}" for u, v in map(_pixel, turned))
    return f'<polygon points="{points}" fill="none" stroke="{colour}" stroke-width="1.8" stroke-opacity="{opacity}"/>'
