"""How far an outline is off is told edge by edge."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.rigid import rotation, transform
from cellwright.engine.model.vision import DepthCamera, DepthImage
from cellwright.engine.stages.vision.pose_hypotheses import PartModel
from cellwright.engine.stages.vision.pose_refinement import (
    MIN_PIECE_PLACES,
    ImageView,
    assign_to_edges,
    judge_pose,
    outline_deviation_px,
)
from cellwright.engine.stages.vision.sensor_images import render_depths
from tests.engine.stages.solids import block

CAMERA = DepthCamera.viewing(640, 480, 0.6, 1.0)
MODEL = PartModel(block(0.1, 0.06, 0.0001))
T = transform(np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 1.0))
LONG, WIDE = 320 / 3, 64.0  # pixels


def outline(turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Places of the outline of the block, with their directions outwards: two long sides, then
    two short ones.
    """
    u, v = np.arange(-50, 51, dtype=float), np.arange(-30, 31, dtype=float)
    sides = [
        (np.stack([u, np.full(len(u), s * WIDE / 2)], axis=1), (0.0, float(s))) for s in (1, -1)
    ] + [(np.stack([np.full(len(v), s * LONG / 2), v], axis=1), (float(s), 0.0)) for s in (1, -1)]
    at = np.concatenate([places for places, _ in sides])
    outward = np.concatenate([np.tile(way, (len(places), 1)) for places, way in sides])
    R = rotation((0, 0, 1), turn)[:2, :2]
    return at @ R.T + CAMERA.centre_px, outward @ R.T


def told(pose: np.ndarray, at: np.ndarray, outward: np.ndarray, shift: np.ndarray) -> float:
    """How far the block at a pose is off where the surface ends so many pixels outside of its
    outline.
    """
    ended = at[:, None] + (shift[:, None] + [-0.5, 0.5])[..., None] * outward[:, None]
    return outline_deviation_px(assign_to_edges(MODEL, CAMERA, pose, at, outward, ended))


def test_every_edge_of_a_part_counts_once() -> None:
    assert len(PartModel(block(0.1, 0.06, 0.05)).ends) == 12


@settings(max_examples=30, deadline=None)
@given(
    turn=st.floats(-3.0, 3.0),
    off=st.floats(-3.0, 3.0),
    side=st.integers(0, 3),
    seed=st.integers(0, 10**6),
)
def test_one_side_that_is_off_is_told_by_as_much_as_it_is(
    turn: float, off: float, side: int, seed: int
) -> None:
    at, outward = outline(turn)
    pose = T @ transform(rotation((0, 0, 1), -turn), np.zeros(3))
    ends = np.cumsum([0, 101, 101, 61, 61])
    shift = np.random.default_rng(seed).normal(0.0, 0.1, len(at))
    shift[ends[side] : ends[side + 1]] += off
    assert told(pose, at, outward, shift) == pytest.approx(abs(off), abs=0.25)


def test_a_side_that_is_turned_is_told_by_its_ends() -> None:
    at, outward = outline()
    shift = np.zeros(len(at))
    shift[:101] = np.linspace(-1.5, 1.5, 101)
    assert told(T, at, outward, shift) > 1.0


def test_noise_alone_is_averaged_out_and_few_places_tell_nothing() -> None:
    at, outward = outline()
    shift = np.random.default_rng(0).normal(0.0, 0.5, len(at))
    assert told(T, at, outward, shift) < 0.5
    few = np.full(len(at), np.nan)
    few[: MIN_PIECE_PLACES - 1] = 5.0
    assert told(T, at, outward, few) == 0.0


@settings(max_examples=20, deadline=None)
@given(turn=st.floats(-3.0, 3.0), u=st.floats(-0.5, 0.5), v=st.floats(-0.5, 0.5))
def test_pixels_of_a_part_in_its_place_are_no_contradiction(
    turn: float, u: float, v: float
) -> None:
    """Also along rows of pixels, and where a side that is seen edge on has two edges side by
    side.
    """
    model = PartModel(block(0.1, 0.06, 0.02))
    camera = DepthCamera.viewing(320, 240, 0.3, 1.0)
    pitch = 0.3 / 320
    pose = T @ transform(rotation((0, 0, 1), turn), np.array([u * pitch, v * pitch, 0.0]))
    shown = DepthImage(camera, render_depths([(model.solid, pose)], camera)[0].depth, 0.001)
    table = np.where(shown.depth > 0, shown.depth, 1.3)
    view = ImageView(DepthImage(camera, table, 0.001), np.zeros(table.shape, dtype=bool))
    found = judge_pose(model, view, pose, closely=True)
    assert found is not None
    assert found.off_px < 0.55
