"""How far an outline is off, edge by edge: chance moves single places of it, but not a whole edge one way.

A part of nearly the right size agrees with most of an image, place by place. Along an edge of n places, chance averages out as
1 / sqrt(n), so the mean tells what single places cannot: that the measured surface ends elsewhere.
"""

import numpy as np

from engine.kernels.rigid import apply
from engine.model.geometry import Floats, Longs, Truths
from engine.model.vision import Camera
from engine.stages.vision.hypotheses import Model

PIECE_PX = 24.0  # edges are looked at in pieces about so long: a turned edge is off one way at each end
LEAST = 12  # places that tell of a piece
BESIDE_PX, ALONG = 1.5, 0.9  # how far a place may be from its edge, and the cosine between their normals
SHORT_PX = 4.0  # edges that look shorter are left out


def outline_off_px(
    model: Model, camera: Camera, T: Floats, at: Floats, outward: Floats, shift_px: Floats
) -> float:
    """By how many pixels, on average, that piece of an outline's edges is off that is off most; 0 if no piece is seen well.

    `at` (n, 2) are places of the outline of a part at T_camera_part (4, 4), `outward` (n, 2) the directions there, and `shift_px` (n,)
    how far outside of them the measured surface ends, nan where this is not seen.
    """
    ends = _edges(model, camera, T)
    told = ~np.isnan(shift_px)
    if not len(ends) or told.sum() < LEAST:
        return 0.0
    piece, near = _pieces(ends, at[told], outward[told])
    if not near.any():
        return 0.0
    count = np.bincount(piece[near])
    total = np.bincount(piece[near], weights=shift_px[told][near])
    enough = count >= LEAST
    return float(np.abs(total[enough] / count[enough]).max(initial=0.0))


def _edges(model: Model, camera: Camera, T: Floats) -> Floats:
    """The edges of a part in the picture (e, 2, 2), each as two ends (u, v), without short ones."""
    corners = apply(T, model.ends.reshape(-1, 3)).reshape(-1, 2, 3)
    corners = corners[corners[:, :, 2].min(axis=1) > 1e-3]
    ends = np.stack(camera.pixels(corners), axis=-1)
    found: Floats = ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > SHORT_PX]
    return found


def _pieces(ends: Floats, at: Floats, outward: Floats) -> tuple[Longs, Truths]:
    """For places (n, 2), the number of the piece of an edge (e, 2, 2) that each belongs to (n,), and whether it is on it (n,)."""
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    share = np.clip(((at[:, None] - ends[:, 0]) * along).sum(axis=2) / length**2, 0.0, 1.0)
    away = np.linalg.norm(at[:, None] - (ends[:, 0] + share[..., None] * along), axis=2)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    away[np.abs(outward @ normal.T) < ALONG] += 2 * BESIDE_PX
    own = away.argmin(axis=1)
    row = np.arange(len(at))
    pieces = np.maximum(np.rint(length / PIECE_PX), 1.0)
    number = np.minimum(np.floor(share[row, own] * pieces[own]), pieces[own] - 1)
    first = np.concatenate([[0.0], np.cumsum(pieces)])
    return (first[own] + number).astype(np.int64), away[row, own] < BESIDE_PX
