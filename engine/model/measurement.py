"""Features of a part, and the points at which they are measured. Metres and radians, in the frame of the part."""

from collections.abc import Mapping
from dataclasses import dataclass, field

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Feature:
    """A feature as the drawing shows it: its kind, its sizes by name, and where it is.

    `tolerances` holds the width of the narrowest tolerance zone for each kind of characteristic. `along` is
    the axis, the normal or the direction of a line. `across` is a direction at right angles to it; the angle
    `sweep` (rad) starts there. `entities` names the faces or edges of the part that the feature consists of.
    """

    name: str
    kind: str
    position: Triple
    along: Triple
    across: Triple | None = None
    sweep: tuple[float, float] | None = None
    sizes: Mapping[str, float] = field(default_factory=dict)
    outline: tuple[Triple, ...] = ()
    internal: bool = False
    tolerances: Mapping[str, float] = field(default_factory=dict)
    entities: tuple[str, ...] = ()


UNSAID_NORMAL: Triple = (
    0.0,
    0.0,
    -1.0,
)  # of a measurement for which a problem gives none: its surface faces down


@dataclass(frozen=True, slots=True)
class MeasurementPoint:
    """Where a tool measures: `normal` points away from the material; `bore_m` is the width of the hole that
    the point lies in.

    `kind` is what the tool must measure (thickness, profile). `tolerance_m` is the width of the tolerance
    zone that the measurement must confirm. `step` says in which step of the alignment the point is measured; 0: in none.
    `nominal_m` is what the measurement should give, `tool` the one that is to take it if it can; empty: any.
    """

    name: str
    feature: str
    kind: str
    position: Triple
    normal: Triple
    tolerance_m: float | None = None
    bore_m: float | None = None
    step: int = 0
    nominal_m: float | None = None
    tool: str = ""


@dataclass(frozen=True, slots=True)
class Excluded:
    """A feature without measurement points, and why it has none; or a remark about one that has points."""

    feature: str
    reason: str


@dataclass(frozen=True, slots=True)
class Inspection:
    """The measurements of a part.

    `left_out` names the kinds of facts about them that a domain does not know, `strange` the kinds of measurements. `unsure` are the
    facts that the domain misses to know how uncertain values are.
    """

    name: str
    points: tuple[MeasurementPoint, ...]
    excluded: tuple[Excluded, ...] = ()
    features: int = 0
    remarks: tuple[Excluded, ...] = ()
    left_out: tuple[str, ...] = ()
    strange: tuple[str, ...] = ()
    unsure: tuple[str, ...] = ()
