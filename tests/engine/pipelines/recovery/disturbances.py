"""Plans in the middle of their execution, and somebody who changes the world meanwhile."""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cellwright.engine.model.ground_task import progress_state
from cellwright.engine.pipelines.recovery.observations import expected_situation
from cellwright.engine.pipelines.recovery.plan_revision import PlanUnderWay
from cellwright.engine.pipelines.recovery.remaining_problem import stages_reached
from cellwright.engine.stages.lifted.lifted_execution import changes_of
from cellwright.kb.loader.plan import load_plan
from cellwright.kb.model.plan_model import StepId
from cellwright.kb.terms import Atom
from tests.places import BUNDLED as DOMAINS

PLANS = sorted(
    path
    for path in DOMAINS.glob("*/golden/*.json")
    if '"status": "infeasible"' not in path.read_text(encoding="utf-8")
)


@cache
def course(path: Path) -> PlanUnderWay:
    return PlanUnderWay.of(*load_plan(path))


@dataclass(frozen=True)
class Moment:
    """Steps that are done, and what is true now."""

    done: tuple[StepId, ...]
    observed: tuple[Atom, ...]


def moment(course: PlanUnderWay, cut: int, acts: int, losses: int, draw: random.Random) -> Moment:
    """After the first `cut` steps somebody takes a few steps of their own, and a few facts get
    lost.
    """
    steps = course.plan.steps[:cut]
    done = tuple(step.id for step in steps)
    reached = stages_reached(course.problem.chains, course.start, changes_of(course.start, steps))
    state = course.bits(expected_situation(course, done).facts, reached)
    for _ in range(acts):
        possible = [
            each
            for each in course.task.operators
            if not each.preconditions & ~state
            and not _is_stage(course.named(each.adds | each.deletes))
        ]
        if possible:
            state = progress_state(state, draw.choice(possible))
    facts = [
        atom for atom in course.named(state) if atom.name != "not" and not atom.name.startswith("_")
    ]
    for _ in range(min(losses, len(facts))):
        facts.pop(draw.randrange(len(facts)))
    return Moment(done, tuple(facts))


def _is_stage(atoms: Sequence[Atom]) -> bool:
    return any(atom.name.startswith("_") for atom in atoms)
