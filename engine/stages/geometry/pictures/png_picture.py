"""A picture as PNG: triangles drawn into a depth buffer at twice the size, then halved."""

import io
from dataclasses import replace

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry.pictures.picture_notes import (
    KEY_PIXELS,
    RING_PIXELS,
    SIZE_PIXELS,
    LegendKey,
    PictureLabel,
    PictureNotes,
)
from cellwright.engine.stages.geometry.pictures.picture_surfaces import Colour, PictureCamera
from cellwright.engine.stages.geometry.pictures.raster import fill

OVERSAMPLING = 2  # how much larger the picture is drawn before it is reduced
INK, LEAD = (26, 26, 26), (85, 85, 85)


def draw_png(
    camera: PictureCamera, triangles: Floats, colours: Floats, notes: PictureNotes | None = None
) -> bytes:
    """The PNG of triangles (m, 3, 3) with colours (m, 3), from 0 to 1."""
    large = replace(
        camera,
        scale=camera.scale * OVERSAMPLING,
        width=camera.width * OVERSAMPLING,
        height=camera.height * OVERSAMPLING,
    )
    blank = np.ones((large.height, large.width, 3))
    image = fill(blank, large.project(triangles), colours * large.shade(triangles)[:, None])
    small = image.reshape(camera.height, OVERSAMPLING, camera.width, OVERSAMPLING, 3).mean(
        axis=(1, 3)
    )
    picture = Image.fromarray((small.clip(0.0, 1.0) * 255 + 0.5).astype(np.uint8))
    _draw_notes(picture, notes or PictureNotes())
    png = io.BytesIO()
    picture.save(png, "PNG", optimize=True)
    return png.getvalue()


def _draw_notes(picture: Image.Image, notes: PictureNotes) -> None:
    """Rings, legend and labels, drawn over everything else."""
    pen = ImageDraw.Draw(picture)
    font = ImageFont.load_default(SIZE_PIXELS)
    for x, y in notes.rings:
        box = (x - RING_PIXELS, y - RING_PIXELS, x + RING_PIXELS, y + RING_PIXELS)
        pen.ellipse(box, outline=INK, width=3)
    for key in notes.legend:
        _draw_key(pen, font, key)
    for label in notes.labels:
        _draw_label(pen, font, label)


def _draw_key(
    pen: ImageDraw.ImageDraw, font: ImageFont.ImageFont | ImageFont.FreeTypeFont, key: LegendKey
) -> None:
    x, y = key.at
    pen.rectangle((x, y, x + KEY_PIXELS, y + KEY_PIXELS), fill=_colour_bytes(key.colour))
    pen.text((x + KEY_PIXELS + 6, y + KEY_PIXELS - 1), key.name, INK, font, anchor="ls")


def _draw_label(
    pen: ImageDraw.ImageDraw,
    font: ImageFont.ImageFont | ImageFont.FreeTypeFont,
    label: PictureLabel,
) -> None:
    """The name with a white rim, so that it can be read on every ground; a line to its point if
    that is far.
    """
    if label.far:
        x, y = label.point
        pen.line((label.point, label.end), fill=LEAD)
        pen.ellipse((x - 2, y - 2, x + 2, y + 2), fill=LEAD)
    pen.text(label.at, label.text, INK, font, anchor="ls", stroke_width=2, stroke_fill="white")


def _colour_bytes(colour: Colour) -> tuple[int, int, int]:
    red, green, blue = (round(part * 255) for part in colour)
    return red, green, blue
