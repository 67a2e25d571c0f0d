"""The true world: a cell with causes that nobody knows.

It answers steps, tests and repairs as the cell would.
"""

import random
from collections.abc import Iterable
from dataclasses import dataclass, field

from cellwright.engine.model.troubleshooting import CaseHypothesis
from cellwright.engine.pipelines.recovery.world_model import FaultyCell, WorldState
from cellwright.engine.stages.diagnosis.fault_problems import CURED
from cellwright.engine.stages.diagnosis.hidden_cause import HiddenWorld
from cellwright.kb.terms import Function

DONE = ""


@dataclass
class TrueWorld:
    """A cell in which `hidden` is there when the exception is noticed. `state`, `present`, the
    causes still there, and `helped`, the repair that put them right, change.

    `before` is the state in which the interrupted step began; `chance` settles what the fault base
    leaves open.
    """

    cell: FaultyCell
    before: WorldState
    hidden: CaseHypothesis
    chance: random.Random = field(default_factory=lambda: random.Random(0))
    state: WorldState = field(init=False)
    present: tuple[str, ...] = field(init=False)
    helped: str = field(default="", init=False)

    def __post_init__(self) -> None:
        self.present = self.hidden.causes
        self.state = self.cell.begun(self.before, self.present)
        self._answers = HiddenWorld(self.cell.model, self.hidden, self.chance)

    def take(self, step: Function) -> str:
        """Take a step: what went wrong, or nothing. Where something did, the state is as before."""
        cause = self.cell.failing(self.present, step)
        if cause:
            return f"{cause} is there"
        refusal = self.cell.dynamics.refusal(step, self.state)
        if refusal:
            return refusal
        self.state = self.cell.taken(self.state, self.present, step)
        return DONE

    def execute(self, steps: Iterable[Function]) -> str:
        """Take steps one after another, until one goes wrong: which one and why, or nothing."""
        for step in steps:
            if wrong := self.take(step):
                return f"{step}: {wrong}"
        return DONE

    def carry_out(self, action: str) -> str:
        """Carry out a test or a repair, and the step that does it: the outcome.

        A repair that helps changes the world.
        """
        model = self.cell.model
        found = model.tests.get(action) or model.repairs[action]
        step = self.cell.carried_out_by(found)
        if step is not None:
            self.take(step)
        outcome = self._answers.answer(action)
        if action in model.repairs and outcome == CURED:
            self.state = self.cell.cured(self.state, model.repairs[action])
            self.present, self.helped = (), action
        return outcome
