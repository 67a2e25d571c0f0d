"""A measurement sequence under way: visits done stay, the rest is sequenced anew on changes."""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TypeVar

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.model.part_measurements import measurements_of
from cellwright.engine.model.tour_problem import (
    Tour,
    TourProblem,
    Visit,
    cost_of,
    times_of,
    tour_violations,
)
from cellwright.engine.pipelines.inspection.arm_capabilities import partition_after_loss
from cellwright.engine.pipelines.inspection.measurement_points import given_positions_m
from cellwright.engine.pipelines.inspection.tool_tours import (
    ToolPartition,
    stations_of,
    tour_problem,
)
from cellwright.engine.pipelines.inspection.tour_demands import (
    TourDemands,
    of_facts,
    remaining_demands,
    with_demands,
    without_windows,
)
from cellwright.engine.pipelines.inspection.travel_costs import open_tour
from cellwright.engine.stages.sequencing import TourLimits, sequence_tour
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.inspection_store import PlannedVisit, SequencePlan

RestVisits = tuple[PlannedVisit, ...]


def tour_of_rest(
    plan: SequencePlan, rest: RestVisits, phases: Mapping[str, int], inspection: Problem
) -> tuple[TourProblem, int]:
    """The tour problem of the rest, and 1 if it starts with the last visit done, else 0. Raises
    `InvalidInput`.

    Windows count from the start of the whole tour. What is done counts as having begun when the
    tour says.
    """
    before = plan.done[-1:]
    first = min(phases.values(), default=0)
    facts = amounts_of(inspection).facts
    demands = of_facts(facts, inspection.domain.conventions, Source(inspection.path))
    stations, shifts = stations_of(facts, inspection.domain.conventions)
    visits = tuple(
        Visit(
            visit.name,
            visit.position or None,
            visit.tool,
            phase=first if number < len(before) else phases.get(visit.name, 0),
            station=stations.get(visit.name, ""),
        )
        for number, visit in enumerate((*before, *rest))
    )
    rest_tour = _rest_tour(plan, visits, inspection, demands, 0 if before else None)
    if before:
        over = _last_begin(plan, inspection, demands) if demands.windows else 0
        demands = remaining_demands(demands, over, {before[0].name})
    return with_demands(replace(rest_tour, shifts=shifts), demands), len(before)


def _rest_tour(
    plan: SequencePlan,
    visits: tuple[Visit, ...],
    inspection: Problem,
    demands: TourDemands,
    start: int | None = None,
) -> TourProblem:
    changes = {(a, b): cost for a, b, cost in plan.changes}
    facts = amounts_of(inspection).facts
    return open_tour(
        inspection, plan.problem, visits, changes, start, facts=facts, in_time=demands.need_times
    )


def _last_begin(plan: SequencePlan, inspection: Problem, demands: TourDemands) -> int:
    """When the last visit done has begun, as the tour through all that is done has it, after
    the start of that tour.
    """
    visits = tuple(Visit(visit.name, visit.position or None, visit.tool) for visit in plan.done)
    tour = with_demands(_rest_tour(plan, visits, inspection, demands), replace(demands, before=()))
    return times_of(tour, tuple(range(len(visits))))[-1][1]


REASON_REMOVED = "no longer in the problem"
FOUND_BAD = "found bad"
Visits = tuple[PlannedVisit, ...]
Parting = Callable[[Problem, tuple[str, ...]], ToolPartition]
ProgressType = TypeVar("ProgressType", bound="KeptSequenceProgress")


@dataclass(frozen=True, slots=True)
class SequenceNews:
    """What has happened: visits done; tools and resources lost; visits found bad, with the
    reason; and names restored.
    """

    done: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    bad: Mapping[str, str] = field(default_factory=dict)
    restored: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class KeptSequenceProgress:
    """How a sequence goes on. `way`: `made`, `kept` (as it was) or `resequenced`.

    `problem` and `tour` are those of the rest, and begin at the last visit done if there is one.
    The visits of the old rest fall into four groups: `kept` are in the old order relative to each
    other, `reordered` are not, `moved` have another tool (old, new), and `dropped` are left out,
    with the reason. `added` are new visits. `outdated` are visits done whose position in the
    problem has changed or that the problem no longer has. `unkept` says why no order keeps all
    windows.
    """

    plan: SequencePlan
    way: str
    problem: TourProblem
    tour: Tour
    kept: tuple[str, ...] = ()
    reordered: tuple[str, ...] = ()
    moved: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    added: tuple[str, ...] = ()
    dropped: Mapping[str, str] = field(default_factory=dict)
    outdated: tuple[str, ...] = ()
    unkept: str = ""

    @property
    def next(self) -> PlannedVisit | None:
        """The next visit; None when none is left."""
        return self.plan.rest[0] if self.plan.rest else None


@dataclass(frozen=True, slots=True)
class RemainingSequence:
    """What is left after some news: the sequence, whose rest is the old one, the visits that
    are wanted now, and all that can be made.
    """

    plan: SequencePlan
    wanted: Visits
    parts: ToolPartition
    asked: TourProblem


