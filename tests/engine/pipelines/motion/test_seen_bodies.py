"""Bodies that are seen while a run goes on: the box around one holds all of it, and what cannot
be read changes nothing.
"""

import json
from math import pi

import numpy as np
import pytest

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.run_protocol import BODIES_SEEN
from cellwright.engine.pipelines.motion.seen_bodies import (
    SEEN_ROOM_M,
    SeenBody,
    at_places,
    look_at,
    seen_in,
    with_seen,
)
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.part_shapes import shape_cores
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.body_shapes import Box, Cylinder, PlacedShape, Pose, Shape, Sphere
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, Placement


def drawn(rng: np.random.Generator) -> Body:
    """A body of some shapes, turned and moved at random."""

    def pose() -> Pose:
        x, y, z = rng.uniform(-1, 1, 3)
        return Pose((x, y, z), (rng.uniform(-pi, pi), rng.uniform(-1.5, 1.5), rng.uniform(-pi, pi)))

    sizes = rng.uniform(0.05, 0.5, (4, 3))
    made: list[Shape] = [
        Box((s[0], s[1], s[2])) if n % 2 else Cylinder(s[0], s[1]) for n, s in enumerate(sizes)
    ]
    shapes = tuple(PlacedShape(each, pose()) for each in (*made, Sphere(float(sizes[0, 2]))))
    return Body("thing", BodyKind.FIXTURE, Placement("world", pose()), shapes)


def test_the_box_that_is_told_holds_the_whole_body() -> None:
    rng = np.random.default_rng(20)
    for _ in range(20):
        body = drawn(rng)
        told = look_at(GeometricWorld.of(Cell("c", bodies={"thing": body})), "thing", boxed=True)
        data = json.loads(json.dumps({BODIES_SEEN: {"thing": told.entry()}}))
        (seen,), unread = seen_in(data, Cell("c"))
        assert unread == ()
        known = with_seen(Cell("c"), [seen]).bodies["thing"]
        half = np.array(known.shapes[0].shape.size_m) / 2 - SEEN_ROOM_M  # type: ignore[union-attr]
        T = matmul(
            transforms.inverse(transforms.of_pose(known.placement.pose)),
            transforms.of_pose(body.placement.pose),
        )
        worst = np.full(3, -np.inf)
        for placed in body.shapes:
            for core in shape_cores(placed.shape):
                at = matmul(T, transforms.of_pose(placed.pose))
                points = matmul(core.vertices, at[:3, :3].T) + at[:3, 3]
                worst = np.maximum(worst, (np.abs(points) + core.radius_m).max(axis=0))
        assert (worst <= half + 1e-9).all()
        assert np.allclose(worst, half, atol=1e-9)


@pytest.mark.parametrize(
    "entry",
    [
        None,
        [],
        {"at": [0, 0]},
        {"at": [0, 0, "x"], "box": [1, 1, 1]},
        {"at": [0, 0, float("nan")], "box": [1, 1, 1]},
        {"at": [0, 0, 0], "box": [1, 1, 0]},
        {"at": [0, 0, 0], "box": [1, 1, True]},
        {"at": [0, 0, 0]},
        {"at": [0, 0, 1e9], "box": [1, 1, 1]},
    ],
)
def test_what_cannot_be_read_is_named_and_left_out(entry: object) -> None:
    good = {"at": [0, 0, 1], "box": [1, 1, 1]}
    seen, unread = seen_in({BODIES_SEEN: {"odd": entry, "crate": good}}, Cell("c"))
    assert [each.name for each in seen] == ["crate"]
    assert unread == ("odd",)
    assert seen_in({BODIES_SEEN: entry}, Cell("c"))[0] == ()


def test_a_known_body_gives_the_fact_of_the_place_where_it_was_seen() -> None:
    cell = cell_of("themse")
    where = {
        place: cell.places[place]
        for place in ("slot(drawer, 3)", "slot(freezer, 1)", "slot(furnace, 2)")
    }
    world = GeometricWorld.of(cell)
    for name, place in where.items():
        T = matmul(
            world.pose("world", place.placement.parent), transforms.of_pose(place.placement.pose)
        )
        there = matmul(T, transforms.inverse(world.grip("probe_1")))
        (nearest, *_) = at_places(cell, SeenBody("probe_1", transforms.to_pose(there)))
        assert str(nearest) == f"at(probe_1, {name})"
    assert at_places(cell, SeenBody("probe_1", Pose((0.6, 0.0, 1.3)))) == ()
