"""Points on the material of a feature's faces: within their loops, and away from their edges.

A scheme says where points should lie (on rings, for example). Where there is no material, or an edge is too near, others take
their place: each as far as possible from those before.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.formats.interop.qif.faces import Face
from cellwright.engine.formats.interop.qif.regions import spread
from cellwright.engine.kernels.arrays import Floats, Truths

Placed = list[tuple[Floats, Floats]]  # positions and normals
SHARE = 0.16  # of the way from the edges to the middle: how far points stay away if nobody says it
LEAST = 0.9  # the same share where material is too narrow for the distance that is asked for
ROWS = (40, 160)
OFF = 1e-3  # how far a place may lie beside a surface, as a share of the size of its face


@dataclass(frozen=True, slots=True, eq=False)
class Pool:
    """Places (n, 3) on material, their normals away from it, how far they are from an edge, and the area of each."""

    places: Floats
    normals: Floats
    gaps: Floats
    areas: Floats

    def only(self, keep: Truths) -> "Pool":
        """The places for which `keep` holds."""
        return Pool(self.places[keep], self.normals[keep], self.gaps[keep], self.areas[keep])


def pool(faces: Sequence[Face], rows: int = ROWS[0]) -> Pool:
    """Places all over the material of faces."""
    parts = [_of_face(face, rows) for face in faces]
    return Pool(*(np.concatenate([part[i] for part in parts]) for i in range(4)))


def _of_face(face: Face, rows: int) -> tuple[Floats, Floats, Floats, Floats]:
    parameters, areas = face.candidates(rows)
    places = face.surface.at(parameters)
    normals, size = face.normals(parameters)
    return places, normals, face.gaps(places), areas * size


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """Points on material, and how far from an edge they are at least; `narrow` if that is less than asked for."""

    points: Placed
    gap: float
    narrow: bool


def chosen(
    faces: Sequence[Face], places: Pool, wanted: Placed, count: int, margin: float | None = None
) -> Choice | None:
    """`count` points on faces: those of `wanted` that lie on material, and others from `places`; None without any material.

    `margin` is the least distance from an edge; if it is not given, it follows from the size of the material.
    """
    if not len(places.places):
        return None
    widest = float(places.gaps.max())
    least = SHARE * widest if margin is None else margin
    least = 0.0 if not np.isfinite(least) else least
    narrow = widest < least
    if narrow:
        least = LEAST * widest
    free = places.only(places.gaps >= least)
    taken = [found for each in wanted if (found := _on_one(faces, each[0], least)) is not None]
    at = np.array([place for place, _ in taken]).reshape(-1, 3)
    more = spread(free.places, count - len(taken), at)
    points = [*taken, *((free.places[i], free.normals[i]) for i in more)]
    return Choice(points[:count], least, narrow)


def _on_one(faces: Sequence[Face], place: Floats, least: float) -> tuple[Floats, Floats] | None:
    """A place on the material of one of the faces, at least so far from its edges, with the normal; None if it is on none."""
    for face in faces:
        parameters = face.lifted(face.surface.parameters(place[None]))
        there = face.surface.at(parameters)
        beside = float(np.linalg.norm(there[0] - place))
        if beside <= OFF * face.size and face.within(parameters)[0] and face.gaps(there)[0] >= least:
            return there[0], face.normals(parameters)[0][0]
    return None


def on_material(faces: Sequence[Face], places: Floats) -> Truths:
    """Whether each of the places (n, 3) lies on the material of one of the faces, or straight before or behind it."""
    found = np.zeros(len(places), bool)
    for face in faces:
        found |= face.within(face.lifted(face.surface.parameters(places)))
    return found
