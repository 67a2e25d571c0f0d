"""From a problem to a plan with motions: poses first, and a new plan where a step has no motion.

A step without a motion becomes a condition of its operator (`bars`), and planning goes on: where
measurements are made in an order, only from the measurement of that step on, until all is as it
was. When every step moves, its real time replaces the declared one, the steps are scheduled again,
and the plan passes the gate with these times.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.motion_values import MovedStep, Sharing, Unmoved, UnprovedStep
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome
from cellwright.engine.model.part_measurements import asked_for, chooses_tools, is_shared
from cellwright.engine.model.shop_scheduling import Schedule, Timetable
from cellwright.engine.pipelines.inspection.measurement_places import measured_at
from cellwright.engine.pipelines.motion.arm_conflicts import ArmEncounters
from cellwright.engine.pipelines.motion.arm_passing import PassingPlan, kept_apart
from cellwright.engine.pipelines.motion.measurement_poses import (
    PoseKnowledge,
    kept_poses,
    known_poses,
    with_stations,
)
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, Ways, steps_by_start
from cellwright.engine.pipelines.motion.unproved_steps import unproved_steps
from cellwright.engine.pipelines.planning.checked_plan import task_for
from cellwright.engine.pipelines.planning.decomposition.joined_plan import patch_plan
from cellwright.engine.pipelines.planning.dwell_limits import wishes_for
from cellwright.engine.pipelines.planning.goal_selection import (
    RelinquishedGoal,
    all_lost,
    drop_unreachable_goals,
)
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.plan_objective import Run
from cellwright.engine.pipelines.planning.restrictions import (
    forbid_unreachable_steps,
    refusal_sentence,
)
from cellwright.engine.pipelines.planning.timetable import keep_plan_order, own_order, time_plan
from cellwright.engine.pipelines.planning.timetable.kept_order import MAX_SCHEDULED_STEPS
from cellwright.engine.pipelines.planning.timetable.step_order import by_step
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.scheduling.plan_blocks import contains_term
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.cell_model import Cell
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.syntax import SECONDS_PER_UNIT
from cellwright.kb.terms import Function

MAX_REFUSED_STEPS = 60  # steps without motion, after which planning gives up
NONE_LOST: Mapping[str, str] = {}
NOTHING_LEFT = "no arm can take any of the measurements that are asked for"
SCOPE_PASSING = "of all ways in which the arms pass each other, each with its steps in this order"
MAX_PASSING_ROUNDS = 4  # schedules, each of whose order is walked through again


@dataclass(frozen=True, slots=True, eq=False)
class MovingRun:
    """A run whose plan moves. `problem` has the real times of the steps, `steps` their motions,
    `refused` what had none.

    `given_up` are goals about measurements that no arm can take; `problem` is without them.
    `sharing` says how several arms keep apart. `walk` knows the motions of the steps, and the cell.
    `unproved` are the steps without a motion, and those that bring a body somewhere without one.
    """

    run: Run
    problem: Problem
    steps: tuple[MovedStep, ...] = ()
    refused: tuple[Unmoved, ...] = ()
    given_up: tuple[RelinquishedGoal, ...] = ()
    sharing: Sharing | None = None
    walk: PlanWalk | None = None
    unproved: tuple[UnprovedStep, ...] = ()


def plan_moving(
    problem: Problem,
    cell: Cell,
    backend: GeometryBackend,
    planned: Callable[[Problem], Run],
    seed: int = 0,
    ways: Ways | None = None,
    lost: Mapping[str, str] = NONE_LOST,
) -> MovingRun:
    """A plan for the problem, by `planned`, in which every step moves.

    `ways` are straight ways into places that are known already. `lost` says why no arm can take
    some measurements. Goals about them are given up, and so are goals about measurements whose
    place is refused, if there is no plan with them. Raises `InvalidInput` for a cell without
    operations.
    """
    _require_operations(cell)
    refused: list[Unmoved] = []
    walk = PlanWalk(PlanGate().semantics(problem), cell, backend, seed, ways=ways or {})
    last: Run | None = None
    while len(refused) <= MAX_REFUSED_STEPS:
        remaining, given_up = drop_unreachable_goals(problem, lost)
        asked = forbid_unreachable_steps(remaining, refused)
        run = (_patch_run(asked, last, refused[-1].step, seed) if last else None) or planned(asked)
        if not isinstance(run.outcome, Found):
            if more := _lost_measurements(problem, refused, lost):
                lost = {**lost, **more}
                continue
            outcome = _without_refused_steps(run.outcome, refused)
            if remaining is problem and lost and isinstance(outcome, Infeasible):
                outcome = replace(outcome, reason=NOTHING_LEFT)
            return MovingRun(
                Run(outcome), problem, (), tuple(refused), given_up or all_lost(problem, lost)
            )
        steps = list(walk.steps(run.outcome.plan))
        if steps and isinstance(steps[-1], Unmoved):
            refused, last = [*refused, steps[-1]], run
            continue
        moved = [step for step in steps if isinstance(step, MovedStep)]
        moving = _in_real_time(_AskedProblem(remaining, asked, walk), run, moved, refused)
        return replace(moving, given_up=given_up, walk=walk)
    reason = f"{len(refused)} steps have no motion; the last: {refusal_sentence(refused[-1:])}"
    return MovingRun(Run(GaveUp(reason, "work")), problem, refused=tuple(refused))


def _patch_run(problem: Problem, last: Run, failed: StepId, seed: int) -> Run | None:
    """The last run with the part of a step replanned that has no motion, if it follows a
    sequence and the rest can stay.
    """
    if last.itinerary is None or not isinstance(last.outcome, Found):
        return None
    patched_outcome = patch_plan(
        problem, last.outcome.plan, last.itinerary, failed, SearchLimits(seed=seed)
    )
    if not isinstance(patched_outcome, Found):
        return None if patched_outcome is None else Run(patched_outcome, None, last.itinerary)
    return Run(patched_outcome, keep_plan_order(problem, patched_outcome.plan), last.itinerary)


def _lost_measurements(
    problem: Problem, refused: Sequence[Unmoved], lost: Mapping[str, str]
) -> dict[str, str]:
    """The measurements whose places have refused steps, with the reasons, but for those that
    are known to be lost.
    """
    words, lost_names = problem.domain.conventions, dict[str, str]()
    for unmoved in refused:
        name = measured_at(words, unmoved.place)
        if name and name not in lost:
            lost_names[name] = unmoved.reason if unmoved.sure else f"{unmoved.reason} (not proved)"
    return lost_names


def _require_operations(cell: Cell) -> None:
    if not cell.operations:
        hint = (
            "say what the arm does in a step under `operations:`, such as pick(Item, Place): "
            "{at: Place}"
        )
        raise InvalidInput(
            [Diagnostic(Source(cell.path), "K405", "the cell declares no operations", hint)]
        )


def _without_refused_steps(outcome: Outcome, refused: Sequence[Unmoved]) -> Outcome:
    """The outcome of planning without the steps that have no motion."""
    if not refused or not isinstance(outcome, Infeasible):
        return outcome
    reason = f"{outcome.reason}; {refusal_sentence(refused)}"
    if all(unmoved.sure for unmoved in refused):
        return replace(outcome, reason=reason)
    return GaveUp(
        f"{reason}. Whether there really is no way was not proved", "work", outcome.statistics
    )


@dataclass(frozen=True, slots=True, eq=False)
class _AskedProblem:
    """The problem as it was given, and without the steps that have no motion; the arm that
    walks through its plans.
    """

    problem: Problem
    barred: Problem
    walk: PlanWalk


def _in_real_time(
    asked: _AskedProblem, run: Run, steps: list[MovedStep], refused: Sequence[Unmoved]
) -> MovingRun:
    """The plan with the times of its motions, in the best order that is found; in its own order
    if no order settles.
    """
    assert isinstance(run.outcome, Found)
    plan = run.outcome.plan
    for _ in range(MAX_PASSING_ROUNDS):
        barred, plan = with_times(asked.barred, plan, steps)
        table = _schedule_run(barred, plan, run)
        if table is None:
            break
        again: Sequence[MovedStep | Unmoved] = steps
        if _step_sequence(table.plan) != _step_sequence(plan):
            again = list(asked.walk.steps(table.plan))
        if any(isinstance(motion, Unmoved) for motion in again):
            break
        moved = [motion for motion in again if isinstance(motion, MovedStep)]
        settled = _real_times(moved, barred) == _real_times(steps, barred)
        plan, steps = table.plan, moved
        if settled:
            return _moving_run(asked, run, table, steps, refused)
    barred, plan = with_times(asked.barred, plan, steps)
    table = own_order(barred, task_for(barred, plan), plan)
    return _moving_run(asked, run, table, steps, refused)


def _step_sequence(plan: Plan) -> list[tuple[StepId, Function]]:
    """What the arms do one after the other."""
    return [(step.id, step.operator) for step in steps_by_start(plan)]


def _moving_run(
    asked: _AskedProblem,
    run: Run,
    table: Timetable,
    steps: Sequence[MovedStep],
    refused: Sequence[Unmoved],
) -> MovingRun:
    """The answer, which has passed the gate with the times of its motions in place of those of
    the domain.
    """
    assert isinstance(run.outcome, Found)
    sharing = None
    if len(asked.walk.cell.arms) > 1:
        shared = _kept_apart(asked, table)
        if isinstance(shared, str):
            reason = f"the arms get in each other's way: {shared}"
            return MovingRun(Run(GaveUp(reason, "work")), asked.problem, refused=tuple(refused))
        table, steps, sharing = _as_table(asked, table, shared), shared.steps, shared.sharing
    problem = replace(asked.problem, durations=_real_times(steps, asked.problem))
    plan = PlanGate().accepted(problem, table.plan)
    outcome = replace(run.outcome, plan=plan, optimal=False)
    timed_run = replace(run, outcome=outcome, timetable=table)
    return MovingRun(
        timed_run,
        problem,
        tuple(steps),
        tuple(refused),
        sharing=sharing,
        unproved=unproved_steps(asked.walk, plan),
    )


def _kept_apart(asked: _AskedProblem, table: Timetable) -> PassingPlan | str:
    """The plan in which several arms keep apart."""
    wishes = wishes_for(asked.walk.semantics, table.plan)
    release = {
        step.id: max(time, 0)
        for step in table.plan.steps
        for subject, time in wishes.release.items()
        if contains_term(step.operator, subject)
    }

    def lasting(plan: Plan, steps: Sequence[MovedStep]) -> Plan:
        return with_times(asked.barred, plan, steps)[1]

    return kept_apart(asked.walk, table.plan, lasting, ArmEncounters(asked.walk.backend), release)


def _as_table(asked: _AskedProblem, table: Timetable, shared: PassingPlan) -> Timetable:
    """The timetable of the plan in which the arms keep apart."""
    bound = min(shared.sharing.lower_bound, shared.makespan)
    schedule = Schedule({}, (), shared.makespan, bound, proved=shared.sharing.proved)
    problem = replace(asked.barred, durations=_real_times(shared.steps, asked.barred))
    return by_step(problem, shared.plan, shared.starts, schedule, table.note, SCOPE_PASSING)


def _real_times(steps: Sequence[MovedStep], problem: Problem) -> Mapping[Function, int]:
    """How long each step lasts, in the domain's unit, rounded up; the longest time of those
    with the same name.
    """
    unit = float(SECONDS_PER_UNIT[problem.domain.time_unit])
    durations = dict(problem.durations)
    longest: dict[Function, int] = {}
    for step in steps:
        lasts = math.ceil(step.seconds / unit - 1e-9)
        longest[step.operator] = max(lasts, longest.get(step.operator, 0))
    return durations | longest


def with_times(problem: Problem, plan: Plan, steps: Sequence[MovedStep]) -> tuple[Problem, Plan]:
    """The problem and the plan with the times of motions."""
    times = _real_times(steps, problem)
    lasting = tuple(
        replace(step, duration=times.get(step.operator, step.duration)) for step in plan.steps
    )
    return replace(problem, durations=times), replace(plan, steps=lasting)


def _schedule_run(problem: Problem, plan: Plan, run: Run) -> Timetable | None:
    """The plan in the best order that is found with these times; a sequence of measurements
    keeps its order.
    """
    if run.itinerary is not None or len(plan.steps) > MAX_SCHEDULED_STEPS:
        return keep_plan_order(problem, plan)
    timetable = time_plan(problem, task_for(problem, plan), plan)
    return timetable if isinstance(timetable, Timetable) else None


@dataclass(frozen=True, slots=True, eq=False)
class MovingInspection:
    """A plan that moves, and what is known of the poses of its measurements; None if it has no
    measurements.
    """

    moving: MovingRun
    knowledge: PoseKnowledge | None = None


def plan_with_poses(
    problem: Problem,
    cell: Cell,
    backend: GeometryBackend,
    planned: Callable[[Problem], Run],
    seed: int = 0,
    store: str = "",
) -> MovingInspection:
    """A plan in which every step moves. Poses come from the store, if one is given, and are kept
    there. Raises `InvalidInput`.

    Goals about measurements that no station reaches are given up. Where several arms share
    measurements, the sequence finds out who reaches them, and the walk through the plan finds the
    poses.
    """
    if not chooses_tools(problem.domain) or is_shared(problem):
        return MovingInspection(plan_moving(problem, cell, backend, planned, seed))
    knowledge = _of_wanted(problem, cell, backend, store)
    ways = _straight_ways(problem, knowledge)
    problem_told = with_stations(problem, knowledge)
    moving = plan_moving(problem_told, cell, backend, planned, seed, ways, knowledge.unreached())
    return MovingInspection(moving, knowledge)


def known_ways(problem: Problem, cell: Cell, backend: GeometryBackend, store: str) -> Ways:
    """The straight ways into the places of measurements that a store has, or that are found now."""
    if not chooses_tools(problem.domain) or is_shared(problem):
        return {}
    return _straight_ways(problem, _of_wanted(problem, cell, backend, store))


def _of_wanted(problem: Problem, cell: Cell, backend: GeometryBackend, store: str) -> PoseKnowledge:
    """The poses of the measurements that are asked for: a few of a large part take no longer
    than those few.
    """
    only = asked_for(problem)
    if store:
        return kept_poses(store, problem, cell, backend, only)
    return known_poses(problem, cell, backend, only=only)


def _straight_ways(problem: Problem, knowledge: PoseKnowledge) -> Ways:
    words = problem.domain.conventions
    return {
        (words.place(name), station): poses.straight
        for (name, _, station), poses in knowledge.poses.items()
        if poses.reached
    }
