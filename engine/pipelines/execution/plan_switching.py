"""Switching plans in a run: steps under way end as begun, and the new steps follow them.

The new plan begins in the world that will be when everything under way has ended. Which of its
steps wait for which of those under way is found out as for any plan: by what they need, by what
they undo, and by what they hold.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.pipelines.execution.compiled_program import unit_ms
from cellwright.engine.pipelines.execution.executable_plan import (
    MAX_RESCHEDULED_STEPS,
    ReadyPlan,
    compile_ready_plan,
)
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.execution.run_progress import RunProgress
from cellwright.engine.pipelines.planning.checked_plan import task_for
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.timetable import operators_of
from cellwright.engine.pipelines.recovery import SymbolicWorld, WorldState
from cellwright.engine.pipelines.recovery.remaining_problem import left_over
from cellwright.engine.stages.execution import ExecutiveState, Running, standing_of
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps
from cellwright.engine.stages.scheduling.plan_blocks import Unstructured
from cellwright.kb.model.object_likeness import constant_names
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Chain, Problem


class SwitchTasks:
    """The ground tasks in which plans for one rest of a run are looked at.

    Plans that name the same things share a task: a review joins many of them.
    """

    def __init__(self, rest: Problem) -> None:
        self.rest, self.gate = rest, PlanGate()
        self._tasks: dict[frozenset[str], GroundTask] = {}

    def task_of(self, plan: Plan) -> GroundTask:
        """The task in which a plan is looked at."""
        names = frozenset(name for step in plan.steps for name in constant_names(step.operator))
        if names not in self._tasks:
            self._tasks[names] = task_for(self.rest, plan)
        return self._tasks[names]


@dataclass(frozen=True)
class JoinedProgram:
    """A program whose first steps are under way already, and the standing in which it is
    followed.
    """

    ready: ReadyPlan
    standing: ExecutiveState


def world_ahead(course: RunProgress, chains: Sequence[Chain] | None = None) -> WorldState:
    """The world when all that is under way has ended as it should; with `chains` for the
    workflow, if they are others.
    """
    pursued = course.world.chains if chains is None else chains
    reached = {chain.name: 0 for chain in pursued} | course.world.reached
    world = SymbolicWorld(pursued, set(course.world.facts), reached)
    for _, running in sorted(course.standing.running.items()):
        world.apply(course.compiled.changes[running.activity])
    return world.state


def left_behind(course: RunProgress) -> Plan:
    """The steps of the plan that have not begun."""
    begun = course.done | {running.activity for running in course.standing.running.values()}
    return left_over(course.compiled.plan, {StepId(number) for number in begun})


def switch_tasks(course: RunProgress, scope: RunScope) -> SwitchTasks:
    """The tasks for plans that are joined now."""
    return SwitchTasks(scope.rest(course.world.state))


def join_plan(course: RunProgress, tasks: SwitchTasks, new_plan: ReadyPlan) -> JoinedProgram:
    """The program of what is under way and of a plan that begins when it has ended."""
    numbers = sorted(course.standing.running)
    first = [_begun_step(course, number, place + 1) for place, number in enumerate(numbers)]
    rest = _steps_behind(new_plan, len(first))
    rest_problem = tasks.rest
    plan = _order_together(tasks, first, rest)
    if not numbers:
        return JoinedProgram(
            new_plan, _joined_standing(course, new_plan, (), course.driver.now_ms())
        )
    now = course.driver.now_ms()
    starts = _forecast_starts(course, unit_ms(rest_problem.domain), plan, numbers, new_plan)
    joined_plan = compile_ready_plan(rest_problem, plan, starts, now, since=course.since)
    return JoinedProgram(joined_plan, _joined_standing(course, joined_plan, numbers, now))


def _begun_step(course: RunProgress, number: int, place: int) -> Step:
    activity = course.standing.running[number].activity
    step = next(candidate for candidate in course.compiled.plan.steps if candidate.id == activity)
    return replace(step, id=StepId(place), after=())


def _steps_behind(new_plan: ReadyPlan, first: int) -> list[Step]:
    """The steps of a plan in the order of their starts, with numbers behind those of the first
    ones.
    """
    order = {step.id: place for place, step in enumerate(new_plan.plan.steps)}
    sequence = sorted(
        new_plan.plan.steps,
        key=lambda plan_step: (new_plan.starts[plan_step.id], order[plan_step.id]),
    )
    ids = {step.id: StepId(first + 1 + place) for place, step in enumerate(sequence)}
    return [
        replace(s, id=ids[s.id], after=tuple(ids[earlier] for earlier in s.after)) for s in sequence
    ]


def _order_together(tasks: SwitchTasks, first: Sequence[Step], rest: Sequence[Step]) -> Plan:
    """The plan of both with only the orders that it needs; where these cannot be found, the
    rest waits for all of the first.
    """
    if first and len(first) + len(rest) <= MAX_RESCHEDULED_STEPS:
        try:
            both = Plan((*first, *rest))
            task = tasks.task_of(both)
            plan = deorder_steps(task, *operators_of(task, both))
        except Unstructured:
            pass
        else:
            whole = [step.operator for step in plan.steps] == [
                step.operator for step in (*first, *rest)
            ]
            if whole and not tasks.gate.findings(tasks.rest, plan):
                return plan
    waits = tuple(step.id for step in first)
    behind = (replace(step, after=step.after or waits) for step in rest)
    return tasks.gate.accepted(tasks.rest, Plan((*first, *behind)))


def _forecast_starts(
    course: RunProgress, unit: Fraction, plan: Plan, numbers: Sequence[int], new_plan: ReadyPlan
) -> Mapping[StepId, int]:
    """The forecast from now on, in the domain's unit: of what is under way as it began, of the rest
    as soon as can be.

    A plan that was timed for wishes keeps its distances.
    """
    now_ms = course.driver.now_ms()
    starts, ends = dict[StepId, int](), dict[StepId, int]()
    for place, number in enumerate(numbers):
        running = course.standing.running[number]
        activity = course.compiled.program.activities[running.activity]
        starts[StepId(place + 1)] = (running.since_ms - now_ms) // unit
        ends[StepId(place + 1)] = max(0, -((now_ms - running.since_ms - activity.lasts_ms) // unit))
    late = max(ends.values(), default=0)
    planned = dict(
        zip(
            (s.id for s in _steps_behind(new_plan, len(numbers))),
            sorted(new_plan.starts.values()),
            strict=True,
        )
    )
    free: dict[object, int] = {}
    for step in plan.steps:
        if step.id not in starts:
            soon = max(
                [0, *(ends[b] for b in step.after), *(free.get(r, 0) for r in step.resources)]
            )
            starts[step.id] = late + planned[step.id] if new_plan.compiled.program.timed else soon
            ends[step.id] = starts[step.id] + step.duration
        free |= {resource: max(free.get(resource, 0), ends[step.id]) for resource in step.resources}
    return starts


def _joined_standing(
    course: RunProgress, joined_plan: ReadyPlan, numbers: Sequence[int], now_ms: int
) -> ExecutiveState:
    """The standing of the joined program: what is under way goes on, and the phase is what it
    was.
    """
    old = course.standing
    places = {old.running[number].activity: place + 1 for place, number in enumerate(numbers)}
    running = {
        n: Running(places[old.running[n].activity], old.running[n].since_ms) for n in numbers
    }
    waits = {
        number: (
            stream,
            frozenset(
                places[number_before] for number_before in awaited if number_before in places
            ),
        )
        for number, (stream, awaited) in old.waits.items()
    }
    program = joined_plan.compiled.program
    fresh = standing_of(program, now_ms, old.number, old.phase, (), running, unrested=old.unrested)
    return replace(fresh, waits=waits, frozen=old.frozen)
