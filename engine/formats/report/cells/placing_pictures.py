"""Pictures of placing a part: depth image, grasp plane, and graph of placements."""

import io
import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from xml.sax.saxutils import escape

import numpy as np
from PIL import Image, ImageDraw

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.vision import DepthImage, PixelWindow
from cellwright.engine.pipelines.manipulation.placement_views import GOAL, START, RegraspGraph
from cellwright.engine.stages.grasping.grasp_approach import GraspPlane

NOTHING, EDGE, FOUND = (70, 90, 160), (230, 60, 40), (40, 190, 220)
POSSIBLE, CHOSEN, SHORT, LONG = (60, 200, 90), (250, 210, 40), 1, 4
HAND_LINE_M = 0.04  # how far a line that stands for a hand goes back


Hands = Sequence[tuple[Floats, float, bool]]


def depth_png(
    image: DepthImage,
    parts: Sequence[tuple[Solid, Floats]] = (),
    hands: Hands = (),
    edges: Sequence[tuple[Floats, Floats]] = (),
    notes: Sequence[tuple[PixelWindow, str]] = (),
) -> bytes:
    """The PNG of a depth image, with the edges of solids at poses T_camera_part (4, 4).

    Each of `hands` is a pose T_camera_hand (4, 4), the width to which it closes, and whether it is
    the chosen one. It is drawn as the line between its pads, and one back to the hand; the chosen
    one is yellow, all others are green. `edges` that were found in the image, each with both ends
    (2,) as (u, v), are cyan. `notes` are frames with what is said of them.
    """
    drawn = _depth_greys(image.depth)
    pen = ImageDraw.Draw(drawn)
    for edge_start, edge_end in edges:
        line = [
            (float(edge_start[0]), float(edge_start[1])),
            (float(edge_end[0]), float(edge_end[1])),
        ]
        pen.line(line, fill=FOUND, width=3)
    for solid, T_camera_part in parts:
        for facet in solid.facets:
            for ends in facet.edges:
                u, v = image.camera.pixels(apply(T_camera_part, ends))
                pen.line([(u[0], v[0]), (u[1], v[1])], fill=EDGE)
    for T, width_m, chosen in sorted(hands, key=lambda hand_line: hand_line[2]):
        half = width_m / 2
        ends = np.array(
            [[-half, 0, -HAND_LINE_M], [-half, 0, 0], [half, 0, 0], [half, 0, -HAND_LINE_M]]
        )
        u, v = image.camera.pixels(apply(T, ends))
        hand = [(float(x), float(y)) for x, y in zip(u, v, strict=True)]
        pen.line(hand, fill=CHOSEN if chosen else POSSIBLE, width=LONG if chosen else SHORT)
    for window, note in notes:
        pen.rectangle((window.left, window.top, window.right, window.bottom), outline=CHOSEN)
        pen.text((window.left + 3, window.top + 2), note, fill=CHOSEN)
    png_buffer = io.BytesIO()
    drawn.save(png_buffer, "PNG")
    return png_buffer.getvalue()


def _depth_greys(depth: Floats) -> Image.Image:
    """Depths (rows, columns) in metres as greys: near is light, and what was not seen has a
    colour of its own.
    """
    seen = depth > 0
    low, high = (
        (float(x) for x in np.percentile(depth[seen], (0.5, 99.5))) if seen.any() else (0.0, 1.0)
    )
    grey = (235 - 200 * np.clip((depth - low) / max(high - low, 1e-6), 0, 1)).astype(np.uint8)
    shown = np.where(seen[..., None], grey[..., None], np.array(NOTHING, dtype=np.uint8))
    return Image.fromarray(shown.astype(np.uint8))


SIDE_PX, REACH_M = 640, 0.26
LAYER_COLOURS = ("#c2452d", "#2d6fc2", "#2e8b57", "#8a5a9e", "#b8860b")
GRASP_PLANE_STYLE = "text{font:13px sans-serif;fill:#222}"


def grasp_plane_svg(plane: GraspPlane, way: Floats, names: Sequence[str]) -> str:
    """The SVG of a plane, seen along the closing direction, with the hand at some poses (n, 3) of
    its way and at the grasp.

    Obstacles and blocks of the hand have the colour of their layer: `names` are those of the
    blocks.
    """
    layers = plane.layers()
    parts = [
        _obstacle_dot(point, LAYER_COLOURS[n % len(LAYER_COLOURS)])
        for n, (_, _, points) in enumerate(layers)
        for point in _thin_points(points)
    ]
    parts += [
        _hand_block(
            pose,
            middle,
            half,
            LAYER_COLOURS[n % len(LAYER_COLOURS)],
            1.0 if at == len(way) - 1 else 0.35,
        )
        for at, pose in enumerate(way)
        for n, (middle, half, _) in enumerate(layers)
    ]
    points = " ".join(f"{u:.1f},{v:.1f}" for u, v in map(_pixel_of, way[:, :2]))
    parts.append(f'<polyline points="{points}" fill="none" stroke="#222" stroke-width="2"/>')
    legend = "".join(
        f'<rect x="12" y="{12 + 18 * n}" width="12" height="12" '
        f'fill="{LAYER_COLOURS[n % len(LAYER_COLOURS)]}"/>'
        f'<text x="30" y="{23 + 18 * n}">{name} and what it could meet</text>'
        for n, name in enumerate(names)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIDE_PX} {SIDE_PX}" '
        f'width="{SIDE_PX}" height="{SIDE_PX}">'
        f'<style>{GRASP_PLANE_STYLE}</style><rect width="100%" height="100%" '
        f'fill="white"/>{"".join(parts)}{legend}</svg>\n'
    )


