"""The parts of an inspection in the order of the sequencer: one part for each measurement that the goals ask for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from engine.model.tour import Tour, TourProblem
from engine.pipelines.inspection import Partition, chooses_tools, measurements_of, partition, tour_problem
from engine.pipelines.inspection.keeping import carry_on
from engine.pipelines.inspection.places import with_places
from engine.stages.macros.lookup.query import goal_literal
from engine.stages.sequencing import Limits, sequence
from kb.model.conditions import Condition, Literal, goal_parts
from kb.model.conditions import literals as literals_of
from kb.model.problem import Problem
from kb.terms import ANYTHING, Function, Term


@dataclass(frozen=True, slots=True)
class Part:
    """What is achieved at once: some goals. `name` is the measurement that they are about, if they are about one."""

    name: str
    goals: tuple[Condition, ...]


@dataclass(frozen=True)
class Itinerary:
    """The parts of an inspection in their order, and the tour that gives it.

    `visits` are the measurements of the tour, with their tools, in its order. `rest` is what the goals ask for beside it.
    """

    parts: tuple[Part, ...]
    rest: tuple[Part, ...]
    visits: tuple[tuple[str, str], ...]
    partition: Partition
    problem: TourProblem
    tour: Tour
    kept: bool = False


def itinerary(problem: Problem, limits: Limits = Limits(), store: str = "") -> Itinerary | None:
    """The parts of an inspection; None for another problem, or if fewer than two measurements can be put in order.

    The sequence that is kept in `store` is used if there is one. Raises `InvalidInput`.
    """
    if problem.chains or not chooses_tools(problem.domain):
        return None
    placed = with_places(problem)
    wanted = _wanted(problem)
    parts = _only(partition(placed), wanted)
    if sum(map(len, parts.groups.values())) < 2:
        return None
    asked, tour, kept = _tour(placed, parts, limits, store)
    if tour is None:
        return None
    visits = _from_here(problem, [(asked.visits[n].name, asked.visits[n].tool) for n in tour.order], tour, asked)
    return _divided(problem, visits, Itinerary((), (), tuple(visits), parts, asked, tour, kept))


def _wanted(problem: Problem) -> set[str]:
    """The measurements that the goals name."""
    known = set(measurements_of(problem))
    return {name for goal in goal_parts(problem.goal) for name in _named(goal, known)}


def _named(goal: Condition, known: set[str]) -> set[str]:
    return {name for literal in literals_of(goal) for name in _constants(literal.atom) if name in known}


def _constants(term: Term) -> set[str]:
    if not isinstance(term, Function):
        return set()
    own = set() if term.arguments else {term.name}
    return own.union(*map(_constants, term.arguments))


def _only(parts: Partition, wanted: set[str]) -> Partition:
    groups = {tool: tuple(n for n in names if n in wanted) for tool, names in parts.groups.items()}
    impossible = {name: why for name, why in parts.impossible.items() if name in wanted}
    return replace(parts, groups={t: names for t, names in groups.items() if names}, impossible=impossible)


def _tour(
    problem: Problem, parts: Partition, limits: Limits, store: str
) -> tuple[TourProblem, Tour | None, bool]:
    if store:
        progress = carry_on(store, problem, limits=limits)
        return progress.problem, progress.tour, progress.way == "kept"
    asked = tour_problem(problem, parts)
    found = sequence(asked, limits)
    return asked, found if isinstance(found, Tour) else None, False


def _from_here(
    problem: Problem, visits: Sequence[tuple[str, str]], tour: Tour, asked: TourProblem
) -> list[tuple[str, str]]:
    """The visits, or an open tour the other way round if it then begins with the tool in hand and costs as much."""
    return list(visits)


def _divided(problem: Problem, visits: Sequence[tuple[str, str]], made: Itinerary) -> Itinerary:
    """The goals by the visit after which they can hold; goals about no visit come last, each by itself."""
    place = {name: number for number, (name, _) in enumerate(visits)}
    goals: dict[int, list[Condition]] = {}
    rest: list[Condition] = []
    for goal in goal_parts(problem.goal):
        about = [place[name] for name in _named(goal, set(place))]
        if about:
            goals.setdefault(max(about), []).append(_by_tool(problem, goal, visits[max(about)]))
        else:
            rest.append(goal)
    parts = tuple(Part(visits[number][0], tuple(own)) for number, own in sorted(goals.items()))
    return replace(made, parts=parts, rest=(Part("", tuple(rest)),) if rest else ())


def _by_tool(problem: Problem, goal: Condition, visit: tuple[str, str]) -> Condition:
    """A goal to measure something by any tool, as one to measure it by the tool that the rules have chosen."""
    literal, words = goal_literal(goal), problem.domain.conventions
    if literal is None or not literal.positive or literal.atom.name != words.measured:
        return goal
    tool = Function(visit[1])
    types = problem.domain.predicates[words.measured].arguments
    own = {**problem.domain.objects, **problem.objects}.get(visit[1], "")
    given = [
        tool if each == ANYTHING and own and problem.domain.is_subtype(own, type_) and type_ != "object" else each
        for each, type_ in zip(literal.atom.arguments, types, strict=True)
    ]
    return Literal(Function(literal.atom.name, tuple(given)))


def without_goals(reasons: Mapping[str, str]) -> str:
    """A sentence about measurements that cannot be made."""
    return "; ".join(f"{name}: {why}" for name, why in reasons.items())
