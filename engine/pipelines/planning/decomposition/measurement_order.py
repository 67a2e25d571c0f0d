"""The order of an inspection's measurements as parts, with the order of its tool runs."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise, permutations, product

from cellwright.engine.model.part_measurements import chooses_tools, is_shared, names_in_goal
from cellwright.engine.model.part_measurements import goal_measurements as wanted_of
from cellwright.engine.model.tour_problem import Tour, TourProblem, cost_of
from cellwright.engine.pipelines.inspection.measurement_points import with_places
from cellwright.engine.pipelines.inspection.tool_tours import (
    ToolPartition,
    partition_by_tool,
    tour_problem,
)
from cellwright.engine.pipelines.inspection.tour_demands import TourDemands, without_windows
from cellwright.engine.pipelines.planning.decomposition.measurement_shares import (
    SharedMeasurements,
    share_measurements,
)
from cellwright.engine.pipelines.planning.decomposition.part_chain import (
    INFINITE_COST,
    PartChain,
    PlanningPart,
)
from cellwright.engine.stages.macros.lookup.macro_query import goal_literal
from cellwright.engine.stages.sequencing import TourLimits, sequence_tour
from cellwright.kb.model.conditions import Condition, Literal, goal_parts
from cellwright.kb.model.domain_model import OBJECT_TYPE
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import ANYTHING, Function

# work of the solver, about seconds: a plan does not wait longer for the proof of a tour with
# windows
SEQUENCE_PROOF = 5.0

Run = tuple[int, ...]  # places of visits that follow one another with one tool from one station


@dataclass(frozen=True, slots=True)
class CountedTour:
    """What the plan along an itinerary takes with all changes of tools and stations, and what every
    order takes at least.

    In the domain's unit of time; costs have no unit.
    """

    takes: int
    least: int
    unit: str

    @property
    def proved(self) -> bool:
        """Whether no order takes less."""
        return self.takes <= self.least

    @property
    def gap(self) -> float:
        """How much less another order could take, as a share of the least."""
        return max(0, self.takes - self.least) / max(1, self.least)


@dataclass(frozen=True)
class Itinerary:
    """The measurements of an inspection in the order of a tour, each with its tool.

    `kept` says that the order was kept in a store. Runs of an order that is not `fixed` may come in
    another order or the other way round; `altered` says that some do. `unasked` are measurements
    that cannot be made, with the reasons, which no goal asks for. `unkept` says why no tour keeps
    all windows, if that is known. `shared` says how several arms share the measurements: then the
    visits are in the order in which they can begin, and `problem` and `tour` are those of the arm
    that is done last. `counted` says what all of that takes, where few visits are made by several
    tools or from several stations.
    """

    visits: tuple[tuple[str, str], ...]
    partition: ToolPartition
    problem: TourProblem
    tour: Tour
    kept: bool = False
    fixed: bool = True
    altered: bool = False
    unasked: Mapping[str, str] = field(default_factory=dict)
    unkept: str = ""
    shared: SharedMeasurements | None = None
    counted: CountedTour | None = None

    @property
    def runs(self) -> tuple[Run, ...]:
        """The places of each run of visits with one tool from one station."""
        stations = {visit.name: visit.station for visit in self.problem.visits}
        places = groupby(
            range(len(self.visits)),
            key=lambda n: (self.visits[n][1], stations.get(self.visits[n][0])),
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

    def parts(
        self, problem: Problem, names: Collection[str] | None = None
    ) -> tuple[PlanningPart, ...]:
        """The goals by the visit after which they can hold; what the goals ask for beside the
        visits comes last.

        With `names`, only the parts of these visits, and what comes last.
        """
        place = {name: number for number, (name, _) in enumerate(self.visits)}
        by_tool = _ToolGoals(problem)
        arms = self.shared.arms if self.shared else {}
        goals: dict[int, list[Condition]] = {}
        rest: list[Condition] = []
        for goal in goal_parts(problem.goal):
            about = max((place[name] for name in names_in_goal(goal, place)), default=None)
            if about is None:
                rest.append(goal)
            elif names is None or self.visits[about][0] in names:
                name, tool = self.visits[about]
                own = by_tool.goal(goal, tool)
                goals.setdefault(about, []).append(
                    by_tool.goal(own, arms[name]) if name in arms else own
                )
        parts = [
            PlanningPart(self.visits[number][0], tuple(own))
            for number, own in sorted(goals.items())
        ]
        return (*parts, PlanningPart("", tuple(rest))) if rest else tuple(parts)


def find_itinerary(
    problem: Problem,
    line: Callable[[], PartChain],
    limits: TourLimits = TourLimits(),
    store: str = "",
) -> Itinerary | None:
    """The order of an inspection; None for another problem, or if fewer than two measurements can
    be put in order, by one arm.

    The sequence that is kept in `store` is used, and one is kept there if there is none. A workflow
    that only says which measurement comes before which is kept. `line` begins plans. Raises
    `InvalidInput`.
    """
    if not chooses_tools(problem.domain):
        return None
    asked_names = wanted_of(problem)
    before = order_of(problem, asked_names) if problem.chains else ()
    least = 1 if is_shared(problem) else 2
    if len(asked_names) < least or before is None:
        return None
    placed = with_places(problem)
    every = partition_by_tool(placed)
    parts = _restrict_partition(every, asked_names)
    if sum(map(len, parts.groups.values())) < least:
        return None
    order_found: Itinerary | None
    if store and not before:
        order_found = _kept_itinerary(placed, parts, limits, store)
    elif is_shared(placed):
        order_found = _share_itinerary(placed, parts, limits, TourDemands(before=before), line())
    else:
        order_found = _tour_itinerary(placed, parts, limits, TourDemands(before=before))
    unasked = {name: why for name, why in every.impossible.items() if name not in asked_names}
    return replace(order_found, unasked=unasked) if order_found else None


def order_of(problem: Problem, asked_names: Collection[str]) -> tuple[tuple[str, str], ...] | None:
    """The pairs (first, second) of measurements that a workflow orders; None if it asks for
    anything but measurements.

    A measurement that is made stays made, so a plan can reach its stage too early: the tour has to
    keep the order.
    """
    measured = problem.domain.conventions.measured
    stages: dict[str, list[str]] = {}
    for chain in problem.chains:
        for stage in chain.stages:
            about = names_in_goal(Literal(stage), asked_names)
            if stage.name != measured or len(about) != 1:
                return None
            stages.setdefault(chain.name, []).extend(about)
    pairs = [pair for stages_of_chain in stages.values() for pair in pairwise(stages_of_chain)]
    pairs += [
        (stages[name][-1], stages[c.name][0])
        for c in problem.chains
        for name in c.after
        if name in stages
    ]
    return tuple(dict.fromkeys(pair for pair in pairs if pair[0] != pair[1]))


def _tour_itinerary(
    problem: Problem, parts: ToolPartition, limits: TourLimits, more: TourDemands
) -> Itinerary | None:
    asked = tour_problem(problem, parts, more)
    limits = replace(limits, proof=SEQUENCE_PROOF) if asked.timed else limits
    tour, unkept = sequence_tour(asked, limits), ""
    if not isinstance(tour, Tour) and asked.timed:
        unkept, tour = tour.reason, sequence_tour(without_windows(asked), limits)
    if not isinstance(tour, Tour):
        return None
    visits = tuple((asked.visits[n].name, asked.visits[n].tool) for n in tour.order)
    return Itinerary(visits, parts, asked, tour, fixed=_has_bounds(asked), unkept=unkept)


def _share_itinerary(
    problem: Problem, parts: ToolPartition, limits: TourLimits, more: TourDemands, line: PartChain
) -> Itinerary | None:
    """The measurements of several arms; None if they cannot be shared."""
    shares = share_measurements(problem, parts, more, limits, line)
    if not isinstance(shares, SharedMeasurements) or not shares.order:
        return None
    last, tour = shares.last
    visits = tuple((name, shares.tools[name]) for name in shares.order)
    return Itinerary(visits, shares.partition, last, tour, unkept=shares.unkept, shared=shares)


def _has_bounds(problem: TourProblem) -> bool:
    """Whether a tour's ends or orders are asked for."""
    ends = (problem.start, problem.end)
    return problem.closed or problem.ordered or ends != (None, None)


