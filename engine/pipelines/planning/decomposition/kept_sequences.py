"""Continues measurement sequences kept in a store, also those that several arms share.

What is left is shared anew when measurements, tools, arms or their order are others than before.
Each arm then goes on from the visit that it has made last.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.part_measurements import is_shared
from cellwright.engine.model.tour_problem import Tour, TourProblem, Visit, times_of
from cellwright.engine.pipelines.inspection.arm_capabilities import (
    Able,
    ArmOffers,
    arm_offers,
    unusable_resources,
    without_tools,
)
from cellwright.engine.pipelines.inspection.measurement_points import with_places
from cellwright.engine.pipelines.inspection.tool_tours import (
    ToolPartition,
    partition_by_tool,
    tour_problem,
)
from cellwright.engine.pipelines.inspection.tour_demands import (
    TourDemands,
    of_facts,
    remaining_demands,
)
from cellwright.engine.pipelines.inspection.tour_progress import (
    KeptSequenceProgress,
    RemainingSequence,
    SequenceNews,
    Visits,
    carry_on_sequence,
    compare_progress,
    is_unkept,
    left_of,
    losable_resources,
)
from cellwright.engine.pipelines.planning.decomposition.measurement_shares import (
    SharedMeasurements,
    SharingRequest,
    of_share,
    share_measurements,
)
from cellwright.engine.pipelines.planning.decomposition.part_chain import PartChain, chain_of
from cellwright.engine.stages.sequencing import TourLimits
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.inspection_store import PlannedVisit, SequencePlan, Sequences

Orders = Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class SharedProgress(KeptSequenceProgress):
    """How a sequence of several arms goes on; `problem` and `tour` are those of the arm that is
    done last.

    The visits of the rest are in the order in which they can begin. `shared` says who makes what;
    None if nothing is left.
    """

    shared: SharedMeasurements | None = None

    @property
    def ahead(self) -> Mapping[str, PlannedVisit]:
        """The next visit of each arm that has one left."""
        return {visit.arm: visit for visit in reversed(self.plan.rest)}


def shares_carried_on(
    plan: SequencePlan,
    problem: Problem,
    news: SequenceNews = SequenceNews(),
    limits: TourLimits = TourLimits(),
) -> SharedProgress:
    """The sequence after some news, compared with the problem as it is now.

    Raises `InvalidInput`.
    """
    if is_unkept(plan) and news != SequenceNews():
        plan = shares_carried_on(plan, problem, limits=limits).plan
    capabilities = _CapabilitiesAfterLoss(problem)
    remaining = left_of(plan, problem, news, capabilities.parted)
    progress = (
        _RestOfSequence(plan, remaining, capabilities, limits).progress()
        if remaining.wanted
        else _finished_progress(remaining)
    )
    return compare_progress(plan, progress, problem)


class _CapabilitiesAfterLoss:
    """What arms can make when some names are lost.

    It is asked for once, as geometry may have to tell.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.offers = problem, ArmOffers((), {})

    def parted(self, problem: Problem, lost: Collection[str]) -> ToolPartition:
        """The measurements by a tool that an arm can make them with."""
        gone = unusable_resources(problem, lost)
        self.problem = without_tools(problem, gone)
        parts = partition_by_tool(self.problem)
        self.offers = arm_offers(self.problem, parts, gone)
        tools_held = {
            name: tool
            for own in reversed([*self.offers.ways[0].values()])
            for name, tool in own.items()
        }
        groups = dict[str, list[str]]()
        for name in (name for own in parts.groups.values() for name in own if name in tools_held):
            groups.setdefault(tools_held[name], []).append(name)
        out = {**parts.impossible, **self.offers.impossible}
        return replace(parts, groups={t: tuple(groups[t]) for t in sorted(groups)}, impossible=out)