def _thin_points(points: Floats) -> Iterator[Floats]:
    """One point of each place of the picture."""
    near = points[(np.abs(points) < REACH_M).all(axis=1)]
    if len(near):
        yield from near[np.unique(np.rint(near / 0.003), axis=0, return_index=True)[1]]


def _pixel_of(at: Floats) -> tuple[float, float]:
    """Where a place (2,) is in the picture: the hand comes from above."""
    scale = SIDE_PX / (2 * REACH_M)
    return SIDE_PX / 2 + scale * float(at[0]), SIDE_PX * 0.68 + scale * float(at[1])


def _obstacle_dot(point: Floats, colour: str) -> str:
    u, v = _pixel_of(point)
    return f'<circle cx="{u:.1f}" cy="{v:.1f}" r="1.6" fill="{colour}" fill-opacity="0.55"/>'


def _hand_block(pose: Floats, middle: Floats, half: Floats, colour: str, opacity: float) -> str:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    corners = middle + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    turned = corners @ np.array([[c, s], [-s, c]]) + pose[:2]
    points = " ".join(f"{u:.1f},{v:.1f}" for u, v in map(_pixel_of, turned))
    return (
        f'<polygon points="{points}" fill="none" stroke="{colour}" stroke-width="1.8" '
        f'stroke-opacity="{opacity}"/>'
    )


WIDTH, HEIGHT, RADIUS = 760, 560, 34
PLACEMENTS_STYLE = """text{font:13px sans-serif;text-anchor:middle;fill:#222}
.e{stroke:#b9c0c8;stroke-width:1.5}.t{stroke:#d39b00;stroke-width:4}
.n{fill:#eef2f6;stroke:#5b6b7b;stroke-width:1.5}.u{fill:#f7f7f7;stroke:#bbb}.c{fill:#ffe9ad;stroke:#d39b00;stroke-width:2.5}
.k{font-size:11px;fill:#555}"""


def placements_svg(shown: RegraspGraph, part: str) -> str:
    """The SVG of a graph of placements."""
    lines = "".join((*_placement_edges(shown), *_placement_nodes(shown)))
    caption = (
        f"Where {part} may lie: in a circle the holds that serve there, on a line those that "
        "serve at both ends"
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'width="{WIDTH}" height="{HEIGHT}">'
        f'<style>{PLACEMENTS_STYLE}</style><rect width="100%" height="100%" fill="white"/>'
        f'<text x="{WIDTH / 2}" y="24">{escape(caption)}</text>{lines}</svg>\n'
    )


def _placement_spots(shown: RegraspGraph) -> dict[str, tuple[float, float]]:
    """The start on the left, the goal on the right, and the facets on an arc above and one
    below.
    """
    facets = [name for name in shown.holds if name not in (START, GOAL)]
    spot_of = {START: (70.0, HEIGHT / 2), GOAL: (WIDTH - 70.0, HEIGHT / 2)}
    upper = (len(facets) + 1) // 2
    for row, sense in ((facets[:upper], -1), (facets[upper:], 1)):
        for n, name in enumerate(row):
            angle = math.pi * (n + 0.5) / len(row)
            spot_of[name] = (
                WIDTH / 2 - 235 * math.cos(angle),
                HEIGHT / 2 + 10 + sense * 200 * math.sin(angle),
            )
    return spot_of


def _placement_edges(shown: RegraspGraph) -> Iterator[str]:
    places, taken = _placement_spots(shown), {frozenset(pair) for pair in pairwise(shown.taken)}
    order = sorted(shown.ways.items(), key=lambda way_count: frozenset(way_count[0]) in taken)
    for (first_placement, second_placement), count in order:
        (x1, y1), (x2, y2) = places[first_placement], places[second_placement]
        kind = "t" if frozenset((first_placement, second_placement)) in taken else "e"
        yield f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'
        if kind == "t":
            x, y = (x1 + x2) / 2, (y1 + y2) / 2 - 7
            yield f'<text x="{x:.1f}" y="{y:.1f}">{count}</text>'


def _placement_nodes(shown: RegraspGraph) -> Iterator[str]:
    for name, (x, y) in _placement_spots(shown).items():
        kind = "c" if name in shown.taken else "n" if shown.holds[name] else "u"
        yield f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{RADIUS}"/>'
        yield f'<text x="{x:.1f}" y="{y:.1f}">{escape(name)}</text>'
        yield f'<text class="k" x="{x:.1f}" y="{y + 16:.1f}">{shown.holds[name]}</text>'
