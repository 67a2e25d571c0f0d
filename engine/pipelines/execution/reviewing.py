"""Looks again at what is left of a plan when reality has left its forecast, or when something is about to stay too long.

The steps that are left are scheduled anew, and where something would stay too long, a plan is made that first takes it away.
Another plan is followed only if it pays.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from cellwright.engine.model.cases import Revision
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.execution.choosing import Choice, busy, choices
from cellwright.engine.pipelines.execution.compiling import unit_ms
from cellwright.engine.pipelines.execution.joining import Joined, ahead, joined, left_behind
from cellwright.engine.pipelines.execution.planned import SHORT, Ready, again, in_windows, ready
from cellwright.engine.pipelines.execution.progress import Progress
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.planning import task_for
from cellwright.engine.pipelines.simulation import Dynamics, WorldState
from cellwright.engine.pipelines.timetable import keeping, operators_of
from cellwright.engine.pipelines.troubleshooting.recovery import recover
from cellwright.engine.stages.execution import Program, Standing
from cellwright.engine.stages.execution.outlook import in_order
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.planning.improvement.deorder import deorder
from cellwright.engine.stages.scheduling.blocks import Unstructured
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.plan import Plan, Step, StepId, in_sequence
from cellwright.kb.model.problem import Problem

PAYS_MS = 10_000  # by which another plan has to be done sooner
SHARE = 50  # or this part of what is left, if that is more


@dataclass(frozen=True, slots=True)
class Prospect:
    """What will come of a program as things stand: by how much things stay too long in all, when all is done, and when its
    steps will have ended on the average.
    """

    late_ms: int
    end_ms: int
    mean_ms: int


@dataclass(frozen=True, slots=True)
class Better:
    """A better way to go on, and what is better about it."""

    joined: Joined
    why: str


def reviewed(course: Progress, scope: Scope, limits: Limits) -> Better | None:
    """A better plan for what is left, with what is under way as it is; None if there is none.

    After a review that came to nothing, the next one waits until something has begun or ended, and needs twice as much reason.
    """
    stands = course.standing.done, frozenset(course.standing.running)
    if stands == course.looked:
        return None
    found = _reviewed(course, scope, limits)
    course.looked = None if found is not None else stands
    course.calm = 1 if found is not None else 2 * course.calm
    return found


def _reviewed(course: Progress, scope: Scope, limits: Limits) -> Better | None:
    now = course.driver.now_ms()
    present = prospect(course.compiled.program, course.standing, now)
    best: tuple[Prospect, Joined] | None = None
    for made in _others(course, scope, limits, present.late_ms > 0):
        new = joined(course, scope, made)
        found = prospect(new.ready.compiled.program, new.standing, now)
        if best is None or _value(found) < _value(best[0]):
            best = found, new
    if best is None or not _pays(present, best[0], now):
        return None
    return Better(best[1], _said(present, best[0]))


def chosen(course: Progress, scope: Scope) -> Choice | None:
    """The choice among equal things with which all is done soonest; None if that of the plan loses nothing."""
    now = course.driver.now_ms()
    best, found = _value(prospect(course.compiled.program, course.standing, now)), None
    for choice in choices(course, scope):
        value = _value(prospect(choice.joined.ready.compiled.program, choice.joined.standing, now))
        if value < best:
            best, found = value, choice
    return found


def _value(found: Prospect) -> tuple[int, int, int]:
    return found.late_ms, found.end_ms, found.mean_ms


def _pays(present: Prospect, other: Prospect, now_ms: int) -> bool:
    """Whether it is worth it to follow another plan: one that is done sooner, or no later and with its steps sooner.

    What is done early cannot be late any more, so steps that need not wait do not wait.
    """
    if other.late_ms != present.late_ms:
        return other.late_ms < present.late_ms
    least = max(PAYS_MS, (present.end_ms - now_ms) // SHARE)
    sooner = present.end_ms - other.end_ms
    return sooner > least or (sooner >= 0 and present.mean_ms - other.mean_ms > least)


def _said(present: Prospect, other: Prospect) -> str:
    if other.late_ms < present.late_ms:
        saved = (present.late_ms - other.late_ms) / 1000
        return f"things stay {saved:g} s less than before beyond what they may"
    if other.end_ms < present.end_ms:
        return f"all is done {(present.end_ms - other.end_ms) / 1000:g} s sooner"
    return f"steps end {(present.mean_ms - other.mean_ms) / 1000:g} s sooner on the average"


def prospect(program: Program, standing: Standing, now_ms: int) -> Prospect:
    """What will come of a program if all goes as forecast from now on, in the order of the forecast."""
    begins, ends = _times(program, standing, now_ms)
    late = 0
    for dwell in program.dwells:
        until = standing.dwelling.get(dwell)
        if until is None and dwell.source in ends:
            until = ends[dwell.source] + dwell.most_ms
        if until is not None and dwell.target in begins:
            late += max(0, begins[dwell.target] - until)
    return Prospect(late, max(ends.values(), default=now_ms), sum(ends.values()) // max(1, len(ends)))


def _times(program: Program, standing: Standing, now_ms: int) -> tuple[Mapping[int, int], Mapping[int, int]]:
    """When each activity that has not begun will begin, and when each that has not ended will end."""
    under_way = {each.activity: each.since_ms for each in standing.running.values()}
    lasts = {each: program.activities[each].lasts_ms for each in program.activities}
    ends = {each: max(now_ms, since + lasts[each]) for each, since in under_way.items()}
    free = {r: ends[each] for each in under_way for r in program.activities[each].resources}
    begins: dict[int, int] = {}
    for each in in_order(program, standing):
        activity = program.activities[each]
        times = [now_ms, *(ends[b] for b in activity.after if b in ends)]
        times += [free[r] for r in activity.resources if r in free]
        begins[each] = max([*times, activity.start_ms] if program.timed else times)
        ends[each] = begins[each] + lasts[each]
        free |= dict.fromkeys(activity.resources, ends[each])
    return begins, ends


def _others(course: Progress, scope: Scope, limits: Limits, late: bool) -> Iterator[Ready]:
    """Other plans for what is left, from the world on that will be when what is under way has ended."""
    state, left, now = ahead(course), left_behind(course), course.driver.now_ms()
    if not left.steps:
        return
    rest = scope.rest(state)
    try:
        if len(left.steps) <= SHORT:
            yield again(rest, left, now, limits, course.since, busy(course, rest))
        if late and (plan := _taken_away(course, scope, state, limits)) is not None:
            yield in_windows(rest, plan, now, course.since) or ready(
                rest, plan, keeping(rest, plan).starts, now, since=course.since
            )
    except InvalidInput:
        return  # what is left has no schedule: the plan stays as it is


def _taken_away(course: Progress, scope: Scope, state: WorldState, limits: Limits) -> Plan | None:
    """A plan that first takes away what would stay too long; None if there is none, or if nothing is taken away sooner by it."""
    waiting = sorted(course.standing.dwelling.items(), key=lambda each: (each[1], each[0].target))
    if not waiting:
        return None
    rest, target = scope.rest(state), waiting[0][0].target
    first = _way_to(course, rest, target, state, limits)
    if first is None or not _is_sooner(course, first, target, unit_ms(rest.domain)):
        return None
    dynamics, after = Dynamics(rest), WorldState(state.facts, {chain.name: 0 for chain in rest.chains})
    for step in first.steps:
        after = dynamics.after(step.operator, after)
    reached = {name: state.reached[name] + more for name, more in after.reached.items()}
    then = scope.rest(WorldState(after.facts, {**state.reached, **reached}))
    second = recover(then, Revision(), limits, None, after.facts)
    if not isinstance(second.outcome, Found) or second.given_up:
        return None
    return _one(rest, (*first.steps, *second.outcome.plan.steps))


def _way_to(course: Progress, rest: Problem, target: int, state: WorldState, limits: Limits) -> Plan | None:
    """The steps that take something away, and what has to be done before; None if there are none."""
    adds = course.compiled.changes[target].adds
    if course.way is None or course.way[:2] != (adds, state.facts):
        goal = And(tuple(map(Literal, adds)))
        found = planning.plan(replace(rest, goal=goal, chains=()), limits)
        course.way = adds, state.facts, found.plan if isinstance(found, Found) else None
    return course.way[2]


def _is_sooner(course: Progress, first: Plan, target: int, unit: Fraction) -> bool:
    """Whether something can be taken away sooner than it will be, if nothing else is done before.

    A step waits for what is under way as the same step of the plan does.
    """
    program, now = course.compiled.program, course.driver.now_ms()
    begins, ends = _times(program, course.standing, now)
    under_way = {each.activity for each in course.standing.running.values()}
    waits = {program.activities[each].action: program.activities[each].after for each in reversed(begins)}
    free = {r: ends[each] for each in under_way for r in program.activities[each].resources}
    start, done = now, dict[StepId, int]()
    for step in first.steps:
        times = [now, *(done[each] for each in step.after), *(free.get(str(r), now) for r in step.resources)]
        behind = [ends[each] for each in waits.get(str(step.operator), ()) if each in under_way]
        start = max(times + behind)
        done[step.id] = start + int(step.duration * unit)
        free |= dict.fromkeys(map(str, step.resources), done[step.id])
    return start < begins.get(target, start)


def _one(rest: Problem, steps: tuple[Step, ...]) -> Plan:
    """One plan of steps in a sequence, with the orders that it needs."""
    plan = in_sequence(Plan(tuple(replace(s, id=StepId(n + 1), after=()) for n, s in enumerate(steps))))
    task = task_for(rest, plan)
    try:
        return deorder(task, *operators_of(task, plan))
    except Unstructured:
        return plan
