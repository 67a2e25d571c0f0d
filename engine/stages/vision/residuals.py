"""How far an outline is off, edge by edge: chance moves single places of it, but not a whole edge one way.

A part of nearly the right size agrees with most of an image, place by place. Along an edge of n places, chance averages out as
1 / sqrt(n), so the median tells what single places cannot: that the measured surface ends elsewhere. A place at a corner, where another
thing begins, does not change it.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.geometry import Floats, Longs
from cellwright.engine.model.vision import Camera
from cellwright.engine.stages.vision.hypotheses import Model

PIECE_PX = 24.0  # edges are looked at in pieces about so long: a turned edge is off one way at each end
LEAST = 12  # places that tell of a piece
BESIDE_PX, ALONG = 1.5, 0.9  # how far a place may be from its edge, and the cosine between their normals
PIXEL = 0.5  # of it: two pixels side by side are twice that apart, and two at a corner are more
SHORT_PX = 4.0  # edges that look shorter are left out


@dataclass(frozen=True, slots=True, eq=False)
class Beside:
    """Places of an outline and the edges they are on: how far (n,) outside of its edge, along the `outward` normal (n, 2), the measured surface ends.

    It is nan where no edge is near or no end is seen. `piece` (n,) numbers the pieces of all edges.
    """

    outward: Floats
    beyond_px: Floats
    piece: Longs


def beside_edges(
    model: Model, camera: Camera, T: Floats, at: Floats, outward: Floats, ended: Floats
) -> Beside:
    """The places (n, 2) of a part's outline at T_camera_part (4, 4), each with its edge.

    `outward` (n, 2) are the directions there. Between both pixels of `ended` (n, 2, 2) the measured surface ends; they are nan where this is not seen.
    They are compared with the edges themselves and not with the pixels that show the part: along a row of pixels these would be off by up to
    one where nothing is. Of edges that lie side by side, such as those of a face that is seen edge on, the outer one makes the outline.
    """
    ends = _edges(model, camera, T)
    if not len(ends):
        return Beside(outward, np.full(len(at), np.nan), np.zeros(len(at), dtype=np.int64))
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    share = np.clip(((at[:, None] - ends[:, 0]) * along).sum(axis=2) / length**2, 0.0, 1.0)
    to = ends[:, 0] + share[..., None] * along - at[:, None]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    cosine = outward @ normal.T
    near = (np.linalg.norm(to, axis=2) < BESIDE_PX) & (np.abs(cosine) > ALONG)
    farthest = np.where(near, (to * outward[:, None]).sum(axis=2), -np.inf)
    own, row = farthest.argmax(axis=1), np.arange(len(at))
    out = normal[own] * np.sign(cosine[row, own])[:, None]
    last, following = ((ended - ends[own, None, 0]) * out[:, None]).sum(axis=2).T
    middle, unseen = (last + following) / 2, np.maximum((following - last) / 2 - PIXEL, 0.0)
    beyond = np.sign(middle) * np.maximum(np.abs(middle) - unseen, 0.0)
    pieces = np.maximum(np.rint(length / PIECE_PX), 1.0)
    number = np.minimum(np.floor(share[row, own] * pieces[own]), pieces[own] - 1)
    first = np.concatenate([[0.0], np.cumsum(pieces)])
    return Beside(out, np.where(near[row, own], beyond, np.nan), (first[own] + number).astype(np.int64))


def off_px(beside: Beside) -> float:
    """By how many pixels, in the median, that piece of an outline's edges is off that is off most; 0 if no piece is seen well."""
    told = ~np.isnan(beside.beyond_px)
    piece, beyond = beside.piece[told], beside.beyond_px[told]
    order = np.argsort(piece, kind="stable")
    pieces = np.split(beyond[order], np.nonzero(np.diff(piece[order]))[0] + 1)
    return max((abs(float(np.median(each))) for each in pieces if len(each) >= LEAST), default=0.0)


def _edges(model: Model, camera: Camera, T: Floats) -> Floats:
    """The edges of a part in the picture (e, 2, 2), each as two ends (u, v), without short ones."""
    corners = apply(T, model.ends.reshape(-1, 3)).reshape(-1, 2, 3)
    corners = corners[corners[:, :, 2].min(axis=1) > 1e-3]
    ends = np.stack(camera.pixels(corners), axis=-1)
    found: Floats = ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > SHORT_PX]
    return found
