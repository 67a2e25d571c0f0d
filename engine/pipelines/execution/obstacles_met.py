"""Obstacles that a run meets: replies correct the world model, blocked steps are replanned.

In a run without motion nothing of this happens.
"""

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.run_protocol import (
    BODIES_SEEN,
    NO_MOTION,
    OBSTRUCTED_REPLIES,
    RecordKind,
    Reply,
    TroubleKind,
)
from cellwright.engine.pipelines import motion
from cellwright.engine.pipelines.execution.run_progress import RunProgress, motion_refusal
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem

if TYPE_CHECKING:
    from cellwright.engine.pipelines.execution.run_motions import ReroutedPlan


def stand_again(course: RunProgress, met: Mapping[str, Any], where: Mapping[str, Any]) -> None:
    """What was met is there, the arms are where the journal has them, and on their way in the
    steps that are under way.
    """
    if course.paths is None:
        return
    course.paths.taken_up(met, where)
    for number, running in sorted(course.standing.running.items()):
        activity = course.compiled.program.activities[running.activity]
        motion_refusal(
            course.paths, course.world.facts, course.compiled, course.standing, number, activity
        )


def take_in(course: RunProgress, reply: Reply) -> None:
    """Take in what a reply tells beside its text: bodies that were seen, and that the arm is
    where it was before the step.
    """
    if course.paths is None:
        return
    if reply.text == OBSTRUCTED_REPLIES:
        course.paths.stopped(reply.number)
    if BODIES_SEEN in reply.data:
        _note_seen(course, reply)


def not_begun(course: RunProgress, numbers: Collection[int]) -> None:
    """Some commands were taken back before they began."""
    if course.paths is not None:
        for number in sorted(numbers, reverse=True):
            course.paths.stopped(number)


def _note_seen(course: RunProgress, reply: Reply) -> None:
    assert course.paths is not None
    seen, unread = motion.seen_in(reply.data, course.paths.cell)
    if unread:
        reason = f"reply {reply.number} tells of {', '.join(unread)} in a way that cannot be read"
        kind = TroubleKind.GARBAGE.value
        course.recorder.note(RecordKind.TROUBLE, trouble=kind, text=reason, command=reply.number)
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
        bodies={body.name: met[body.name].entry() if body.name in met else None for body in seen},
    )


def by_another_way(course: RunProgress, reply: str) -> bool:
    """Whether a step with this reply is planned anew with its motion."""
    return course.paths is not None and reply in (OBSTRUCTED_REPLIES, NO_MOTION)


def nobody_knows(reply: str) -> str:
    """Why a run cannot go on after a reply that is no exception of the fault base."""
    if reply == OBSTRUCTED_REPLIES:
        return "only a run with --motion finds a way around what its model does not know"
    return "the fault base knows no such exception"


def reroute_run(
    course: RunProgress, rest: Problem, left: Plan | None, limits: SearchLimits
) -> "ReroutedPlan | str":
    """A plan for what is left, from where the arm stands, in which every step moves; why there
    is none.
    """
    assert course.paths is not None
    rerouted_plan = course.paths.rerouted(rest, left, course.world.state.facts, limits)
    for goal in () if isinstance(rerouted_plan, str) else rerouted_plan.given_up:
        course.recorder.note(RecordKind.GIVEN_UP, goal=goal.goal, why=goal.why)
    return rerouted_plan


def what_stopped(course: RunProgress, reply: str) -> str:
    """What was in the way of a step, for people."""
    assert course.paths is not None
    if reply == OBSTRUCTED_REPLIES:
        return f"the arm met {course.paths.last}" if course.paths.last else "the arm was stopped"
    return course.paths.reason
