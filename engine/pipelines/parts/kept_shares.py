"""A kept sequence that several arms share: what each has done stays, and the rest keeps its shares as long as nothing else changes.

What is left is shared anew when measurements, tools, arms or their order are others than before. Each arm then goes on from the visit
that it has made last.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.tour import Tour, TourProblem, Visit, times_of
from cellwright.engine.pipelines.inspection import Partition, partition, tour_problem
from cellwright.engine.pipelines.inspection.arms import Able, Offers, offers
from cellwright.engine.pipelines.inspection.demands import Demands, later, of_facts
from cellwright.engine.pipelines.inspection.losses import bereft, unusable
from cellwright.engine.pipelines.inspection.progress import (
    Left,
    News,
    Progress,
    Visits,
    compared,
    empty,
    left_of,
)
from cellwright.engine.pipelines.parts.beginning import chain_of
from cellwright.engine.pipelines.parts.chain import Chain
from cellwright.engine.pipelines.parts.sharing import Asked, Shared, shared
from cellwright.engine.pipelines.parts.turns import of_share
from cellwright.engine.stages.sequencing import Limits
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.problem import Problem
from cellwright.kb.store.sequences import PlannedVisit, SequencePlan

Orders = Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class SharedProgress(Progress):
    """How a sequence of several arms goes on; `problem` and `tour` are those of the arm that is done last.

    The visits of the rest are in the order in which they can begin. `shared` says who makes what; None if nothing is left.
    """

    shared: Shared | None = None

    @property
    def ahead(self) -> Mapping[str, PlannedVisit]:
        """The next visit of each arm that has one left."""
        return {each.arm: each for each in reversed(self.plan.rest)}


def shares_carried_on(
    plan: SequencePlan, problem: Problem, news: News = News(), limits: Limits = Limits()
) -> SharedProgress:
    """The sequence after some news, compared with the problem as it is now. Raises `InvalidInput`."""
    if empty(plan) and news != News():
        plan = shares_carried_on(plan, problem, limits=limits).plan
    known = _Known(problem)
    left = left_of(plan, problem, news, known.parted)
    made = _Rest(plan, left, known, limits).progress() if left.wanted else _over(left)
    return compared(plan, made, problem)


class _Known:
    """What arms can make when some names are lost. It is asked for once, as geometry may have to tell."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.offers = problem, Offers((), {})

    def parted(self, problem: Problem, lost: Collection[str]) -> Partition:
        """The measurements by a tool that an arm can make them with."""
        gone = unusable(problem, lost)
        self.problem = bereft(problem, gone)
        parts = partition(self.problem)
        self.offers = offers(self.problem, parts, gone)
        made = {name: tool for own in reversed([*self.offers.ways[0].values()]) for name, tool in own.items()}
        groups = dict[str, list[str]]()
        for name in (name for own in parts.groups.values() for name in own if name in made):
            groups.setdefault(made[name], []).append(name)
        out = {**parts.impossible, **self.offers.impossible}
        return replace(parts, groups={t: tuple(groups[t]) for t in sorted(groups)}, impossible=out)


