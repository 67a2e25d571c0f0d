"""Sensors of the physical cell: what each reads from physics, and as which reading."""

from collections.abc import Callable, Iterator, Mapping

import mujoco
import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_model import (
    bearer_of,
    held_by,
    worn_by,
)
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_stage import MujocoStage
from cellwright.engine.pipelines.simulators.mujoco_replay.replay_contacts import body_of
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.cell_model import Sensing, Sensor

SLIDE_S = 0.1  # so long it is watched whether something slides
OUT_OF_SIGHT_M = 100.0  # where nothing is in sight
MAX_RAY_BODIES = 16  # things of its own that a ray may pass
PAST_M = 1e-4


def sensor_reading(stage: MujocoStage, world: GeometricWorld, sensor: Sensor) -> str:
    """The reading of a sensor now: the range that its value lies in, or is nearest to."""
    now = sensor_value(stage, world, sensor)

    def off(name: str) -> float:
        lower, upper = sensor.readings[name]
        return max(lower - now, now - upper, 0.0)

    return min(sensor.readings, key=off)


def sensor_value(stage: MujocoStage, world: GeometricWorld, sensor: Sensor) -> float:
    """What a sensor reads now: m, rad, N or m/s."""
    return _VALUE_OF_SENSING[sensor.sensing](stage, world, sensor.of)


def _joint_value(stage: MujocoStage, _world: GeometricWorld, body: str) -> float:
    return stage.value(body)


def _pressing_force(stage: MujocoStage, world: GeometricWorld, body: str) -> float:
    """How hard everything else but the arm's own hand presses against a body."""
    own = {
        name
        for arm in world.cell.arms
        if body in (worn := set(worn_by(world, arm)))
        for name in worn
    }
    forces = [force for presser, force in _pressing_bodies(stage, {body}) if presser not in own]
    return float(sum(np.linalg.norm(force) for force in forces))


def _hand_load(stage: MujocoStage, world: GeometricWorld, arm: str) -> float:
    """How heavy everything that touches a hand is on it, beside the hand itself; a tool at its
    latch weighs, too.
    """
    own = set(worn_by(world, arm)) | {f"{arm}.flange"}
    total = sum(
        (force for presser, force in _pressing_bodies(stage, own) if presser not in own),
        np.zeros(3),
    )
    hung = [name for name in held_by(world, arm) if name in stage.tools]
    masses = sum(float(stage.model.body(name).mass[0]) for name in hung)
    return float(np.linalg.norm(total)) + masses * float(np.linalg.norm(stage.model.opt.gravity))


def _distance_ahead(stage: MujocoStage, world: GeometricWorld, frame: str) -> float:
    """How far it is along z of a frame to the nearest thing that is not of the hand on which
    the frame is.
    """
    body = bearer_of(world, frame) if frame in world.placed else frame
    T = stage.actual(world).pose("world", frame)
    own = {body, *(name for arm in world.cell.arms for name in worn_by(world, arm))}
    start, hit, gone = T[:3, 3].copy(), np.array([-1], dtype=np.int32), 0.0
    for _ in range(MAX_RAY_BODIES):
        far = mujoco.mj_ray(stage.model, stage.data, start, T[:3, 2].copy(), None, 1, -1, hit)
        if far < 0.0:
            return OUT_OF_SIGHT_M
        gone += far
        if body_of(stage.model, int(hit[0])) not in own:
            return float(gone)
        gone += PAST_M
        start = start + T[:3, 2] * (far + PAST_M)
    return OUT_OF_SIGHT_M


def _slip_speed(stage: MujocoStage, world: GeometricWorld, body: str) -> float:
    """How fast the parts that touch a body slide along it."""
    parts = {name for name, _ in _pressing_bodies(stage, {body})} & set(world.cell.bodies)
    before = {name: _seen_from(stage, body, name) for name in parts}
    stage.wait(SLIDE_S)
    moved = [np.linalg.norm(_seen_from(stage, body, name) - at) for name, at in before.items()]
    return float(max(moved, default=0.0)) / SLIDE_S


def _seen_from(stage: MujocoStage, body: str, other_body: str) -> Floats:
    T: Floats = transforms.inverse(stage.pose(body)) @ stage.pose(other_body)
    return T[:3, 3]


def _pressing_bodies(stage: MujocoStage, bodies: set[str]) -> Iterator[tuple[str, Floats]]:
    """What presses against some bodies, and the force with which it does, in the world (3,)."""
    wrench = np.zeros(6)
    for number in range(stage.data.ncon):
        contact = stage.data.contact[number]
        first, second = (body_of(stage.model, int(geom)) for geom in contact.geom)
        if (first in bodies) == (second in bodies):
            continue
        mujoco.mj_contactForce(stage.model, stage.data, number, wrench)
        force = contact.frame.reshape(3, 3).T @ wrench[:3]
        yield (second, -force) if first in bodies else (first, force)


_VALUE_OF_SENSING: Mapping[Sensing, Callable[[MujocoStage, GeometricWorld, str], float]] = {
    Sensing.JOINT: _joint_value,
    Sensing.FORCE: _pressing_force,
    Sensing.LOAD: _hand_load,
    Sensing.DISTANCE: _distance_ahead,
    Sensing.SLIP: _slip_speed,
}
