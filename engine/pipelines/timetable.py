"""From a problem to a timetable: plan, schedule, make a plan of the schedule, and check it.

A schedule is always also a valid plan: the steps are put in the order of their starts, orders that they do not need are
removed, and the result passes the gate. Some plans have no structure that can be scheduled. Such a plan keeps its own
order, and passes the gate as it was given.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from engine.model.forecast import earliest_starts
from engine.model.outcome import Found, GaveUp, Infeasible, Statistics
from engine.model.schedule import Schedule, Scheduled, Timetable
from engine.model.shop import Job, Resource, Shop, Stage
from engine.model.stages import STAGE
from engine.model.task import Bits, GroundOperator, Task, bitset, progress
from engine.pipelines.gate import PlanGate
from engine.pipelines.planning import planned, problem_of
from engine.stages.grounding import ground
from engine.stages.planning import Limits
from engine.stages.planning.improvement.deorder import deorder
from engine.stages.planning.variants import plainly
from engine.stages.scheduling import ScheduleLimits, schedule
from engine.stages.scheduling.blocks import Unstructured
from engine.stages.scheduling.bounds import lower_bound
from engine.stages.scheduling.lags import Lags
from engine.stages.scheduling.rebuild import Mislaid, TimedStep, timed_steps
from engine.stages.scheduling.work import CellWork, Wishes, cell_work
from engine.stages.validation.datalog import Facts
from kb.diagnostics import InvalidInput
from kb.loader import load_plan
from kb.loader.plan import is_plan
from kb.model.conventions import Conventions
from kb.model.plan import Plan, StepId
from kb.model.problem import Problem
from kb.terms import Function, Number, Term


def subject_of(target: str, goals: str = "", command: str = "") -> tuple[Problem, Plan | None]:
    """The problem that a target names, and the plan if the target is the file of a plan. Raises `InvalidInput`."""
    if is_plan(Path(target)):
        return load_plan(Path(target))
    return problem_of(target, goals, command), None


def timetable(
    problem: Problem,
    plan: Plan | None = None,
    planning: Limits = Limits(),
    limits: ScheduleLimits = ScheduleLimits(),
) -> Timetable | Infeasible | GaveUp:
    """The timetable of `plan`, or of a new plan for the problem if none is given. Raises `InvalidInput`."""
    started = time.perf_counter()
    outcome, task = (Found(plan), ground(problem)) if plan is not None else planned(problem, planning)
    if not isinstance(outcome, Found):
        return outcome
    before = time.perf_counter()
    made = timed(problem, task, outcome.plan, limits)
    if not isinstance(made, Timetable):
        return made
    seconds = {
        "planning": before - started,
        **made.statistics.seconds,
        "in all": time.perf_counter() - started,
    }
    return replace(made, statistics=Statistics(made.statistics.counts, seconds))


def timed(
    problem: Problem, task: Task, plan: Plan, limits: ScheduleLimits = ScheduleLimits()
) -> Timetable | Infeasible | GaveUp:
    """The timetable of a plan: as scheduled, or in the plan's own order if it cannot be scheduled.

    If the scheduler finds no schedule and longest stays limit some waits, its answer is returned as it is, because the
    plan's own order may break these limits. Raises `InvalidInput` if the plan keeps its own order and is not valid.
    """
    gate = PlanGate()
    wishes = wishes_of(gate.semantics(problem).statics, problem.domain.conventions)
    try:
        steps, goals = operators_of(task, plan)
        subjects = tuple(dict.fromkeys(c.subject for c in problem.chains if c.subject is not None))
        work = cell_work(task, steps, goals, subjects, wishes)
        found = schedule(work.shop, limits)
        if isinstance(found, Scheduled):
            return _as_plan(gate, problem, task, goals, work, found)
        return found if _dwells(work.shop) else in_its_order(_sound(gate, problem, plan), found.reason)
    except (Unstructured, Mislaid) as error:
        unwatched = "; longest stays are not checked" if wishes.longest_stay else ""
        return in_its_order(_sound(gate, problem, plan), f"{error}{unwatched}")


def _sound(gate: PlanGate, problem: Problem, plan: Plan) -> Plan:
    """A plan as it may be given out. Raises `InvalidInput` if the checker refuses it."""
    settled, wrong = gate.settled(problem, plan)
    if wrong:
        raise InvalidInput(wrong)
    return settled


def _dwells(shop: Shop) -> bool:
    return any(window.most is not None for window in shop.windows)


def _as_plan(
    gate: PlanGate, problem: Problem, task: Task, goals: Bits, work: CellWork, found: Scheduled
) -> Timetable:
    """The schedule as a plan that the checker accepts. Raises `Mislaid` if it refuses the plan."""
    steps = timed_steps(task, work, found.schedule)
    plan = deorder(task, [step.operator for step in steps], goals)
    starts = {made.id: step.start for made, step in zip(plan.steps, steps, strict=True)}
    if wrong := gate.findings(problem, plan):
        raise Mislaid(wrong[0].message)
    _require_order(plan, starts, steps)
    return Timetable(plan, starts, work.shop, found.schedule, statistics=found.statistics)


def _require_order(plan: Plan, starts: Mapping[StepId, int], steps: Sequence[TimedStep]) -> None:
    """Check that every step starts only after all steps that it waits for have ended. Raises `Mislaid`."""
    ends = {made.id: step.end for made, step in zip(plan.steps, steps, strict=True)}
    for step in plan.steps:
        if any(ends[before] > starts[step.id] for before in step.after):
            raise Mislaid(f"{step.operator} starts before a step that it waits for has ended")


def operators_of(task: Task, plan: Plan) -> tuple[list[GroundOperator], Bits]:
    """The ground operators of a plan's steps in its order, without conditional effects, and the goal that they reach.

    Several ground operators of a step may be applicable in its state. One that reaches most stages is taken. Raises
    `Unstructured` if the plan cannot be followed in the ground task.
    """
    variants: dict[Function, list[GroundOperator]] = {}
    for operator in task.operators:
        variants.setdefault(operator.instance, []).append(operator)
    stages = bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE])
    state, found = task.initial, []
    for step in plan.steps:
        fitting = [each for each in variants.get(step.operator, ()) if each.preconditions & ~state == 0]
        if not fitting:
            raise Unstructured(f"step {step.id} {step.operator} cannot be followed in the ground task")
        found.append(max(fitting, key=lambda each: (each.adds & stages).bit_count()))
        state = progress(state, found[-1])
    met = [goal for goal in task.goals if _visible(task, goal) & ~state == 0]
    if not met:
        raise Unstructured("the ground task does not show how the plan reaches its goals")
    return plainly(task, found), _visible(task, met[0])


def _visible(task: Task, goal: Bits) -> Bits:
    """A goal without the internal atoms that grounding has added, except those of stages."""
    hidden = [n for n, atom in enumerate(task.atoms) if atom.name.startswith("_") and atom.name != STAGE]
    return goal & ~bitset(hidden)


def wishes_of(statics: Facts, words: Conventions) -> Wishes:
    """What the static facts say about times: travel, longest stays, releases, due dates and priorities."""

    def numbers(name: str) -> dict[Term, int]:
        facts = [atom.arguments for atom in statics.named(name) if len(atom.arguments) == 2]
        return {first: last.value for first, last in facts if isinstance(last, Number)}

    trips = [atom.arguments for atom in statics.named(words.travel) if len(atom.arguments) == 3]
    travel = {(a, b): lasts.value for a, b, lasts in trips if isinstance(lasts, Number)}
    return Wishes(travel, *map(numbers, (words.longest_stay, words.release, words.due, words.priority)))


def in_its_order(plan: Plan, note: str) -> Timetable:
    """The plan with every step as early as its own order allows. Its bound considers only causal links and resources."""
    starts = earliest_starts(plan)
    stages = {
        step.id: Stage(f"{step.id} {step.operator}", step.duration, tuple(map(str, step.resources)))
        for step in plan.steps
    }
    jobs = tuple(Job(stage.name, (stage,)) for stage in stages.values())
    resources = dict.fromkeys(str(resource) for step in plan.steps for resource in step.resources)
    bare = Shop(jobs, tuple(map(Resource, resources)))
    pairs = [(link.producer, link.consumer) for link in plan.links]
    linked = [bare.after(stages[a].name, stages[b].name) for a, b in pairs if a in stages and b in stages]
    bound = lower_bound(Lags(replace(bare, windows=tuple(dict.fromkeys(linked)))))
    ordered = [bare.after(stages[a].name, stages[s.id].name) for s in plan.steps for a in s.after]
    times = {stages[step].name: start for step, start in starts.items()}
    last = max((start + stages[step].duration for step, start in starts.items()), default=0)
    made = Schedule(times, (), last, bound, 0, bound == last)
    return Timetable(plan, starts, replace(bare, windows=tuple(ordered)), made, note)