@dataclass(frozen=True)
class _RestOfSequence:
    """What several arms have left to visit; `old` is the sequence as it was kept."""

    old: SequencePlan
    left: RemainingSequence
    known: _CapabilitiesAfterLoss
    limits: TourLimits

    def progress(self) -> SharedProgress:
        """The rest as it was, if nothing about it has changed; else shared anew, unless the old
        shares are as good.
        """
        standing = self._standing()
        if (
            not is_unkept(self.old)
            and self._on_course()
            and {*map(_visit_place, standing)} == {*map(_visit_place, self._wanted)}
        ):
            same = self._following(standing)
            if same is not None:
                return self._told(same, "kept")
        shares_found = share_measurements(
            self.known.problem,
            self._parts,
            self._more,
            self.limits,
            self._line,
            self._at,
            self._offers,
        )
        if not isinstance(shares_found, SharedMeasurements):
            raise InvalidInput([_unshared_diagnostic(self.known.problem, shares_found)])
        same = self._following(standing) if len(standing) == len(self._wanted) else None
        steady = same is not None and same.shares.makespan <= shares_found.shares.makespan
        bound = shares_found.shares.lower_bound
        chosen = (
            replace(same, shares=replace(same.shares, lower_bound=bound))
            if same and steady
            else shares_found
        )
        is_kept = len(standing) == len(self.old.rest) and _is_same_order(chosen, standing)
        return self._told(
            chosen, "made" if is_unkept(self.old) else "kept" if is_kept else "resequenced"
        )

    def _standing(self) -> Visits:
        """The visits of the old rest that are still wanted."""
        names_wanted = {visit.name for visit in self._wanted}
        return tuple(visit for visit in self.old.rest if visit.name in names_wanted)

    def _on_course(self) -> bool:
        """Whether each arm has made the next visits of its own, nothing else was done, and no
        arm or tool was lost or is back.
        """
        done = self.left.plan.done[len(self.old.done) :]
        arms = dict.fromkeys(visit.arm for visit in (*self.old.rest, *done))
        for arm in arms:
            own = [visit for visit in done if visit.arm == arm]
            if own != [visit for visit in self.old.rest if visit.arm == arm][: len(own)]:
                return False
        return (self.old.changes, self.old.lost) == (self.left.plan.changes, self.left.plan.lost)

    @property
    def _wanted(self) -> Visits:
        return self.left.wanted

    @property
    def _parts(self) -> ToolPartition:
        names = {visit.name for visit in self._wanted}
        groups = {
            tool: tuple(n for n in own if n in names)
            for tool, own in self.left.parts.groups.items()
        }
        return replace(self.left.parts, groups={tool: own for tool, own in groups.items() if own})

    @property
    def _offers(self) -> ArmOffers:
        names = {visit.name for visit in self._wanted}
        return replace(
            self.known.offers,
            ways=tuple(_restrict_able(ability, names) for ability in self.known.offers.ways),
        )

    @property
    def _line(self) -> PartChain:
        return chain_of(self.known.problem, self.limits)

    @property
    def _at(self) -> dict[str, Visit]:
        """The visit that each arm has made last."""
        stations = {visit.name: visit.station for visit in self.left.asked.visits}
        return {
            visit.arm: Visit(
                visit.name, visit.position, visit.tool, station=stations.get(visit.name, "")
            )
            for visit in self.left.plan.done
            if visit.position
        }

    @property
    def _more(self) -> TourDemands:
        """The windows that are left, when what is done took the time that its tours say."""
        words, done = self.known.problem.domain.conventions, self.left.plan.done
        facts = evaluate_statics(self.known.problem).atoms
        demands = of_facts(facts, words, Source(self.known.problem.path))
        if not demands.windows or not done:
            return TourDemands()
        names = {visit.name for visit in done}
        return replace(remaining_demands(demands, self._over(done), names), lasts={}, before=())

    def _over(self, done: Visits) -> int:
        """When the last visit done has begun, as the tours of the arms have it."""
        groups = dict[str, tuple[str, ...]]()
        for finished_visit in done:
            groups[finished_visit.tool] = (
                *groups.get(finished_visit.tool, ()),
                finished_visit.name,
            )
        tours = tour_problem(self.known.problem, replace(self.left.parts, groups=groups))
        names_known = {visit.name for visit in tours.visits}
        arms = dict.fromkeys(visit.arm for visit in done)
        own = (
            [visit.name for visit in done if visit.arm == arm and visit.name in names_known]
            for arm in arms
        )
        shares = (of_share(tours, names) for names in own if names)
        return max(
            (
                times_of(share_tour, tuple(range(len(share_tour.visits))))[-1][1]
                for share_tour in shares
            ),
            default=0,
        )

    def _following(self, visits: Visits) -> SharedMeasurements | None:
        """The shares in which the arms make visits in their order, if they still can."""
        orders = _arm_orders(visits)
        ability = next(
            (ability for ability in self._offers.ways if _can_serve(ability, visits)), None
        )
        if ability is None:
            return None
        asked = SharingRequest(
            self.known.problem, self._parts, self._more, self.limits, self._line, ability, self._at
        )
        return asked.following(orders)

    def _told(self, shares_found: SharedMeasurements, manner: str) -> SharedProgress:
        place = {visit.name: visit.position for visit in self._wanted}
        rest = tuple(
            PlannedVisit(name, shares_found.tools[name], place[name], shares_found.arms[name])
            for name in shares_found.order
        )
        plan = replace(self.left.plan, rest=rest)
        return SharedProgress(
            plan, manner, *shares_found.last, unkept=shares_found.unkept, shared=shares_found
        )


