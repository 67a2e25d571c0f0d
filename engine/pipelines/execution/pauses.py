"""What a person can do at a pause: skip a step, do it again, go back, correct the world model, add a command."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.cases import Revision
from cellwright.engine.model.execution import Order, Phase, RecordKind
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.execution.adding import addition, extended
from cellwright.engine.pipelines.execution.choosing import others
from cellwright.engine.pipelines.execution.compiling import full_hands, unit_ms
from cellwright.engine.pipelines.execution.joining import Joined, ahead, joined, left_behind
from cellwright.engine.pipelines.execution.orders import Given
from cellwright.engine.pipelines.execution.planned import Ready, again
from cellwright.engine.pipelines.execution.progress import Progress
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.revision.observing import corrected, read_facts
from cellwright.engine.pipelines.revision.remaining import left_over
from cellwright.engine.pipelines.simulation import Dynamics, WorldState
from cellwright.engine.pipelines.timetable import from_then_on
from cellwright.engine.pipelines.timetable.kept import lateness
from cellwright.engine.pipelines.timetable.wishes import wishes_for
from cellwright.engine.pipelines.troubleshooting.recovery import recover
from cellwright.engine.ports import Simulated
from cellwright.engine.stages.macros.lifted.world import StepChange
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.validation.changes import State
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.terms import Atom, ordered

RESUME = "resume"  # the origin of the order to plan on that a run gives itself when it is taken up after a safe stop
PARTS = 6  # of equal things that are tried for one that is due


class Refused(Exception):
    """An order that cannot be followed now. The message says why."""


@dataclass(frozen=True, slots=True)
class _Pause:
    """Where a run stands when an order comes: the world when what is under way has ended, and what is left of the plan."""

    course: Progress
    scope: Scope
    state: WorldState
    left: Plan
    limits: Limits


def changed(course: Progress, scope: Scope, given: Given, limits: Limits) -> tuple[Scope, Joined]:
    """The scope, and the program with its standing, after an order. Raises `Refused`.

    Steps that have begun are not touched. After a further command the run does what it did before, else it goes on.
    """
    rests = course.standing.phase is Phase.PAUSED or given.origin == RESUME
    if given.order is not Order.ADD and not rests:
        raise Refused("the run is not paused: interrupt it first")
    here = _Pause(course, scope, ahead(course), left_behind(course), limits)
    try:
        found, made = MOVES[given.order](here, given.text)
    except InvalidInput as error:
        raise Refused("; ".join(each.message for each in error.diagnostics)) from error
    new = joined(course, found, made)
    if given.order is Order.ADD:
        return found, new
    full = full_hands(found.problem, new.ready.plan.steps, ahead(course).facts)
    standing = replace(new.standing, phase=Phase.READY, frozen=False, unrested=full)
    return found, replace(new, standing=standing)


def _step(here: _Pause, text: str) -> StepId:
    """The step of the plan that a text names: by its number, or as it is written. Raises `Refused`."""
    wanted = text.strip().replace(" ", "")
    for step in here.course.whole().plan.steps:
        if wanted in (str(step.id), str(step.operator).replace(" ", "")):
            return step.id
    raise Refused(f"the plan has no step {text.strip() or '(none was named)'}")


def _skip(here: _Pause, text: str) -> tuple[Scope, Ready]:
    """Take a step for done by hand: with its effects."""
    wanted = _step(here, text)
    step = next((each for each in here.left.steps if each.id == wanted), None)
    if step is None:
        raise Refused(f"step {wanted} is done already, or under way")
    change = _change_now(here, step)
    here.course.world.apply(change)
    _note(here, f"{step.operator} was done by hand", change.adds, change.ends)
    rest = left_over(here.left, {wanted})
    return _replanned(replace(here, state=ahead(here.course), left=rest))


def _change_now(here: _Pause, step: Step) -> StepChange:
    """What a step changes if it is done now: quantities may not have the values that they have at its turn."""
    change, quantities = here.course.compiled.changes[int(step.id)], here.scope.problem.domain.quantities
    if not any(each.name in quantities for each in change.adds):
        return change
    now = here.course.world.state
    after = Dynamics(here.scope.problem).after(step.operator, now)

    def counted(own: Sequence[Atom], new: State) -> tuple[Atom, ...]:
        others = (each for each in own if each.name not in quantities)
        return (*others, *ordered(each for each in new if each.name in quantities))

    adds, ends = counted(change.adds, after.facts - now.facts), counted(change.ends, now.facts - after.facts)
    return replace(change, adds=adds, ends=ends)


def _retry(here: _Pause, _text: str) -> tuple[Scope, Ready]:
    """Go on with what is left, from the world as it is."""
    return _replanned(here)


def _back(here: _Pause, text: str) -> tuple[Scope, Ready]:
    """Do a step again, and what comes behind it, as far as the world allows; else a new plan leads to the goals."""
    wanted = _step(here, text)
    whole = here.course.whole().plan
    order = [step.id for step in whole.steps]
    behind = set(order[order.index(wanted) :])
    plan = left_over(whole, set(order) - behind - {step.id for step in here.left.steps})
    dynamics = Dynamics(here.scope.rest(here.state))
    state = dynamics.start()
    for step in plan.steps:
        if why := dynamics.refusal(step.operator, state):
            raise Refused(f"step {step.id} {step.operator} cannot be taken again: {why}")
        state = dynamics.after(step.operator, state)
    return here.scope, again(
        here.scope.rest(here.state), plan, here.course.driver.now_ms(), here.limits, here.course.since
    )


def _correct(here: _Pause, text: str) -> tuple[Scope, Ready]:
    """Correct the world model: facts that hold, and behind a `-` facts that do not."""
    holds, gone = _signed(text)
    domain = here.scope.problem.domain
    known = read_facts(holds, domain, "correct"), read_facts(gone, domain, "correct")
    state = here.course.world.state
    facts = frozenset(corrected(Dynamics(here.scope.problem), state.facts, *known))
    new, old = here.course.world.become(replace(state, facts=facts))
    _note(here, "corrected by a person", new, old)
    return _replanned(replace(here, state=ahead(here.course)))


def _signed(text: str) -> tuple[str, str]:
    """The facts of a correction: `at(lid, stand); -free(stand)` are one that holds and one that does not."""
    parts = [each.strip() for each in text.split(";") if each.strip()]
    return (
        ", ".join(each for each in parts if not each.startswith("-")),
        ", ".join(each[1:].strip() for each in parts if each.startswith("-")),
    )


def _add(here: _Pause, text: str) -> tuple[Scope, Ready]:
    """A further command: its goals and stages join those that are pursued, and wishes about times are kept to from now on."""
    found = addition(here.scope.problem, text, here.course.driver.now_ms())
    scope = replace(here.scope, problem=extended(here.scope.problem, found.words, found.wishes))
    made = _replanned(replace(here, scope=scope, state=ahead(here.course, scope.problem.chains)))
    return (made[0], _most_punctual(here, made[1], found.wishes)) if found.wishes else made


def _most_punctual(here: _Pause, made: Ready, wishes: Sequence[Atom]) -> Ready:
    """The program, or one in which what is due has the part of an equal thing, if less is late then."""
    problem, now = made.problem, here.course.driver.now_ms()
    known = wishes_for(PlanGate().semantics(problem), made.plan)
    said = from_then_on(known, int(now // unit_ms(problem.domain)))
    best = lateness(made.plan, said, made.starts)
    subjects = {atom.arguments[0] for atom in wishes}
    for _, plan in itertools.islice(
        others(problem, problem.initial, subjects, made.plan, here.course.gate), PARTS
    ):
        if not best:
            break
        other = again(problem, plan, now, here.limits, here.course.since)
        if (late := lateness(other.plan, said, other.starts)) < best:
            made, best = other, late
    return made


def _replanned(here: _Pause) -> tuple[Scope, Ready]:
    """What is left of the plan if it still serves, else a new plan for what is pursued. Raises `Refused`."""
    rest = here.scope.rest(here.state)
    found = recover(rest, Revision(), here.limits, here.left, here.state.facts)
    if not isinstance(found.outcome, Found):
        raise Refused(found.outcome.reason)
    scope = here.scope.narrowed(found.problem, here.state, found.given_up)
    return scope, again(
        found.problem, found.outcome.plan, here.course.driver.now_ms(), here.limits, here.course.since
    )


def _note(here: _Pause, why: str, adds: Sequence[object], ends: Sequence[object]) -> None:
    """Note what a person has changed; a simulated cell is told, so that it is so there."""
    new, old, reached = list(map(str, adds)), list(map(str, ends)), dict(here.course.world.reached)
    here.course.recorder.note(RecordKind.WORLD, why=why, adds=new, ends=old, reached=reached)
    if isinstance(here.course.driver, Simulated):
        here.course.driver.by_hand(new, old, reached)


MOVES: Mapping[Order, Callable[[_Pause, str], tuple[Scope, Ready]]] = {
    Order.SKIP: _skip,
    Order.RETRY: _retry,
    Order.BACK: _back,
    Order.CORRECT: _correct,
    Order.ADD: _add,
}
