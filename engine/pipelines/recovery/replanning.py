"""Replanning after a diagnosis: from the revised state to the goals that can still be reached.

The plan that failed is revised before anything is planned anew. A kept sequence is updated by what
was lost.
"""

from dataclasses import dataclass, replace

from cellwright.engine.model.outcome import Found, Outcome
from cellwright.engine.model.part_measurements import is_put_in_order
from cellwright.engine.model.troubleshooting import PreparationSteps, Revision
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.inspection.tour_progress import KeptSequenceProgress
from cellwright.engine.pipelines.planning.checked_plan import LARGE_INSTANCES
from cellwright.engine.pipelines.planning.goal_selection import RelinquishedGoal
from cellwright.engine.pipelines.recovery import Dynamics, WorldState
from cellwright.engine.pipelines.recovery.plan_revision import (
    PlanUnderWay,
    planned_anew,
    revise_plan,
)
from cellwright.engine.pipelines.recovery.remaining_problem import KnownChanges, rest_after_steps
from cellwright.engine.stages.grounding.instance_bounds import bound_instances
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.model.plan_model import Plan, Step
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import sort_naturally

__all__ = [
    "RecoveryResult",
    "RepairFirst",
    "plan_in_sequence",
    "recover_goals",
    "rest_after_steps",
    "with_kept_sequence",
]


@dataclass(frozen=True, slots=True)
class RepairFirst:
    """A sure repair with which a recovery begins, and the steps that prepare it."""

    name: str
    say: str
    prepared: PreparationSteps


@dataclass(frozen=True, slots=True)
class RecoveryResult:
    """How the work goes on: the problem from the state as it is now known, and the answer for the
    original goals.

    `way` is `planned` where no plan had failed, else what became of its remaining steps: done
    (nothing is left to do), continued, repaired, or replanned where no repair was found or a new
    plan is cheaper. `given_up` are the goals that cannot be reached any more: the answer is for the
    others. `repair` comes before everything else. `sequence` is the kept sequence after it was told
    what was lost. `now` is the state from which the work goes on, with the stages that are reached,
    and `change` what was found to be different there.
    """

    problem: Problem
    outcome: Outcome
    way: str = "planned"
    kept: tuple[Step, ...] = ()
    dropped: tuple[Step, ...] = ()
    added: tuple[Step, ...] = ()
    given_up: tuple[RelinquishedGoal, ...] = ()
    repair: RepairFirst | None = None
    sequence: KeptSequenceProgress | None = None
    now: WorldState | None = None
    change: Revision | None = None


def recover_goals(
    problem: Problem,
    change: Revision,
    limits: SearchLimits = SearchLimits(),
    left: Plan | None = None,
    believed: State | None = None,
    executable: bool = True,
) -> RecoveryResult:
    """From the revised state to the goals that the failed plan had, or to those that can still be
    reached.

    What was lost is not used, and what is blocked is not tried. `left` are the steps that were not
    done when the plan failed, from the problem's initial state on: they are revised before anything
    is planned anew, if they are still `executable` there. `believed` is the state now; without it,
    it is what `change` makes of the initial state. Raises `InvalidInput`.
    """
    dynamics = Dynamics(problem)
    changes = KnownChanges(dynamics, change)
    now = sort_naturally(changes.state() if believed is None else believed)
    rest_problem, obstacles = changes.planned_in(now), changes.obstacles(now)
    if bound_instances(rest_problem) > LARGE_INSTANCES and isinstance(
        ordered_plan := plan_in_sequence(rest_problem, limits), Found
    ):
        return RecoveryResult(
            rest_problem, ordered_plan, "planned" if left is None else "replanned"
        )
    if left is None or not executable:
        revised = planned_anew(rest_problem, left, limits, obstacles, plan_in_sequence)
        origin = "planned" if left is None else revised.way
        return RecoveryResult(
            revised.problem,
            revised.outcome,
            origin,
            revised.kept,
            revised.dropped,
            revised.added,
            revised.given_up,
        )
    course = PlanUnderWay.of(
        replace(rest_problem, initial=sort_naturally(dynamics.semantics.initial())), left
    )
    revised = revise_plan(course, (), now, limits, obstacles=obstacles, sequencer=plan_in_sequence)
    return RecoveryResult(
        revised.problem,
        revised.outcome,
        revised.way,
        revised.kept,
        revised.dropped,
        revised.added,
        revised.given_up,
    )


def plan_in_sequence(problem: Problem, limits: SearchLimits) -> Outcome | None:
    """A plan for an inspection in the order of its sequence; None for any other problem, or if
    that leads to no plan.
    """
    if not is_put_in_order(problem):
        return None
    sequenced = planning.by_sequence(problem, limits)
    return sequenced.outcome if sequenced is not None else None


def with_kept_sequence(
    recovery: RecoveryResult, problem: Problem, change: Revision, store: str
) -> RecoveryResult:
    """The recovery with the kept sequence of the problem from `store`, after its update by what
    was lost or regained.
    """
    if not change.lost and not change.regained:
        return recovery
    return replace(
        recovery,
        sequence=planning.told_of_losses(
            store, problem.replace(recovery.problem.initial), change.lost, change.regained
        ),
    )
