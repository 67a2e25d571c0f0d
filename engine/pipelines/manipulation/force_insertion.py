"""Insertion by force: the arm with servos guides a part into its hole by what it feels.

The arm goes where the controller says by the Jacobian of the hand. Where it presses, the height
gives way: it goes down as fast as force is lacking (admittance). The force is that of all contacts
of the part but those with the hand, as a sensor at the wrist feels it.
"""

from dataclasses import replace

import mujoco
import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import rotation, rotation_vector
from cellwright.engine.pipelines.manipulation.mujoco_cell import MujocoCell
from cellwright.engine.pipelines.manipulation.part_grasps import HAND_BODY
from cellwright.engine.pipelines.manipulation.place_answers import Carry
from cellwright.engine.pipelines.simulators.mujoco_replay.replay_contacts import body_of
from cellwright.engine.stages.grasping.hole_insertion import (
    Insertion,
    InsertionPhase,
    advance_insertion,
    begin_insertion,
)

SEARCH_ABOVE_RIM_M = 0.006  # over the rim, where the search begins
FORCE_LOOK_S = 0.01  # between two looks at the force
YIELD_PER_NEWTON = 0.0015  # m/s of height for each newton that is lacking
MAX_SPEED_M_S = 0.02  # m/s
BESIDE_N, LAGS_M = (
    4.0,
    0.003,
)  # a push from the side that is more than friction, and how far the servos' aim may be ahead
# 1/s: friction holds a part that is led across a surface back, until the servos have caught up
PULL_RATE = 2.0
ALONG_M_S = 0.0025  # on the spiral: the servos of an arm lag
PRESS_N = 6.0  # a part that is pressed harder leans between the pads
SPIRAL_PITCH = 0.6  # of the room: the turns of the spiral, as the part gives way between the pads
MOST_S = 60.0
STILL_S, STILL_M = 3.0, 0.0002  # a part that gets no deeper for so long is stuck
JACOBIAN_DAMPING = 1e-4  # of the inverse of the Jacobian
PRESSING_PHASES = (
    InsertionPhase.SEARCH,
    InsertionPhase.LEAD,
    InsertionPhase.RIGHT,
    InsertionPhase.INSERT,
)


def insert_part(shop: MujocoCell, part: str, carry: Carry) -> bool:
    """Whether a part that the hand holds over its hole goes in.

    The arm is above the rim; it is left where it has got to.
    """
    assert carry.insertion is not None
    plan = carry.insertion
    plan = replace(plan, along_m_s=ALONG_M_S, press_n=PRESS_N, room_m=SPIRAL_PITCH * plan.room_m)
    servo = _ArmServo(shop, carry, plan)
    now, push, deepest, since = begin_insertion(servo.at(), plan), np.zeros(3), np.inf, shop.seconds
    until = shop.seconds + MOST_S
    while shop.seconds < until and now.phase not in (InsertionPhase.DONE, InsertionPhase.FAILED):
        now = advance_insertion(plan, now, servo.at(), float(push[2]), FORCE_LOOK_S)
        if now.phase in PRESSING_PHASES:
            servo.press(now.target, plan.press_n, push, now.lean_rad)
        else:
            servo.go(now.target, now.lean_rad)
        shop.wait(FORCE_LOOK_S)
        push = _push_n(shop, part)
        at = servo.at()
        if now.phase is not InsertionPhase.INSERT or at[2] < deepest - STILL_M:
            deepest, since = float(at[2]), shop.seconds
        if shop.seconds - since > STILL_S:
            return False
    if now.phase is InsertionPhase.DONE:
        _to_the_end(shop, part, servo, plan)
    return now.phase is InsertionPhase.DONE


def raise_up(shop: MujocoCell, carry: Carry) -> None:
    """Back up to above the rim, from wherever an insertion has ended."""
    assert carry.insertion is not None
    servo = _ArmServo(shop, carry, carry.insertion)
    height = float(servo.at()[2])
    while height < SEARCH_ABOVE_RIM_M:
        height += carry.insertion.down_m_s * FORCE_LOOK_S
        servo.go(np.array([0.0, 0.0, height]))
        shop.wait(FORCE_LOOK_S)


def _to_the_end(shop: MujocoCell, part: str, servo: "_ArmServo", plan: Insertion) -> None:
    """On to the depth that was meant, unless the bottom comes before."""
    x, y, height = servo.at()
    while height > -plan.depth_m and _push_n(shop, part)[2] < plan.press_n:
        height -= plan.down_m_s * FORCE_LOOK_S
        servo.go(np.array([x, y, height]))
        shop.wait(FORCE_LOOK_S)


