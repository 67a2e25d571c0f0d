"""PLACE as a whole: a scene file becomes motions, or the first thing that stands in their way."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwright.engine.kernels.rigid import difference
from cellwright.engine.pipelines.manipulation.place_answers import NotPlaced, Placed
from cellwright.engine.pipelines.manipulation.place_operation import (
    body_features,
    goal_of,
    place_part,
)
from cellwright.engine.pipelines.manipulation.scene_camera import camera_of, depth_image
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.part_scene import SaidRelation, Scene
from cellwright.kb.targets import BUNDLED_DOMAINS

SCENE = load_scene(BUNDLED_DOMAINS / "handey" / "scene.yaml")


def said(kind: str, first: str, second: str, value: float = 0.0) -> SaidRelation:
    """A relation between `body.feature` and `body.feature`."""
    one, _, a = first.partition(".")
    other, _, b = second.partition(".")
    return SaidRelation(kind, (one, a), (other, b), value)


def related(*relations: SaidRelation) -> Scene:
    """The bundled scene with other relations."""
    return replace(SCENE, relations=relations)


def test_the_angle_is_placed_in_the_corner_of_the_base() -> None:
    found, looked = place_part(SCENE, "angle", "base")
    assert isinstance(found, Placed)
    assert looked is not None
    world = GeometricWorld.of(SCENE.cell)
    metres, radians = difference(found.T_world_part, world.pose("world", "angle"))
    assert metres < 0.001
    assert radians < np.radians(0.5)
    np.testing.assert_allclose(found.T_world_goal[:3, 3], (0.37, -0.34, 0.065), atol=1e-9)
    (carry,) = found.carries
    assert all(leg.proved for leg in carry.legs)
    ends = [leg.path[-1] for leg in carry.legs[:-1]]
    starts = [leg.path[0] for leg in carry.legs[1:]]
    assert all(np.abs(a - b).max() < 1e-9 for a, b in zip(ends, starts, strict=True))


def test_an_image_from_a_file_is_as_good_as_one_made_here() -> None:
    image = depth_image(SCENE, GeometricWorld.of(SCENE.cell), camera_of(SCENE)).depth
    found, _ = place_part(SCENE, "angle", "base", image=image)
    assert isinstance(found, Placed)


def test_contradictory_relations_are_named() -> None:
    scene = related(*SCENE.relations, said("distance", "angle.bottom", "base.top", 0.01))
    found, _ = place_part(scene, "angle", "base")
    assert isinstance(found, NotPlaced)
    assert found.step == "relations"
    assert "angle.bottom against base.top" in found.reason


def test_a_part_that_is_not_there_is_not_found() -> None:
    empty = np.zeros((480, 640))
    found, _ = place_part(SCENE, "angle", "base", image=empty)
    assert isinstance(found, NotPlaced)
    assert found.step == "sight"


def test_a_feature_that_is_not_there_is_told() -> None:
    with pytest.raises(InvalidInput, match="feature of angle"):
        place_part(related(said("against", "angle.botom", "base.top")), "angle", "base")
    with pytest.raises(InvalidInput, match="no relation says"):
        place_part(related(), "angle", "base")


def test_a_relation_may_name_a_third_body() -> None:
    scene = related(*SCENE.relations[:2], said("distance", "angle.heel", "table.front", 0.2))
    goal = goal_of(scene, GeometricWorld.of(scene.cell), ("angle",), "base")
    assert not hasattr(goal, "relations")


def test_features_of_bodies_have_the_names_of_their_shapes() -> None:
    cell = SCENE.cell
    assert {"bottom", "spine", "toe", "a"} <= set(body_features(cell.bodies["angle"]))
    assert {"top", "left", "front_top"} <= set(body_features(cell.bodies["table"]))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "angle.bottom against base.top",
            "angle.bottom agianst base.top",
            "unknown relation 'agianst'",
        ),
        ("angle.bottom against base.top", "angel.bottom against base.top", "unknown body 'angel'"),
        (
            "angle.bottom against base.top",
            "angle.bottom distance base.top",
            "distance needs a value",
        ),
        ("angle.bottom against base.top", "angle on base", "is not a relation"),
        ("clutter: [brick, slab]", "clutter: [brik]", "unknown body 'brik'"),
        ("arm: arm", "arm: arn", "unknown arm 'arn'"),
        ("in: eye", "in: eyes", "unknown frame 'eyes'"),
    ],
)
def test_mistakes_in_a_scene_are_told_at_their_place(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    folder = BUNDLED_DOMAINS / "handey"
    (tmp_path / "cell.yaml").write_text((folder / "cell.yaml").read_text("utf-8"), "utf-8")
    text = (folder / "scene.yaml").read_text("utf-8")
    assert old in text
    (tmp_path / "scene.yaml").write_text(text.replace(old, new), "utf-8")
    with pytest.raises(InvalidInput, match=message) as error:
        load_scene(tmp_path / "scene.yaml")
    assert error.value.diagnostics[0].where.line > 1
