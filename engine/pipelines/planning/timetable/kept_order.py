"""Timetables in the order of a plan: every step as early as order, travel and windows allow.

A longest path is exact here, so nothing is searched, and plans of any length are scheduled.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.model.shop_scheduling import (
    Schedule,
    Shop,
    StageMoment,
    StageWindow,
    Timetable,
)
from cellwright.engine.model.time_limits import measured_steps, missed_windows, opening_delays
from cellwright.engine.pipelines.planning.dwell_limits import find_overstays
from cellwright.engine.pipelines.planning.plan_gate import InternalError, PlanGate
from cellwright.engine.pipelines.planning.timetable.step_order import by_step
from cellwright.engine.pipelines.planning.window_keeping import judge_times, lags_of_plan
from cellwright.engine.stages.scheduling.checker import check_schedule
from cellwright.engine.stages.scheduling.plan_blocks import (
    Unstructured,
    arm_resource,
    contains_term,
)
from cellwright.engine.stages.scheduling.shop_translation import Wishes
from cellwright.engine.stages.scheduling.window_lags import raised_starts
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.time_windows import TimeOfWork
from cellwright.kb.terms import Term

MAX_SCHEDULED_STEPS = 400  # steps; longer plans without a workflow keep their order
# steps of a workflow; longer plans keep their order where their objects cannot be scheduled by
# themselves
LONGEST = 4_000
SCOPE_KEPT_ORDER = "of all schedules that keep this order of the steps"


def order_keeping_timetable(
    problem: Problem, plan: Plan, wishes: Wishes, note: str = ""
) -> Timetable:
    """The timetable of a plan that the checker accepts, in its own order, with what stays too long
    in a place then.

    The checker of schedules has replayed it.
    """
    round_, visits = (
        _arm_round(plan, wishes),
        measured_steps(problem, plan) if wishes.windows else {},
    )
    # of the tour; None if it starts with the first measurement
    start = 0 if wishes.under_way else None
    known = PlanGate().semantics(problem)
    opening = opening_delays(wishes.windows, visits)

    def starts_from(least: Mapping[StepId, int]) -> dict[StepId, int]:
        return _earliest_starts(plan, wishes, round_, opening, start, least)

    starts = _within_windows(problem, plan, wishes, known, starts_from)
    last, late = plan_makespan(plan, starts), weighted_lateness(plan, wishes, starts)
    too_long = find_overstays(problem, plan, starts, wishes.longest_stay, known)
    schedule = Schedule({}, (), last, last, late, proved=not too_long)
    timetable = by_step(problem, plan, starts, schedule, note, SCOPE_KEPT_ORDER)
    waiting = (
        timetable.shop
        if wishes.under_way
        else _with_windows(timetable.shop, wishes.windows, visits, plan)
    )
    shop = _with_travel(waiting, round_)
    # due times are of objects, and so of several jobs
    replayed = replace(timetable.schedule, tardiness=0)
    if wrong := check_schedule(shop, replayed):
        raise InternalError([Diagnostic(Source(problem.path), "K508", wrong[0])])
    outside = missed_windows(wishes.windows, visits, starts, start)
    made = replace(timetable, shop=shop, overstays=too_long, missed=outside)
    return judge_times(problem, made, known)


StartsFrom = Callable[[Mapping[StepId, int]], dict[StepId, int]]


def _within_windows(
    problem: Problem, plan: Plan, wishes: Wishes, known: Semantics, starts_from: StartsFrom
) -> dict[StepId, int]:
    """The earliest starts in the order of the plan that keep all windows; else those that keep all
    without a price; else the earliest ones.
    """
    earliest = starts_from({})
    if not wishes.between:
        return earliest
    ids = [step.id for step in plan.steps]

    def forward(least: Sequence[int]) -> tuple[list[int], int]:
        starts = starts_from(dict(zip(ids, least, strict=True)))
        return [starts[number] for number in ids], plan_makespan(plan, starts)

    lags = lags_of_plan(problem, plan, known)
    hard = [lag for lag in lags if lag.price is None]
    for asked in (lags, hard) if len(hard) < len(lags) else (lags,):
        raised = raised_starts(asked, len(ids), forward)
        if raised is not None:
            return dict(zip(ids, raised[0], strict=True))
    return earliest


@dataclass(frozen=True, slots=True)
class _ArmRound:
    """What the arm does between steps: the steps before its steps, the times from there, and
    where its stages are.
    """

    arm: str
    before: Mapping[StepId, StepId]
    ways: Mapping[StepId, int]
    places: Mapping[str, str]  # by the name of the stage
    travel: Mapping[tuple[str, str], int]


def _arm_round(plan: Plan, wishes: Wishes) -> _ArmRound:
    """The round of the arm through the places of its steps; a step that names no place is done
    where the last one was.
    """
    own = _steps_of_arm(plan, wishes)
    arm, steps = own if own is not None else (None, [])
    stops: list[Term | None] = []
    for step in steps:
        at = wishes.place(step.operator, step.resources, arm) if arm is not None else None
        stops.append(at if at is not None or not stops else stops[-1])
    new_round = _ArmRound(str(arm), {}, {}, {}, {})
    before, ways, travel = dict[StepId, StepId](), dict[StepId, int](), dict[tuple[str, str], int]()
    for (step_before, place_before), (step_after, place_after) in itertools.pairwise(
        zip(steps, stops, strict=True)
    ):
        lasts = (
            0
            if place_before is None or place_after is None
            else wishes.travel.get((place_before, place_after), 0)
        )
        before[step_after.id], ways[step_after.id] = step_before.id, lasts
        travel[(str(place_before or ""), str(place_after or ""))] = lasts
    places = {f"{s.id} {s.operator}": str(at or "") for s, at in zip(steps, stops, strict=True)}
    return replace(new_round, before=before, ways=ways, places=places, travel=travel)


def _steps_of_arm(plan: Plan, wishes: Wishes) -> tuple[Term, list[Step]] | None:
    if not wishes.stops:
        return None
    try:
        arm = arm_resource(plan.steps)
    except Unstructured:
        return None
    return arm, [step for step in plan.steps if arm in step.resources]


def _earliest_starts(
    plan: Plan,
    wishes: Wishes,
    round_: _ArmRound,
    opening: Mapping[StepId, int],
    begin: int | None,
    least: Mapping[StepId, int],
) -> dict[StepId, int]:
    """The earliest start of each step: after the steps that it waits for, its release, the way of
    the arm to it, and the `opening` of its window after the `begin` of the tour; not below its
    `least` start, and when calendars allow it.
    """
    starts: dict[StepId, int] = {}
    ends: dict[StepId, int] = {}
    for step in plan.steps:
        soonest = [ends[before] for before in step.after]
        soonest += [
            time
            for subject, time in wishes.release.items()
            if contains_term(step.operator, subject)
        ]
        if step.id in round_.before:
            soonest.append(ends[round_.before[step.id]] + round_.ways[step.id])
        if step.id in opening:
            begin = max(soonest, default=0) if begin is None else begin
            soonest.append(begin + opening[step.id])
        soonest.append(least.get(step.id, 0))
        starts[step.id] = _open_from(wishes.calendars, step, max(soonest))
        ends[step.id] = starts[step.id] + step.duration
    return starts


def _open_from(calendars: Sequence[TimeOfWork], step: Step, start: int) -> int:
    """The first time from `start` on at which all calendars allow a step; `start` if none is."""
    own = [each for each in calendars if each.covers(step.operator, step.resources)]
    time, before = start, start - 1
    while own and before < time:
        before = time
        for calendar in own:
            soonest = calendar.soonest(time, step.duration)
            if soonest is None:
                return start
            time = soonest
    return time


def _with_windows(
    shop: Shop, windows: Mapping[str, tuple[int, int]], visits: Mapping[StepId, str], plan: Plan
) -> Shop:
    """The shop with the windows that visits open after the first one, so that the checker of
    schedules sees them.
    """
    names = {step.id: f"{step.id} {step.operator}" for step in plan.steps}
    if not visits:
        return shop
    first, *later_visits = visits
    begin = windows.get(visits[first], (0, 0))[0]
    opened = (
        StageWindow(
            StageMoment(names[first]),
            StageMoment(names[step]),
            max(0, windows[visits[step]][0] - begin),
        )
        for step in later_visits
        if visits[step] in windows
    )
    return replace(shop, windows=(*shop.windows, *opened))


def weighted_lateness(plan: Plan, wishes: Wishes, starts: Mapping[StepId, int]) -> int:
    """The weighted sum of how late the steps about each object end."""
    late = 0
    for subject, due in wishes.due.items():
        ends = [starts[s.id] + s.duration for s in plan.steps if contains_term(s.operator, subject)]
        late += wishes.priority.get(subject, 1) * max(0, max(ends, default=0) - due)
    return late


def _with_travel(shop: Shop, round_: _ArmRound) -> Shop:
    """The shop with the ways of the arm between its steps, so that the checker of schedules
    sees them.
    """
    if not round_.travel:
        return shop
    resources = tuple(
        replace(resource, travel=round_.travel) if resource.name == round_.arm else resource
        for resource in shop.resources
    )
    jobs = tuple(
        replace(
            job,
            stages=tuple(
                replace(
                    s,
                    origin=round_.places.get(s.name, ""),
                    destination=round_.places.get(s.name, ""),
                )
                for s in job.stages
            ),
        )
        for job in shop.jobs
    )
    return replace(shop, jobs=jobs, resources=resources)
