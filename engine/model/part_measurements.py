"""Measurements of a part: features, points, and those that a problem asks for."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from cellwright.kb.model.conditions import Condition, Literal, goal_parts
from cellwright.kb.model.conditions import literals_in as literals_of
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Term

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class DrawnFeature:
    """A feature as the drawing shows it: its kind, its sizes by name, and where it is.

    `tolerances` holds the width of the narrowest tolerance zone for each kind of characteristic.
    `along` is the axis, the normal or the direction of a line. `across` is a direction at right
    angles to it; the angle `sweep` (rad) starts there. `entities` names the faces or edges of the
    part that the feature consists of.
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
    """Where a tool measures: `normal` points away from the material; `bore_m` is the width of the
    hole that the point lies in.

    `kind` is what the tool must measure (thickness, profile). `tolerance_m` is the width of the
    tolerance zone that the measurement must confirm. `step` says in which step of the alignment the
    point is measured; 0: in none. `nominal_m` is what the measurement should give, `tool` the one
    that is to take it if it can; empty: any.
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
    """A feature without measurement points, and why it has none; or a remark about one that has
    points.
    """

    feature: str
    reason: str


@dataclass(frozen=True, slots=True)
class Inspection:
    """The measurements of a part.

    `left_out` names the kinds of facts about them that a domain does not know, `strange` the kinds
    of measurements. `unsure` are the facts that the domain misses to know how uncertain values are.
    """

    name: str
    points: tuple[MeasurementPoint, ...]
    excluded: tuple[Excluded, ...] = ()
    features: int = 0
    remarks: tuple[Excluded, ...] = ()
    left_out: tuple[str, ...] = ()
    strange: tuple[str, ...] = ()
    unsure: tuple[str, ...] = ()


def chooses_tools(domain: Domain) -> bool:
    """Whether the rules of a domain say which tool takes which measurement."""
    return domain.conventions.chosen in domain.predicates


def measuring_arms(problem: Problem) -> tuple[str, ...]:
    """The arms that can be the second argument of `measured`; none if it has no such argument."""
    domain = problem.domain
    declared = domain.predicates.get(domain.conventions.measured)
    if declared is None or len(declared.arguments) < 3:
        return ()
    objects = {**domain.objects, **problem.objects}
    return tuple(
        name for name, own in objects.items() if domain.is_subtype(own, declared.arguments[1])
    )


def is_shared(problem: Problem) -> bool:
    """Whether several arms can make the measurements of a problem, whose rules choose the tools."""
    return chooses_tools(problem.domain) and len(measuring_arms(problem)) > 1


def measurements_of(problem: Problem) -> list[str]:
    """The objects of a problem that are measurements, in the order in which they are listed."""
    objects, type_ = (
        {**problem.domain.objects, **problem.objects},
        problem.domain.conventions.measurement,
    )
    return [name for name, own in objects.items() if own == type_]


def goal_measurements(problem: Problem) -> set[str]:
    """The measurements that the goals name."""
    known = set(measurements_of(problem))
    return {name for goal in goal_parts(problem.goal) for name in names_in_goal(goal, known)}


def is_put_in_order(problem: Problem) -> bool:
    """Whether the goals name measurements that the sequencer puts in order, or shares among
    arms.
    """
    least = 1 if is_shared(problem) else 2
    return chooses_tools(problem.domain) and len(goal_measurements(problem)) >= least


def asked_for(problem: Problem) -> set[str] | None:
    """The measurements that goals and workflows name; None if that is all of them, or if some
    goal names none: it may take any.
    """
    known = set(measurements_of(problem))
    stages = (Literal(stage) for chain in problem.chains for stage in chain.stages)
    names = [names_in_goal(condition, known) for condition in (*goal_parts(problem.goal), *stages)]
    measurements = set[str]().union(*names)
    return measurements if all(names) and measurements < known else None


def names_in_goal(goal: Condition, known: Collection[str]) -> set[str]:
    """Those of some names that a goal names."""
    return {
        name
        for literal in literals_of(goal)
        for name in _constant_names(literal.atom)
        if name in known
    }


def _constant_names(term: Term) -> set[str]:
    if not isinstance(term, Function):
        return set()
    own = set() if term.arguments else {term.name}
    return own.union(*map(_constant_names, term.arguments))
