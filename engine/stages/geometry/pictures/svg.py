"""A picture as SVG: the triangles that face the viewer, the farthest first.

Large ones are split so that this order is right.
"""

from collections.abc import Sequence
from xml.sax.saxutils import escape

import numpy as np

from engine.model.geometry import Contact, Floats
from engine.stages.geometry.pictures.camera import Camera

LONGEST_PIXELS = 60.0  # longer edges are split
SPLITS = 6


def draw(camera: Camera, triangles: Floats, colours: Floats, contacts: Sequence[Contact] = ()) -> str:
    """The SVG of triangles (m, 3, 3) with colours (m, 3). Each contact has a ring and a name."""
    shown = (np.clip(colours * camera.shade(triangles)[:, None], 0, 1) * 255 + 0.5).astype(int)
    seen, fills = _facing(camera.project(triangles), shown)
    for _ in range(SPLITS):
        seen, fills = _split(seen, fills)
    order = np.argsort(seen[:, :, 2].mean(axis=1), kind="stable")
    lines = [_triangle(seen[n], fills[n]) for n in order]
    size = f'width="{camera.width}" height="{camera.height}" viewBox="0 0 {camera.width} {camera.height}"'
    marks = [line for contact in contacts for line in _mark(camera, contact)]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>'
    return (
        "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *lines, *marks, "</svg>"]) + "\n"
    )


def _facing(seen: Floats, fills: Floats) -> tuple[Floats, Floats]:
    """The triangles that show their outside: the order of their corners tells it (pixels count downwards)."""
    a, b, c = (seen[:, k, :2] for k in range(3))
    ahead = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1]) < 0
    return seen[ahead], fills[ahead]


def _split(seen: Floats, fills: Floats) -> tuple[Floats, Floats]:
    """The triangles, where each one with an edge that is too long is halved across its longest edge."""
    edges = np.linalg.norm(seen[:, [1, 2, 0], :2] - seen[:, :, :2], axis=2)
    longest = edges.argmax(axis=1)
    large = edges.max(axis=1) > LONGEST_PIXELS
    turned = np.take_along_axis(seen, ((longest[:, None] + np.arange(3)) % 3)[:, :, None], axis=1)[large]
    middle = (turned[:, 0] + turned[:, 1]) / 2
    halves = [
        np.stack([turned[:, 0], middle, turned[:, 2]], 1),
        np.stack([middle, turned[:, 1], turned[:, 2]], 1),
    ]
    return np.concatenate([seen[~large], *halves]), np.concatenate(
        [fills[~large], fills[large], fills[large]]
    )


def _triangle(corners: Floats, fill: Floats) -> str:
    """A triangle in SVG. Its outline has the colour of its face, to close the seams between neighbours."""
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners[:, :2])
    colour = "#{:02x}{:02x}{:02x}".format(*fill)
    return f'<polygon points="{points}" fill="{colour}" stroke="{colour}" stroke-width="0.6"/>'


def _mark(camera: Camera, contact: Contact) -> list[str]:
    x, y, _ = camera.project((contact.point_first + contact.point_second) / 2)
    said = escape(f"{contact.first} / {contact.second}: {contact.depth_m * 1000:.1f} mm")
    return [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="11" fill="none" stroke="#1a1a1a" stroke-width="3"/>',
        f'<text x="{x + 16:.1f}" y="{y + 5:.1f}" font-family="sans-serif" font-size="14">{said}</text>',
    ]
