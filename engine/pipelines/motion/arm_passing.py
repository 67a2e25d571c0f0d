"""Schedules plans of several arms so that one goes first wherever they could collide.

Each arm has found its ways without the others. Where steps of two arms can meet (`meetings`), one
waits until the other has left. These orders become part of the plan, so the arms keep apart however
long the steps take: who is late makes others wait. An arm that would rest in the way of another
goes home, if that is quicker.
"""

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.motion_values import (
    MovedStep,
    PassingOrder,
    Sharing,
    StepPair,
    Unmoved,
)
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.pipelines.motion.arm_conflicts import (
    ArmEncounters,
    ArmMeetings,
    StepMoment,
    find_meetings,
)
from cellwright.engine.pipelines.motion.arm_progress import Where
from cellwright.engine.pipelines.motion.cell_state import arms_of_step
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, operation_of, states_of
from cellwright.engine.stages.scheduling.arm_crossing import Crossing, schedule_crossing
from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits
from cellwright.kb.model.plan_model import Plan, StepId

PASSING_WORK_S = 4.0  # of the solver for one answer, about seconds of one core

Lasting = Callable[[Plan, Sequence[MovedStep]], Plan]  # a plan with the times of its motions


@dataclass(frozen=True, slots=True, eq=False)
class PassingPlan:
    """A plan in which the arms keep apart: its steps wait for each other, with their starts and
    motions.
    """

    plan: Plan
    starts: Mapping[StepId, int]
    steps: tuple[MovedStep, ...]
    sharing: Sharing

    @property
    def makespan(self) -> int:
        """When the last step ends."""
        return plan_makespan(self.plan, self.starts)


def kept_apart(
    walk: PlanWalk,
    plan: Plan,
    lasting: Lasting,
    encounters: ArmEncounters,
    release: Mapping[StepId, int],
    start: Where | None = None,
) -> PassingPlan | str:
    """The plan in which the arms keep apart, with the least makespan that is found; why there is
    none, if none is found.

    Arms begin where they rest, or where `start` has them.
    """
    first, where = _try_passing(walk, plan, lasting, encounters, release, start)
    resting = (
        frozenset(after for _, after, _ in where.meetings.rests if after is not None)
        if where
        else None
    )
    if not resting or (
        isinstance(first, PassingPlan)
        and first.makespan <= plan_makespan(lasting(plan, first.steps))
    ):
        return first
    second, _ = _try_passing(walk, plan, lasting, encounters, release, start, resting)
    if isinstance(second, str) or (
        isinstance(first, PassingPlan) and first.makespan <= second.makespan
    ):
        return first
    return second


def _try_passing(
    walk: PlanWalk,
    plan: Plan,
    lasting: Lasting,
    encounters: ArmEncounters,
    release: Mapping[StepId, int],
    start: Where | None,
    home: Collection[StepId] = (),
) -> tuple[PassingPlan | str, ArmMeetings | None]:
    """The answer where arms go home after some steps, and where they can meet then."""
    steps: list[MovedStep] = []
    for attempt in walk.steps(plan, home, start):
        if isinstance(attempt, Unmoved):
            return attempt.reason, None
        steps.append(attempt)
    timed = lasting(plan, steps)
    known_orders = frozenset(
        (earlier, step) for step, all_ in timed.predecessors().items() for earlier in all_
    )
    where = find_meetings(moments_of(walk, timed, steps, start), known_orders, encounters)
    direct = frozenset((earlier, step.id) for step in timed.steps for earlier in step.after)
    durations = {step.id: step.duration for step in timed.steps}
    crossing_answer = schedule_crossing(
        Crossing(durations, direct, where.meetings, release), ScheduleLimits(PASSING_WORK_S)
    )
    if isinstance(crossing_answer, Infeasible):
        return crossing_answer.reason, where
    if crossing_answer is None:
        return "no order in which the arms pass each other was found", where
    return _passing_plan(timed, steps, where, crossing_answer), where


def moments_of(
    walk: PlanWalk, plan: Plan, steps: Sequence[MovedStep], start: Where | None = None
) -> list[StepMoment]:
    """Each step with the cell before and after it, in the order of the earliest starts.

    Before the first one arms are where they rest, or where `start` has them.
    """
    moved = {step.step: step for step in steps}
    moments = []
    for step, before, after in states_of(walk.semantics, plan):
        arms = arms_of_step(walk.cell, step.operator, operation_of(walk.cell, step.operator))
        worlds = walk.room(before).world, walk.room(after).world
        moments.append(StepMoment(step.id, *worlds, moved.get(step.id), arms))
    if moments and start:
        first = moments[0].before
        for arm, (q, _) in start.items():
            first = first.moved(arm, q)
        moments[0] = replace(moments[0], before=first)
    return moments


def _passing_plan(
    plan: Plan, steps: Sequence[MovedStep], where: ArmMeetings, passing: PassingOrder
) -> PassingPlan:
    meetings = where.meetings
    ordered = wait_for_orders(
        plan, passing.starts, passing.orders | meetings.orders | _track_orders(meetings.tracks)
    )
    sharing = Sharing(
        where.zones,
        meetings.looked - len(meetings.steps),
        len(meetings.steps),
        passing.orders,
        passing.lower_bound,
        passing.proved,
    )
    return PassingPlan(ordered, passing.starts, tuple(steps), sharing)


def _track_orders(tracks: Mapping[str, tuple[StepId, ...]]) -> frozenset[StepPair]:
    return frozenset(
        pair for steps_of_arm in tracks.values() for pair in itertools.pairwise(steps_of_arm)
    )


def wait_for_orders(plan: Plan, starts: Mapping[StepId, int], orders: frozenset[StepPair]) -> Plan:
    """The plan in the order of its starts, whose steps also wait as some orders ask; what
    follows from others is left out.
    """
    rank = {step.id: n for n, step in enumerate(plan.steps)}
    ends = {step.id: starts[step.id] + step.duration for step in plan.steps}
    steps = sorted(
        plan.steps,
        key=lambda step_entry: (starts[step_entry.id], ends[step_entry.id], rank[step_entry.id]),
    )
    waits: dict[StepId, set[StepId]] = {step.id: set(step.after) for step in steps}
    for earlier, later in orders:
        waits[later].add(earlier)
    behind: dict[StepId, frozenset[StepId]] = {}
    ordered = []
    for step in steps:
        implied = frozenset[StepId]().union(*(behind[earlier] for earlier in waits[step.id]))
        direct = tuple(sorted(waits[step.id] - implied))
        behind[step.id] = implied | waits[step.id]
        ordered.append(replace(step, after=direct))
    return replace(plan, steps=tuple(ordered))
