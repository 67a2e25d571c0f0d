"""Values of spatial relations: features of parts, what shall hold between them, and what follows. Metres, radians."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

from cellwright.engine.model.geometry import Floats


class FeatureKind(Enum):
    """What a feature is geometrically: a face lies in a plane; edges and axes lie on lines; vertices and centres are points."""

    PLANE = "plane"
    LINE = "line"
    POINT = "point"


class RelationKind(Enum):
    """What may be said of two features."""

    PARALLEL = "parallel"
    AGAINST = "against"
    COPLANAR = "coplanar"
    ALIGNED = "aligned"
    FITS = "fits"
    CONCENTRIC = "concentric"
    DISTANCE = "distance"
    ANGLE = "angle"


@dataclass(frozen=True, slots=True, eq=False)
class Feature:
    """A feature in the frame of its part.

    It passes through `point` (3,). `direction` (3,) is the unit vector of a line, or the outward normal of a plane; zero for
    a point.
    """

    part: str
    name: str
    kind: FeatureKind
    point: Floats
    direction: Floats

    def __str__(self) -> str:
        return f"{self.part}.{self.name}"


@dataclass(frozen=True, slots=True, eq=False)
class Relation:
    """`kind` holds between two features; `value` is in metres or radians where the kind takes one.

    A preferred relation holds as far as the others allow.
    """

    kind: RelationKind
    first: Feature
    second: Feature
    value: float = 0.0
    preferred: bool = False

    def __str__(self) -> str:
        return f"{self.first} {self.kind.value} {self.second}"


@dataclass(frozen=True, slots=True, eq=False)
class Freedom:
    """A way in which a part may still move in the base's frame: `pitch_m` metres along a line for each radian about it.

    The line has a unit `direction` (3,) and passes through `point` (3,). A pitch of 0 is a turn, an infinite one a slide.
    """

    part: str
    direction: Floats
    point: Floats
    pitch_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Assembled:
    """Poses T_base_part (4, 4) with which all relations hold.

    `degrees` counts how many numbers are still free, for all parts together; `freedoms` lists the ways of each part.
    `redundant` can all be left out, and nothing changes. `others` are further solutions, none reached from another by the
    free numbers; each is a mapping as `poses`. `residual` is what the worst equation lacks, with lengths over the size of
    the parts.
    """

    poses: Mapping[str, Floats]
    degrees: int
    freedoms: tuple[Freedom, ...]
    redundant: tuple[Relation, ...]
    others: tuple[Mapping[str, Floats], ...]
    residual: float


@dataclass(frozen=True, slots=True, eq=False)
class Contradiction:
    """Relations that cannot hold together. No smaller set of those given is contradictory."""

    relations: tuple[Relation, ...]


AssemblyAnswer: TypeAlias = Assembled | Contradiction
