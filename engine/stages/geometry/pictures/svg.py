"""A picture as SVG: triangles that face the viewer, painted from the farthest to the nearest, and notes over them."""

from collections.abc import Iterator
from xml.sax.saxutils import escape

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs
from cellwright.engine.stages.geometry.pictures.camera import Camera
from cellwright.engine.stages.geometry.pictures.labels import SIZE_PIXELS, Label
from cellwright.engine.stages.geometry.pictures.notes import KEY_PIXELS, RING_PIXELS, Key, Notes
from cellwright.engine.stages.geometry.pictures.painting import back_to_front, doubled_area
from cellwright.engine.stages.geometry.pictures.surfaces import Colour

LEAST_PIXELS = 1e-3  # twice the area of a triangle that is seen edge on


def draw(
    camera: Camera,
    triangles: Floats,
    colours: Floats,
    pieces: Longs | None = None,
    notes: Notes | None = None,
) -> str:
    """The SVG of triangles (m, 3, 3) with colours (m, 3).

    `pieces` (m,) are the numbers of their convex pieces; without them each triangle is a piece of its own.
    """
    pieces, notes = np.arange(len(triangles)) if pieces is None else pieces, notes or Notes()
    fills = (np.clip(colours * camera.shade(triangles)[:, None], 0, 1) * 255 + 0.5).astype(int)
    seen = camera.project(triangles)
    seen[:, :, 2] *= camera.scale
    facing = np.flatnonzero(doubled_area(seen) < -LEAST_PIXELS)
    corners, source = back_to_front(seen[facing], pieces[facing])
    size = f'width="{camera.width}" height="{camera.height}" viewBox="0 0 {camera.width} {camera.height}"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>',
        '<rect width="100%" height="100%" fill="white"/>',
        *(_triangle(each, fills[facing[n]]) for each, n in zip(corners, source, strict=True)),
        *_noted(notes),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _triangle(corners: Floats, fill: Longs) -> str:
    """A triangle in SVG. Its outline has the colour of its face, to close the seams between neighbours."""
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners[:, :2])
    colour = "#{:02x}{:02x}{:02x}".format(*fill)
    return f'<polygon points="{points}" fill="{colour}" stroke="{colour}" stroke-width="1"/>'


def _noted(notes: Notes) -> Iterator[str]:
    for x, y in notes.rings:
        yield (
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{RING_PIXELS:g}" fill="none" stroke="#1a1a1a" stroke-width="3"/>'
        )
    for key in notes.legend:
        yield from _key(key)
    for label in notes.labels:
        yield from _label(label)


def _key(key: Key) -> Iterator[str]:
    (x, y), side = key.at, KEY_PIXELS
    yield f'<rect class="key" x="{x:g}" y="{y:g}" width="{side}" height="{side}" fill="{_hex(key.colour)}"/>'
    yield _text(key.name, x + side + 6, y + side - 1)


def _label(label: Label) -> Iterator[str]:
    """The name with a white rim, so that it can be read on every ground; a line to its point if that is far."""
    if label.far:
        (x, y), (to_x, to_y) = label.point, label.end
        yield f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{to_x:.1f}" y2="{to_y:.1f}" stroke="#555555"/>'
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2" fill="#555555"/>'
    rim = _text(label.text, *label.at).replace(
        'fill="#1a1a1a"', 'class="rim" stroke="white" stroke-width="4" stroke-linejoin="round"'
    )
    yield from (rim, _text(label.text, *label.at))


def _text(said: str, x: float, y: float) -> str:
    at = f'x="{x:.1f}" y="{y:.1f}" font-family="sans-serif" font-size="{SIZE_PIXELS}"'
    return f'<text {at} fill="#1a1a1a">{escape(said)}</text>'


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*(round(part * 255) for part in colour))
