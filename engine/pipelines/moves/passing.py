"""Arms that share space pass each other: the schedule lets one go first wherever they could meet.

Each arm has found its ways without the others. Where steps of two arms can meet (`meetings`), one waits until the other has left.
These orders become part of the plan, so the arms keep apart however long the steps take: who is late makes others wait. An arm
that would rest in the way of another goes home, if that is quicker.
"""

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.forecast import makespan
from cellwright.engine.model.moves import MovedStep, Unmoved
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.passing import Pair, Passed, Sharing
from cellwright.engine.pipelines.moves.arms import arms_of
from cellwright.engine.pipelines.moves.hands import Where
from cellwright.engine.pipelines.moves.meetings import Encounters, Found, found
from cellwright.engine.pipelines.moves.states import states_of
from cellwright.engine.pipelines.moves.tracks import Moment
from cellwright.engine.pipelines.moves.walking import Walk, operation_of
from cellwright.engine.stages.scheduling.limits import ScheduleLimits
from cellwright.engine.stages.scheduling.passing import Crossing, passed
from cellwright.kb.model.plan import Plan, StepId

WORK = 4.0  # of the solver for one answer, about seconds of one core

Lasting = Callable[[Plan, Sequence[MovedStep]], Plan]  # a plan with the times of its motions


@dataclass(frozen=True, slots=True, eq=False)
class Shared:
    """A plan in which the arms keep apart: its steps wait for each other, with their starts and motions."""

    plan: Plan
    starts: Mapping[StepId, int]
    steps: tuple[MovedStep, ...]
    sharing: Sharing

    @property
    def makespan(self) -> int:
        """When the last step ends."""
        return makespan(self.plan, self.starts)


def kept_apart(
    walk: Walk,
    plan: Plan,
    lasting: Lasting,
    encounters: Encounters,
    release: Mapping[StepId, int],
    start: Where | None = None,
) -> Shared | str:
    """The plan in which the arms keep apart, with the least makespan that is found; why there is none, if none is found.

    Arms begin where they rest, or where `start` has them.
    """
    first, where = _tried(walk, plan, lasting, encounters, release, start)
    resting = frozenset(after for _, after, _ in where.meetings.rests if after is not None) if where else None
    if not resting or (isinstance(first, Shared) and first.makespan <= makespan(lasting(plan, first.steps))):
        return first
    second, _ = _tried(walk, plan, lasting, encounters, release, start, resting)
    if isinstance(second, str) or (isinstance(first, Shared) and first.makespan <= second.makespan):
        return first
    return second


def _tried(
    walk: Walk,
    plan: Plan,
    lasting: Lasting,
    encounters: Encounters,
    release: Mapping[StepId, int],
    start: Where | None,
    home: Collection[StepId] = (),
) -> tuple[Shared | str, Found | None]:
    """The answer where arms go home after some steps, and where they can meet then."""
    steps: list[MovedStep] = []
    for each in walk.steps(plan, home, start):
        if isinstance(each, Unmoved):
            return each.reason, None
        steps.append(each)
    timed = lasting(plan, steps)
    known = frozenset((one, step) for step, all_ in timed.predecessors().items() for one in all_)
    where = found(moments_of(walk, timed, steps, start), known, encounters)
    direct = frozenset((one, step.id) for step in timed.steps for one in step.after)
    durations = {step.id: step.duration for step in timed.steps}
    made = passed(Crossing(durations, direct, where.meetings, release), ScheduleLimits(WORK))
    if isinstance(made, Infeasible):
        return made.reason, where
    if made is None:
        return "no order in which the arms pass each other was found", where
    return _shared(timed, steps, where, made), where


def moments_of(
    walk: Walk, plan: Plan, steps: Sequence[MovedStep], start: Where | None = None
) -> list[Moment]:
    """Each step with the cell before and after it, in the order of the earliest starts.

    Before the first one arms are where they rest, or where `start` has them.
    """
    moved = {each.step: each for each in steps}
    found = []
    for step, before, after in states_of(walk.semantics, plan):
        arms = arms_of(walk.cell, step.operator, operation_of(walk.cell, step.operator))
        worlds = walk.room(before).world, walk.room(after).world
        found.append(Moment(step.id, *worlds, moved.get(step.id), arms))
    if found and start:
        first = found[0].before
        for arm, (q, _) in start.items():
            first = first.moved(arm, q)
        found[0] = replace(found[0], before=first)
    return found


def _shared(plan: Plan, steps: Sequence[MovedStep], where: Found, made: Passed) -> Shared:
    meetings = where.meetings
    ordered = waiting(plan, made.starts, made.orders | meetings.orders | _turns(meetings.tracks))
    sharing = Sharing(
        where.zones,
        meetings.looked - len(meetings.steps),
        len(meetings.steps),
        made.orders,
        made.lower_bound,
        made.proved,
    )
    return Shared(ordered, made.starts, tuple(steps), sharing)


def _turns(tracks: Mapping[str, tuple[StepId, ...]]) -> frozenset[Pair]:
    return frozenset(pair for each in tracks.values() for pair in itertools.pairwise(each))


def waiting(plan: Plan, starts: Mapping[StepId, int], orders: frozenset[Pair]) -> Plan:
    """The plan in the order of its starts, whose steps also wait as some orders ask; what follows from others is left out."""
    rank = {step.id: n for n, step in enumerate(plan.steps)}
    ends = {step.id: starts[step.id] + step.duration for step in plan.steps}
    steps = sorted(plan.steps, key=lambda each: (starts[each.id], ends[each.id], rank[each.id]))
    wanted: dict[StepId, set[StepId]] = {step.id: set(step.after) for step in steps}
    for one, other in orders:
        wanted[other].add(one)
    behind: dict[StepId, frozenset[StepId]] = {}
    ordered = []
    for step in steps:
        implied = frozenset[StepId]().union(*(behind[one] for one in wanted[step.id]))
        direct = tuple(sorted(wanted[step.id] - implied))
        behind[step.id] = implied | wanted[step.id]
        ordered.append(replace(step, after=direct))
    return replace(plan, steps=tuple(ordered))
