"""A sequence under way: visits that are done stay as they are. If something changes, the rest is sequenced anew.

A kept sequence is compared with the problem whenever it is used. This shows which measurements were added, removed, moved
or assigned to another tool.
"""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TypeVar

from cellwright.engine.model.measurements import measurements_of
from cellwright.engine.model.tour import Longs, Tour, TourProblem, cost_of, violations
from cellwright.engine.pipelines.inspection import Partition, tour_problem
from cellwright.engine.pipelines.inspection.demands import without_windows
from cellwright.engine.pipelines.inspection.losses import parted
from cellwright.engine.pipelines.inspection.rest import tour_of_rest
from cellwright.engine.pipelines.points import positions
from cellwright.engine.stages.sequencing import Limits, sequence
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.problem import Problem
from cellwright.kb.store.sequences import PlannedVisit, SequencePlan

REMOVED = "no longer in the problem"
FOUND_BAD = "found bad"
Visits = tuple[PlannedVisit, ...]
Parting = Callable[[Problem, tuple[str, ...]], Partition]
P = TypeVar("P", bound="Progress")


@dataclass(frozen=True, slots=True)
class News:
    """What has happened: visits done; tools and resources lost; visits found bad, with the reason; and names restored."""

    done: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    bad: Mapping[str, str] = field(default_factory=dict)
    restored: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Progress:
    """How a sequence goes on. `way`: `made`, `kept` (as it was) or `resequenced`.

    `problem` and `tour` are those of the rest, and begin at the last visit done if there is one. The visits of the old
    rest fall into four groups: `kept` are in the old order relative to each other, `reordered` are not, `moved` have
    another tool (old, new), and `dropped` are left out, with the reason. `added` are new visits. `outdated` are visits
    done whose position in the problem has changed or that the problem no longer has. `unkept` says why no order keeps all windows.
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
class Left:
    """What is left after some news: the sequence, whose rest is the old one, the visits that are wanted now, and all that can be made."""

    plan: SequencePlan
    wanted: Visits
    parts: Partition
    asked: TourProblem


def carried_on(
    plan: SequencePlan, problem: Problem, news: News = News(), limits: Limits = Limits()
) -> Progress:
    """The sequence after some news, compared with the problem as it is now. Raises `InvalidInput`."""
    if empty(plan) and news != News():
        plan = carried_on(plan, problem, limits=limits).plan
    left = left_of(plan, problem, news)
    phases = {each.name: each.phase for each in left.asked.visits}
    made = _sequenced(plan, left.plan, left.wanted, phases, problem, limits)
    return compared(plan, made, problem)


def left_of(plan: SequencePlan, problem: Problem, news: News, part: Parting = parted) -> Left:
    """What is left of a sequence after some news; `part` says what is possible when names are lost. Raises `InvalidInput`."""
    _known(problem, plan, news)
    lost = tuple(sorted({*plan.lost, *news.lost} - set(news.restored)))
    bad = {name: why for name, why in {**plan.bad, **news.bad}.items() if name not in news.restored}
    parts = part(problem, lost)
    asked = tour_problem(problem, parts, timed=False)
    visits = tuple(PlannedVisit(each.name, each.tool, each.position or ()) for each in asked.visits)
    done = _done(plan, visits, parts, news)
    names = {each.name for each in done}
    _not_done(names, news)
    wanted = tuple(each for each in visits if each.name not in names and each.name not in bad)
    changes = tuple(sorted((a, b, cost) for (a, b), cost in asked.changes.items()))
    out = {name: why for name, why in parts.impossible.items() if name not in names}
    now = replace(plan, done=done, lost=lost, bad=bad, impossible=out, changes=changes)
    return Left(now, wanted, parts, asked)


def empty(plan: SequencePlan) -> bool:
    """Whether nothing was kept yet."""
    return plan == SequencePlan(plan.domain, plan.problem, version=plan.version)


def _known(problem: Problem, plan: SequencePlan, news: News) -> None:
    """Raise `InvalidInput` for names in the news that are not known."""
    measurements = {*measurements_of(problem)} | {each.name for each in (*plan.done, *plan.rest)}
    others = resources(problem)
    for option, names, known in (
        ("done", news.done, measurements),
        ("bad", news.bad, measurements),
        ("lost", news.lost, others),
        ("restored", news.restored, {*others, *measurements}),
    ):
        wrong = [
            unknown_name(_kind(option), each, sorted(known), Source(f"--{option}"))
            for each in names
            if each not in known
        ]
        if wrong:
            raise InvalidInput(wrong)


def resources(problem: Problem) -> set[str]:
    """The names that can be lost: objects other than measurements, and the resources of operators."""
    named = {str(each) for operator in problem.domain.operators for each in operator.resources}
    return {*problem.domain.objects, *problem.objects, *named}.difference(measurements_of(problem))


def _kind(option: str) -> str:
    return "visit" if option in ("done", "bad") else "resource"


def _done(plan: SequencePlan, visits: Visits, parts: Partition, news: News) -> Visits:
    """The visits done: those of the kept sequence, then those that the problem says are done, then those in the news.

    Raises `InvalidInput` for a visit that is left out of the sequence.
    """
    finished = {each.name for each in plan.done}
    recorded = {each.name: each for each in (*visits, *plan.rest)}
    said = [each.name for each in plan.rest if each.name in set(parts.done)]
    new = [
        name
        for name in dict.fromkeys((*said, *news.done))
        if name not in finished | set(parts.done) - set(said)
    ]
    out = {**parts.impossible, **plan.bad}
    wrong = [
        Diagnostic(Source("--done"), "K411", f"'{name}' is left out: {out.get(name, REMOVED)}", "")
        for name in new
        if name not in recorded or name in plan.bad
    ]
    if wrong:
        raise InvalidInput(wrong)
    return (*plan.done, *(recorded[name] for name in new))


def _not_done(done: set[str], news: News) -> None:
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


def _sequenced(
    old: SequencePlan,
    now: SequencePlan,
    wanted: Visits,
    phases: Mapping[str, int],
    inspection: Problem,
    limits: Limits,
) -> Progress:
    """The rest in its old order if nothing about it has changed; else in the best order found."""
    behind = len(now.done) - len(old.done)
    problem, first = tour_of_rest(now, wanted, phases, inspection)
    standing = old.rest[behind:]
    on_course = now.done[len(old.done) :] == old.rest[:behind] and old.changes == now.changes
    if not empty(old) and on_course and {*standing} == {*wanted}:
        same, _ = tour_of_rest(now, standing, phases, inspection)
        order = tuple(range(len(same.visits)))
        if not order or not violations(same, order):
            tour = Tour(order, cost_of(same, order) if order else 0, 0)
            return Progress(replace(now, rest=standing), "kept", same, tour)
    found, unkept = sequence(problem, limits), ""
    if problem.timed and not isinstance(found, Tour):
        unkept, problem = found.reason, without_windows(problem)
        found = sequence(problem, limits)
    tour = _steadier(problem, _inserted(problem, wanted, old.rest, first), found)
    rest = tuple(wanted[each - first] for each in tour.order[first:])
    way = "made" if empty(old) else "kept" if unkept and rest == standing else "resequenced"
    return Progress(replace(now, rest=rest), way, problem, tour, unkept=unkept)


def _inserted(problem: TourProblem, wanted: Visits, old: Visits, first: int) -> tuple[int, ...]:
    """The wanted visits in their old order. Each visit that is not in the old order is inserted where that costs least."""
    number = {each: index + first for index, each in enumerate(wanted)}
    order = [*range(first), *(number[each] for each in old if each in number)]
    arcs = problem.arcs
    for each in sorted({*number.values()} - {*order}):
        order.insert(_cheapest(arcs, order, each, first), each)
    return tuple(order)


def _cheapest(arcs: Longs, order: Sequence[int], visit: int, first: int) -> int:
    """The position where one more visit costs least in an open tour whose first `first` visits are fixed."""
    if not order:
        return 0
    ways = [int(arcs[a, visit] + arcs[visit, b] - arcs[a, b]) for a, b in pairwise(order)]
    ways.append(int(arcs[order[-1], visit]))
    if not first:
        ways.insert(0, int(arcs[visit, order[0]]))
    return ways.index(min(ways)) + first


def _steadier(problem: TourProblem, order: tuple[int, ...], found: object) -> Tour:
    """The tour that was found if it is cheaper than `order`, else `order`: with equal costs nothing changes."""
    cost = cost_of(problem, order) if order else 0
    if not isinstance(found, Tour):
        return Tour(order, cost, 0)
    return (
        found
        if found.cost < cost or (order and violations(problem, order))
        else replace(found, order=order, cost=cost)
    )


def compared(old: SequencePlan, made: P, problem: Problem) -> P:
    """The progress, with what has become of the visits of the old rest."""
    tools, now = {each.name: _by(each) for each in old.rest}, made.plan
    done = {each.name for each in now.done}
    rest = {each.name: each for each in now.rest}
    moved = {
        name: (tool, _by(rest[name]))
        for name, tool in tools.items()
        if name in rest and _by(rest[name]) != tool
    }
    place = {name: index for index, name in enumerate(tools)}
    staying = [each for each in now.rest if each.name in tools and each.name not in moved]
    arms = dict.fromkeys(each.arm for each in staying)
    own = ([each.name for each in staying if each.arm == arm] for arm in arms)
    kept = tuple(name for names in own for name in _rising(names, place))
    out = {**now.impossible, **now.bad}
    return replace(
        made,
        kept=kept,
        reordered=tuple(each.name for each in staying if each.name not in set(kept)),
        moved=moved,
        added=tuple(each.name for each in now.rest if each.name not in tools),
        dropped={name: out.get(name, REMOVED) for name in tools if name not in rest and name not in done},
        outdated=_outdated(now, problem),
    )


def _by(visit: PlannedVisit) -> str:
    """What makes a visit: its tool, and whose it is where several arms share the visits."""
    return f"{visit.tool} of {visit.arm}" if visit.arm else visit.tool


def _rising(names: Sequence[str], place: Mapping[str, int]) -> tuple[str, ...]:
    """A longest subsequence of names whose places increase (Fredman 1975)."""
    ends: list[int] = []
    tails: list[tuple[str, ...]] = []
    for name in names:
        at = bisect_left(ends, place[name])
        chain = (*(tails[at - 1] if at else ()), name)
        ends[at : at + 1] = [place[name]]
        tails[at : at + 1] = [chain]
    return tails[-1] if tails else ()


def _outdated(plan: SequencePlan, problem: Problem) -> tuple[str, ...]:
    """The visits done whose position has changed since, or that the problem no longer has."""
    places = positions(problem) if plan.done else {}
    known = {*measurements_of(problem)}
    return tuple(
        each.name
        for each in plan.done
        if each.name not in known or places.get(each.name, ()) != each.position
    )
