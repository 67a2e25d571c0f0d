"""Peg and hole in MuJoCo: whether an insertion by a force sensor at the wrist works.

The hand moves on three slides with servos; the wrist gives way to tilts like a spring. The hole is
a ring of blocks.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.grasping.hole_insertion import (
    HoleSearch,
    Insertion,
    InsertionPhase,
    InsertionState,
    advance_insertion,
    begin_insertion,
)

PEG_HOLE_SIDES = 24
PEG_STEP_S = 0.0005
STEPS_PER_LOOK = 4
STILL_S = 2.0  # after so long without getting deeper, a part that should go in is stuck


@dataclass(frozen=True, slots=True)
class RoundPeg:
    """A round peg, and a hole that is wider by `clearance_m` in all. Metres."""

    radius_m: float = 0.01
    clearance_m: float = 0.0002
    depth_m: float = 0.02
    length_m: float = 0.05


@dataclass(frozen=True, slots=True)
class InsertionResult:
    """How an insertion ended: whether the peg is in, after how many seconds, and with what
    greatest force in newtons.
    """

    phase: InsertionPhase
    seconds: float
    force_n: float


def simulate_insertion(
    peg: RoundPeg, plan: Insertion, error: Floats, tilt_rad: float = 0.0, most_s: float = 60.0
) -> InsertionResult:
    """What comes of an insertion that begins at (2,) beside the hole, with a peg that leans."""
    model = mujoco.MjModel.from_xml_string(
        _peg_xml(peg, plan.search is not HoleSearch.NONE, tilt_rad)
    )
    data = mujoco.MjData(model)
    data.qpos[:3] = [*error, 0.005]
    now, force, worst, deepest, since = (
        begin_insertion(data.qpos[:3].copy(), plan),
        0.0,
        0.0,
        np.inf,
        0.0,
    )
    while data.time < most_s and now.phase not in (InsertionPhase.DONE, InsertionPhase.FAILED):
        now = advance_insertion(plan, now, data.qpos[:3].copy(), force, PEG_STEP_S * STEPS_PER_LOOK)
        _steer_servos(data, now, plan)
        for _ in range(STEPS_PER_LOOK):
            mujoco.mj_step(model, data)
        force = -float(data.sensordata[2])  # the sensor tells what the peg does to the wrist
        worst = max(worst, float(np.linalg.norm(data.sensordata[:3])))
        if now.phase is not InsertionPhase.INSERT or data.qpos[2] < deepest - 1e-4:
            deepest, since = float(data.qpos[2]), data.time
        if data.time - since > STILL_S:
            return InsertionResult(InsertionPhase.FAILED, data.time, worst)
    return InsertionResult(now.phase, data.time, worst)


def _steer_servos(data: "mujoco.MjData", now: InsertionState, plan: Insertion) -> None:
    """The servos' targets; a hand that presses sets a force in place of a height."""
    pressing = now.phase in (
        InsertionPhase.SEARCH,
        InsertionPhase.LEAD,
        InsertionPhase.RIGHT,
        InsertionPhase.INSERT,
    )
    data.ctrl[:3] = now.target
    data.ctrl[2] = data.qpos[2] if pressing else now.target[2]
    data.ctrl[3] = -plan.press_n if pressing else 0.0
    data.ctrl[4] = now.lean_rad


def _peg_xml(peg: RoundPeg, soft: bool, tilt_rad: float) -> str:
    """The model; a hand without compliance is stiff to the sides and against tilts."""
    hole = peg.radius_m + peg.clearance_m / 2
    wall, half = 0.02, peg.depth_m / 2
    width = (hole + 2 * wall) * np.tan(np.pi / PEG_HOLE_SIDES)
    ring = "".join(
        f'<geom type="box" size="{wall} {width} {half}" pos="{(hole + wall) * np.cos(a)} '
        f'{(hole + wall) * np.sin(a)} {-half}" euler="0 0 {a}"/>'
        for a in np.arange(PEG_HOLE_SIDES) * 2 * np.pi / PEG_HOLE_SIDES
    )
    slide, turn = (15000.0, 40.0) if soft else (40000.0, 200.0)
    slides = "".join(
        f'<joint name="{n}" type="slide" axis="{axis}" damping="{damping}"/>'
        for n, axis, damping in (("x", "1 0 0", 80), ("y", "0 1 0", 80), ("z", "0 0 1", 60))
    )
    hinges = "".join(
        f'<joint name="r{n}" type="hinge" axis="{axis}" pos="0 0 {peg.length_m}" damping="0.05"/>'
        for n, axis in (("x", "1 0 0"), ("y", "0 1 0"))
    )
    servos = "".join(f'<position joint="{n}" kp="{slide}"/>' for n in "xyz")
    length = peg.length_m / 2
    return f"""<mujoco><compiler angle="radian"/>
<option timestep="{PEG_STEP_S}" gravity="0 0 0" integrator="implicitfast" cone="elliptic"/>
<default><geom friction="0.2 0.001 0.0001" solref="0.002 1" solimp="0.98 0.999 0.00005"/></default>
<worldbody>{ring}
<body name="hand"><inertial pos="0 0 {peg.length_m}" mass="0.5"
 diaginertia="1e-3 1e-3 1e-3"/>{slides}
<body name="peg" euler="{tilt_rad} 0 0">{hinges}
<geom type="cylinder" size="{peg.radius_m} {length}" pos="0 0 {length}" mass="0.2"/>
<site name="wrist" pos="0 0 {peg.length_m}"/></body></body></worldbody>
<actuator>{servos}<motor joint="z"/>
<position joint="ry" kp="{turn}"/><position joint="rx" kp="{turn}"/></actuator>
<sensor><force site="wrist"/></sensor></mujoco>"""
