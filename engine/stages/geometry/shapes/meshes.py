"""Reads STL and OBJ files as triangles, with diagnostics for meshes that cannot be solid, and finds their
connected components.
"""

import struct
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import networkx
import numpy as np

from engine.model.geometry import Floats, Longs
from engine.stages.geometry.shapes.hull import FlatError, hull_vertices
from kb.diagnostics import Diagnostic, InvalidInput, Source

MAX_BYTES = 256 * 2**20
MAX_TRIANGLES = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class TriangleMesh:
    """Vertices (n, 3) and triangles (m, 3) of indices."""

    vertices: Floats
    triangles: Longs


def read_mesh(path: Path) -> TriangleMesh:
    """The mesh in a file. Equal vertices are merged, and triangles without area are dropped.

    Raises `InvalidInput`.
    """
    try:
        data = _bytes(path)
        vertices, triangles = _obj(data) if path.suffix.lower() == ".obj" else _stl(data)
    except (ValueError, IndexError, OSError, struct.error) as error:
        raise _refused(path, f"the mesh cannot be read: {error}", "export it again as STL or OBJ") from None
    if not len(triangles) or not np.isfinite(vertices).all():
        raise _refused(path, "a mesh without triangles, or with endless ones", "export it again")
    return _cleaned(vertices, triangles)


def _bytes(path: Path) -> bytes:
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"larger than {MAX_BYTES // 2**20} MiB")
    return path.read_bytes()


def _refused(path: Path, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path)), "K702", message, hint)])


def _stl(data: bytes) -> tuple[Floats, Longs]:
    """The triangles of an STL file: it is binary if its length fits the binary format, else text."""
    if len(data) >= 84:
        (count,) = struct.unpack_from("<I", data, 80)
        if len(data) == 84 + 50 * count:
            rows = np.frombuffer(data, dtype=np.uint8, offset=84).reshape(count, 50)[:, 12:48]
            return _soup(np.ascontiguousarray(rows).view("<f4").astype(float))
    lines = data.decode("ascii", "strict").split("\n")
    if not lines[0].lstrip().startswith("solid"):
        raise ValueError("neither binary nor text STL")
    corners = [line.split()[1:4] for line in lines if line.lstrip().startswith("vertex")]
    return _soup(np.array(corners, dtype=float))


def _soup(corners: Floats) -> tuple[Floats, Longs]:
    vertices = corners.reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def _obj(data: bytes) -> tuple[Floats, Longs]:
    """The vertices and faces of an OBJ file; all else is skipped. A polygon becomes a fan of triangles.

    Indices count from 1, or, if negative, back from the last vertex.
    """
    vertices: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    for line in data.decode("utf-8", "replace").split("\n"):
        parts = line.split()
        if parts[:1] == ["v"]:
            vertices.append([float(part) for part in parts[1:4]])
        elif parts[:1] == ["f"]:
            corners = [_index(part, len(vertices)) for part in parts[1:]]
            triangles += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
    return np.array(vertices, dtype=float).reshape(-1, 3), np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _index(part: str, count: int) -> int:
    number = int(part.partition("/")[0])
    index = number - 1 if number > 0 else count + number
    if not 0 <= index < count:
        raise ValueError(f"a face names vertex {number} of {count}")
    return index


def _cleaned(vertices: Floats, triangles: Longs) -> TriangleMesh:
    scale = float(np.ptp(vertices, axis=0).max()) or 1.0
    _, kept, merged = np.unique(
        np.round(vertices / (scale * 1e-7)), axis=0, return_index=True, return_inverse=True
    )
    triangles = merged.reshape(-1)[triangles]
    distinct = (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)
    return TriangleMesh(vertices[kept], triangles[distinct])


def components(mesh: TriangleMesh) -> list[Floats]:
    """The vertices of each connected component. Components are in the order of their first vertex."""
    graph: networkx.Graph[int] = networkx.Graph()
    graph.add_edges_from(map(tuple, mesh.triangles[:, :2]))
    graph.add_edges_from(map(tuple, mesh.triangles[:, 1:]))
    parts = sorted(networkx.connected_components(graph), key=min)
    return [mesh.vertices[sorted(part)] for part in parts]


def convex_pieces(mesh: TriangleMesh, where: Source) -> list[Floats]:
    """The corners of the hull of each component. Raises `InvalidInput` when one spans no volume."""
    pieces = []
    for part in components(mesh):
        try:
            pieces.append(hull_vertices(part))
        except FlatError as error:
            message = f"a part of the mesh has no volume: {error}"
            raise InvalidInput(
                [Diagnostic(where, "K702", message, "close the mesh, or delete the part")]
            ) from None
    if not pieces:
        raise InvalidInput([Diagnostic(where, "K702", "a mesh without area", "export it again")])
    return pieces


def is_closed(mesh: TriangleMesh) -> bool:
    """Whether every edge has exactly one triangle on each side."""
    t = mesh.triangles
    directed = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    edges = {(int(a), int(b)) for a, b in directed}
    return len(edges) == len(directed) and all((b, a) in edges for a, b in edges)
