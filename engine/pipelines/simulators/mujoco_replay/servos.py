"""Servos of the MuJoCo cell: gains, masses of what they move, and where that stands."""

from typing import Any

import mujoco
import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import StepLeg
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_model import carriers_of
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.cell_model import JointKind

SERVO_PACE = 40.0  # 1/s: how quickly the servos of an arm follow
SOON_S = 1e-3  # between moments whose differences tell speed and acceleration
# A body is at its place within so many metres, and this share of its joint's range.
NEAR_M, NEAR_SHARE = 0.03, 0.1
SLIPPED_M, SLIPPED_RAD = 0.008, 0.35  # a hand turns by 0.12 on a lid that comes along


def tune_servos(model: mujoco.MjModel, world: GeometricWorld) -> None:
    """Give the servos of all arms, and of what carries them, the gains of one pace, critically
    damped for the inertia at rest.

    The engine balances contacts before it adds the damping of the servos. If damping by far
    outweighs inertia in a time step, it takes the arm for faster than it is, and what is gripped
    creeps between the fingers.
    """
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    arms = world.cell.arms.items()
    joints = [f"{arm}/{joint.name}" for arm, mounted in arms for joint in mounted.arm.joints]
    for name in (*joints, *sorted(carriers_of(world))):
        number, dof = model.actuator(name).id, model.joint(name).dofadr[0]
        inertia, only = np.zeros(model.nv), np.zeros(model.nv)
        only[dof] = 1.0
        mujoco.mj_mulM(model, data, inertia, only)
        stiff, damped = SERVO_PACE**2 * inertia[dof], 2 * SERVO_PACE * inertia[dof]
        model.actuator_gainprm[number, 0] = stiff
        model.actuator_biasprm[number, 1:3] = -stiff, -damped


def aim_lead(leg: StepLeg, t: float) -> Floats:
    """How far ahead (k,) of where an arm is to be at a time on a leg its servos must be aimed, as
    it would lag by so much.

    With the gains of `tuned` a joint x follows its aim u as x'' + 2 w x' + w^2 x = w^2 u, where w
    is the pace.
    """
    before, now, after = (leg.at(max(t + offset_s, 0.0)) for offset_s in (-SOON_S, 0.0, SOON_S))
    speed, acceleration = (after - before) / (2 * SOON_S), (after - 2 * now + before) / SOON_S**2
    ahead: Floats = 2 * speed / SERVO_PACE + acceleration / SERVO_PACE**2
    return ahead


def weigh_bodies(model: mujoco.MjModel, world: GeometricWorld) -> None:
    """Give bodies the masses that are known.

    Each is spread over the volume of its shapes, so that it lies where it belongs.
    """
    for name, body in world.cell.bodies.items():
        if body.mass_kg is not None and body.shapes:
            number = model.body(name).id
            heavier = body.mass_kg / model.body_mass[number]
            model.body_mass[number] *= heavier
            model.body_inertia[number] *= heavier
    mujoco.mj_setConst(model, mujoco.MjData(model))


def guide_position(world: GeometricWorld, body: str) -> float:
    """How far a body is along its guide."""
    body_model: Any = world.cell.bodies[body]
    moved = (
        transforms.inverse(transforms.of_pose(body_model.placement.pose))
        @ world.placed[body].T_parent_frame
    )
    slides = body_model.guide.kind is JointKind.PRISMATIC
    along = moved[:3, 3] if slides else transforms.rotation_vector(moved[:3, :3])
    return float(along @ np.array(body_model.guide.axis))


def guide_tolerance(world: GeometricWorld, body: str) -> float:
    """How near to a value along its guide a body counts as being there (m or rad)."""
    guide = world.cell.bodies[body].guide
    assert guide is not None
    near = NEAR_SHARE * abs(guide.upper - guide.lower)
    return min(near, NEAR_M) if guide.kind is JointKind.PRISMATIC else near


def has_slipped(T_before: Floats, T_now: Floats) -> bool:
    """Whether a hand has moved along what it drags, or has turned on it: more than a grip gives
    way.
    """
    turn = transforms.rotation_vector(T_before[:3, :3].T @ T_now[:3, :3])
    along = np.linalg.norm(T_now[:3, 3] - T_before[:3, 3])
    return bool(along > SLIPPED_M or np.linalg.norm(turn) > SLIPPED_RAD)
