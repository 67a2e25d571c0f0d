"""Parts are recognised by the relations between their faces and by their edges; what is alike,
missing or strange is said.
"""

from dataclasses import replace

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import (
    apply,
    difference,
    rotation,
    rotation_by_vector,
    transform,
)
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.vision import DepthCamera, PartSight, Recognised
from cellwright.engine.stages.vision.part_localisation import KnownScene
from cellwright.engine.stages.vision.part_recognition import (
    PartClaim,
    decide_claims,
    recognise_in_image,
)
from cellwright.engine.stages.vision.pose_hypotheses import PartModel
from cellwright.engine.stages.vision.sensor_images import DepthSensor, disturb_image, render_depths
from tests.engine.stages.solids import block, ell, prism

CAMERA = DepthCamera.viewing(320, 240, 0.3, 1.0)
DOWN: Floats = np.diag([1.0, -1.0, -1.0])
TABLE = (block(2.0, 2.0, 0.1), transform(DOWN, (0.0, 0.0, 1.25)))
PARTS = {
    "brick": block(0.1, 0.06, 0.04),
    "plank": block(0.14, 0.05, 0.02),
    "ell": ell(0.1, 0.08, 0.03, 0.05),
    "wedge": prism("wedge", [(-0.05, 0), (0.05, 0), (0.02, 0.06)], 0.05),
}
MODELS = {name: PartModel(each) for name, each in PARTS.items()}
CORNER = rotation_by_vector(np.array([0.6, 0.5, 0.2]))
AWAY = 0.02  # metres between boxes around parts of a scene


def seen(
    *things: tuple[Solid, Floats],
    models: dict[str, PartModel] | None = None,
    seed: int = 0,
    floor: bool = False,
) -> Recognised:
    """What is recognised of things at poses before a table; the table is told where it carries
    parts.
    """
    image = disturb_image(
        render_depths([TABLE, *things], CAMERA)[0], DepthSensor(0.0005, 0.01), seed
    )
    known = np.abs(image.depth - render_depths([TABLE], CAMERA)[0].depth) < 0.002
    floors = (np.array([0.0, 0.0, -1.0, -1.2]),) if floor else ()
    return recognise_in_image(
        MODELS if models is None else models, image, KnownScene(known, floors)
    )


def looked_at(
    part: Solid, R: Floats, models: dict[str, PartModel] | None = None, seed: int = 0
) -> Recognised:
    return seen((part, transform(R, (0.0, 0.0, 1.0))), models=models, seed=seed)


@pytest.mark.parametrize("name", sorted(PARTS))
def test_a_part_is_recognised_where_three_faces_meet(name: str) -> None:
    found = looked_at(PARTS[name], CORNER)
    assert [each.best.part for each in found.named] == [name]
    assert found.unexplained == ()
    T = transform(CORNER, (0.0, 0.0, 1.0))
    metres, radians = min(difference(T, each) for each in found.named[0].equivalent)
    assert metres < 0.001
    assert radians < np.radians(1.0)
    assert sorted(found.missing) == sorted(set(PARTS) - {name})


def test_symmetric_poses_are_told() -> None:
    found = looked_at(PARTS["brick"], CORNER)
    assert len(found.named[0].equivalent) == 4


def test_two_parts_that_look_alike_are_not_decided_between() -> None:
    models = {"one": MODELS["brick"], "other": PartModel(block(0.1, 0.06, 0.04))}
    found = looked_at(PARTS["brick"], CORNER, models)
    assert found.named == ()
    assert [each.parts for each in found.unclear] == [("one", "other")]
    assert found.missing == {}


def test_a_part_that_is_not_among_them_is_not_found_and_told_to_be_none_of_them() -> None:
    zed = [
        (0, 0),
        (0.06, 0),
        (0.06, 0.03),
        (0.1, 0.03),
        (0.1, 0.06),
        (0.03, 0.06),
        (0.03, 0.03),
        (0, 0.03),
    ]
    found = looked_at(
        prism("zed", zed, 0.05), CORNER, {"ell": MODELS["ell"], "wedge": MODELS["wedge"]}
    )
    assert (found.named, found.unclear) == ((), ())
    assert sorted(found.missing) == ["ell", "wedge"]
    assert len(found.unexplained) == 1


def test_one_face_alone_is_too_little() -> None:
    found = looked_at(PARTS["brick"], np.eye(3))
    assert found.named == ()
    assert "only one of its faces is seen" in found.missing["brick"]


