"""Ground steps worked out once say of every state what executing the operator there says."""

import random
from pathlib import Path

import pytest

from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.lifted.lifted_execution import LiftedExecution
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.terms import Function, Term
from tests.engine.stages.macros.macro_cells import GOLDEN, Example, golden


def _steps(found: Example, draw: random.Random) -> list[Function]:
    """The plan's steps, and others of the same operators with arguments changed over."""
    own = [step.operator for step in found.plan.steps]
    arguments: list[Term] = sorted({a for step in own for a in step.arguments}, key=str)
    mixed = []
    for step in [each for each in own if each.arguments]:
        changed = list(step.arguments)
        changed[draw.randrange(len(changed))] = draw.choice(arguments)
        mixed.append(Function(step.name, tuple(changed)))
    return own + mixed


@pytest.mark.parametrize("path", GOLDEN, ids=[path.stem for path in GOLDEN])
def test_a_ground_step_does_in_every_state_what_its_operator_does(path: Path) -> None:
    found = golden(path)
    draw = random.Random(1)
    here = Situation.of(found.world, found.initial)
    compared = 0
    for taken in found.plan.steps:
        for operator in draw.choices(_steps(found, draw), k=12):
            known = found.world.ground_step(operator)
            if known is None:
                continue
            step = Step(StepId(1), operator)
            slow, fast = (
                LiftedExecution(found.world, here.facts),
                LiftedExecution(found.world, here.facts),
            )
            assert bool(slow.take_any(step)) == bool(fast.take_known(step, known))
            assert frozenset(slow.facts) == frozenset(fast.facts)
            compared += 1
        change = found.world.change(taken.operator, here.facts)
        here = Situation(found.world, change.applied(here.facts))
    assert compared or any(
        found.world.ground_step(step.operator) is None for step in found.plan.steps
    )
