"""A picture as SVG: triangles painted from the farthest to the nearest, and notes over them.

A binary space partition in the coordinates of the picture (Fuchs, Kedem & Naylor 1980): the plane
of one triangle parts the others, and a triangle that crosses the plane is cut. Surfaces that pass
through each other are shown correctly, too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.stages.geometry.pictures.picture_notes import (
    KEY_PIXELS,
    RING_PIXELS,
    SIZE_PIXELS,
    LegendKey,
    PictureLabel,
    PictureNotes,
)
from cellwright.engine.stages.geometry.pictures.picture_surfaces import Colour, PictureCamera

FLAT_PIXELS = 1e-3  # a corner this near to a plane lies on it
FEW_TRIANGLES = 64  # triangles that are compared pair by pair
CUT_CANDIDATES = 6  # planes that are tried for each cut
CUT_COSTS = 8  # a cut triangle counts as much as this many triangles too many on one side


@dataclass(frozen=True, slots=True, eq=False)
class PaintedTriangles:
    """Triangles (m, 3, 3) that face the viewer, in pixels to the right, down and towards the
    viewer. Each has the number of the given triangle that it is a part of, and of its convex piece
    (m,).
    """

    corners: Floats
    source: Longs
    piece: Longs

    def at(self, chosen: Longs) -> "PaintedTriangles":
        """Some of the triangles."""
        return PaintedTriangles(self.corners[chosen], self.source[chosen], self.piece[chosen])


def back_to_front(corners: Floats, piece: Longs) -> tuple[Floats, Longs]:
    """Triangles (n, 3, 3) and the number of the given triangle that each is a part of (n,), the
    farthest first.

    `corners` (m, 3, 3) are in pixels to the right, down and towards the viewer; `piece` (m,) tells
    which triangles belong to one convex piece. Each triangle must face the viewer: those of one
    piece then never cover each other.
    """
    random = np.random.default_rng(0)
    waiting = [(PaintedTriangles(corners, np.arange(len(corners)), piece), False)]
    done = []
    while waiting:
        group, flat = waiting.pop()
        if flat or _in_any_order(group):
            done.append(group)
        else:
            behind, level, ahead = _part_by_plane(group, random)
            waiting += [(ahead, False), (level, True), (behind, False)]
    return np.concatenate([group.corners for group in done]), np.concatenate(
        [group.source for group in done]
    )


def _in_any_order(group: PaintedTriangles) -> bool:
    """Whether no triangle of the group can cover one of another piece."""
    if len(group.piece) < 2 or (group.piece == group.piece[0]).all():
        return True
    if len(group.piece) > FEW_TRIANGLES:
        return False
    low, high = group.corners[:, :, :2].min(axis=1), group.corners[:, :, :2].max(axis=1)
    meet = (low[:, None] < high[None]).all(axis=2) & (low[None] < high[:, None]).all(axis=2)
    return not (meet & (group.piece[:, None] != group.piece[None])).any()


def _part_by_plane(
    group: PaintedTriangles, random: np.random.Generator
) -> tuple[PaintedTriangles, PaintedTriangles, PaintedTriangles]:
    """What lies behind the plane of one triangle, on it, and before it."""
    tried = random.choice(
        len(group.corners), min(CUT_CANDIDATES, len(group.corners)), replace=False
    )
    tries = _plane_distances(group.corners, group.corners[tried])
    before, after = np.any(tries < -FLAT_PIXELS, axis=2), np.any(tries > FLAT_PIXELS, axis=2)
    costs = CUT_COSTS * (before & after).sum(axis=1) + np.abs(
        before.sum(axis=1) - after.sum(axis=1)
    )
    best = int(costs.argmin())
    behind, ahead, away = before[best], after[best], tries[best]
    cut = np.flatnonzero(behind & ahead)
    parts = [
        _join_groups(
            group.at(np.flatnonzero(side & ~opposite)), _cut_group(group.at(cut), sign * away[cut])
        )
        for side, opposite, sign in ((behind, ahead, -1.0), (ahead, behind, 1.0))
    ]
    return parts[0], group.at(np.flatnonzero(~behind & ~ahead)), parts[1]


def _plane_distances(corners: Floats, planes: Floats) -> Floats:
    """How far corners (m, 3, 3) lie before the planes of triangles (k, 3, 3), seen by the
    viewer: (k, m, 3).
    """
    normals = np.cross(planes[:, 1] - planes[:, 0], planes[:, 2] - planes[:, 0])
    normals *= np.sign(normals[:, 2:]) / np.linalg.norm(normals, axis=1, keepdims=True)
    away = np.einsum("kc,mvc->kmv", normals, corners)
    distances: Floats = away - np.einsum("kc,kc->k", normals, planes[:, 0])[:, None, None]
    return distances


def _join_groups(first: PaintedTriangles, second: PaintedTriangles) -> PaintedTriangles:
    return PaintedTriangles(
        *(
            np.concatenate([getattr(first, name), getattr(second, name)])
            for name in ("corners", "source", "piece")
        )
    )


def _cut_group(group: PaintedTriangles, away: Floats) -> PaintedTriangles:
    """The parts of triangles on the side where `away` (m, 3) is positive."""
    parts: list[Floats] = []
    of: list[int] = []
    for number, (corners, distances) in enumerate(zip(group.corners, away, strict=True)):
        polygon = _clip_triangle(corners, distances)
        parts += [
            np.stack([polygon[0], polygon[n], polygon[n + 1]]) for n in range(1, len(polygon) - 1)
        ]
        of += [number] * (len(polygon) - 2)
    shown = PaintedTriangles(np.array(parts).reshape(-1, 3, 3), group.source[of], group.piece[of])
    return shown.at(np.flatnonzero(np.abs(doubled_area(shown.corners)) > FLAT_PIXELS**2))


def _clip_triangle(corners: Floats, away: Floats) -> Sequence[Floats]:
    """The corners of the part of one triangle (3, 3) where `away` (3,) is positive, in their
    order.
    """
    clipped: list[Floats] = []
    for this, following in ((0, 1), (1, 2), (2, 0)):
        if away[this] >= 0:
            clipped.append(corners[this])
        if away[this] * away[following] < 0:
            share = away[this] / (away[this] - away[following])
            clipped.append(corners[this] + share * (corners[following] - corners[this]))
    return clipped


def doubled_area(corners: Floats) -> Floats:
    """Twice the area (m,) of triangles (m, 3, 3) in square pixels.

    It is negative for those that face the viewer.
    """
    a, b, c = (corners[:, k, :2] for k in range(3))
    areas: Floats = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (
        b[:, 1] - a[:, 1]
    )
    return areas


LEAST_PIXELS = 1e-3  # twice the area of a triangle that is seen edge on


def draw_svg(
    camera: PictureCamera,
    triangles: Floats,
    colours: Floats,
    pieces: Longs | None = None,
    notes: PictureNotes | None = None,
) -> str:
    """The SVG of triangles (m, 3, 3) with colours (m, 3).

    `pieces` (m,) are the numbers of their convex pieces; without them each triangle is a piece of
    its own.
    """
    pieces, notes = np.arange(len(triangles)) if pieces is None else pieces, notes or PictureNotes()
    fills = (np.clip(colours * camera.shade(triangles)[:, None], 0, 1) * 255 + 0.5).astype(int)
    seen = camera.project(triangles)
    seen[:, :, 2] *= camera.scale
    facing = np.flatnonzero(doubled_area(seen) < -LEAST_PIXELS)
    corners, source = back_to_front(seen[facing], pieces[facing])
    size = (
        f'width="{camera.width}" height="{camera.height}" viewBox="0 0 {camera.width} '
        f'{camera.height}"'
    )
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>',
        '<rect width="100%" height="100%" fill="white"/>',
        *(
            _svg_triangle(triangle, fills[facing[n]])
            for triangle, n in zip(corners, source, strict=True)
        ),
        *_svg_notes(notes),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _svg_triangle(corners: Floats, fill: Longs) -> str:
    """A triangle in SVG. Its outline has the colour of its face, to close the seams between
    neighbours.
    """
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners[:, :2])
    colour = "#{:02x}{:02x}{:02x}".format(*fill)
    return f'<polygon points="{points}" fill="{colour}" stroke="{colour}" stroke-width="1"/>'


def _svg_notes(notes: PictureNotes) -> Iterator[str]:
    for x, y in notes.rings:
        yield (
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{RING_PIXELS:g}" fill="none" '
            'stroke="#1a1a1a" stroke-width="3"/>'
        )
    for key in notes.legend:
        yield from _svg_key(key)
    for label in notes.labels:
        yield from _svg_label(label)


def _svg_key(key: LegendKey) -> Iterator[str]:
    (x, y), side = key.at, KEY_PIXELS
    yield (
        f'<rect class="key" x="{x:g}" y="{y:g}" width="{side}" height="{side}" '
        f'fill="{_hex_colour(key.colour)}"/>'
    )
    yield _svg_text(key.name, x + side + 6, y + side - 1)


def _svg_label(label: PictureLabel) -> Iterator[str]:
    """The name with a white rim, so that it can be read on every ground; a line to its point if
    that is far.
    """
    if label.far:
        (x, y), (to_x, to_y) = label.point, label.end
        yield f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{to_x:.1f}" y2="{to_y:.1f}" stroke="#555555"/>'
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2" fill="#555555"/>'
    rim = _svg_text(label.text, *label.at).replace(
        'fill="#1a1a1a"', 'class="rim" stroke="white" stroke-width="4" stroke-linejoin="round"'
    )
    yield from (rim, _svg_text(label.text, *label.at))


def _svg_text(words: str, x: float, y: float) -> str:
    at = f'x="{x:.1f}" y="{y:.1f}" font-family="sans-serif" font-size="{SIZE_PIXELS}"'
    return f'<text {at} fill="#1a1a1a">{escape(words)}</text>'


def _hex_colour(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*(round(part * 255) for part in colour))
