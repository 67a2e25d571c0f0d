"""A depth image as a picture: near is light, far is dark, nothing is blue; the edges of a part are drawn over it."""

import io

import numpy as np
from PIL import Image, ImageDraw

from engine.kernels.rigid import apply
from engine.model.geometry import Floats
from engine.model.solid import Solid
from engine.model.vision import DepthImage

NOTHING, EDGE = (70, 90, 160), (230, 60, 40)


def picture(image: DepthImage, solid: Solid | None = None, T_camera_part: Floats | None = None) -> bytes:
    """The PNG of a depth image, with the edges of a solid at a pose (4, 4), if there is one."""
    depth = image.depth
    seen = depth > 0
    low, high = (float(x) for x in np.percentile(depth[seen], (0.5, 99.5))) if seen.any() else (0.0, 1.0)
    grey = (235 - 200 * np.clip((depth - low) / max(high - low, 1e-6), 0, 1)).astype(np.uint8)
    shown = np.where(seen[..., None], grey[..., None], np.array(NOTHING, dtype=np.uint8))
    drawn = Image.fromarray(shown.astype(np.uint8))
    if solid is not None and T_camera_part is not None:
        pen = ImageDraw.Draw(drawn)
        for facet in solid.facets:
            for ends in facet.edges:
                u, v = image.camera.pixels(apply(T_camera_part, ends))
                pen.line([(u[0], v[0]), (u[1], v[1])], fill=EDGE)
    made = io.BytesIO()
    drawn.save(made, "PNG")
    return made.getvalue()
