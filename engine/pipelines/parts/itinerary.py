"""The parts of an inspection in the order of the sequencer: one part for each measurement that the goals ask for."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise

from cellwright.engine.model.measurements import chooses_tools, is_shared, named
from cellwright.engine.model.measurements import wanted as wanted_of
from cellwright.engine.model.tour import Tour, TourProblem, cost_of
from cellwright.engine.pipelines.inspection import Partition, partition, tour_problem
from cellwright.engine.pipelines.inspection.demands import Demands, without_windows
from cellwright.engine.pipelines.parts.chain import Chain, Part
from cellwright.engine.pipelines.parts.sharing import Shared, shared
from cellwright.engine.pipelines.points import with_places
from cellwright.engine.stages.macros.lookup.query import goal_literal
from cellwright.engine.stages.sequencing import Limits, sequence
from cellwright.kb.model.conditions import Condition, Literal, goal_parts
from cellwright.kb.model.domain import OBJECT
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import ANYTHING, Function

PROOF = (
    5.0  # work of the solver, about seconds: a plan does not wait longer for the proof of a tour with windows
)

Run = tuple[int, ...]  # places of visits that follow one another with one tool from one station


@dataclass(frozen=True)
class Itinerary:
    """The measurements of an inspection in the order of a tour, each with its tool.

    `kept` says that the order was kept in a store. Runs of an order that is not `fixed` may come in another order or the other
    way round; `altered` says that some do. `unasked` are measurements that cannot be made, with the reasons, which no goal asks for.
    `unkept` says why no tour keeps all windows, if that is known. `shared` says how several arms share the measurements: then the
    visits are in the order in which they can begin, and `problem` and `tour` are those of the arm that is done last.
    """

    visits: tuple[tuple[str, str], ...]
    partition: Partition
    problem: TourProblem
    tour: Tour
    kept: bool = False
    fixed: bool = True
    altered: bool = False
    unasked: Mapping[str, str] = field(default_factory=dict)
    unkept: str = ""
    shared: Shared | None = None

    @property
    def runs(self) -> tuple[Run, ...]:
        """The places of each run of visits with one tool from one station."""
        stations = {visit.name: visit.station for visit in self.problem.visits}
        places = groupby(
            range(len(self.visits)), key=lambda n: (self.visits[n][1], stations.get(self.visits[n][0]))
        )
        return tuple(tuple(run) for _, run in places)

    @property
    def ends(self) -> set[str]:
        """The first two and the last two visits of each run."""
        return {self.visits[place][0] for run in self.runs for place in (*run[:2], *run[-2:])}

    def turnable(self, run: Run) -> bool:
        """Whether the ways between the visits of a run cost as much the other way round."""
        order = tuple(self.tour.order[place] for place in run)
        return cost_of(self.problem, order) == cost_of(self.problem, order[::-1])

    def of_runs(self, runs: Sequence[Run]) -> "Itinerary":
        """The same visits in the order of other runs."""
        order = [place for run in runs for place in run]
        tour = tuple(self.tour.order[place] for place in order)
        return replace(
            self,
            visits=tuple(self.visits[place] for place in order),
            tour=replace(self.tour, order=tour, cost=cost_of(self.problem, tour)),
            altered=True,
        )

    def parts(self, problem: Problem, names: Collection[str] | None = None) -> tuple[Part, ...]:
        """The goals by the visit after which they can hold; what the goals ask for beside the visits comes last.

        With `names`, only the parts of these visits, and what comes last.
        """
        place = {name: number for number, (name, _) in enumerate(self.visits)}
        by_tool = _ByTool(problem)
        arms = self.shared.arms if self.shared else {}
        goals: dict[int, list[Condition]] = {}
        rest: list[Condition] = []
        for goal in goal_parts(problem.goal):
            about = max((place[name] for name in named(goal, place)), default=None)
            if about is None:
                rest.append(goal)
            elif names is None or self.visits[about][0] in names:
                name, tool = self.visits[about]
                own = by_tool.goal(goal, tool)
                goals.setdefault(about, []).append(by_tool.goal(own, arms[name]) if name in arms else own)
        parts = [Part(self.visits[number][0], tuple(own)) for number, own in sorted(goals.items())]
        return (*parts, Part("", tuple(rest))) if rest else tuple(parts)


def itinerary(
    problem: Problem, line: Callable[[], Chain], limits: Limits = Limits(), store: str = ""
) -> Itinerary | None:
    """The order of an inspection; None for another problem, or if fewer than two measurements can be put in order, by one arm.

    The sequence that is kept in `store` is used, and one is kept there if there is none. A workflow
    that only says which measurement comes before which is kept. `line` begins plans. Raises `InvalidInput`.
    """
    if not chooses_tools(problem.domain):
        return None
    wanted = wanted_of(problem)
    before = order_of(problem, wanted) if problem.chains else ()
    least = 1 if is_shared(problem) else 2
    if len(wanted) < least or before is None:
        return None
    placed = with_places(problem)
    every = partition(placed)
    parts = _only(every, wanted)
    if sum(map(len, parts.groups.values())) < least:
        return None
    found: Itinerary | None
    if store and not before:
        found = _kept(placed, parts, limits, store)
    elif is_shared(placed):
        found = _shared(placed, parts, limits, Demands(before=before), line())
    else:
        found = _made(placed, parts, limits, Demands(before=before))
    unasked = {name: why for name, why in every.impossible.items() if name not in wanted}
    return replace(found, unasked=unasked) if found else None


def order_of(problem: Problem, wanted: Collection[str]) -> tuple[tuple[str, str], ...] | None:
    """The pairs (first, second) of measurements that a workflow orders; None if it asks for anything but measurements.

    A measurement that is made stays made, so a plan can reach its stage too early: the tour has to keep the order.
    """
    measured = problem.domain.conventions.measured
    stages: dict[str, list[str]] = {}
    for chain in problem.chains:
        for stage in chain.stages:
            about = named(Literal(stage), wanted)
            if stage.name != measured or len(about) != 1:
                return None
            stages.setdefault(chain.name, []).extend(about)
    pairs = [pair for each in stages.values() for pair in pairwise(each)]
    pairs += [
        (stages[name][-1], stages[c.name][0]) for c in problem.chains for name in c.after if name in stages
    ]
    return tuple(dict.fromkeys(pair for pair in pairs if pair[0] != pair[1]))


def _made(problem: Problem, parts: Partition, limits: Limits, more: Demands) -> Itinerary | None:
    asked = tour_problem(problem, parts, more)
    limits = replace(limits, proof=PROOF) if asked.timed else limits
    tour, unkept = sequence(asked, limits), ""
    if not isinstance(tour, Tour) and asked.timed:
        unkept, tour = tour.reason, sequence(without_windows(asked), limits)
    if not isinstance(tour, Tour):
        return None
    visits = tuple((asked.visits[n].name, asked.visits[n].tool) for n in tour.order)
    return Itinerary(visits, parts, asked, tour, fixed=_bound(asked), unkept=unkept)


def _shared(
    problem: Problem, parts: Partition, limits: Limits, more: Demands, line: Chain
) -> Itinerary | None:
    """The measurements of several arms; None if they cannot be shared."""
    made = shared(problem, parts, more, limits, line)
    if not isinstance(made, Shared) or not made.order:
        return None
    last, tour = made.last
    visits = tuple((name, made.tools[name]) for name in made.order)
    return Itinerary(visits, made.partition, last, tour, unkept=made.unkept, shared=made)


def _bound(problem: TourProblem) -> bool:
    """Whether a tour's ends or orders are asked for."""
    ends = (problem.start, problem.end)
    return problem.closed or problem.ordered or ends != (None, None)


