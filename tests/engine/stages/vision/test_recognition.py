"""Parts are recognised by the relations between their faces; what is alike or missing is said."""

import numpy as np
import pytest

from engine.kernels.arrays import Floats
from engine.kernels.rigid import difference, transform, turned
from engine.model.ranging import Recognised, Recognising, Unrecognised
from engine.model.solid import Solid
from engine.model.vision import Camera
from engine.stages.vision.hypotheses import Model
from engine.stages.vision.images import Sensor, disturbed, rendered
from engine.stages.vision.recognition import recognised
from tests.engine.stages.solids import block, ell, prism

CAMERA = Camera.viewing(320, 240, 0.3, 1.0)
TABLE = (block(2.0, 2.0, 0.1), transform(np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 1.25)))
PARTS = {
    "brick": block(0.1, 0.06, 0.04),
    "plank": block(0.14, 0.05, 0.02),
    "ell": ell(0.1, 0.08, 0.03, 0.05),
    "wedge": prism("wedge", [(-0.05, 0), (0.05, 0), (0.02, 0.06)], 0.05),
}
MODELS = {name: Model(each) for name, each in PARTS.items()}
CORNER = turned(np.array([0.6, 0.5, 0.2]))


def looked_at(part: Solid, R: Floats, models: dict[str, Model] | None = None, seed: int = 0) -> Recognising:
    solids = [TABLE, (part, transform(R, (0.0, 0.0, 1.0)))]
    image = disturbed(rendered(solids, CAMERA)[0], Sensor(0.0005, 0.01), seed)
    known = np.abs(image.depth - rendered([TABLE], CAMERA)[0].depth) < 0.002
    return recognised(MODELS if models is None else models, image, known)


@pytest.mark.parametrize("name", sorted(PARTS))
def test_a_part_is_recognised_where_three_faces_meet(name: str) -> None:
    found = looked_at(PARTS[name], CORNER)
    assert isinstance(found, Recognised)
    assert found.best.part == name
    T = transform(CORNER, (0.0, 0.0, 1.0))
    metres, radians = min(difference(T, each) for each in found.equivalent)
    assert metres < 0.001
    assert radians < np.radians(1.0)


def test_symmetric_poses_are_told() -> None:
    found = looked_at(PARTS["brick"], CORNER)
    assert isinstance(found, Recognised)
    assert len(found.equivalent) == 4


def test_two_parts_that_look_alike_are_not_decided_between() -> None:
    models = {"one": MODELS["brick"], "other": Model(block(0.1, 0.06, 0.04))}
    found = looked_at(PARTS["brick"], CORNER, models)
    assert isinstance(found, Unrecognised)
    assert "one or other" in found.reason


def test_a_part_that_is_not_among_them_is_not_found() -> None:
    zed = [(0, 0), (0.06, 0), (0.06, 0.03), (0.1, 0.03), (0.1, 0.06), (0.03, 0.06), (0.03, 0.03), (0, 0.03)]
    found = looked_at(prism("zed", zed, 0.05), CORNER, {"ell": MODELS["ell"], "wedge": MODELS["wedge"]})
    assert isinstance(found, Unrecognised)


def test_one_face_alone_is_too_little() -> None:
    found = looked_at(PARTS["brick"], np.eye(3))
    assert isinstance(found, Unrecognised)
    assert "too few faces" in found.reason
    assert "brick" in found.reason


def test_an_empty_image_shows_nothing() -> None:
    image = disturbed(rendered([TABLE], CAMERA)[0], Sensor(0.0005), 0)
    found = recognised(MODELS, image, np.ones(image.depth.shape, dtype=bool))
    assert isinstance(found, Unrecognised)
    assert found.reason == "there is no plane face in the image"
