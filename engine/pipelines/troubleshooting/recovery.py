"""How the work goes on after a diagnosis.

The plan that failed is revised before anything is planned anew. A kept sequence is updated by what was lost.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

from cellwright.engine.model.cases import Prepared, Revision
from cellwright.engine.model.measurements import is_put_in_order
from cellwright.engine.model.outcome import Found, Outcome
from cellwright.engine.pipelines.attainment import GivenUp
from cellwright.engine.pipelines.inspection.progress import Progress
from cellwright.engine.pipelines.planning import LARGE
from cellwright.engine.pipelines.revision import Course, planned_anew, revise
from cellwright.engine.pipelines.revision.changes import Changes
from cellwright.engine.pipelines.revision.remaining import rest_of
from cellwright.engine.pipelines.simulation import Dynamics, WorldState
from cellwright.engine.stages.grounding.limits import size
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.validation.changes import State
from cellwright.kb.model.plan import Plan, Step
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import ordered

__all__ = ["FirstRepair", "Recovery", "in_sequence", "recover", "rest_of", "told"]


@dataclass(frozen=True, slots=True)
class FirstRepair:
    """A sure repair with which a recovery begins, and the steps that prepare it."""

    name: str
    say: str
    prepared: Prepared


@dataclass(frozen=True, slots=True)
class Recovery:
    """How the work goes on: the problem from the state as it is now known, and the answer for the original goals.

    `way` is `planned` where no plan had failed, else what became of its remaining steps: done (nothing is left to do),
    continued, repaired, or replanned where no repair was found or a new plan is cheaper. `given_up` are the goals that
    cannot be reached any more: the answer is for the others. `repair` comes before everything else. `sequence` is the kept sequence
    after it was told what was lost. `now` is the state from which the work goes on,
    with the stages that are reached, and `change` what was found to be different there.
    """

    problem: Problem
    outcome: Outcome
    way: str = "planned"
    kept: tuple[Step, ...] = ()
    dropped: tuple[Step, ...] = ()
    added: tuple[Step, ...] = ()
    given_up: tuple[GivenUp, ...] = ()
    repair: FirstRepair | None = None
    sequence: Progress | None = None
    now: WorldState | None = None
    change: Revision | None = None


def recover(
    problem: Problem,
    change: Revision,
    limits: Limits = Limits(),
    left: Plan | None = None,
    believed: State | None = None,
    executable: bool = True,
) -> Recovery:
    """From the revised state to the goals that the failed plan had, or to those that can still be reached.

    What was lost is not used, and what is blocked is not tried. `left` are the steps that were not done when the plan
    failed, from the problem's initial state on: they are revised before anything is planned anew, if they are still
    `executable` there. `believed` is the state now; without it, it is what `change` makes of the initial state. Raises
    `InvalidInput`.
    """
    dynamics = Dynamics(problem)
    changes = Changes(dynamics, change)
    now = ordered(changes.state() if believed is None else believed)
    here, obstacles = changes.planned_in(now), changes.obstacles(now)
    if size(here) > LARGE and isinstance(ordered_plan := in_sequence(here, limits), Found):
        return Recovery(here, ordered_plan, "planned" if left is None else "replanned")
    if left is None or not executable:
        found = planned_anew(here, left, limits, obstacles, in_sequence)
        way = "planned" if left is None else found.way
        return Recovery(
            found.problem, found.outcome, way, found.kept, found.dropped, found.added, found.given_up
        )
    course = Course.of(replace(here, initial=ordered(dynamics.semantics.initial())), left)
    found = revise(course, (), now, limits, obstacles=obstacles, sequencer=in_sequence)
    return Recovery(
        found.problem, found.outcome, found.way, found.kept, found.dropped, found.added, found.given_up
    )


def in_sequence(problem: Problem, limits: Limits) -> Outcome | None:
    """A plan for an inspection in the order of its sequence; None for any other problem, or if that leads to no plan."""
    if not is_put_in_order(problem):
        return None
    from cellwright.engine.pipelines.parts import by_sequence  # slow to load, and only inspections need it

    made = by_sequence(problem, limits)
    return made.outcome if made is not None else None


def told(found: Recovery, problem: Problem, lost: Collection[str], store: str) -> Recovery:
    """The recovery with the kept sequence of the problem from `store`, after its update by what was lost."""
    if not lost:
        return found
    from cellwright.engine.pipelines.parts.keeping import (
        told_of_losses,  # slow to load, and only a store needs it
    )

    return replace(found, sequence=told_of_losses(store, problem.replace(found.problem.initial), lost))