def _is_same_order(shares_found: SharedMeasurements, visits: Visits) -> bool:
    """Whether the arms make visits in the order that these have."""
    orders = {arm: own for arm, own in shares_found.shares.orders.items() if own}
    return orders == _arm_orders(visits) and all(
        shares_found.tools[visit.name] == visit.tool for visit in visits
    )


def _finished_progress(remaining: RemainingSequence) -> SharedProgress:
    """The progress of a sequence of which nothing is left."""
    problem = TourProblem(remaining.plan.problem, (), np.zeros((0, 0), np.int64), closed=False)
    return SharedProgress(replace(remaining.plan, rest=()), "kept", problem, Tour((), 0, 0))


def _visit_place(visit: PlannedVisit) -> tuple[str, tuple[float, ...]]:
    return visit.name, visit.position


def _restrict_able(ability: Able, names: Collection[str]) -> Able:
    return {
        arm: {name: tool for name, tool in own.items() if name in names}
        for arm, own in ability.items()
    }


def _can_serve(ability: Able, visits: Visits) -> bool:
    """Whether the arms can make visits with the tools that were planned."""
    return all(ability.get(visit.arm, {}).get(visit.name) == visit.tool for visit in visits)


def _arm_orders(visits: Visits) -> Orders:
    orders = dict[str, tuple[str, ...]]()
    for visit in visits:
        orders[visit.arm] = (*orders.get(visit.arm, ()), visit.name)
    return orders


def _unshared_diagnostic(problem: Problem, refusal: Infeasible | GaveUp) -> Diagnostic:
    hint = "look at `before`, at windows and at the alignment"
    return Diagnostic(
        Source(problem.path), "K405", f"the measurements cannot be shared: {refusal.reason}", hint
    )


def carry_on(
    store: str,
    problem: Problem,
    news: SequenceNews = SequenceNews(),
    limits: TourLimits = TourLimits(),
    anew: bool = False,
) -> KeptSequenceProgress:
    """Bring the kept sequence of a problem up to date, or make one; `anew` forgets the kept one.
    Raises `InvalidInput`.

    Where several arms share the measurements, the answer is a `SharedProgress`.

    If another process has written the sequence in the meantime, the news is applied to what it
    wrote, so that nothing is lost.
    """
    problem = with_places(problem)
    with Sequences(store) as sequences:
        while True:
            kept_plan = sequences.of(problem.domain.name, problem.name)
            plan = SequencePlan(
                problem.domain.name, problem.name, version=kept_plan.version if kept_plan else 0
            )
            progress = _carried_on(
                plan if kept_plan is None or anew else kept_plan, problem, news, limits
            )
            if progress.plan == kept_plan or sequences.keep(progress.plan):
                return progress


def _carried_on(
    plan: SequencePlan, problem: Problem, news: SequenceNews, limits: TourLimits
) -> KeptSequenceProgress:
    if not is_shared(problem):
        return carry_on_sequence(plan, problem, news, limits)
    # slow to load, and one arm needs it never

    return shares_carried_on(plan, problem, news, limits)


def told_of_losses(
    store: str, problem: Problem, lost: Collection[str], regained: Collection[str] = ()
) -> KeptSequenceProgress | None:
    """The kept sequence of a problem after tools or resources were lost, and others put right
    again.

    None if none is kept. Raises `InvalidInput`.

    Names in `lost` that are neither objects nor resources of the problem do not concern the
    sequence, and are ignored.
    """
    with Sequences(store) as sequences:
        if sequences.of(problem.domain.name, problem.name) is None:
            return None
    known = losable_resources(problem)
    gone, back = (tuple(name for name in names if name in known) for names in (lost, regained))
    return carry_on(store, problem, SequenceNews(lost=gone, restored=back))