def _kept_itinerary(
    problem: Problem, parts: ToolPartition, limits: TourLimits, store: str
) -> Itinerary:
    """The order of the kept sequence, without what the goals do not ask for."""
    from cellwright.engine.pipelines.planning.decomposition.kept_sequences import carry_on

    progress = carry_on(store, problem, limits=limits)
    asked_names = {name for names in parts.groups.values() for name in names}
    visits = tuple(
        (visit.name, visit.tool) for visit in progress.plan.rest if visit.name in asked_names
    )
    reasons = {**progress.plan.impossible, **progress.plan.bad, **parts.impossible}
    out = {
        name: why for name, why in reasons.items() if name in asked_names | set(parts.impossible)
    }
    fixed = (
        progress.way == "kept"
        or len(visits) < len(progress.tour.order)
        or _has_bounds(progress.problem)
    )
    parts, shares = replace(parts, impossible=out), getattr(progress, "shared", None)
    return Itinerary(visits, parts, progress.problem, progress.tour, fixed=fixed, shared=shares)


def _restrict_partition(parts: ToolPartition, asked_names: set[str]) -> ToolPartition:
    groups = {
        tool: tuple(n for n in names if n in asked_names) for tool, names in parts.groups.items()
    }
    impossible = {name: why for name, why in parts.impossible.items() if name in asked_names}
    return replace(
        parts, groups={t: names for t, names in groups.items() if names}, impossible=impossible
    )