def test_one_face_is_enough_where_its_height_above_what_carries_it_is_known() -> None:
    lying = transform(DOWN @ rotation((0, 0, 1), 0.3), (0.0, 0.0, 1.18))
    found = seen((PARTS["brick"], lying), floor=True)
    assert [each.best.part for each in found.named] == ["brick"]
    models = {"flat": PartModel(block(0.1, 0.06, 0.02)), "high": PartModel(block(0.1, 0.06, 0.07))}
    found = seen((PARTS["brick"], lying), models=models, floor=True)
    assert (found.named, len(found.unexplained)) == ((), 1)


def test_an_empty_image_shows_nothing() -> None:
    found = seen()
    assert (found.named, found.unclear, found.unexplained) == ((), (), ())
    assert sorted(found.missing) == sorted(PARTS)


def claim(part: str, evidence: float, *pixels: int) -> PartClaim:
    shows = np.zeros((1, 100), dtype=bool)
    shows[0, list(pixels)] = True
    return PartClaim(PartSight(part, np.eye(4), len(pixels), 1.0, 3), evidence, shows)


def settled(*claims: PartClaim) -> tuple[list[str], list[tuple[str, ...]]]:
    named, unclear = decide_claims(claims, dict.fromkeys(("a", "b", "c"), MODELS["brick"]))
    return sorted(each.best.part for each in named), [each.parts for each in unclear]


def test_each_part_is_there_once_so_what_is_found_elsewhere_decides() -> None:
    left, right = range(0, 40), range(50, 90)
    assert settled(claim("a", 100.0, *left), claim("b", 99.0, *left)) == ([], [("a", "b")])
    twins = claim("a", 100.0, *left), claim("b", 99.0, *left)
    assert settled(*twins, claim("a", 50.0, *right)) == (["a", "b"], [])
    assert settled(*twins, claim("b", 50.0, *right), claim("c", 40.0, *right)) == (["a", "b"], [])
    assert settled(claim("a", 100.0, *left), claim("a", 50.0, *right)) == ([], [("a",), ("a",)])
    assert settled(*twins, claim("a", 50.0, *right), claim("b", 50.0, *right)) == (
        [],
        [("a", "b"), ("a", "b")],
    )


def test_a_part_that_stands_is_believed_before_one_that_hangs_in_the_air() -> None:
    hanging = replace(claim("a", 100.0, *range(40)), stands=False)
    assert settled(hanging, claim("b", 99.0, *range(40))) == (["b"], [])
    assert settled(hanging, claim("b", 50.0, *range(40))) == (["a"], [])


def lying(part: Solid, random: np.random.Generator) -> Floats:
    """A pose in the camera's frame in which a part lies on one of its faces somewhere on the
    table.
    """
    below = [
        each for each in part.facets if (part.vertices @ each.normal - each.offset).max() < 1e-9
    ]
    z = -below[random.integers(len(below))].normal
    across = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x = across / np.linalg.norm(across)
    R = rotation((0, 0, 1), random.uniform(-3, 3)) @ np.stack([x, np.cross(z, x), z])
    middle, low = R @ part.vertices.mean(axis=0), (part.vertices @ R[2]).min()
    at = np.array([*random.uniform((-0.08, -0.05), (0.08, 0.05)), 0.0]) - [
        middle[0],
        middle[1],
        low,
    ]
    return transform(DOWN, (0.0, 0.0, 1.2)) @ transform(R, at)


def spread(names: list[str], random: np.random.Generator) -> dict[str, Floats]:
    """Poses of parts that lie beside each other; of as many as there is room for."""
    found: dict[str, Floats] = {}
    boxes: list[tuple[Floats, Floats]] = []
    for name in names:
        for _ in range(100):
            T = lying(PARTS[name], random)
            points = apply(T, PARTS[name].vertices)[:, :2]
            low, high = points.min(axis=0) - AWAY / 2, points.max(axis=0) + AWAY / 2
            if all((low > b).any() or (high < a).any() for a, b in boxes):
                boxes.append((low, high))
                found[name] = T
                break
    return found


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30))
def test_each_part_of_a_scene_is_named_and_none_is_false(seed: int) -> None:
    random = np.random.default_rng(seed)
    there = spread(
        [str(each) for each in random.permutation(sorted(PARTS))[: random.integers(2, 5)]], random
    )
    strange = next(iter(there)) if seed % 3 == 0 else ""  # nobody looks for it
    models = {name: model for name, model in MODELS.items() if name != strange}
    found = seen(
        *((PARTS[name], T) for name, T in there.items()), models=models, seed=seed, floor=True
    )
    wanted = {name: T for name, T in there.items() if name != strange}
    assert sorted(each.best.part for each in found.named) == sorted(wanted)
    for each in found.named:
        poses = [T @ S for T in each.poses for S in MODELS[each.best.part].symmetries]
        metres, radians = min(difference(wanted[each.best.part], T) for T in poses)
        assert metres < 0.003
        assert radians < np.radians(2.0)
    assert len(found.unexplained) == bool(strange)
