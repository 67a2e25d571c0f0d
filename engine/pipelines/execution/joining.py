"""Another plan while steps are under way: these end as they have begun, and the new steps join behind them.

The new plan begins in the world that will be when everything under way has ended. Which of its steps wait for which of those
under way is found out as for any plan: by what they need, by what they undo, and by what they hold.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from cellwright.engine.pipelines.execution.compiling import unit_ms
from cellwright.engine.pipelines.execution.planned import SHORT, Ready, ready
from cellwright.engine.pipelines.execution.progress import Progress
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.planning import task_for
from cellwright.engine.pipelines.revision.remaining import left_over
from cellwright.engine.pipelines.simulation import SymbolicWorld, WorldState
from cellwright.engine.pipelines.timetable import operators_of
from cellwright.engine.stages.execution import Running, Standing, standing_of
from cellwright.engine.stages.planning.improvement.deorder import deorder
from cellwright.engine.stages.scheduling.blocks import Unstructured
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.model.problem import Chain, Problem


@dataclass(frozen=True)
class Joined:
    """A program whose first steps are under way already, and the standing in which it is followed."""

    ready: Ready
    standing: Standing


def ahead(course: Progress, chains: Sequence[Chain] | None = None) -> WorldState:
    """The world when all that is under way has ended as it should; with `chains` for the workflow, if they are others."""
    pursued = course.world.chains if chains is None else chains
    reached = {chain.name: 0 for chain in pursued} | course.world.reached
    world = SymbolicWorld(pursued, set(course.world.facts), reached)
    for _, running in sorted(course.standing.running.items()):
        world.apply(course.compiled.changes[running.activity])
    return world.state


def left_behind(course: Progress) -> Plan:
    """The steps of the plan that have not begun."""
    begun = course.done | {each.activity for each in course.standing.running.values()}
    return left_over(course.compiled.plan, {StepId(each) for each in begun})


def joined(course: Progress, scope: Scope, found: Ready) -> Joined:
    """The program of what is under way and of a plan that begins when it has ended."""
    numbers = sorted(course.standing.running)
    first = [_begun(course, number, place + 1) for place, number in enumerate(numbers)]
    rest = _behind(found, len(first))
    here = scope.rest(course.world.state)
    plan = _ordered(here, first, rest)
    if not numbers:
        return Joined(found, _standing(course, found, (), course.driver.now_ms()))
    now = course.driver.now_ms()
    starts = _starts(course, unit_ms(here.domain), plan, numbers, found)
    made = ready(here, plan, starts, now, since=course.since)
    return Joined(made, _standing(course, made, numbers, now))


def _begun(course: Progress, number: int, place: int) -> Step:
    activity = course.standing.running[number].activity
    step = next(each for each in course.compiled.plan.steps if each.id == activity)
    return replace(step, id=StepId(place), after=())


def _behind(found: Ready, first: int) -> list[Step]:
    """The steps of a plan in the order of their starts, with numbers behind those of the first ones."""
    order = {step.id: place for place, step in enumerate(found.plan.steps)}
    sequence = sorted(found.plan.steps, key=lambda each: (found.starts[each.id], order[each.id]))
    ids = {step.id: StepId(first + 1 + place) for place, step in enumerate(sequence)}
    return [replace(s, id=ids[s.id], after=tuple(ids[each] for each in s.after)) for s in sequence]


def _ordered(here: Problem, first: Sequence[Step], rest: Sequence[Step]) -> Plan:
    """The plan of both with only the orders that it needs; where these cannot be found, the rest waits for all of the first."""
    if first and len(first) + len(rest) <= SHORT:
        try:
            both = Plan((*first, *rest))
            task = task_for(here, both)
            plan = deorder(task, *operators_of(task, both))
        except Unstructured:
            pass
        else:
            whole = [step.operator for step in plan.steps] == [step.operator for step in (*first, *rest)]
            if whole and not PlanGate().findings(here, plan):
                return plan
    waits = tuple(step.id for step in first)
    behind = (replace(step, after=step.after or waits) for step in rest)
    return PlanGate().accepted(here, Plan((*first, *behind)))


def _starts(
    course: Progress, unit: Fraction, plan: Plan, numbers: Sequence[int], found: Ready
) -> Mapping[StepId, int]:
    """The forecast from now on, in the domain's unit: of what is under way as it began, of the rest as soon as can be.

    A plan that was timed for wishes keeps its distances.
    """
    now_ms = course.driver.now_ms()
    starts, ends = dict[StepId, int](), dict[StepId, int]()
    for place, number in enumerate(numbers):
        running = course.standing.running[number]
        each = course.compiled.program.activities[running.activity]
        starts[StepId(place + 1)] = (running.since_ms - now_ms) // unit
        ends[StepId(place + 1)] = max(0, -((now_ms - running.since_ms - each.lasts_ms) // unit))
    late = max(ends.values(), default=0)
    planned = dict(
        zip((s.id for s in _behind(found, len(numbers))), sorted(found.starts.values()), strict=True)
    )
    free: dict[object, int] = {}
    for step in plan.steps:
        if step.id not in starts:
            soon = max([0, *(ends[b] for b in step.after), *(free.get(r, 0) for r in step.resources)])
            starts[step.id] = late + planned[step.id] if found.compiled.program.timed else soon
            ends[step.id] = starts[step.id] + step.duration
        free |= {resource: max(free.get(resource, 0), ends[step.id]) for resource in step.resources}
    return starts


def _standing(course: Progress, made: Ready, numbers: Sequence[int], now_ms: int) -> Standing:
    """The standing of the joined program: what is under way goes on, and the phase is what it was."""
    old = course.standing
    places = {old.running[number].activity: place + 1 for place, number in enumerate(numbers)}
    running = {n: Running(places[old.running[n].activity], old.running[n].since_ms) for n in numbers}
    waits = {
        number: (stream, frozenset(places[each] for each in awaited if each in places))
        for number, (stream, awaited) in old.waits.items()
    }
    program = made.compiled.program
    fresh = standing_of(program, now_ms, old.number, old.phase, (), running, unrested=old.unrested)
    return replace(fresh, waits=waits, frozen=old.frozen)
