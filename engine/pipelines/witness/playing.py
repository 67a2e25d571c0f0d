"""A finished motion program, played in MuJoCo: position servos follow the paths, friction alone holds what is gripped.

What the arm, its hand and what it holds touch beside what the step allows is told, with the step; and how far every part is in
the end from where the plan puts it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from cellwright.engine.model.moves import MovedStep
from cellwright.engine.pipelines.moves.states import states_of
from cellwright.engine.pipelines.places import measured_cell
from cellwright.engine.pipelines.witness.stage import SETTLE_S, Stage
from cellwright.engine.pipelines.witness.touches import Touched
from cellwright.engine.stages.geometry.world.following import following
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.cell import Cell
from cellwright.kb.model.plan import Plan


@dataclass(frozen=True, slots=True)
class Witnessed:
    """What the physics saw: how long it took, what touched, how far each part is from its place (m), and how far the joints of
    the arm (rad or m) and the tip of what it holds (m) were from where its motions lead, at most."""

    seconds: float
    touched: tuple[Touched, ...]
    off_m: dict[str, float] = field(default_factory=dict)
    off_place: float = 0.0
    off_tip_m: float = 0.0


def played(semantics: Semantics, cell: Cell, plan: Plan, steps: Sequence[MovedStep]) -> Witnessed:
    """The steps of a plan, one after the other in the order of their starts; waiting times are left out."""
    moved = {each.step: each for each in steps}
    cell = measured_cell(semantics, cell)
    start = following(World.of(cell), semantics.initial())
    stage, last = Stage(start), start
    for step, before, after in states_of(semantics, plan):
        last = following(World.of(cell), after)
        if step.id in moved:
            stage.take(moved[step.id], following(World.of(cell), before), last)
    stage.wait(SETTLE_S)
    return Witnessed(stage.data.time, stage.touches.found, stage.off(last), stage.off_place, stage.off_tip_m)
