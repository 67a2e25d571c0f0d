"""What a person can change at a pause: skip, retry, go back, correct facts, add a command."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.run_protocol import OperatorCommand, RecordKind, RunPhase
from cellwright.engine.model.troubleshooting import Revision
from cellwright.engine.pipelines.execution.compiled_program import full_hands, unit_ms
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, schedule_again
from cellwright.engine.pipelines.execution.operator_orders import GivenOrder
from cellwright.engine.pipelines.execution.plan_review import exchanged_plans
from cellwright.engine.pipelines.execution.plan_switching import (
    JoinedProgram,
    join_plan,
    left_behind,
    switch_tasks,
    world_ahead,
)
from cellwright.engine.pipelines.execution.run_goals import RunScope, extend_problem, read_addition
from cellwright.engine.pipelines.execution.run_progress import RunProgress
from cellwright.engine.pipelines.planning.dwell_limits import wishes_for
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.timetable import from_then_on
from cellwright.engine.pipelines.planning.timetable.kept_order import weighted_lateness
from cellwright.engine.pipelines.recovery import Dynamics, WorldState
from cellwright.engine.pipelines.recovery.observations import correct_state, read_facts
from cellwright.engine.pipelines.recovery.remaining_problem import left_over
from cellwright.engine.pipelines.recovery.replanning import recover_goals
from cellwright.engine.ports import Simulated
from cellwright.engine.stages.lifted.cell_domain import StepChange
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.terms import Atom, sort_naturally

# the origin of the order to plan on that a run gives itself when it is taken up after a safe stop
RESUME_ORIGIN = "resume"
MAX_EXCHANGES = 6  # of equal things that are tried for one that is due


class OrderRefused(Exception):
    """An order that cannot be followed now. The message says why."""


@dataclass(frozen=True, slots=True)
class _Pause:
    """Where a run stands when an order comes: the world when what is under way has ended, and
    what is left of the plan.
    """

    course: RunProgress
    scope: RunScope
    state: WorldState
    left: Plan
    limits: SearchLimits


def change_run(
    course: RunProgress, scope: RunScope, given: GivenOrder, limits: SearchLimits
) -> tuple[RunScope, JoinedProgram]:
    """The scope, and the program with its standing, after an order. Raises `OrderRefused`.

    Steps that have begun are not touched. After a further command the run does what it did before,
    else it goes on.
    """
    rests = course.standing.phase is RunPhase.PAUSED or given.origin == RESUME_ORIGIN
    if given.order is not OperatorCommand.ADD and not rests:
        raise OrderRefused("the run is not paused: interrupt it first")
    pause = _Pause(course, scope, world_ahead(course), left_behind(course), limits)
    try:
        new_scope, ready_plan = CHANGE_OF_ORDER[given.order](pause, given.text)
    except InvalidInput as error:
        raise OrderRefused(
            "; ".join(diagnostic.message for diagnostic in error.diagnostics)
        ) from error
    new = join_plan(course, switch_tasks(course, new_scope), ready_plan)
    if given.order is OperatorCommand.ADD:
        return new_scope, new
    full = full_hands(new_scope.problem, new.ready.plan.steps, world_ahead(course).facts)
    standing = replace(new.standing, phase=RunPhase.READY, frozen=False, unrested=full)
    return new_scope, replace(new, standing=standing)


def _named_step(pause: _Pause, text: str) -> StepId:
    """The step of the plan that a text names: by its number, or as it is written.

    Raises `OrderRefused`.
    """
    name = text.strip().replace(" ", "")
    for step in pause.course.whole().plan.steps:
        if name in (str(step.id), str(step.operator).replace(" ", "")):
            return step.id
    raise OrderRefused(f"the plan has no step {text.strip() or '(none was named)'}")


def _skip_step(pause: _Pause, text: str) -> tuple[RunScope, ReadyPlan]:
    """Take a step for done by hand: with its effects."""
    skipped = _named_step(pause, text)
    step = next((candidate for candidate in pause.left.steps if candidate.id == skipped), None)
    if step is None:
        raise OrderRefused(f"step {skipped} is done already, or under way")
    change = _change_now(pause, step)
    pause.course.world.apply(change)
    _note_change(pause, f"{step.operator} was done by hand", change.adds, change.ends)
    rest = left_over(pause.left, {skipped})
    return _replan_rest(replace(pause, state=world_ahead(pause.course), left=rest))


def _change_now(pause: _Pause, step: Step) -> StepChange:
    """What a step changes if it is done now: quantities may not have the values that they have
    at its turn.
    """
    change, quantities = (
        pause.course.compiled.changes[int(step.id)],
        pause.scope.problem.domain.quantities,
    )
    if not any(atom.name in quantities for atom in change.adds):
        return change
    now = pause.course.world.state
    after = Dynamics(pause.scope.problem).after(step.operator, now)

    def counted(own: Sequence[Atom], new: State) -> tuple[Atom, ...]:
        uncounted = (atom for atom in own if atom.name not in quantities)
        return (*uncounted, *sort_naturally(atom for atom in new if atom.name in quantities))

    adds, ends = (
        counted(change.adds, after.facts - now.facts),
        counted(change.ends, now.facts - after.facts),
    )
    return replace(change, adds=adds, ends=ends)


def _retry_rest(pause: _Pause, _text: str) -> tuple[RunScope, ReadyPlan]:
    """Go on with what is left, from the world as it is."""
    return _replan_rest(pause)


def _go_back(pause: _Pause, text: str) -> tuple[RunScope, ReadyPlan]:
    """Do a step again, and what comes behind it, as far as the world allows; else a new plan
    leads to the goals.
    """
    target = _named_step(pause, text)
    whole = pause.course.whole().plan
    order = [step.id for step in whole.steps]
    behind = set(order[order.index(target) :])
    plan = left_over(whole, set(order) - behind - {step.id for step in pause.left.steps})
    dynamics = Dynamics(pause.scope.rest(pause.state))
    state = dynamics.start()
    for step in plan.steps:
        if why := dynamics.refusal(step.operator, state):
            raise OrderRefused(f"step {step.id} {step.operator} cannot be taken again: {why}")
        state = dynamics.after(step.operator, state)
    return pause.scope, schedule_again(
        pause.scope.rest(pause.state),
        plan,
        pause.course.driver.now_ms(),
        pause.limits,
        pause.course.since,
    )


def _correct_facts(pause: _Pause, text: str) -> tuple[RunScope, ReadyPlan]:
    """Correct the world model: facts that hold, and behind a `-` facts that do not."""
    holds, gone = _signed_facts(text)
    domain = pause.scope.problem.domain
    corrections = read_facts(holds, domain, "correct"), read_facts(gone, domain, "correct")
    state = pause.course.world.state
    facts = frozenset(correct_state(Dynamics(pause.scope.problem), state.facts, *corrections))
    new, old = pause.course.world.become(replace(state, facts=facts))
    _note_change(pause, "corrected by a person", new, old)
    return _replan_rest(replace(pause, state=world_ahead(pause.course)))


def _signed_facts(text: str) -> tuple[str, str]:
    """The facts of a correction: `at(lid, stand); -free(stand)` are one that holds and one that
    does not.
    """
    parts = [part.strip() for part in text.split(";") if part.strip()]
    return (
        ", ".join(part for part in parts if not part.startswith("-")),
        ", ".join(part[1:].strip() for part in parts if part.startswith("-")),
    )


def _add_goals(pause: _Pause, text: str) -> tuple[RunScope, ReadyPlan]:
    """A further command: its goals and stages join those that are pursued, and wishes about
    times are kept to from now on.
    """
    further = read_addition(pause.scope.problem, text, pause.course.driver.now_ms())
    scope = replace(
        pause.scope, problem=extend_problem(pause.scope.problem, further.words, further.wishes)
    )
    scope_and_plan = _replan_rest(
        replace(pause, scope=scope, state=world_ahead(pause.course, scope.problem.chains))
    )
    return (
        (scope_and_plan[0], _most_punctual(pause, scope_and_plan[1], further.wishes))
        if further.wishes
        else scope_and_plan
    )


def _most_punctual(pause: _Pause, ready_plan: ReadyPlan, wishes: Sequence[Atom]) -> ReadyPlan:
    """The program, or one in which what is due has the part of an equal thing, if less is late
    then.
    """
    problem, now = ready_plan.problem, pause.course.driver.now_ms()
    plan_wishes = wishes_for(PlanGate().semantics(problem), ready_plan.plan)
    shifted_wishes = from_then_on(plan_wishes, int(now // unit_ms(problem.domain)))
    best = weighted_lateness(ready_plan.plan, shifted_wishes, ready_plan.starts)
    subjects = {atom.arguments[0] for atom in wishes}
    for _, plan in itertools.islice(
        exchanged_plans(problem, problem.initial, subjects, ready_plan.plan, pause.course.gate),
        MAX_EXCHANGES,
    ):
        if not best:
            break
        candidate = schedule_again(problem, plan, now, pause.limits, pause.course.since)
        if (late := weighted_lateness(candidate.plan, shifted_wishes, candidate.starts)) < best:
            ready_plan, best = candidate, late
    return ready_plan


def _replan_rest(pause: _Pause) -> tuple[RunScope, ReadyPlan]:
    """What is left of the plan if it still serves, else a new plan for what is pursued.

    Raises `OrderRefused`.
    """
    rest = pause.scope.rest(pause.state)
    recovery = recover_goals(rest, Revision(), pause.limits, pause.left, pause.state.facts)
    if not isinstance(recovery.outcome, Found):
        raise OrderRefused(recovery.outcome.reason)
    scope = pause.scope.narrowed(recovery.problem, pause.state, recovery.given_up)
    return scope, schedule_again(
        recovery.problem,
        recovery.outcome.plan,
        pause.course.driver.now_ms(),
        pause.limits,
        pause.course.since,
    )


def _note_change(pause: _Pause, why: str, adds: Sequence[object], ends: Sequence[object]) -> None:
    """Note what a person has changed; a simulated cell is told, so that it is so there."""
    new, old, reached = list(map(str, adds)), list(map(str, ends)), dict(pause.course.world.reached)
    pause.course.recorder.note(RecordKind.WORLD, why=why, adds=new, ends=old, reached=reached)
    if isinstance(pause.course.driver, Simulated):
        pause.course.driver.by_hand(new, old, reached)


CHANGE_OF_ORDER: Mapping[OperatorCommand, Callable[[_Pause, str], tuple[RunScope, ReadyPlan]]] = {
    OperatorCommand.SKIP: _skip_step,
    OperatorCommand.RETRY: _retry_rest,
    OperatorCommand.BACK: _go_back,
    OperatorCommand.CORRECT: _correct_facts,
    OperatorCommand.ADD: _add_goals,
}