def _kept(problem: Problem, parts: Partition, limits: Limits, store: str) -> Itinerary:
    """The order of the kept sequence, without what the goals do not ask for."""
    from cellwright.engine.pipelines.parts.keeping import (
        carry_on,  # slow to import, and only a store needs it
    )

    progress = carry_on(store, problem, limits=limits)
    wanted = {name for names in parts.groups.values() for name in names}
    visits = tuple((each.name, each.tool) for each in progress.plan.rest if each.name in wanted)
    reasons = {**progress.plan.impossible, **progress.plan.bad, **parts.impossible}
    out = {name: why for name, why in reasons.items() if name in wanted | set(parts.impossible)}
    fixed = progress.way == "kept" or len(visits) < len(progress.tour.order) or _bound(progress.problem)
    parts, shares = replace(parts, impossible=out), getattr(progress, "shared", None)
    return Itinerary(visits, parts, progress.problem, progress.tour, fixed=fixed, shared=shares)


def _only(parts: Partition, wanted: set[str]) -> Partition:
    groups = {tool: tuple(n for n in names if n in wanted) for tool, names in parts.groups.items()}
    impossible = {name: why for name, why in parts.impossible.items() if name in wanted}
    return replace(parts, groups={t: names for t, names in groups.items() if names}, impossible=impossible)


class _ByTool:
    """Goals to measure something by any tool, as goals to measure it by the tool that the rules have chosen."""

    def __init__(self, problem: Problem) -> None:
        domain = problem.domain
        self.measured = domain.conventions.measured
        declared = domain.predicates.get(self.measured)
        self.types = declared.arguments if declared else ()
        self.objects, self.domain = {**domain.objects, **problem.objects}, domain

    def goal(self, goal: Condition, tool: str) -> Condition:
        """The goal by a tool, or by an arm."""
        literal = goal_literal(goal)
        if literal is None or not literal.positive or literal.atom.name != self.measured:
            return goal
        given = [
            Function(tool) if fits and each == ANYTHING else each
            for each, fits in zip(literal.atom.arguments, self._places(tool), strict=True)
        ]
        return Literal(Function(self.measured, tuple(given)))

    def _places(self, tool: str) -> Sequence[bool]:
        """For each argument of the predicate whether it can be the tool."""
        own = self.objects.get(tool)
        return [
            own is not None and type_ != OBJECT and self.domain.is_subtype(own, type_) for type_ in self.types
        ]