class _ToolGoals:
    """Goals to measure something by any tool, as goals to measure it by the tool that the rules
    have chosen.
    """

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
        tool_parts = [
            Function(tool) if fits and argument == ANYTHING else argument
            for argument, fits in zip(literal.atom.arguments, self._places(tool), strict=True)
        ]
        return Literal(Function(self.measured, tuple(tool_parts)))

    def _places(self, tool: str) -> Sequence[bool]:
        """For each argument of the predicate whether it can be the tool."""
        own = self.objects.get(tool)
        return [
            own is not None and type_ != OBJECT_TYPE and self.domain.is_subtype(own, type_)
            for type_ in self.types
        ]


EXACT_RUNS = 4  # runs of which every order is compared; orders of more are improved step by step
MAX_PLANNED_LINKS = 120  # between runs that are planned
Value = tuple[int, int]
Order = tuple[Run, ...]
Turnable = Callable[[Run], bool]


def in_best_order(route: Itinerary, line: PartChain, cheap: bool = False) -> Itinerary:
    """The tour, or its runs in another order and some the other way round, if the plan then lasts
    less.

    What lasts as long may cost less; if it is to be `cheap`, the cost comes first.
    """
    if route.fixed or route.shared is not None or not route.visits:
        return route
    parts = {part.name: part for part in route.parts(line.problem)}
    links, own = Links(route, line, cheap, parts), route.runs
    best = _best_order(own, links, route.turnable)
    if best == own:
        return route
    ends, other_route = route.ends, route.of_runs(best)
    was, now = (
        line.trial(candidate.parts(line.problem, ends)) for candidate in (route, other_route)
    )
    return other_route if (now[::-1] < was[::-1] if cheap else now < was) else route


def _best_order(own: Order, links: "Links", turnable: Turnable) -> Order:
    """The best of all orders of few runs; of more, what step by step improvement ends with."""
    if len(own) <= EXACT_RUNS:
        return min((own, *_all_orders(own, turnable)), key=links.value)
    better: Order | None = own
    while better is not None:
        own, least = better, links.value(better)
        better = next(
            (
                neighbour
                for neighbour in _neighbour_orders(own, turnable)
                if links.below(least, neighbour)
            ),
            None,
        )
    return own


def _all_orders(runs: Order, turnable: Turnable) -> Iterator[Order]:
    for order in permutations(runs):
        yield from product(*((run, run[::-1]) if turnable(run) else (run,) for run in order))


def _neighbour_orders(order: Order, turnable: Turnable) -> Iterator[Order]:
    """The orders with a stretch of runs the other way round, or in its order elsewhere."""
    count = len(order)
    for first, after in ((i, j) for i in range(count) for j in range(i + 1, count + 1)):
        stretch, rest = order[first:after], (*order[:first], *order[after:])
        turned = tuple(run[::-1] if turnable(run) else run for run in reversed(stretch))
        yield (*order[:first], *turned, *order[after:])
        for place in range(len(rest) + 1):
            if place != first:
                yield (*rest[:place], *stretch, *rest[place:])


@dataclass
class Links:
    """What plans take from visit to visit, planned when first asked for; a visit is its place
    in the tour.
    """

    way: Itinerary
    line: PartChain
    cheap: bool
    parts: Mapping[str, PlanningPart]
    known: dict[tuple[int | None, int | None], Value] = field(default_factory=dict)
    after: dict[int, PartChain | None] = field(default_factory=dict)

    def value(self, order: Order) -> Value:
        """How long the ways between runs take together, from the start and to what is asked for at
        the end; and their cost.

        The cost comes first if the order is to be cheap.
        """
        ends = [None, *(place for run in order for place in (run[0], run[-1])), None]
        ways = [self._link(one, other) for one, other in list(pairwise(ends))[::2]]
        lasts, cost = sum(lasts for lasts, _ in ways), sum(cost for _, cost in ways)
        return (cost, lasts) if self.cheap else (lasts, cost)

    def below(self, least: Value, order: Order) -> bool:
        """Whether an order is known to take less; not if too many ways have been planned."""
        return len(self.known) < MAX_PLANNED_LINKS and self.value(order) < least

    def value_between(self, one: int | None, other: int | None) -> Value:
        """What leads from one visit to another one takes; None is the start, or the end.
        Nothing leads from a visit to itself.
        """
        lasts, cost = (0, 0) if one == other else self._link(one, other)
        return (cost, lasts) if self.cheap else (lasts, cost)

    def _link(self, one: int | None, other: int | None) -> Value:
        if (one, other) not in self.known:
            self.known[one, other] = self._planned(one, other)
        return self.known[one, other]

    def _planned(self, one: int | None, other: int | None) -> Value:
        part = self.parts.get("" if other is None else self.way.visits[other][0])
        if part is None:
            return 0, 0
        begin = self._after(one)
        return (INFINITE_COST, INFINITE_COST) if begin is None else begin.trial([part])

    def _after(self, visit: int | None) -> PartChain | None:
        """The chain after a visit, as if it were the first of all; None if it cannot be that."""
        if visit is None:
            return self.line
        if visit not in self.after:
            part = self.parts.get(self.way.visits[visit][0])
            self.after[visit] = self.line.led([part] if part else [])
        return self.after[visit]
