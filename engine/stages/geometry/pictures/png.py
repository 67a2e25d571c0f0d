"""A picture as PNG: triangles are drawn into a depth buffer at twice the size; halving the picture then
smooths the edges.
"""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from engine.model.geometry import Floats
from engine.stages.geometry.pictures.camera import Camera

OVER = 2  # how much larger the picture is drawn before it is reduced
RING_PIXELS = (9.0, 13.0)  # inner and outer radius of the ring around a contact


def draw(camera: Camera, triangles: Floats, colours: Floats, marks: Sequence[Floats] = ()) -> bytes:
    """The PNG of triangles (m, 3, 3) with colours (m, 3), and a ring around each marked point (3,)."""
    large = replace(camera, scale=camera.scale * OVER, width=camera.width * OVER, height=camera.height * OVER)
    image = np.ones((large.height, large.width, 3))
    depth = np.full(image.shape[:2], -np.inf)
    shown = colours * large.shade(triangles)[:, None]
    for corners, colour in zip(large.project(triangles), shown, strict=True):
        _fill(image, depth, corners, colour)
    for point in marks:
        _ring(image, large.project(point))
    small = image.reshape(camera.height, OVER, camera.width, OVER, 3).mean(axis=(1, 3))
    return _encoded((small.clip(0.0, 1.0) * 255 + 0.5).astype(np.uint8))


def _fill(image: Floats, depth: Floats, corners: Floats, colour: Floats) -> None:
    """Colours the pixels whose middle lies in a triangle (3, 3), where the triangle is nearer than what was
    drawn before.
    """
    low = np.maximum(np.floor(corners[:, :2].min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(corners[:, :2].max(axis=0)).astype(int) + 1, image.shape[1::-1])
    (ax, ay), (bx, by), (cx, cy) = corners[:, :2]
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if abs(area) < 1e-12 or (low >= high).any():
        return
    x = np.arange(low[0], high[0])[None] + 0.5
    y = np.arange(low[1], high[1])[:, None] + 0.5
    u = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
    v = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
    z = u * corners[0, 2] + v * corners[1, 2] + (1 - u - v) * corners[2, 2]
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    nearer = (u >= 0) & (v >= 0) & (u + v <= 1) & (z > depth[window])
    depth[window][nearer] = z[nearer]
    image[window][nearer] = colour


def _ring(image: Floats, at: Floats) -> None:
    """Draws a dark ring over everything else."""
    y, x = np.ogrid[: image.shape[0], : image.shape[1]]
    away = np.hypot(x + 0.5 - at[0], y + 0.5 - at[1]) / OVER
    image[(away >= RING_PIXELS[0]) & (away <= RING_PIXELS[1])] = (0.1, 0.1, 0.1)


def _encoded(pixels: NDArray[np.uint8]) -> bytes:
    """Pixels (height, width, 3) as PNG: a filter byte of 0 (no filter) stands before each row."""
    height, width, _ = pixels.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)], axis=1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, content) for kind, content in parts)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