def carry_on_sequence(
    plan: SequencePlan,
    problem: Problem,
    news: SequenceNews = SequenceNews(),
    limits: TourLimits = TourLimits(),
) -> KeptSequenceProgress:
    """The sequence after some news, compared with the problem as it is now.

    Raises `InvalidInput`.
    """
    if is_unkept(plan) and news != SequenceNews():
        plan = carry_on_sequence(plan, problem, limits=limits).plan
    remaining = left_of(plan, problem, news)
    phases = {visit.name: visit.phase for visit in remaining.asked.visits}
    progress = _sequence_rest(plan, remaining.plan, remaining.wanted, phases, problem, limits)
    return compare_progress(plan, progress, problem)


def left_of(
    plan: SequencePlan, problem: Problem, news: SequenceNews, part: Parting = partition_after_loss
) -> RemainingSequence:
    """What is left of a sequence after some news; `part` says what is possible when names are
    lost. Raises `InvalidInput`.
    """
    _require_known(problem, plan, news)
    lost = tuple(sorted({*plan.lost, *news.lost} - set(news.restored)))
    bad = {name: why for name, why in {**plan.bad, **news.bad}.items() if name not in news.restored}
    parts = part(problem, lost)
    asked = tour_problem(problem, parts, timed=False)
    visits = tuple(
        PlannedVisit(visit.name, visit.tool, visit.position or ()) for visit in asked.visits
    )
    done = _visits_done(plan, visits, parts, news)
    names = {visit.name for visit in done}
    _not_done(names, news)
    wanted_visits = tuple(
        visit for visit in visits if visit.name not in names and visit.name not in bad
    )
    changes = tuple(sorted((a, b, cost) for (a, b), cost in asked.changes.items()))
    out = {name: why for name, why in parts.impossible.items() if name not in names}
    now = replace(plan, done=done, lost=lost, bad=bad, impossible=out, changes=changes)
    return RemainingSequence(now, wanted_visits, parts, asked)


def is_unkept(plan: SequencePlan) -> bool:
    """Whether nothing was kept yet."""
    return plan == SequencePlan(plan.domain, plan.problem, version=plan.version)


def _require_known(problem: Problem, plan: SequencePlan, news: SequenceNews) -> None:
    """Raise `InvalidInput` for names in the news that are not known."""
    measurements = {*measurements_of(problem)} | {visit.name for visit in (*plan.done, *plan.rest)}
    losable = losable_resources(problem)
    for option, names, known_names in (
        ("done", news.done, measurements),
        ("bad", news.bad, measurements),
        ("lost", news.lost, losable),
        ("restored", news.restored, {*losable, *measurements}),
    ):
        wrong = [
            unknown_name(_option_kind(option), name, sorted(known_names), Source(f"--{option}"))
            for name in names
            if name not in known_names
        ]
        if wrong:
            raise InvalidInput(wrong)


def losable_resources(problem: Problem) -> set[str]:
    """The names that can be lost: objects other than measurements, and the resources of
    operators.
    """
    named = {
        str(resource) for operator in problem.domain.operators for resource in operator.resources
    }
    return {*problem.domain.objects, *problem.objects, *named}.difference(measurements_of(problem))


def _option_kind(option: str) -> str:
    return "visit" if option in ("done", "bad") else "resource"


def _visits_done(
    plan: SequencePlan, visits: Visits, parts: ToolPartition, news: SequenceNews
) -> Visits:
    """The visits done: those of the kept sequence, then those that the problem says are done, then
    those in the news.

    Raises `InvalidInput` for a visit that is left out of the sequence.
    """
    finished = {visit.name for visit in plan.done}
    recorded = {visit.name: visit for visit in (*visits, *plan.rest)}
    names_said = [visit.name for visit in plan.rest if visit.name in set(parts.done)]
    new = [
        name
        for name in dict.fromkeys((*names_said, *news.done))
        if name not in finished | set(parts.done) - set(names_said)
    ]
    out = {**parts.impossible, **plan.bad}
    wrong = [
        Diagnostic(
            Source("--done"), "K411", f"'{name}' is left out: {out.get(name, REASON_REMOVED)}", ""
        )
        for name in new
        if name not in recorded or name in plan.bad
    ]
    if wrong:
        raise InvalidInput(wrong)
    return (*plan.done, *(recorded[name] for name in new))


def _not_done(done: set[str], news: SequenceNews) -> None:
    wrong = [
        Diagnostic(
            Source("--bad"),
            "K411",
            f"'{name}' is done already",
            "only visits that are not done can be left out",
        )
        for name in news.bad
        if name in done
    ]
    if wrong:
        raise InvalidInput(wrong)


