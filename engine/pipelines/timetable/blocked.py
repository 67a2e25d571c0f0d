"""The schedule of the blocks of a plan, as a plan that passes the gate."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from cellwright.engine.model.forecast import makespan
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.replay import instances, joined, reached_goals, replayed
from cellwright.engine.model.schedule import Scheduled, Timetable
from cellwright.engine.model.shop import Shop
from cellwright.engine.model.stages import STAGE
from cellwright.engine.model.task import Bits, GroundOperator, Task, bitset
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.timetable.orders import Steps
from cellwright.engine.stages.planning.improvement.deorder import deorder
from cellwright.engine.stages.planning.variants import plainly
from cellwright.engine.stages.scheduling import ScheduleLimits, schedule
from cellwright.engine.stages.scheduling.blocks import Unstructured
from cellwright.engine.stages.scheduling.rebuild import Mislaid, TimedStep, timed_steps, units
from cellwright.engine.stages.scheduling.work import CellWork, cell_work
from cellwright.kb.model.plan import Plan, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Term

BLOCKS = "of all schedules of the blocks of this plan"


def subjects_of(problem: Problem) -> tuple[Term, ...]:
    """The objects of the workflow."""
    return tuple(dict.fromkeys(c.subject for c in problem.chains if c.subject is not None))


def by_blocks(gate: PlanGate, steps: Steps, limits: ScheduleLimits) -> Timetable | str:
    """The schedule of the blocks of a plan, or why there is none; none is longer than the plan in its own order."""
    problem, wishes = steps.problem, steps.wishes
    if problem.domain.quantities:
        return "steps change quantities, so that their order counts"
    try:
        work = cell_work(steps.task, steps.operators, steps.goals, subjects_of(problem), wishes)
        found = schedule(work.shop, limits)
        if isinstance(found, Scheduled):
            made = _as_plan(gate, steps, work, found)
            longer = not wishes.any and made.schedule.makespan > makespan(steps.plan)
            return "as blocks they take longer" if longer else made
        tight = isinstance(found, Infeasible) and _dwells(work.shop)
        return "no order of the blocks keeps to all longest stays" if tight else found.reason
    except (Unstructured, Mislaid) as error:
        return str(error)


def _dwells(shop: Shop) -> bool:
    return any(window.most is not None for window in shop.windows)


def _as_plan(gate: PlanGate, steps: Steps, work: CellWork, found: Scheduled) -> Timetable:
    """The schedule as a plan that the checker accepts. Raises `Mislaid`."""
    made = timed_steps(steps.task, work, found.schedule)
    plan = deorder(steps.task, [s.operator for s in made], steps.goals, [s.start for s in made])
    starts = {step.id: each.start for step, each in zip(plan.steps, made, strict=True)}
    if wrong := gate.findings(steps.problem, plan):
        raise Mislaid(wrong[0].message)
    _require_order(plan, starts, made)
    settled = replace(found.schedule, units=units(work, found.schedule))
    return Timetable(plan, starts, work.shop, settled, BLOCKS, statistics=found.statistics)


def _require_order(plan: Plan, starts: Mapping[StepId, int], steps: Sequence[TimedStep]) -> None:
    """Check that every step starts only after all steps that it waits for have ended. Raises `Mislaid`."""
    ends = {made.id: step.end for made, step in zip(plan.steps, steps, strict=True)}
    for step in plan.steps:
        if any(ends[before] > starts[step.id] for before in step.after):
            raise Mislaid(f"{step.operator} starts before a step that it waits for has ended")


def operators_of(task: Task, plan: Plan) -> tuple[list[GroundOperator], Bits]:
    """The ground operators of a plan's steps in its order, without conditional effects, and the goal that they reach.

    Every stage is reached as early as possible.
    """
    found = replayed(task, instances(task), task.initial, [step.operator for step in plan.steps])
    if found is None:
        raise Unstructured("a step cannot be followed")
    state = task.initial
    for operator in found:
        state = task.after(state, operator)
    met = next((goal for goal in task.goals if _visible(task, goal) & ~state == 0), None)
    if met is None:
        raise Unstructured("the goals are reached in a way that cannot be followed")
    needed = reached_goals(task, state) if task.axioms else met
    steps, goals = joined(task, plainly(task, found), _visible(task, met if needed is None else needed))
    return steps, _visible(task, goals)


def _visible(task: Task, goal: Bits) -> Bits:
    """A goal without the internal atoms that grounding has added, except those of stages."""
    hidden = [n for n, atom in enumerate(task.atoms) if atom.name.startswith("_") and atom.name != STAGE]
    return goal & ~bitset(hidden)
