"""A run with motion: what replies tell of the cell joins the world model, and what has no way any more is planned anew.

In a run without motion nothing of this happens.
"""

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.execution import NO_MOTION, OBSTRUCTED, SEEN, RecordKind, Reply, TroubleKind
from cellwright.engine.pipelines.execution.progress import Progress
from cellwright.engine.pipelines.execution.sending import refusal
from cellwright.engine.stages.planning import Limits
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem

if TYPE_CHECKING:
    from cellwright.engine.pipelines.execution.paths import Rerouted


def stand_again(course: Progress, met: Mapping[str, Any], where: Mapping[str, Any]) -> None:
    """What was met is there, the arms are where the journal has them, and on their way in the steps that are under way."""
    if course.paths is None:
        return
    course.paths.taken_up(met, where)
    for number, running in sorted(course.standing.running.items()):
        each = course.compiled.program.activities[running.activity]
        refusal(course.paths, course.world.facts, course.compiled, course.standing, number, each)


def take_in(course: Progress, reply: Reply) -> None:
    """Take in what a reply tells beside its text: bodies that were seen, and that the arm is where it was before the step."""
    if course.paths is None:
        return
    if reply.text == OBSTRUCTED:
        course.paths.stopped(reply.number)
    if SEEN in reply.data:
        _sees(course, reply)


def not_begun(course: Progress, numbers: Collection[int]) -> None:
    """Some commands were taken back before they began."""
    if course.paths is not None:
        for number in sorted(numbers, reverse=True):
            course.paths.stopped(number)


def _sees(course: Progress, reply: Reply) -> None:
    from cellwright.engine.pipelines.moves.seen import seen_in  # it needs numpy, and most runs no geometry

    assert course.paths is not None
    seen, unread = seen_in(reply.data, course.paths.cell)
    if unread:
        said = f"reply {reply.number} tells of {', '.join(unread)} in a way that cannot be read"
        kind = TroubleKind.GARBAGE.value
        course.recorder.note(RecordKind.TROUBLE, trouble=kind, text=said, command=reply.number)
    if not seen:
        return
    state = course.world.state
    facts, met = course.paths.sees(seen, state.facts), course.paths.met
    new, gone = course.world.become(type(state)(facts, state.reached))
    course.recorder.note(
        RecordKind.WORLD,
        why=f"{course.paths.last} {'was' if len(seen) == 1 else 'were'} seen",
        adds=list(map(str, new)),
        ends=list(map(str, gone)),
        reached=dict(state.reached),
        bodies={each.name: met[each.name].entry() if each.name in met else None for each in seen},
    )


def by_another_way(course: Progress, reply: str) -> bool:
    """Whether a step with this reply is planned anew with its motion."""
    return course.paths is not None and reply in (OBSTRUCTED, NO_MOTION)


def nobody_knows(reply: str) -> str:
    """Why a run cannot go on after a reply that is no exception of the fault base."""
    if reply == OBSTRUCTED:
        return "only a run with --motion finds a way around what its model does not know"
    return "the fault base knows no such exception"


def rerouted(course: Progress, rest: Problem, left: Plan | None, limits: Limits) -> "Rerouted | str":
    """A plan for what is left, from where the arm stands, in which every step moves; why there is none."""
    assert course.paths is not None
    found = course.paths.rerouted(rest, left, course.world.state.facts, limits)
    for goal in () if isinstance(found, str) else found.given_up:
        course.recorder.note(RecordKind.GIVEN_UP, goal=goal.goal, why=goal.why)
    return found


def what_stopped(course: Progress, reply: str) -> str:
    """What was in the way of a step, for people."""
    assert course.paths is not None
    if reply == OBSTRUCTED:
        return f"the arm met {course.paths.last}" if course.paths.last else "the arm was stopped"
    return course.paths.reason