class _ArmServo:
    """The arm as the controller sees it: places are those of the part beside its goal, heights
    count from the rim.

    Its x axis is that in which the fingers close, as far as this is horizontal: they hold a part
    firmly that is tilted that way.
    """

    def __init__(self, shop: MujocoCell, carry: Carry, plan: Insertion) -> None:
        self.shop, joints = shop, shop.scene.cell.arms[shop.arm].arm.joints
        model = shop.stage.model
        self.own = [int(model.joint(f"{shop.arm}/{joint.name}").dofadr[0]) for joint in joints]
        T_hand_tool = np.linalg.inv(shop.stage.pose(HAND_BODY)) @ self._tool()
        self.T_goal = (
            carry.T_world_to @ carry.T_part_hand @ np.linalg.inv(T_hand_tool)
        )  # of the body of the hand
        self.rim = self.T_goal[:3, 3] + [0.0, 0.0, plan.depth_m]
        self.axes = rotation(
            (0.0, 0.0, 1.0), float(np.arctan2(self.T_goal[1, 0], self.T_goal[0, 0]))
        )
        self.height, self.lags = self.at()[2], np.zeros(2)

    def _tool(self) -> Floats:
        shop = self.shop
        return shop.stage.actual(shop.stage.world).pose("world", f"{shop.arm}.tool")

    def at(self) -> Floats:
        """Where the hand is (3,), from above the hole at the height of the rim."""
        place: Floats = self.axes.T @ (self.shop.stage.pose(HAND_BODY)[:3, 3] - self.rim)
        return place

    def press(self, target: Floats, press_n: float, push: Floats, lean_rad: float) -> None:
        """Aim at a place (3,) as far as this needs little force (3,) to the sides; the height
        follows from the force that is lacking.
        """
        self.height -= (
            float(np.clip(YIELD_PER_NEWTON * (press_n - push[2]), -MAX_SPEED_M_S, MAX_SPEED_M_S))
            * FORCE_LOOK_S
        )
        beside = (self.axes.T @ push)[:2]
        strength = float(np.linalg.norm(beside))
        if strength > BESIDE_N:  # a wall holds it there
            self.lags += YIELD_PER_NEWTON * FORCE_LOOK_S * (1 - BESIDE_N / strength) * beside
        else:
            self.lags += PULL_RATE * FORCE_LOOK_S * (target[:2] - self.at()[:2])
        self.lags = np.clip(self.lags, -LAGS_M, LAGS_M)
        self._aim(np.array([*(target[:2] + self.lags), self.height]), lean_rad)

    def go(self, target: Floats, lean_rad: float = 0.0) -> None:
        """Aim at a place (3,), leaning about y."""
        self.height = target[2]
        self._aim(np.array([*(target[:2] + self.lags), self.height]), lean_rad)

    def _aim(self, beside: Floats, lean_rad: float) -> None:
        aim = self.axes @ beside + self.rim
        leant = self.axes @ rotation((0.0, 1.0, 0.0), lean_rad) @ self.axes.T @ self.T_goal[:3, :3]
        q, shop = self.shop.q, self.shop
        T = self._aimed()
        off = np.concatenate([aim - T[:3, 3], rotation_vector(leant @ T[:3, :3].T)])
        J = self._jacobian()
        step = J.T @ np.linalg.solve(J @ J.T + JACOBIAN_DAMPING**2 * np.eye(6), off)
        shop.aim(q + np.clip(step, -0.02, 0.02))

    def _aimed(self) -> Floats:
        """Where the hand would be if its servos did not lag."""
        shop = self.shop
        world = shop.stage.world.moved(shop.arm, shop.q)
        return world.pose("world", HAND_BODY)

    def _jacobian(self) -> Floats:
        stage = self.shop.stage
        moves, turns = np.zeros((3, stage.model.nv)), np.zeros((3, stage.model.nv))
        body = stage.model.body(HAND_BODY).id
        mujoco.mj_jac(stage.model, stage.data, moves, turns, stage.data.body(HAND_BODY).xpos, body)
        return np.concatenate([moves[:, self.own], turns[:, self.own]])


def _push_n(shop: MujocoCell, part: str) -> Floats:
    """How hard a part and the hand are pushed by everything else (3,), in the world (N)."""
    own, pushed = {part, *shop.own}, np.zeros(3)
    stage, force = shop.stage, np.zeros(6)
    for number in range(stage.data.ncon):
        contact = stage.data.contact[number]
        first, second = (body_of(stage.model, geom) in own for geom in contact.geom)
        if first != second:
            mujoco.mj_contactForce(stage.model, stage.data, number, force)
            onto = contact.frame.reshape(3, 3).T @ force[:3]  # on the second body
            pushed += onto if second else -onto
    return pushed
