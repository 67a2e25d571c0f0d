"""Parts in their three views, meshes from files, and what is refused because it encloses
nothing.
"""

import math
import struct
import tempfile
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.reference_distances import signed_distance
from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes import meshes
from cellwright.engine.stages.geometry.shapes.hulls import hull_planes, hull_triangles
from cellwright.engine.stages.geometry.shapes.meshes import TriangleMesh, mesh_components, read_mesh
from cellwright.engine.stages.geometry.shapes.part_shapes import (
    ConvexCore,
    check_polyhedron,
    shape_cores,
    shape_features,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.body_shapes import (
    Box,
    Cylinder,
    Edge,
    Face,
    HeightField,
    Mesh,
    PlacedShape,
    PointSet,
    Polyhedron,
    Pose,
    Shape,
    Sphere,
    Tube,
)

sizes = st.floats(0.01, 2.0)
poses = st.builds(
    Pose,
    st.tuples(*[st.floats(-2, 2)] * 3),
    st.tuples(*[st.floats(-math.pi, math.pi)] * 3),
)
CUBE = np.array(list(product((0.0, 1.0), repeat=3)))
CUBE_TRIANGLES = hull_triangles(CUBE)


def contains(core: ConvexCore, points: Floats, slack: float = 1e-9) -> Floats:
    """Which points a core holds, by its planes or its segment."""
    if len(core.vertices) <= 2:
        low, high = core.vertices.min(axis=0), core.vertices.max(axis=0)
        return np.linalg.norm(points - points.clip(low, high), axis=1) <= core.radius_m + slack
    normals, offsets = hull_planes(core.vertices, hull_triangles(core.vertices))
    return (points @ normals.T - offsets).max(axis=1) <= slack


@given(sizes, sizes, sizes)
def test_shapes_hold_what_their_definition_does(a: float, b: float, c: float) -> None:
    points = np.random.default_rng(3).uniform(-2, 2, (300, 3))
    x, y, z = np.abs(points).T
    round_ = np.hypot(x, y)
    inside: list[tuple[Shape, Floats]] = [
        (Sphere(a), np.linalg.norm(points, axis=1) <= a),
        (Box((a, b, c)), (x <= a / 2) & (y <= b / 2) & (z <= c / 2)),
        (Tube(a, b), np.hypot(round_, (z - b / 2).clip(min=0)) <= a),
    ]
    for shape, expected in inside:
        (core,) = shape_cores(shape)
        assert np.array_equal(contains(core, points), expected)
    (prism,) = shape_cores(Cylinder(a, b))
    held = contains(prism, points)
    assert held[(round_ <= a) & (z <= b / 2)].all()
    assert not held[(round_ > 1.02 * a) | (z > b / 2 + 1e-9)].any()


@settings(max_examples=30, deadline=None)
@given(st.lists(st.lists(st.floats(0.1, 1.0), min_size=3, max_size=3), min_size=3, max_size=3))
def test_a_height_field_holds_what_is_below_its_surface(heights: list[list[float]]) -> None:
    field = HeightField((0.5, 0.25), tuple(map(tuple, heights)), -0.2)
    pieces = shape_cores(field)
    assert len(pieces) == 2 * 4
    for row, column in product(range(3), range(3)):
        top = np.array([[0.5 * column, 0.25 * row, heights[row][column]]])
        below, above = top - np.array([0, 0, 0.05]), top + np.array([0, 0, 0.01])
        assert any(contains(core, below)[0] for core in pieces)
        assert not any(contains(core, above)[0] for core in pieces)
        assert not any(contains(core, top - np.array([0, 0, 2.0]))[0] for core in pieces)


def test_a_point_set_is_a_ball_for_each_point() -> None:
    found = shape_cores(PointSet(((0, 0, 0), (1, 0, 0)), 0.1))
    assert [core.radius_m for core in found] == [0.1, 0.1]
    assert [core.vertices.tolist() for core in found] == [[[0, 0, 0]], [[1, 0, 0]]]


@given(st.tuples(sizes, sizes, sizes), poses)
def test_a_block_has_six_named_faces_twelve_edges_and_eight_vertices(
    size: tuple[float, float, float], pose: Pose
) -> None:
    found = shape_features(PlacedShape(Box(size), pose))
    assert (len(found.faces), len(found.edges), len(found.vertices)) == (6, 12, 8)
    T = transforms.of_pose(pose)
    for name, axis, side in (("right", 0, 1), ("left", 0, -1), ("top", 2, 1), ("front", 1, -1)):
        face = found.faces[name]
        assert np.abs(face.normal - side * T[:3, axis]).max() < 1e-6
        middle = T[:3, 3] + side * size[axis] / 2 * T[:3, axis]
        assert np.abs(face.corners.mean(axis=0) - middle).max() < 1e-9
    ends = found.edges["left_top"]
    assert math.isclose(float(np.linalg.norm(ends[1] - ends[0])), size[1], rel_tol=1e-9)
    corner = T[:3, :3] @ (np.array(size) / 2) + T[:3, 3]
    assert np.abs(found.vertices["right_back_top"] - corner).max() < 1e-9


def wedge(**changed: object) -> Polyhedron:
    entries: dict[str, object] = {
        "vertices": {"a": (0, 0, 0), "b": (1, 0, 0), "c": (0, 1, 0), "d": (0, 0, 1)},
        "faces": (Face("floor", ("a", "c", "b")), Face("slope", ("b", "c", "d"))),
        "edges": (Edge("ridge", ("c", "d")),),
    }
    return Polyhedron(**{**entries, **changed})  # type: ignore[arg-type]


def test_a_polyhedron_keeps_its_names() -> None:
    found = shape_features(PlacedShape(wedge()))
    assert found.faces["floor"].normal.tolist() == [0, 0, -1]
    assert np.abs(found.faces["slope"].normal - 1 / math.sqrt(3)).max() < 1e-12
    assert found.edges["ridge"].tolist() == [[0, 1, 0], [0, 0, 1]]
    assert check_polyhedron(wedge()) == []


@pytest.mark.parametrize(
    ("face", "said"),
    [
        (Face("floor", ("a", "b")), "no area"),
        (Face("floor", ("a", "b", "a")), "no area"),
        (Face("floor", ("a", "b", "c")), "turned inwards"),
        (Face("floor", ("a", "b", "c", "d")), "not planar"),
    ],
)
def test_a_face_that_is_none_is_told(face: Face, said: str) -> None:
    (found,) = check_polyhedron(wedge(faces=(face,)))
    assert (found.code, said in found.message) == ("K702", True)
    assert found.hint


def test_a_polyhedron_without_volume_is_refused() -> None:
    flat = Polyhedron({"a": (0, 0, 0), "b": (1, 0, 0), "c": (0, 1, 0), "d": (1, 1, 0)})
    with pytest.raises(InvalidInput, match="no volume"):
        shape_cores(flat)
    with pytest.raises(InvalidInput, match="no volume"):
        shape_cores(wedge(pieces=(("a", "b", "c"),)))


def binary_stl(triangles: Floats) -> bytes:
    rows = [struct.pack("<12fH", *([0.0] * 3), *each.ravel(), 0) for each in triangles]
    return b"\0" * 80 + struct.pack("<I", len(rows)) + b"".join(rows)


def text_stl(triangles: Floats) -> bytes:
    lines = ["solid part"]
    for each in triangles:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(f"{value:.9g}" for value in corner) for corner in each]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid part"]).encode()


