"""Random rooms with obstacles that can be moved: a plan that moves is found exactly where
trying everything finds one.
"""

import random
from pathlib import Path

import pytest

from cellwright.engine.model.motion_values import MovedStep
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, operation_of
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.recovery.world_model import Dynamics, WorldState
from cellwright.engine.plugins import geometry_backend
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function
from tests.engine.pipelines.motion.test_moving_plan import kiln_room, moving

PLACES = ("bench", "kiln", "top", "shelf")
PAIRS = tuple(f"suits({item}, {place})" for item in ("bolt", "brick") for place in PLACES)


def steps() -> list[Function]:
    return [
        Function(name, (Function(item), Function(place)))
        for name in ("pick", "put")
        for item in ("bolt", "brick")
        for place in PLACES
    ]


def moves_anyhow(problem: Problem, cell: Path) -> bool:
    """Whether the goal is reached by trying every step that has a motion, in every state that
    is reached.
    """
    dynamics, walk = (
        Dynamics(problem),
        PlanWalk(PlanGate().semantics(problem), load_cell(cell), geometry_backend()),
    )
    waiting, seen = [dynamics.start().facts], {dynamics.start().facts}
    while waiting:
        facts = waiting.pop()
        if "at(bolt, kiln)" in set(map(str, facts)):
            return True
        for step in steps():
            state = WorldState(facts, {})
            if dynamics.refusal(step, state):
                continue
            after = dynamics.after(step, state).facts
            if after not in seen and _moves(walk, step, facts, after):
                seen.add(after)
                waiting.append(after)
    return False


def _moves(
    walk: PlanWalk, step: Function, before: frozenset[Function], after: frozenset[Function]
) -> bool:
    walk.hands.go_home()
    operation = operation_of(walk.cell, step)
    assert operation is not None
    return isinstance(walk.step(Step(StepId(1), step), operation, before, after), MovedStep)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 5, 6, 8])
def test_a_plan_is_found_where_trying_everything_finds_one(seed: int, tmp_path: Path) -> None:
    chance = random.Random(seed)
    suits = ("suits(bolt, kiln)", *(each for each in PAIRS[1:] if chance.random() < 0.7))
    problem, cell = kiln_room(tmp_path, chance.choice((1.5, 1.5, 0.4)), suits)
    assert isinstance(moving(problem, cell).run.outcome, Found) == moves_anyhow(problem, cell)
