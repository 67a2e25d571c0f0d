"""Replay of a finished motion program in MuJoCo: servos follow its paths, friction holds.

What the arm, its hand and what it holds touch beside what the step allows is told, with the step;
and how far every part is in the end from where the plan puts it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from cellwright.engine.model.motion_values import MovedStep
from cellwright.engine.pipelines.inspection.measurement_places import measured_cell
from cellwright.engine.pipelines.motion.plan_walk import states_of
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_stage import (
    REST_TIME_S,
    MujocoStage,
)
from cellwright.engine.pipelines.simulators.mujoco_replay.replay_contacts import ForbiddenContact
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.cell_model import Cell
from cellwright.kb.model.plan_model import Plan


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """What the physics saw: how long it took, what touched, how far each part is from its place
    (m), and how far the joints of the arm (rad or m) and the tip of what it holds (m) were from
    where its motions lead, at most."""

    seconds: float
    touched: tuple[ForbiddenContact, ...]
    off_m: dict[str, float] = field(default_factory=dict)
    off_place: float = 0.0
    off_tip_m: float = 0.0


def replay_program(
    semantics: Semantics, cell: Cell, plan: Plan, steps: Sequence[MovedStep]
) -> ReplayResult:
    """The steps of a plan, one after the other in the order of their starts; waiting times are
    left out.
    """
    moved = {step.step: step for step in steps}
    cell = measured_cell(semantics, cell)
    start = world_after_facts(GeometricWorld.of(cell), semantics.initial())
    stage, last = MujocoStage(start), start
    for step, before, after in states_of(semantics, plan):
        last = world_after_facts(GeometricWorld.of(cell), after)
        if step.id in moved:
            stage.take(moved[step.id], world_after_facts(GeometricWorld.of(cell), before), last)
    stage.wait(REST_TIME_S)
    return ReplayResult(
        stage.data.time, stage.touches.found, stage.off(last), stage.off_place, stage.off_tip_m
    )
