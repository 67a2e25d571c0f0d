"""Parts as seen and grasped: a closed surface of triangles, and the plane facets that these make up. Metres."""

from dataclasses import dataclass

from cellwright.engine.model.geometry import Floats, Longs, Truths


@dataclass(frozen=True, slots=True, eq=False)
class Facet:
    """A plane piece of a surface: the points x with normal . x = offset, inside the `edges`.

    `edges` (e, 2, 3) run counter-clockwise seen from outside; those around a hole run the other way. `convex` (e,) says
    where the next facet falls back.
    """

    name: str
    normal: Floats
    offset: float
    edges: Floats
    convex: Truths


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A part's surface in its own frame: corners (m, 3, 3) of triangles, and the number of each one's facet (m,)."""

    name: str
    corners: Floats
    facet_of: Longs
    facets: tuple[Facet, ...]

    @property
    def vertices(self) -> Floats:
        """The corners of all triangles (3 m, 3)."""
        found: Floats = self.corners.reshape(-1, 3)
        return found
