"""What a scanner sees: the answer agrees with many rays among random blocks, cast by a plain
rule that shares no code with it.
"""

from dataclasses import replace

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.reach.scanner_view import ScannerSight
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, Place, Placement, Sight

RAYS = 21  # on each side of the patch
EYE = np.array([0.03, -0.02, 0.39])
LIFTED_M = 0.002
TIP_M = 0.8


@pytest.fixture(scope="module")
def bare() -> Cell:
    """The cell with nothing but the arm on its carriage, and the scanner."""
    whole = cell_of("bulkhead/three_stations")
    kept = {
        name: body
        for name, body in whole.bodies.items()
        if name in ("carriage", "tool_rack", "slra")
    }
    slra = replace(kept["slra"], features={"tip": Pose((0.0, 0.0, TIP_M)), "eye": Pose(tuple(EYE))})
    return replace(whole, bodies={**kept, "slra": slra}, regions={}, locations=(), places={})


def seeing(cell: Cell, **how: object) -> ScannerSight:
    sight = replace(Sight(("eye",), (0.1, 2.0), np.pi / 2), **how)
    return ScannerSight(GeometricWorld.of(cell), "t3_746", "slra", cell.measuring["slra"], sight)


def with_blocks(cell: Cell, blocks: list[tuple[Floats, Floats, Floats]]) -> Cell:
    """The cell with blocks, each with its size, middle, and roll, pitch and yaw."""
    bodies = {
        f"block_{n}": Body(
            f"block_{n}",
            BodyKind.FIXTURE,
            Placement("world", Pose(tuple(at), tuple(turn))),
            (PlacedShape(Box(tuple(size))),),
        )
        for n, (size, at, turn) in enumerate(blocks)
    }
    return replace(cell, bodies={**cell.bodies, **bodies})


PLACE = Place(
    "meas(p)", Placement("world", Pose((3.0, 0.0, 1.5), (0.0, np.pi / 2, 0.0))), "t3_746", "slra"
)


def rays_hit(block: tuple[Floats, Floats, Floats], eye: Floats, ends: Floats) -> bool:
    """Whether a ray from the eye to one of some ends (n, 3) goes through a block, by the rule
    of slabs (Kay & Kajiya 1986).
    """
    size, at, turn = block
    T = transforms.inverse(transforms.of_pose(Pose(tuple(at), tuple(turn))))
    start, way = transforms.apply(T, eye[None])[0], transforms.apply(T, ends)
    way = way - start
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-size / 2 - start) / way, (size / 2 - start) / way
    enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    return bool(((enter <= leave) & (leave >= 0.0) & (enter <= 1.0)).any())


def test_what_any_ray_meets_is_in_the_way_and_nothing_else(
    bare: Cell, rng: np.random.Generator
) -> None:
    hidden = seen = 0
    for _ in range(150):
        turn = transforms.rotation((0, 0, 1), rng.uniform(0, 6.28))
        T = transforms.of_pose(PLACE.placement.pose) @ transforms.transform(turn, np.zeros(3))
        size, at = (
            rng.uniform(0.01, 0.2, 3),
            np.array([2.85, 0.0, 1.5]) + rng.uniform((-0.3, -0.13, -0.13), (0.12, 0.13, 0.13)),
        )
        block = size, at, rng.uniform(-3, 3, 3)
        side = float(rng.uniform(0.02, 0.08))
        place = replace(PLACE, patch_m=side)
        found = seeing(with_blocks(bare, [block])).unseen(place, T)
        eye = transforms.apply(T, (EYE - np.array([0.0, 0.0, TIP_M]))[None])[0]
        share = np.linspace(-side / 2, side / 2, RAYS)
        grid = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
        ends = T[:3, 3] - LIFTED_M * T[:3, 2] + grid @ T[:3, :2].T
        if rays_hit(block, eye, ends):
            assert found is not None
            assert found.culprits == ("block_0",)
            hidden += 1
        else:
            grown = (size + 0.01, *block[1:])  # rays leave gaps
            assert found is None or rays_hit(grown, eye, ends)
            seen += found is None
    assert hidden > 30
    assert seen > 30


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"range_m": (0.45, 0.6)}, "is 0.41 m from it, and sees from 0.45 to 0.6 m"),
        ({"range_m": (0.1, 0.4)}, "is 0.41 m from it, and sees from 0.1 to 0.4 m"),
        ({"range_m": (0.45, 0.6), "back_m": 0.1}, None),
        ({"incidence_rad": np.radians(5.0)}, "looks at it 7 degrees off the normal, 5 at most"),
        ({"incidence_rad": np.radians(8.0)}, None),
    ],
)
def test_what_is_too_near_too_far_or_too_flat_is_not_seen(
    bare: Cell, how: dict[str, object], said: str | None
) -> None:
    place = replace(PLACE, patch_m=0.02)
    found = seeing(bare, **how).unseen(place, transforms.of_pose(PLACE.placement.pose))
    assert (found.reason if found else None) == (f"the eye of slra {said}" if said else None)


def test_a_tool_that_leans_looks_at_the_same_patch_more_flatly(bare: Cell) -> None:
    tilt = transforms.transform(transforms.rotation((0, 1, 0), np.radians(40.0)), np.zeros(3))
    T = transforms.of_pose(PLACE.placement.pose) @ tilt
    place = replace(
        PLACE,
        patch_m=0.02,
        placement=Placement("world", transforms.to_pose(T)),
        surface=PLACE.placement,
    )
    assert seeing(bare, incidence_rad=np.radians(50.0)).unseen(place, T) is None
    found = seeing(bare, incidence_rad=np.radians(30.0)).unseen(place, T)
    assert found is not None
    assert "degrees off the normal, 30 at most" in found.reason
