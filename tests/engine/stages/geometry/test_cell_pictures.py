"""Pictures without a display, and glTF that says where everything is."""

import base64
import functools
import io
import itertools
import json
import math
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import ConvexPiece, Joints
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinBackend
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.pictures import png_picture, svg_picture
from cellwright.engine.stages.geometry.pictures.cell_view import (
    CellView,
    _camera_and_notes,
    cell_view_of,
    view_as_gltf,
    view_as_png,
    view_as_svg,
)
from cellwright.engine.stages.geometry.pictures.picture_notes import SIZE_PIXELS, WIDTH_PIXELS
from cellwright.engine.stages.geometry.pictures.picture_surfaces import (
    AZIMUTH_RAD,
    ELEVATION_RAD,
    KIND_COLOURS,
    PictureSurface,
    camera_for_points,
    mesh_of,
    scene_surfaces,
)
from cellwright.engine.stages.geometry.pictures.raster import fill
from cellwright.engine.stages.geometry.pictures.svg_picture import back_to_front, doubled_area
from cellwright.engine.stages.geometry.pictures.viewer_files import gltf_of_motion, quaternion_xyzw
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.kb.loader import bundled_domains
from cellwright.kb.loader.cell import load_cell

AZIMUTHS = [-60.0, 110.0, *(pytest.param(each, marks=pytest.mark.slow) for each in (20.0, 200.0))]
HITTING = "0, 45, -20, 0, 60, 0"


@pytest.fixture(scope="module")
def hitting() -> CellView:
    return cell_view_of(
        load_cell(bundled_domains()["themse"] / "cell.yaml"), BuiltinBackend(), [HITTING]
    )


@pytest.fixture(scope="module")
def drawn(hitting: CellView) -> tuple[bytes, str]:
    """Both pictures of that cell, as PNG and as SVG."""
    return view_as_png(hitting, AZIMUTH_RAD, ELEVATION_RAD), view_as_svg(
        hitting, AZIMUTH_RAD, ELEVATION_RAD
    )


