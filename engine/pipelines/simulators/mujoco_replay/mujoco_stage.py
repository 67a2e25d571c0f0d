"""Running MuJoCo model of a cell: time, servos, contacts, and latches that hold tools."""

from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import LegKind, MovedStep, StepLeg
from cellwright.engine.pipelines.motion.places_in_a_row import step_parts
from cellwright.engine.pipelines.motion.plan_walk import operation_of
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_model import (
    GRIP_N,
    MODEL_STEP_S,
    dragged_by_hand,
    exchanged_tools,
    finger_bodies,
    held_by,
    holder_of,
    in_hand,
    in_hands,
    is_free,
    mujoco_xml,
    quaternion_of,
)
from cellwright.engine.pipelines.simulators.mujoco_replay.replay_contacts import (
    ArmStopped,
    ContactRecord,
    allowed_in,
)
from cellwright.engine.pipelines.simulators.mujoco_replay.servos import (
    guide_position,
    guide_tolerance,
    has_slipped,
    tune_servos,
    weigh_bodies,
)
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.cell_model import BodyKind, Operation

SEATED_M, SEATED_RAD = 0.01, 0.05  # how far off a tool may be that a latch still takes


@dataclass(eq=False)
class ToolLatches:
    """The latches of a stage. A tool that sticks stays where it hangs, whatever the hand does."""

    model: Any
    data: Any
    _stuck: set[str] = field(default_factory=set)

    def hang(self, tool: str, world: GeometricWorld) -> None:
        """A tool hangs where a world has it, at once."""
        joint, T = self.data.joint(tool), world.pose("world", tool)
        joint.qpos[:3], joint.qpos[3:], joint.qvel[:] = T[:3, 3], quaternion_of(T[:3, :3]), 0.0
        self._close(tool, world)

    def exchange(self, tool: str, before: GeometricWorld, after: GeometricWorld) -> None:
        """The latch that holds a tool before a step opens; that of the world after it closes,
        if the tool is in it.
        """
        if tool in self._stuck or holder_of(before, tool) == holder_of(after, tool):
            return
        if self._is_seated(tool, after):
            self._close(tool, after)
        else:
            self.data.eq_active[self._number(tool)] = 0
            self.model.body_gravcomp[self.model.body(tool).id] = 0.0

    def stick(self, tool: str, on: bool) -> None:
        """Whether a tool sticks where it hangs."""
        (self._stuck.add if on else self._stuck.discard)(tool)

    def _number(self, tool: str) -> int:
        return int(self.model.equality(f"latch/{tool}").id)

    def _close(self, tool: str, world: GeometricWorld) -> None:
        holder, number = holder_of(world, tool), self._number(tool)
        T = world.pose(tool, holder)
        self.model.eq_obj2id[number] = self.model.body(holder).id
        self.model.eq_data[number, 3:6], self.model.eq_data[number, 6:10] = (
            T[:3, 3],
            quaternion_of(T[:3, :3]),
        )
        self.data.eq_active[number] = 1
        # The controller is told the load of the tool in the hand.
        self.model.body_gravcomp[self.model.body(tool).id] = float(holder.endswith(".flange"))

    def _is_seated(self, tool: str, world: GeometricWorld) -> bool:
        """Whether a tool is, beside what holds it in a world, where that world has it."""
        holder = holder_of(world, tool)
        T_holder_tool = transforms.inverse(self._pose(holder)) @ self._pose(tool)
        off = transforms.inverse(world.pose(holder, tool)) @ T_holder_tool
        turned = float(np.linalg.norm(transforms.rotation_vector(off[:3, :3])))
        return float(np.linalg.norm(off[:3, 3])) <= SEATED_M and turned <= SEATED_RAD

    def _pose(self, body: str) -> Floats:
        body_data = self.data.body(body)
        return transforms.transform(body_data.xmat.reshape(3, 3).copy(), body_data.xpos.copy())


CONTACT_LOOK_S = 0.01  # how often contacts are looked at
GRIPS_N = 18.0  # how hard a finger presses against what it grips
REST_TIME_S = 0.5
CATCH_UP_S = 0.2  # after a leg: the servos lag behind
BLOCKED_KG = 1e6