def _sequence_rest(
    old: SequencePlan,
    now: SequencePlan,
    wanted_visits: Visits,
    phases: Mapping[str, int],
    inspection: Problem,
    limits: TourLimits,
) -> KeptSequenceProgress:
    """The rest in its old order if nothing about it has changed; else in the best order found."""
    behind = len(now.done) - len(old.done)
    problem, first = tour_of_rest(now, wanted_visits, phases, inspection)
    standing = old.rest[behind:]
    on_course = now.done[len(old.done) :] == old.rest[:behind] and old.changes == now.changes
    if not is_unkept(old) and on_course and {*standing} == {*wanted_visits}:
        same, _ = tour_of_rest(now, standing, phases, inspection)
        order = tuple(range(len(same.visits)))
        if not order or not tour_violations(same, order):
            tour = Tour(order, cost_of(same, order) if order else 0, 0)
            return KeptSequenceProgress(replace(now, rest=standing), "kept", same, tour)
    tour_found, unkept = sequence_tour(problem, limits), ""
    if problem.timed and not isinstance(tour_found, Tour):
        unkept, problem = tour_found.reason, without_windows(problem)
        tour_found = sequence_tour(problem, limits)
    tour = _steadier_tour(
        problem, _insert_visits(problem, wanted_visits, old.rest, first), tour_found
    )
    rest = tuple(wanted_visits[number_in_tour - first] for number_in_tour in tour.order[first:])
    manner = "made" if is_unkept(old) else "kept" if unkept and rest == standing else "resequenced"
    return KeptSequenceProgress(replace(now, rest=rest), manner, problem, tour, unkept=unkept)


def _insert_visits(
    problem: TourProblem, wanted_visits: Visits, old: Visits, first: int
) -> tuple[int, ...]:
    """The wanted visits in their old order.

    Each visit that is not in the old order is inserted where that costs least.
    """
    number = {wanted_visit: index + first for index, wanted_visit in enumerate(wanted_visits)}
    order = [*range(first), *(number[old_visit] for old_visit in old if old_visit in number)]
    arcs = problem.arcs
    for new_visit in sorted({*number.values()} - {*order}):
        order.insert(_cheapest_position(arcs, order, new_visit, first), new_visit)
    return tuple(order)


def _cheapest_position(arcs: Longs, order: Sequence[int], visit: int, first: int) -> int:
    """The position where one more visit costs least in an open tour whose first `first` visits
    are fixed.
    """
    if not order:
        return 0
    ways = [int(arcs[a, visit] + arcs[visit, b] - arcs[a, b]) for a, b in pairwise(order)]
    ways.append(int(arcs[order[-1], visit]))
    if not first:
        ways.insert(0, int(arcs[visit, order[0]]))
    return ways.index(min(ways)) + first


def _steadier_tour(problem: TourProblem, order: tuple[int, ...], answer: object) -> Tour:
    """The tour that was found if it is cheaper than `order`, else `order`: with equal costs
    nothing changes.
    """
    cost = cost_of(problem, order) if order else 0
    if not isinstance(answer, Tour):
        return Tour(order, cost, 0)
    return (
        answer
        if answer.cost < cost or (order and tour_violations(problem, order))
        else replace(answer, order=order, cost=cost)
    )


def compare_progress(old: SequencePlan, progress: ProgressType, problem: Problem) -> ProgressType:
    """The progress, with what has become of the visits of the old rest."""
    tools, now = {visit.name: _visit_maker(visit) for visit in old.rest}, progress.plan
    done = {visit.name for visit in now.done}
    rest = {visit.name: visit for visit in now.rest}
    moved = {
        name: (tool, _visit_maker(rest[name]))
        for name, tool in tools.items()
        if name in rest and _visit_maker(rest[name]) != tool
    }
    place = {name: index for index, name in enumerate(tools)}
    staying = [visit for visit in now.rest if visit.name in tools and visit.name not in moved]
    arms = dict.fromkeys(visit.arm for visit in staying)
    own = ([visit.name for visit in staying if visit.arm == arm] for arm in arms)
    staying_names = tuple(name for names in own for name in _longest_rising(names, place))
    out = {**now.impossible, **now.bad}
    return replace(
        progress,
        kept=staying_names,
        reordered=tuple(visit.name for visit in staying if visit.name not in set(staying_names)),
        moved=moved,
        added=tuple(visit.name for visit in now.rest if visit.name not in tools),
        dropped={
            name: out.get(name, REASON_REMOVED)
            for name in tools
            if name not in rest and name not in done
        },
        outdated=_outdated_visits(now, problem),
    )


def _visit_maker(visit: PlannedVisit) -> str:
    """What makes a visit: its tool, and whose it is where several arms share the visits."""
    return f"{visit.tool} of {visit.arm}" if visit.arm else visit.tool


def _longest_rising(names: Sequence[str], place: Mapping[str, int]) -> tuple[str, ...]:
    """A longest subsequence of names whose places increase (Fredman 1975)."""
    ends: list[int] = []
    tails: list[tuple[str, ...]] = []
    for name in names:
        at = bisect_left(ends, place[name])
        chain = (*(tails[at - 1] if at else ()), name)
        ends[at : at + 1] = [place[name]]
        tails[at : at + 1] = [chain]
    return tails[-1] if tails else ()


def _outdated_visits(plan: SequencePlan, problem: Problem) -> tuple[str, ...]:
    """The visits done whose position has changed since, or that the problem no longer has."""
    places = given_positions_m(problem) if plan.done else {}
    measurements = {*measurements_of(problem)}
    return tuple(
        visit.name
        for visit in plan.done
        if visit.name not in measurements or places.get(visit.name, ()) != visit.position
    )
