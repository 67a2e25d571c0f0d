"""A picture as PNG: triangles are drawn into a depth buffer at twice the size; halving the picture then smooths the edges.
Notes are written over it by Pillow.
"""

import io
from dataclasses import replace

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.geometry.pictures.camera import Camera
from cellwright.engine.stages.geometry.pictures.labels import SIZE_PIXELS, Label
from cellwright.engine.stages.geometry.pictures.notes import KEY_PIXELS, RING_PIXELS, Key, Notes
from cellwright.engine.stages.geometry.pictures.raster import fill
from cellwright.engine.stages.geometry.pictures.surfaces import Colour

OVER = 2  # how much larger the picture is drawn before it is reduced
INK, LEAD = (26, 26, 26), (85, 85, 85)


def draw(camera: Camera, triangles: Floats, colours: Floats, notes: Notes | None = None) -> bytes:
    """The PNG of triangles (m, 3, 3) with colours (m, 3), from 0 to 1."""
    large = replace(camera, scale=camera.scale * OVER, width=camera.width * OVER, height=camera.height * OVER)
    blank = np.ones((large.height, large.width, 3))
    image = fill(blank, large.project(triangles), colours * large.shade(triangles)[:, None])
    small = image.reshape(camera.height, OVER, camera.width, OVER, 3).mean(axis=(1, 3))
    picture = Image.fromarray((small.clip(0.0, 1.0) * 255 + 0.5).astype(np.uint8))
    _write(picture, notes or Notes())
    made = io.BytesIO()
    picture.save(made, "PNG", optimize=True)
    return made.getvalue()


def _write(picture: Image.Image, notes: Notes) -> None:
    """Rings, legend and labels, drawn over everything else."""
    pen = ImageDraw.Draw(picture)
    font = ImageFont.load_default(SIZE_PIXELS)
    for x, y in notes.rings:
        box = (x - RING_PIXELS, y - RING_PIXELS, x + RING_PIXELS, y + RING_PIXELS)
        pen.ellipse(box, outline=INK, width=3)
    for key in notes.legend:
        _key(pen, font, key)
    for label in notes.labels:
        _label(pen, font, label)


def _key(pen: ImageDraw.ImageDraw, font: ImageFont.ImageFont | ImageFont.FreeTypeFont, key: Key) -> None:
    x, y = key.at
    pen.rectangle((x, y, x + KEY_PIXELS, y + KEY_PIXELS), fill=_bytes(key.colour))
    pen.text((x + KEY_PIXELS + 6, y + KEY_PIXELS - 1), key.name, INK, font, anchor="ls")


def _label(
    pen: ImageDraw.ImageDraw, font: ImageFont.ImageFont | ImageFont.FreeTypeFont, label: Label
) -> None:
    """The name with a white rim, so that it can be read on every ground; a line to its point if that is far."""
    if label.far:
        x, y = label.point
        pen.line((label.point, label.end), fill=LEAD)
        pen.ellipse((x - 2, y - 2, x + 2, y + 2), fill=LEAD)
    pen.text(label.at, label.text, INK, font, anchor="ls", stroke_width=2, stroke_fill="white")


def _bytes(colour: Colour) -> tuple[int, int, int]:
    red, green, blue = (round(part * 255) for part in colour)
    return red, green, blue
