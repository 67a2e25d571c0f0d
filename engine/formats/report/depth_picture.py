"""A depth image as a picture: near is light, far is dark, nothing is blue; the edges of parts are drawn over it."""

import io
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.ranging import Window
from cellwright.engine.model.solid import Solid
from cellwright.engine.model.vision import DepthImage

NOTHING, EDGE, FOUND = (70, 90, 160), (230, 60, 40), (40, 190, 220)
POSSIBLE, CHOSEN, SHORT, LONG = (60, 200, 90), (250, 210, 40), 1, 4
BACK_M = 0.04  # how far a line that stands for a hand goes back


Hands = Sequence[tuple[Floats, float, bool]]


def picture(
    image: DepthImage,
    parts: Sequence[tuple[Solid, Floats]] = (),
    hands: Hands = (),
    edges: Sequence[tuple[Floats, Floats]] = (),
    notes: Sequence[tuple[Window, str]] = (),
) -> bytes:
    """The PNG of a depth image, with the edges of solids at poses T_camera_part (4, 4).

    Each of `hands` is a pose T_camera_hand (4, 4), the width to which it closes, and whether it is the chosen one. It is drawn as
    the line between its pads, and one back to the hand; the chosen one is yellow, all others are green. `edges` that were found in the
    image, each with both ends (2,) as (u, v), are cyan. `notes` are frames with what is said of them.
    """
    drawn = _grey(image.depth)
    pen = ImageDraw.Draw(drawn)
    for one, other in edges:
        line = [(float(one[0]), float(one[1])), (float(other[0]), float(other[1]))]
        pen.line(line, fill=FOUND, width=3)
    for solid, T_camera_part in parts:
        for facet in solid.facets:
            for ends in facet.edges:
                u, v = image.camera.pixels(apply(T_camera_part, ends))
                pen.line([(u[0], v[0]), (u[1], v[1])], fill=EDGE)
    for T, width_m, chosen in sorted(hands, key=lambda each: each[2]):
        half = width_m / 2
        ends = np.array([[-half, 0, -BACK_M], [-half, 0, 0], [half, 0, 0], [half, 0, -BACK_M]])
        u, v = image.camera.pixels(apply(T, ends))
        hand = [(float(x), float(y)) for x, y in zip(u, v, strict=True)]
        pen.line(hand, fill=CHOSEN if chosen else POSSIBLE, width=LONG if chosen else SHORT)
    for window, said in notes:
        pen.rectangle((window.left, window.top, window.right, window.bottom), outline=CHOSEN)
        pen.text((window.left + 3, window.top + 2), said, fill=CHOSEN)
    made = io.BytesIO()
    drawn.save(made, "PNG")
    return made.getvalue()


def _grey(depth: Floats) -> Image.Image:
    """Depths (rows, columns) in metres as greys: near is light, and what was not seen has a colour of its own."""
    seen = depth > 0
    low, high = (float(x) for x in np.percentile(depth[seen], (0.5, 99.5))) if seen.any() else (0.0, 1.0)
    grey = (235 - 200 * np.clip((depth - low) / max(high - low, 1e-6), 0, 1)).astype(np.uint8)
    shown = np.where(seen[..., None], grey[..., None], np.array(NOTHING, dtype=np.uint8))
    return Image.fromarray(shown.astype(np.uint8))