@dataclass(frozen=True)
class _Rest:
    """What several arms have left to visit; `old` is the sequence as it was kept."""

    old: SequencePlan
    left: Left
    known: _Known
    limits: Limits

    def progress(self) -> SharedProgress:
        """The rest as it was, if nothing about it has changed; else shared anew, unless the old shares are as good."""
        standing = self._standing()
        if (
            not empty(self.old)
            and self._on_course()
            and {*map(_place, standing)} == {*map(_place, self._wanted)}
        ):
            same = self._following(standing)
            if same is not None:
                return self._told(same, "kept")
        found = shared(
            self.known.problem, self._parts, self._more, self.limits, self._line, self._at, self._offers
        )
        if not isinstance(found, Shared):
            raise InvalidInput([_unshared(self.known.problem, found)])
        same = self._following(standing) if len(standing) == len(self._wanted) else None
        steady = same is not None and same.shares.makespan <= found.shares.makespan
        bound = found.shares.lower_bound
        chosen = replace(same, shares=replace(same.shares, lower_bound=bound)) if same and steady else found
        kept = len(standing) == len(self.old.rest) and _same(chosen, standing)
        return self._told(chosen, "made" if empty(self.old) else "kept" if kept else "resequenced")

    def _standing(self) -> Visits:
        """The visits of the old rest that are still wanted."""
        wanted = {each.name for each in self._wanted}
        return tuple(each for each in self.old.rest if each.name in wanted)

    def _on_course(self) -> bool:
        """Whether each arm has made the next visits of its own, nothing else was done, and no arm or tool was lost or is back."""
        done = self.left.plan.done[len(self.old.done) :]
        arms = dict.fromkeys(each.arm for each in (*self.old.rest, *done))
        for arm in arms:
            own = [each for each in done if each.arm == arm]
            if own != [each for each in self.old.rest if each.arm == arm][: len(own)]:
                return False
        return (self.old.changes, self.old.lost) == (self.left.plan.changes, self.left.plan.lost)

    @property
    def _wanted(self) -> Visits:
        return self.left.wanted

    @property
    def _parts(self) -> Partition:
        names = {each.name for each in self._wanted}
        groups = {tool: tuple(n for n in own if n in names) for tool, own in self.left.parts.groups.items()}
        return replace(self.left.parts, groups={tool: own for tool, own in groups.items() if own})

    @property
    def _offers(self) -> Offers:
        names = {each.name for each in self._wanted}
        return replace(self.known.offers, ways=tuple(_only(way, names) for way in self.known.offers.ways))

    @property
    def _line(self) -> Chain:
        return chain_of(self.known.problem, self.limits)

    @property
    def _at(self) -> dict[str, Visit]:
        """The visit that each arm has made last."""
        stations = {each.name: each.station for each in self.left.asked.visits}
        return {
            each.arm: Visit(each.name, each.position, each.tool, station=stations.get(each.name, ""))
            for each in self.left.plan.done
            if each.position
        }

    @property
    def _more(self) -> Demands:
        """The windows that are left, when what is done took the time that its tours say."""
        words, done = self.known.problem.domain.conventions, self.left.plan.done
        facts = evaluated(self.known.problem).atoms
        demands = of_facts(facts, words, Source(self.known.problem.path))
        if not demands.windows or not done:
            return Demands()
        names = {each.name for each in done}
        return replace(later(demands, self._over(done), names), lasts={}, before=())

    def _over(self, done: Visits) -> int:
        """When the last visit done has begun, as the tours of the arms have it."""
        groups = dict[str, tuple[str, ...]]()
        for each in done:
            groups[each.tool] = (*groups.get(each.tool, ()), each.name)
        tours = tour_problem(self.known.problem, replace(self.left.parts, groups=groups))
        known = {visit.name for visit in tours.visits}
        arms = dict.fromkeys(each.arm for each in done)
        own = ([each.name for each in done if each.arm == arm and each.name in known] for arm in arms)
        made = (of_share(tours, names) for names in own if names)
        return max((times_of(each, tuple(range(len(each.visits))))[-1][1] for each in made), default=0)

    def _following(self, visits: Visits) -> Shared | None:
        """The shares in which the arms make visits in their order, if they still can."""
        orders = _orders(visits)
        way = next((way for way in self._offers.ways if _serves(way, visits)), None)
        if way is None:
            return None
        asked = Asked(self.known.problem, self._parts, self._more, self.limits, self._line, way, self._at)
        return asked.following(orders)

    def _told(self, found: Shared, way: str) -> SharedProgress:
        place = {each.name: each.position for each in self._wanted}
        rest = tuple(
            PlannedVisit(name, found.tools[name], place[name], found.arms[name]) for name in found.order
        )
        plan = replace(self.left.plan, rest=rest)
        return SharedProgress(plan, way, *found.last, unkept=found.unkept, shared=found)


def _same(found: Shared, visits: Visits) -> bool:
    """Whether the arms make visits in the order that these have."""
    orders = {arm: own for arm, own in found.shares.orders.items() if own}
    return orders == _orders(visits) and all(found.tools[each.name] == each.tool for each in visits)


def _over(left: Left) -> SharedProgress:
    """The progress of a sequence of which nothing is left."""
    problem = TourProblem(left.plan.problem, (), np.zeros((0, 0), np.int64), closed=False)
    return SharedProgress(replace(left.plan, rest=()), "kept", problem, Tour((), 0, 0))


def _place(visit: PlannedVisit) -> tuple[str, tuple[float, ...]]:
    return visit.name, visit.position


def _only(way: Able, names: Collection[str]) -> Able:
    return {arm: {name: tool for name, tool in own.items() if name in names} for arm, own in way.items()}


def _serves(way: Able, visits: Visits) -> bool:
    """Whether the arms can make visits with the tools that were planned."""
    return all(way.get(each.arm, {}).get(each.name) == each.tool for each in visits)


def _orders(visits: Visits) -> Orders:
    found = dict[str, tuple[str, ...]]()
    for each in visits:
        found[each.arm] = (*found.get(each.arm, ()), each.name)
    return found


def _unshared(problem: Problem, found: Infeasible | GaveUp) -> Diagnostic:
    hint = "look at `before`, at windows and at the alignment"
    return Diagnostic(
        Source(problem.path), "K405", f"the measurements cannot be shared: {found.reason}", hint
    )