def pixels(picture: bytes) -> Floats:
    """A PNG as (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=float)


@pytest.mark.slow
def test_a_colliding_pair_is_marked_in_both_pictures(
    hitting: CellView, drawn: tuple[bytes, str]
) -> None:
    assert hitting.contacts
    image = pixels(drawn[0])
    assert image.shape == (720, 960, 3)
    red = (image[..., 0] > 1.8 * image[..., 1]) & (image[..., 0] > 2.5 * image[..., 2])
    assert red.sum() > 500
    root = ElementTree.fromstring(drawn[1])
    said = written(root)
    assert "in collision" in said
    for contact in hitting.contacts:
        assert any(each.startswith(f"{contact.first} / {contact.second}: ") for each in said)
    free = resting("themse")
    assert {
        each.kind
        for each in scene_surfaces(free.world, collision_scene_of(free.world), free.contacts)
    } == set(KIND_COLOURS) - {
        "in collision",
        "region",
    }
    assert "in collision" not in view_as_svg(free, AZIMUTH_RAD, ELEVATION_RAD)


def written(root: ElementTree.Element) -> list[str]:
    """The texts of an SVG, without their rims."""
    found = root.iter("{http://www.w3.org/2000/svg}text")
    return [each.text or "" for each in found if each.get("class") != "rim"]


@functools.cache
def resting(name: str) -> CellView:
    """A bundled cell with its arms at home."""
    return cell_view_of(load_cell(bundled_domains()[name] / "cell.yaml"), BuiltinBackend())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["themse", "bulkhead"])
@pytest.mark.parametrize("azimuth", AZIMUTHS)
def test_every_body_is_named_once_and_no_name_lies_on_another(name: str, azimuth: float) -> None:
    view = resting(name)
    root = ElementTree.fromstring(view_as_svg(view, math.radians(azimuth), ELEVATION_RAD))
    said = sorted(each.removesuffix(" (hidden)") for each in written(root))
    kinds = {each.kind for each in scene_surfaces(view.world, collision_scene_of(view.world), ())}
    bodies = {each.partition(".")[0] for each in collision_scene_of(view.world).bodies}
    assert said == sorted([*kinds, *bodies])
    _, _, _, notes = _camera_and_notes(view, math.radians(azimuth), ELEVATION_RAD)
    for one, other in itertools.combinations(notes.labels, 2):
        left, right = sorted((one, other), key=lambda each: each.at[0])
        apart = right.at[0] - left.at[0] >= WIDTH_PIXELS * len(left.text)
        assert apart or abs(one.at[1] - other.at[1]) >= SIZE_PIXELS


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_painting_from_the_farthest_shows_what_a_depth_buffer_shows(seed: int) -> None:
    """For random triangles, many of which pass through each other."""
    random = np.random.default_rng(seed)
    corners = random.uniform(2, 38, size=(random.integers(1, 14), 3, 3))
    away = doubled_area(corners) > 0
    corners[away] = corners[away][:, ::-1]
    corners = corners[np.abs(doubled_area(corners)) > 20]
    piece = np.arange(len(corners))
    expected = fill(np.full((40, 40), -1), corners, piece)
    parts, source = back_to_front(corners, piece)
    flat = parts * np.array([1.0, 1.0, 0.0]) + np.arange(len(parts))[:, None, None] * np.array(
        [0, 0, 1.0]
    )
    painted = fill(np.full((40, 40), -1), flat, source)
    assert (painted != expected).mean() < 0.01  # pixels on the seams of parts


def test_triangles_of_one_piece_are_not_cut() -> None:
    corners = np.random.default_rng(1).uniform(0, 40, size=(9, 3, 3))
    parts, _ = back_to_front(corners, np.zeros(9, dtype=int))
    assert len(parts) == 9


@pytest.mark.slow
def test_the_same_view_gives_the_same_bytes(hitting: CellView, drawn: tuple[bytes, str]) -> None:
    assert view_as_png(hitting, AZIMUTH_RAD, ELEVATION_RAD) == drawn[0]
    assert view_as_svg(hitting, AZIMUTH_RAD, ELEVATION_RAD) == drawn[1]
    assert view_as_gltf(hitting) == view_as_gltf(hitting)


def test_what_is_nearer_hides_what_is_farther() -> None:
    square = np.array(
        [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=float
    )
    triangles = np.concatenate([square + np.array([0, 0, 1.0]), square])
    camera = camera_for_points(triangles.reshape(-1, 3), (60, 60), -math.pi / 2, math.pi / 2)
    colours = np.array([[1.0, 0, 0]] * 2 + [[0, 0, 1.0]] * 2)
    middle = pixels(png_picture.draw_png(camera, triangles, colours))[30, 30]
    assert middle[0] > 100 > middle[2]
    polygons = [
        line
        for line in svg_picture.draw_svg(camera, triangles, colours).splitlines()
        if "<polygon" in line
    ]
    last = polygons[-1].split('fill="#')[1][:6]
    assert int(last[:2], 16) > 100 > int(last[4:], 16)


@given(st.floats(-3.2, 3.2), st.floats(-1.5, 1.5), st.integers(0, 1000))
def test_everything_is_in_the_picture(azimuth: float, elevation: float, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(20, 3))
    seen = camera_for_points(points, (300, 200), azimuth, elevation).project(points)
    assert (seen[:, :2] >= -1e-6).all()
    assert (seen[:, 0] <= 300 + 1e-6).all()
    assert (seen[:, 1] <= 200 + 1e-6).all()


@given(st.integers(0, 2**32 - 1))
def test_surfaces_are_closed_turned_outwards_and_lie_on_their_piece(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    T = transforms.transform(
        transforms.rotation(axis / np.linalg.norm(axis), 1.0), rng.normal(size=3)
    )
    ends = [np.zeros((1, 3)), rng.normal(size=(2, 3)), rng.normal(size=(8, 3))]
    for vertices in ends:
        radius = 0.2 if len(vertices) < 3 else 0.0
        piece = ConvexPiece("piece", 1, T, vertices, radius)
        points, triangles = mesh_of(piece)
        corners = points[triangles]
        volume = np.einsum("ni,ni->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
        assert volume > 0
        low = (transforms.apply(T, vertices) - radius).min(axis=0) - 1e-9
        high = (transforms.apply(T, vertices) + radius).max(axis=0) + 1e-9
        assert ((points >= low) & (points <= high)).all()


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-8, 1.0, math.pi - 1e-8, math.pi]))
def test_a_quaternion_turns_as_its_rotation_does(seed: int, angle: float) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    R = transforms.rotation(axis / np.linalg.norm(axis), angle)
    assert np.abs(turned(quaternion_xyzw(R)) - R).max() < 1e-9


def turned(q: Floats) -> Floats:
    """The rotation (3, 3) of a quaternion (x, y, z, w)."""
    angle = 2 * math.atan2(float(np.linalg.norm(q[:3])), q[3])
    length = np.linalg.norm(q[:3])
    return transforms.rotation(q[:3] / length if length else np.array([0.0, 0, 1]), angle)


class Gltf:
    """A glTF file read again, as a viewer would."""

    def __init__(self, text: str) -> None:
        self.content: dict[str, Any] = json.loads(text)
        uri = self.content["buffers"][0]["uri"]
        self.data = base64.b64decode(uri.partition(",")[2])
        assert len(self.data) == self.content["buffers"][0]["byteLength"]

    def numbers(self, accessor: int) -> Floats:
        entry = self.content["accessors"][accessor]
        view = self.content["bufferViews"][entry["bufferView"]]
        kind = {5126: "<f4", 5125: "<u4"}[entry["componentType"]]
        raw = self.data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        values = np.frombuffer(raw, kind).reshape(entry["count"], -1)
        assert np.array_equal(values.min(axis=0), np.array(entry["min"], kind))
        assert np.array_equal(values.max(axis=0), np.array(entry["max"], kind))
        return values.astype(float)

    def poses(self, moved: dict[int, dict[str, Floats]] | None = None) -> dict[str, Floats]:
        """Of every node by name, in the cell (z up); `moved` overrides translations and
        rotations of nodes.
        """
        found: dict[str, Floats] = {}

        def visit(number: int, above: Floats) -> None:
            node = {**self.content["nodes"][number], **(moved or {}).get(number, {})}
            R = turned(np.array(node.get("rotation", [0, 0, 0, 1])))
            here = above @ transforms.transform(R, np.array(node.get("translation", [0, 0, 0])))
            found[node["name"]] = here
            for child in node.get("children", []):
                visit(child, here)

        (root,) = self.content["scenes"][0]["nodes"]
        visit(root, np.eye(4))
        up = found["cell"]
        return {name: transforms.inverse(up) @ T for name, T in found.items()}

    def at(self, time_s: float) -> dict[str, Floats]:
        """The poses at a time, rotations interpolated the short way round."""
        (animation,) = self.content["animations"]
        moved = {}
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            times, values = self.numbers(sampler["input"])[:, 0], self.numbers(sampler["output"])
            after = int(np.clip(np.searchsorted(times, time_s), 1, len(times) - 1))
            part = (time_s - times[after - 1]) / (times[after] - times[after - 1])
            a, b = values[after - 1], values[after]
            mixed = (1 - part) * a + part * b
            if channel["target"]["path"] == "rotation":
                b = -b if a @ b < 0 else b
                angle = math.acos(min(1.0, float(a @ b)))
                mixed = (
                    a
                    if angle < 1e-9
                    else (math.sin((1 - part) * angle) * a + math.sin(part * angle) * b)
                )
                mixed = mixed / np.linalg.norm(mixed)
            moved[channel["target"]["node"]] = {channel["target"]["path"]: mixed}
        return self.poses(moved)


def test_the_nodes_of_a_gltf_stand_where_the_carriers_do(hitting: CellView) -> None:
    read, world = Gltf(view_as_gltf(hitting)), hitting.world
    rest = carrier_poses(world.joints, hitting.configurations[0])
    for number in range(1, world.joints.count + 1):
        assert np.abs(read.poses()[f"carrier {number}"] - rest[number]).max() < 1e-9
    meshes = [node for node in read.content["nodes"] if "mesh" in node]
    assert {node["name"] for node in meshes} == set(collision_scene_of(world).bodies)
    colours = [m["pbrMetallicRoughness"]["baseColorFactor"][:3] for m in read.content["materials"]]
    assert list(KIND_COLOURS["in collision"]) in colours
    assert read.content["asset"]["version"] == "2.0"


def test_a_motion_passes_through_every_configuration_and_interpolates_joints() -> None:
    joints = Joints(
        np.array([0, 1, 2]),
        np.stack([transforms.translation(0, 0, 0.3), transforms.translation(0.5, 0, 0), np.eye(4)]),
        np.array([[0, 0, 1.0], [0, 1.0, 0], [1.0, 0, 0]]),
        np.array([False, False, True]),
        np.full(3, -7.0),
        np.full(3, 7.0),
    )
    shown = [PictureSurface("tip", 3, np.eye(3), np.array([[0, 1, 2]]), (0.5, 0.5, 0.5))]
    passed = np.array([[0.0, 0.0, 0.0], [6.0, -1.0, 0.5], [-1.0, 2.5, 0.0]])
    times = np.array([0.0, 2.0, 3.0])
    read = Gltf(gltf_of_motion(shown, joints, times, passed))
    for time_s in np.linspace(0.0, 3.0, 13):
        q = np.array([np.interp(time_s, times, passed[:, k]) for k in range(3)])
        expected = carrier_poses(joints, q)[-1]
        assert np.abs(read.at(float(time_s))["tip"] - expected).max() < 1e-5


def test_one_configuration_is_a_scene_without_motion() -> None:
    still = resting("themse")
    assert "animations" not in json.loads(view_as_gltf(still))