def obj(vertices: Floats, triangles: Floats) -> bytes:
    lines = ["v " + " ".join(map(str, each)) for each in vertices]
    return "\n".join(
        [*lines, *("f " + " ".join(f"{i + 1}/1" for i in each) for each in triangles)]
    ).encode()


FILES = {
    "binary.stl": binary_stl(CUBE[CUBE_TRIANGLES]),
    "text.STL": text_stl(CUBE[CUBE_TRIANGLES]),
    "part.obj": obj(CUBE, CUBE_TRIANGLES),
}


def is_closed(mesh: TriangleMesh) -> bool:
    """Whether every edge has exactly one triangle on each side."""
    t = mesh.triangles
    directed = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    edges = {(int(a), int(b)) for a, b in directed}
    return len(edges) == len(directed) and all((b, a) in edges for a, b in edges)


@pytest.mark.parametrize("name", FILES)
def test_the_same_mesh_is_read_from_every_format(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(FILES[name])
    mesh = read_mesh(tmp_path / name)
    assert is_closed(mesh)
    assert sorted(map(tuple, mesh.vertices)) == sorted(map(tuple, CUBE))
    (core,) = shape_cores(Mesh(str(tmp_path / name), (2.0, 1.0, 0.5)))
    assert core.vertices.max(axis=0).tolist() == [2.0, 1.0, 0.5]


def test_each_connected_component_is_a_convex_piece(tmp_path: Path) -> None:
    both = np.concatenate([CUBE, CUBE + np.array([3, 0, 0])])
    (tmp_path / "two.obj").write_bytes(
        obj(both, np.concatenate([CUBE_TRIANGLES, CUBE_TRIANGLES + 8]))
    )
    assert len(mesh_components(read_mesh(tmp_path / "two.obj"))) == 2
    assert [core.vertices[:, 0].max() for core in shape_cores(Mesh(str(tmp_path / "two.obj")))] == [
        1.0,
        4.0,
    ]


def test_triangles_without_area_and_repeated_vertices_do_no_harm(tmp_path: Path) -> None:
    noisy = np.concatenate([CUBE[CUBE_TRIANGLES], CUBE[[[0, 0, 1], [2, 2, 2]]]])
    (tmp_path / "noisy.stl").write_bytes(binary_stl(noisy))
    mesh = read_mesh(tmp_path / "noisy.stl")
    assert (len(mesh.vertices), len(mesh.triangles)) == (8, 12)
    assert is_closed(mesh)


BROKEN = {
    "empty.stl": b"",
    "cut.stl": FILES["binary.stl"][:-7],
    "count.stl": b"\0" * 80 + struct.pack("<I", 4_000_000_000),
    "nothing.stl": b"\0" * 80 + struct.pack("<I", 0),
    "endless.stl": binary_stl(np.full((2, 3, 3), math.nan)),
    "words.stl": b"solid x\nvertex one two three\n",
    "corners.stl": b"solid x\nvertex 0 0 0\nvertex 1 0 0\n",
    "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
    "text.obj": b"v a b c\n",
    "points.obj": b"v 0 0 0\nv 1 0 0\n",
    "ragged.obj": b"v 0 0\nv 1 0 0\nv 1 1 1\nf 1 2 3\n",
    "face.obj": b"v 0 0 0\nf x y z\n",
    "flat.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "point.obj": b"v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n",
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_mesh_that_encloses_nothing_is_told(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(BROKEN[name])
    with pytest.raises(InvalidInput) as error:
        shape_cores(Mesh(str(tmp_path / name)))
    assert {each.code for each in error.value.diagnostics} == {"K702"}
    assert all(each.hint for each in error.value.diagnostics)


def read(path: Path) -> list[ConvexCore] | set[str]:
    """The pieces, or the codes of what is wrong."""
    try:
        return shape_cores(Mesh(str(path)))
    except InvalidInput as error:
        return {each.code for each in error.diagnostics}


words = st.sampled_from(
    ["v", "f", "1", "-1", "2/3", "0", "nan", "1e999", "x", "\n", "\n", "solid", "vertex"]
)


@given(st.binary(max_size=200) | st.lists(words, max_size=60).map(" ".join).map(str.encode))
def test_no_file_makes_the_reader_stumble(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name in ("a.stl", "a.obj"):
            path = Path(folder) / name
            path.write_bytes(data)
            assert read(path) == {"K702"}


OUTLINE = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], dtype=float)


def channel() -> tuple[Floats, Longs]:
    """The letter U, 3 wide, 3 high and 1 deep."""
    sides = [(0, 1, 4), (0, 4, 5), (1, 2, 4), (2, 3, 4), (0, 5, 7), (5, 6, 7)]
    faces = [(c, b, a) for a, b, c in sides] + [(a + 8, b + 8, c + 8) for a, b, c in sides]
    for n in range(8):
        after = (n + 1) % 8
        faces += [(n, after, after + 8), (n, after + 8, n + 8)]
    vertices = np.vstack([np.c_[OUTLINE, np.zeros(8)], np.c_[OUTLINE, np.ones(8)]])
    return vertices, np.array(faces)


def apart(pieces: list[ConvexCore], point: Floats) -> float:
    return min(signed_distance(point[None], piece.vertices) for piece in pieces)


@pytest.mark.parametrize("with_coacd", [True, False])
def test_a_mesh_that_is_not_convex_leaves_its_hollow_free(
    with_coacd: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a decomposer its triangles are the pieces, and the check says so."""
    if with_coacd:
        pytest.importorskip("coacd", reason="an extra")
    else:
        monkeypatch.setattr(meshes, "has_decomposer", lambda: False)
    path = tmp_path / f"channel_{with_coacd}.obj"
    path.write_bytes(obj(*channel()))
    pieces = shape_cores(Mesh(str(path)))
    assert apart(pieces, np.array([1.5, 2.0, 0.5])) > 0.3
    for inside in ([1.5, 0.99, 0.5], [0.01, 1.5, 0.5], [2.99, 2.5, 0.5]):
        assert apart(pieces, np.array(inside)) < 0.02
    assert meshes.surface_only(path) is not with_coacd


def test_a_collada_file_is_read_in_its_own_unit(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    text = trimesh.exchange.dae.export_collada(trimesh.creation.box((1.0, 2.0, 3.0)))
    (tmp_path / "metres.dae").write_bytes(text)
    inches = text.replace(b"<up_axis>", b'<unit name="inch" meter="0.0254"/><up_axis>')
    (tmp_path / "inches.dae").write_bytes(inches)
    for name, unit in (("metres.dae", 1.0), ("inches.dae", 0.0254)):
        (core,) = shape_cores(Mesh(str(tmp_path / name)))
        assert np.allclose(np.sort(np.ptp(core.vertices, axis=0)), unit * np.array([1.0, 2.0, 3.0]))


@pytest.mark.parametrize(
    ("factor", "said"),
    [(0.0, "no volume"), (1e-12, "no volume"), (1e30, "larger than")],
)
def test_a_mesh_scaled_to_nothing_or_beyond_all_cells_is_told(
    factor: float, said: str, tmp_path: Path
) -> None:
    (tmp_path / "part.obj").write_bytes(FILES["part.obj"])
    with pytest.raises(InvalidInput, match=said):
        shape_cores(Mesh(str(tmp_path / "part.obj"), (1.0, factor, 1.0)))


def test_a_mesh_of_which_the_numbers_are_huge_is_told(tmp_path: Path) -> None:
    (tmp_path / "part.obj").write_bytes(obj(CUBE * 1e30, CUBE_TRIANGLES))
    with pytest.raises(InvalidInput, match="endless"):
        shape_cores(Mesh(str(tmp_path / "part.obj")))


def test_a_flat_height_field_is_told() -> None:
    for heights, floor in ((0.0, 0.0), (0.2, 0.2), (-0.1, 0.0)):
        with pytest.raises(InvalidInput, match="no volume"):
            shape_cores(HeightField((0.1, 0.1), ((heights,) * 3,) * 2, floor))
    assert len(shape_cores(HeightField((0.1, 0.1), ((0.2,) * 3,) * 2, 0.0))) == 4
