"""Reads mesh files as triangles, reports meshes that are not solid, makes convex pieces of them.

Files are read by trimesh: STL, OBJ, and Collada (DAE) in its own unit. A component that is not
convex is divided by CoACD (Wei et al. 2022), whose pieces hold all of it. Without CoACD its
triangles are the pieces: what is near the surface is right, but a body wholly inside is not
noticed; `check` says so.
"""

import contextlib
import importlib.util
import io
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.stages.geometry.shapes.hulls import (
    FlatError,
    hull_planes,
    hull_triangles,
    hull_vertices,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import foreign_bytes
from cellwright.kb.numbers import MAX_FILE_NUMBER

MAX_MESH_BYTES = 256 * 2**20
MAX_TRIANGLES = 2_000_000
CONVEX_TOLERANCE = (
    1e-3  # parts of its size by which a component may be hollow and still be taken for its hull
)
MAX_CONCAVITY = 0.03  # by CoACD's measure, of each piece
UNIT_PATTERN = re.compile(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']+)[\"']")


@dataclass(frozen=True, slots=True, eq=False)
class TriangleMesh:
    """Vertices (n, 3) and triangles (m, 3) of indices."""

    vertices: Floats
    triangles: Longs


def read_mesh(path: Path) -> TriangleMesh:
    """The mesh in a file. Equal vertices are merged, and triangles without area are dropped.

    Raises `InvalidInput`.
    """
    data = foreign_bytes(path, "K702", "the mesh", MAX_MESH_BYTES)
    try:
        vertices, triangles = _read_triangles(data, path.suffix.lower().removeprefix("."))
    except Exception as error:  # what a garbled file makes trimesh raise is not laid down
        detail = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise _refuse_mesh(
            path, f"the mesh cannot be read: {detail}", "export it again as STL, OBJ or DAE"
        ) from None
    if not _is_sound(vertices, triangles):
        raise _refuse_mesh(
            path, "a mesh without triangles, or with endless ones", "export it again"
        )
    return _clean_mesh(vertices, triangles)


def _is_sound(vertices: Floats, triangles: Longs) -> bool:
    """Whether there are triangles, between vertices that are there, with coordinates that can
    be calculated with.
    """
    if (
        not len(triangles)
        or vertices.ndim != 2
        or vertices.shape[1] != 3
        or not (np.abs(vertices) <= MAX_FILE_NUMBER).all()
    ):
        return False
    return bool(triangles.min() >= 0 and triangles.max() < len(vertices))


def _refuse_mesh(path: Path, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path)), "K702", message, hint)])


def _read_triangles(data: bytes, kind: str) -> tuple[Floats, Longs]:
    """Vertices and triangles of a file of one kind, in metres if it tells its unit.

    No other file is opened.
    """
    import trimesh

    if kind == "dae" and (b"<!DOCTYPE" in data or b"<!ENTITY" in data):
        raise ValueError("entities are refused")
    with contextlib.redirect_stderr(io.StringIO()), np.errstate(all="ignore"):
        mesh = trimesh.load_scene(
            io.BytesIO(data), file_type=kind, process=False, skip_materials=True
        ).to_mesh()
    vertices, triangles = (
        np.asarray(mesh.vertices, dtype=float),
        np.asarray(mesh.faces, dtype=np.int64),
    )
    if len(triangles) > MAX_TRIANGLES:
        raise ValueError(f"more than {MAX_TRIANGLES} triangles")
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise ValueError("a triangle names a vertex that is not there")
    unit = UNIT_PATTERN.search(data) if kind == "dae" else None
    return vertices * (float(unit[1]) if unit else 1.0), triangles


def _clean_mesh(vertices: Floats, triangles: Longs) -> TriangleMesh:
    scale = float(np.ptp(vertices, axis=0).max()) or 1.0
    _, first_rows, merged = np.unique(
        np.round(vertices / (scale * 1e-7)), axis=0, return_index=True, return_inverse=True
    )
    triangles = merged.reshape(-1)[triangles]
    distinct = (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)
    return TriangleMesh(vertices[first_rows], triangles[distinct])