class MujocoStage:
    """The model while it is played."""

    def __init__(self, world: GeometricWorld) -> None:
        self.world, self.model = world, mujoco.MjModel.from_xml_string(mujoco_xml(world))
        self.data = mujoco.MjData(self.model)
        weigh_bodies(self.model, world)
        tune_servos(self.model, world)
        self.by_hand = dragged_by_hand(world.cell)
        self.tools, self.latches = (
            sorted(exchanged_tools(world.cell)),
            ToolLatches(self.model, self.data),
        )
        self.targets: dict[str, float] = {}
        self.touches = ContactRecord(self.model, self.data, world)
        self.off_place, self.off_tip_m, self.step, self.allowed = 0.0, 0.0, 0, frozenset[str]()
        self.held: frozenset[str] = frozenset()
        self.guard: frozenset[str] = frozenset()  # bodies that stop an arm which touches them
        self._drives: dict[str, float] = {}
        # whether a hand closes between two places of a step, which no fact says
        self._carries = False
        for arm, q in world.configurations.items():
            for joint, value in zip(world.cell.arms[arm].arm.joints, q, strict=True):
                self._set(f"{arm}/{joint.name}", float(value))
        for name, body in world.cell.bodies.items():
            if body.guide is not None:
                self._set(name, guide_position(world, name))
        for tool in self.tools:
            self.latches.hang(tool, world)
        mujoco.mj_forward(self.model, self.data)

    def _set(self, joint: str, value: float) -> None:
        self.data.joint(joint).qpos[0] = value
        self.aim(joint, value)

    def aim(self, joint: str, value: float) -> None:
        """Aim the servo of a joint, and those of all that follow it."""
        bodies = self.world.cell.bodies
        same = (
            name
            for name, body in bodies.items()
            if body.guide is not None and body.guide.follows == joint
        )
        for name in (joint, *same):
            number = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
            if number >= 0:
                self.data.ctrl[number] = value

    def take(
        self, step: MovedStep, before: GeometricWorld, after: GeometricWorld, stops: bool = False
    ) -> StepLeg | None:
        """One step: its legs, and at the place what fingers and furniture do.

        If it `stops`, it ends where something that the arm drags does not come along, as at the
        limit of a force. The hand holds it still, and the way that the arm came in by is left to go
        back. Raises `ArmStopped`.
        """
        parts = step_parts(step, before, after)
        for stop, (part, old, new) in zip(step.stops, parts[:-1], strict=False):
            self._carries = bool(stop.in_hand)
            self._take_part(part, old, new, stops)
        self._carries = False
        return self._take_part(*parts[-1], stops)

    def _take_part(
        self, step: MovedStep, before: GeometricWorld, after: GeometricWorld, stops: bool
    ) -> StepLeg | None:
        """A step at one place."""
        operation = operation_of(before.cell, step.operator)
        assert operation is not None
        named = allowed_in(step.place, operation, before)
        self.step = step.step
        way_in: StepLeg | None = None
        for leg in step.legs:
            end_world = after if leg.kind is LegKind.OUT else before
            self.held = in_hands(end_world)
            gripped = operation.with_place is not None and way_in is not None
            self.allowed = named if gripped or leg.kind is not LegKind.WAY else frozenset()
            if leg.kind is LegKind.DRIVE:
                self._ride(operation.drives, step.takes_s, before, after)
                continue
            if not self._follow(leg, operation.drags, before, after, stops):
                return way_in
            if leg.kind is not LegKind.DRAG:
                self._note_tip(leg, end_world)
            way_in = leg if leg.kind is LegKind.IN else way_in
            self._at_end(leg, step.takes_s, operation, before, after)
        return None

    def _at_end(
        self,
        leg: StepLeg,
        takes_s: float,
        operation: Operation,
        before: GeometricWorld,
        after: GeometricWorld,
    ) -> None:
        """What hands and furniture do at the end of a leg."""
        if leg.kind is LegKind.IN:
            q = self.actual(before).configurations[leg.arm]
            self.off_place = max(self.off_place, float(np.abs(q - leg.path[-1]).max()))
            self.held |= in_hands(after)
            if operation.with_place is None:
                self._at_place(leg.arm, takes_s, operation.drags, before, after)
            else:
                self._with_another(leg.arm, takes_s, operation, before, after)
        elif leg.kind in (LegKind.DRAG, LegKind.CARRY):
            for leg_beside in (leg, *leg.beside):
                self.fingers(leg_beside.arm, after, closed=False)
            self.wait(REST_TIME_S)

    def _note_tip(self, leg: StepLeg, world: GeometricWorld) -> None:
        """Note how far the tip of what the arm holds, else its tool point, is from where the
        leg leads.
        """
        tips = [f"{body}.tip" for body in held_by(world, leg.arm) if f"{body}.tip" in world.placed]
        frame = tips[0] if tips else f"{leg.arm}.tool"
        aimed = world.moved(leg.arm, leg.path[-1]).pose("world", frame)[:3, 3]
        if tips:
            body = frame.removesuffix(".tip")
            reached = (self.pose(body) @ world.pose(body, frame))[:3, 3]
        else:
            reached = self.actual(world).pose("world", frame)[:3, 3]
        self.off_tip_m = max(self.off_tip_m, float(np.linalg.norm(reached - aimed)))

    def _ride(
        self, body: str, seconds: float, before: GeometricWorld, after: GeometricWorld
    ) -> None:
        """A body takes its arm along: smoothly, from rest to rest."""
        began, first, last = (
            self.data.time,
            guide_position(before, body),
            guide_position(after, body),
        )
        while (s := (self.data.time - began) / max(seconds, MODEL_STEP_S)) < 1.0:
            self.aim(body, first + s**3 * (10 - 15 * s + 6 * s * s) * (last - first))
            self.tick()
        self.aim(body, last)
        self.wait(CATCH_UP_S)

    def _at_place(
        self, arm: str, takes_s: float, drags: str, before: GeometricWorld, after: GeometricWorld
    ) -> None:
        self.fingers(arm, after, closed=bool(drags) or self._carries)
        for name, body in after.cell.bodies.items():
            changed = (
                body.guide is not None
                and not body.guide.follows
                and abs(guide_position(after, name) - guide_position(before, name)) > 1e-9
            )
            if changed and name != drags and name not in finger_bodies(after, arm):
                self.aim(name, guide_position(after, name))
        for tool in self.tools:
            self.latches.exchange(tool, before, after)
        self.wait(max(takes_s, REST_TIME_S))

    def _with_another(
        self,
        arm: str,
        takes_s: float,
        operation: Operation,
        before: GeometricWorld,
        after: GeometricWorld,
    ) -> None:
        """Two arms are at their places, or the first of them is: a body is gripped from both
        sides before one hand lets go.
        """
        other_arm = before.cell.places[str(operation.with_place)].arm
        if operation.carries is not None:
            self.fingers(arm, before, closed=True)
        elif arm != other_arm:
            self.fingers(arm, after, closed=False)
            self.wait(REST_TIME_S)
            self.fingers(other_arm, after, closed=False)
        self.wait(max(takes_s, REST_TIME_S))

    def fingers(self, arm: str, world: GeometricWorld, closed: bool) -> None:
        """The fingers go where the facts put them; they close until they meet what they hold,
        or all the way.
        """
        for name in finger_bodies(world, arm):
            guide = world.cell.bodies[name].guide
            assert guide is not None
            grips = not closed and guide_position(world, name) > 1e-9
            self._strong(name, grips)
            self.aim(name, guide.upper if closed or grips else guide_position(world, name))

    def go(self, leg: StepLeg, world: GeometricWorld) -> None:
        """An arm goes along a way, with what it holds in a world."""
        self.held, self.allowed = in_hands(world), frozenset()
        self.follow(leg)

    def back_out(self, way_in: StepLeg) -> None:
        """The arm goes back the way by which it came in, after the hand has let go."""
        seconds = way_in.corners_s[-1] - way_in.corners_s[::-1]
        self.follow(replace(way_in, path=way_in.path[::-1], corners_s=seconds))

    def follow(self, leg: StepLeg) -> None:
        """The arm goes along a leg, and drags nothing."""
        self._follow(leg, "", self.world, self.world)

    def _strong(self, finger: str, grips: bool) -> None:
        """A finger that grips presses with a force of its own; else its drive does what it can."""
        bodies = self.world.cell.bodies
        most = GRIPS_N if grips else GRIP_N
        for name, body in bodies.items():
            if name == finger or (body.guide is not None and body.guide.follows == finger):
                self.model.actuator_forcerange[self.model.actuator(name).id] = -most, most

    def _follow(
        self,
        leg: StepLeg,
        drags: str,
        before: GeometricWorld,
        after: GeometricWorld,
        stops: bool = False,
    ) -> bool:
        """The arm goes along a leg.

        Whether it gets to the end: if it `stops`, it does not go on without what it drags.
        """
        began = self.data.time
        first, last = (
            (guide_position(before, drags), guide_position(after, drags)) if drags else (0.0, 0.0)
        )
        legs = (leg, *leg.beside)
        stops = stops and leg.kind is LegKind.DRAG
        grip = self._seen_from(drags, leg.arm) if stops else np.eye(4)
        while (t := self.data.time - began) < leg.seconds:
            for own_leg in legs:
                self._aim_arm(own_leg.arm, own_leg.at(t))
            if leg.kind is LegKind.DRAG:
                self.aim(drags, first + (last - first) * t / leg.seconds)
            self.tick()
            if self.guard and (met := self.touches.met(self.guard, {*self.held, drags})):
                raise ArmStopped(met, leg, t)
            if stops and has_slipped(grip, self._seen_from(drags, leg.arm)):
                self.aim(drags, self.value(drags))
                return False
        for own_leg in legs:
            self._aim_arm(own_leg.arm, own_leg.path[-1])
        self.wait(CATCH_UP_S)
        return not stops or self.is_near(drags, last)

    def _aim_arm(self, arm: str, q: Floats) -> None:
        """Aim the servos of an arm at a configuration (k,)."""
        for joint, value in zip(self.world.cell.arms[arm].arm.joints, q, strict=True):
            self.aim(f"{arm}/{joint.name}", float(value))

    def _seen_from(self, body: str, arm: str) -> Floats:
        pose: Floats = transforms.inverse(self.pose(body)) @ self.pose(f"{arm}.flange")
        return pose

    def wait(self, seconds: float) -> None:
        """Time goes on, and everything aims where it aimed."""
        until = self.data.time + seconds
        while self.data.time < until:
            self.tick()

    def tick(self) -> None:
        """One step of time."""
        mujoco.mj_step(self.model, self.data)
        if self.data.time % CONTACT_LOOK_S < self.model.opt.timestep:
            self.touches.look(self.step, self.held, self.allowed)

    def pose(self, body: str) -> Floats:
        """Where a body is in the world, (4, 4)."""
        body_data = self.data.body(body)
        return transforms.transform(body_data.xmat.reshape(3, 3).copy(), body_data.xpos.copy())

    def actual(self, world: GeometricWorld) -> GeometricWorld:
        """A world with all joints, of arms and furniture, as they are on the stage."""
        for arm, mounted in world.cell.arms.items():
            names = (f"{arm}/{joint.name}" for joint in mounted.arm.joints)
            world = world.moved(arm, np.array([self.data.joint(name).qpos[0] for name in names]))
        for name, body in world.cell.bodies.items():
            if body.guide is not None and not body.guide.follows:
                world = world.guided(name, self.value(name))
        return world

    def value(self, body: str) -> float:
        """How far a body is along its guide on the stage."""
        return float(self.data.joint(body).qpos[0])

    def is_near(self, body: str, value: float) -> bool:
        """Whether a body is about as far along its guide as a value (m or rad)."""
        return abs(self.value(body) - value) <= guide_tolerance(self.world, body)

    def put(self, body: str, world: GeometricWorld) -> None:
        """Somebody puts a body where a world has it."""
        guide = world.cell.bodies[body].guide
        if guide is not None:
            self._set(body, guide_position(world, body))
            return
        if body in self.tools:
            self.latches.hang(body, self.actual(world))
            mujoco.mj_forward(self.model, self.data)
            return
        T = self.actual(world).pose("world", body)
        joint = self.data.joint(body)
        joint.qpos[:3], joint.qpos[3:] = T[:3, 3], quaternion_of(T[:3, :3])
        joint.qvel[:] = [0.0, 0.0, -0.001, 0.0, 0.0, 0.0]  # a body that sleeps wakes when it moves
        mujoco.mj_forward(self.model, self.data)

    def make_slippery(self, friction: float) -> None:
        """All parts have this friction with whatever they touch."""
        for name, body in self.world.cell.bodies.items():
            if body.kind is BodyKind.PART:
                own = np.nonzero(self.model.geom_bodyid == self.model.body(name).id)[0]
                self.model.geom_priority[own] = 1
                self.model.geom_friction[own, 0] = friction
                self.model.geom_friction[own, 1] = (
                    min(friction, 1.0) * self.model.geom_friction[own, 1]
                )

    def block(self, body: str, on: bool) -> None:
        """Whether the joint of a body is as hard to move as if it had the mass of a house."""
        dof = self.model.joint(body).dofadr[0]
        self._drives.setdefault(body, float(self.model.dof_armature[dof]))
        self.model.dof_armature[dof] = BLOCKED_KG if on else self._drives[body]

    def stick(self, part: str, on: bool) -> None:
        """Whether a part sticks where it stood at first, or a tool where it hangs."""
        if part in self.tools:
            self.latches.stick(part, on)
            return
        self.data.eq_active[self.model.equality(f"stuck/{part}").id] = int(on)

    def off(self, world: GeometricWorld) -> dict[str, float]:
        """How far each part and each tool that is in no hand is from where the facts put it, in
        m.
        """
        free = [
            body
            for body in world.cell.bodies
            if is_free(world.cell, body) and not in_hand(world, body)
        ]
        away = {name: self.data.body(name).xpos - world.pose("world", name)[:3, 3] for name in free}
        return {name: float(np.linalg.norm(offset)) for name, offset in away.items()}