def mesh_components(mesh: TriangleMesh) -> list[TriangleMesh]:
    """The connected components, in the order of their first vertex."""
    import networkx  # takes long to load, and most shapes are no meshes

    graph: networkx.Graph[int] = networkx.Graph()
    graph.add_edges_from(map(tuple, mesh.triangles[:, :2].tolist()))
    graph.add_edges_from(map(tuple, mesh.triangles[:, 1:].tolist()))
    part = np.full(len(mesh.vertices), -1)
    groups = sorted(networkx.connected_components(graph), key=min)
    for number, members in enumerate(groups):
        part[list(members)] = number
    parts = []
    for number in range(len(groups)):
        own, renumbered = np.nonzero(part == number)[0], np.cumsum(part == number) - 1
        triangles = mesh.triangles[part[mesh.triangles[:, 0]] == number]
        parts.append(TriangleMesh(mesh.vertices[own], renumbered[triangles]))
    return parts


def convex_pieces(path: Path, where: Source) -> tuple[Floats, ...]:
    """The corners of the convex pieces that fill the mesh in a file.

    Raises `InvalidInput`, also for a part without volume.
    """
    try:
        status = path.stat()
        return _pieces_of(path, status.st_mtime_ns, status.st_size, where)
    except OSError as error:
        raise _refuse_mesh(
            path, f"the mesh cannot be read: {error.strerror}", "is it a file that can be read?"
        ) from None


@lru_cache(maxsize=256)
def _pieces_of(path: Path, _changed_ns: int, _size: int, where: Source) -> tuple[Floats, ...]:
    pieces: list[Floats] = []
    for part in mesh_components(read_mesh(path)):
        try:
            pieces += [hull_vertices(part.vertices)] if is_convex(part) else _divide_component(part)
        except FlatError as error:
            message = f"a part of the mesh has no volume: {error}"
            raise InvalidInput(
                [Diagnostic(where, "K702", message, "close the mesh, or delete the part")]
            ) from None
    if not pieces:
        raise InvalidInput([Diagnostic(where, "K702", "a mesh without area", "export it again")])
    return tuple(pieces)


def is_convex(mesh: TriangleMesh) -> bool:
    """Whether the middle and the corners of every triangle are at the hull of all, except for a
    thousandth of the size.

    Raises `FlatError` for a mesh without volume.
    """
    normals, offsets = hull_planes(mesh.vertices, hull_triangles(mesh.vertices))
    corners = mesh.vertices[mesh.triangles]
    points = np.concatenate([mesh.vertices, corners.mean(axis=1)])
    size = norm(np.ptp(mesh.vertices, axis=0))
    chunks = np.array_split(points, 1 + len(points) * len(offsets) // 2**24)
    depth = max(float((offsets - matmul(chunk, normals.T)).min(axis=1).max()) for chunk in chunks)
    return depth <= CONVEX_TOLERANCE * size


def has_decomposer() -> bool:
    """Whether CoACD is there."""
    return importlib.util.find_spec("coacd") is not None


def _divide_component(mesh: TriangleMesh) -> list[Floats]:
    """The corners of convex pieces that hold a component which is not convex; its triangles,
    without CoACD.
    """
    if not has_decomposer():
        return list(mesh.vertices[mesh.triangles])
    import coacd

    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.triangles), threshold=MAX_CONCAVITY, seed=0
    )
    return [hull_vertices(np.asarray(vertices, dtype=float)) for vertices, _ in parts]


def surface_only(path: Path) -> bool:
    """Whether some component of the mesh in a file stands for its surface alone.

    Raises as `convex_pieces` does.
    """
    return not has_decomposer() and any(
        not is_convex(part) for part in mesh_components(read_mesh(path))
    )
