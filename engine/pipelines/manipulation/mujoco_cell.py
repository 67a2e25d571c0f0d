"""Scene in MuJoCo: an arm with a hand that closes, parts held by friction, and a camera.

The controller knows the weight of what it believes to hold. Between what it knows and what is
there, nothing is shared.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import inverse
from cellwright.engine.model.motion_values import LegKind, StepLeg
from cellwright.engine.pipelines.manipulation.mujoco_hands import CLOSE_S, MujocoHand, scene_hand
from cellwright.engine.pipelines.manipulation.part_grasps import HAND_BODY
from cellwright.engine.pipelines.motion.arm_progress import corners_s
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_model import quaternion_of
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_stage import MujocoStage
from cellwright.engine.pipelines.simulators.mujoco_replay.replay_contacts import body_of
from cellwright.engine.pipelines.simulators.mujoco_replay.servos import aim_lead
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grasping.stable_placements import volume_and_centre
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, Placement
from cellwright.kb.model.part_scene import Scene

SERVO_SETTLE_S = 0.3  # until the servos have caught up
EMPTY_FACTOR, CARRY_FACTOR = 0.6, 0.3  # shares of the full speed and acceleration
GRAVITY_M_S2 = 9.81  # m/s2
FLOOR_M = -0.5  # what is lower has fallen from the table


class MujocoCell:
    """The scene while time goes on. `q` (k,) is where the arm is told to be."""

    def __init__(self, scene: Scene, poses: Mapping[str, Floats] | None = None) -> None:
        self.scene, self.arm, self.hand = scene, scene.hand.arm, scene_hand(scene)
        cell = _with_hand(scene, self.hand)
        self.own = frozenset(cell.bodies) - frozenset(scene.cell.bodies)
        world = GeometricWorld.of(cell)
        for name, T in (poses or {}).items():
            world = world.put(name, "world", T)
        self.stage = MujocoStage(world)
        self.q = world.configurations[self.arm]
        self.load = ""
        self.hand.prepare(self.stage)
        self.wait(SERVO_SETTLE_S)

    @property
    def seconds(self) -> float:
        """The time that has passed."""
        return float(self.stage.data.time)

    def pose(self, body: str) -> Floats:
        """T_world_body (4, 4), as it really is."""
        return self.stage.pose(body)

    def world(self) -> GeometricWorld:
        """The scene's world with all parts where they really are; what has fallen from the
        table is not in it.
        """
        world = GeometricWorld.of(self.scene.cell)
        gone = [name for name in self._parts() if self.pose(name)[2, 3] < FLOOR_M]
        bodies = {name: body for name, body in world.cell.bodies.items() if name not in gone}
        world = replace(world, cell=replace(world.cell, bodies=bodies))
        for name in self._parts():
            if name not in gone:
                world = world.put(name, "world", self.pose(name))
        return world

    def _parts(self) -> Iterator[str]:
        return (name for name, body in self.scene.cell.bodies.items() if body.kind is BodyKind.PART)

    def follow(
        self, path: Floats, until: Callable[[], bool] | None = None, carries: bool = False
    ) -> bool:
        """The arm follows a path (m, k); False if `until` became true on the way, where the arm
        then stays.
        """
        mounted = self.scene.cell.arms[self.arm]
        factor = CARRY_FACTOR if carries else EMPTY_FACTOR
        leg = StepLeg(LegKind.WAY, self.arm, path, corners_s(mounted.arm, path, factor), True)
        began = self.seconds
        while (t := self.seconds - began) < leg.seconds:
            self.aim(leg.at(t), aim_lead(leg, t))
            self._tick()
            if until is not None and until():
                self.aim(self.q)
                return False
        self.aim(path[-1])
        self.wait(SERVO_SETTLE_S)
        return until is None or not until()

    def aim(self, q: Floats, ahead: Floats | float = 0.0) -> None:
        """The arm is told to be at joint values (k,): its servos are aimed there, or so far
        `ahead` of it (k,) while it moves.
        """
        self.q = q
        for joint, value in zip(self.scene.cell.arms[self.arm].arm.joints, q + ahead, strict=True):
            self.stage.aim(f"{self.arm}/{joint.name}", float(value))

    def open_for(self, opening: Sequence[float]) -> None:
        """The hand opens for a grasp, with the clearance beside it; whatever it held is let go."""
        self.load = ""
        self.hand.open_for(self.stage, opening)
        self.wait(CLOSE_S)

    def open_wide(self) -> None:
        """The hand opens as far as it can."""
        self.open_for(self.hand.wide)

    def close(self) -> float:
        """The fingers close until they meet something, or each other; how far apart they are
        then (m).
        """
        for seconds in self.hand.closing(self.stage):
            self.wait(seconds)
        return self.hand.width_m(self.stage)

    def clamp(self, part: str, on: bool) -> None:
        """Whether a part is clamped to the hand as it is now, as a target is for a calibration."""
        model, data = self.stage.model, self.stage.data
        number = int(model.equality(f"stuck/{part}").id)
        T = inverse(self.pose(part)) @ self.pose(HAND_BODY)
        model.eq_obj2id[number] = model.body(HAND_BODY).id if on else 0
        model.eq_data[number, 3:6], model.eq_data[number, 6:10] = T[:3, 3], quaternion_of(T[:3, :3])
        model.eq_solref[number], model.eq_solimp[number, :2] = (0.008, 1.0), (0.99, 0.999)
        data.eq_active[number] = int(on)
        model.body_gravcomp[model.body(part).id] = float(on)  # the controller is told the load

    def wait(self, seconds: float) -> None:
        """Time goes on, and everything aims where it aimed."""
        until = self.seconds + seconds
        while self.seconds < until:
            self._tick()

    def _tick(self) -> None:
        self._bear()
        self.stage.tick()

    def _bear(self) -> None:
        """The drives bear the weight of what is believed to be in the hand."""
        model, data = self.stage.model, self.stage.data
        data.qfrc_applied[:] = 0.0
        if not self.load:
            return
        mass = float(model.body(self.load).mass[0])
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(
            model, data, jacobian, None, data.body(self.load).xipos, model.body(HAND_BODY).id
        )
        joints = self.scene.cell.arms[self.arm].arm.joints
        own = [int(model.joint(f"{self.arm}/{joint.name}").dofadr[0]) for joint in joints]
        data.qfrc_applied[own] = jacobian[2, own] * mass * GRAVITY_M_S2

    def permit(self, *others: str) -> None:
        """What the hand, and what it holds, may touch from now on; every other contact is noted
        by the stage.
        """
        self.stage.held = frozenset([self.load] if self.load else [])
        self.stage.allowed = frozenset(others)

    def push_n(self) -> float:
        """How hard the hand is pushed by anything (N)."""
        return sum(force for names, force in self._touches() if self._is_hand(names))

    def _is_hand(self, names: frozenset[str]) -> bool:
        return bool(names & self.own) and not names <= self.own

    def holds(self, part: str) -> bool:
        """Whether all fingers press on a part."""
        pressing = {
            name for names, _ in self._touches() if part in names for name in names - {part}
        }
        return pressing.issuperset(self.hand.fingers)

    def _touches(self) -> Iterator[tuple[frozenset[str], float]]:
        """The bodies that touch each other, and the force of each contact (N)."""
        stage, force = self.stage, np.zeros(6)
        for number in range(stage.data.ncon):
            contact = stage.data.contact[number]
            mujoco.mj_contactForce(stage.model, stage.data, number, force)
            yield (
                frozenset(body_of(stage.model, geom) for geom in contact.geom),
                abs(float(force[0])),
            )


def _with_hand(scene: Scene, hand: MujocoHand) -> Cell:
    """The scene's cell with the hand as bodies, some of which move; parts have the scene's
    density and friction.
    """
    cell, arm = scene.cell, scene.hand.arm
    mounted = cell.arms[arm]
    bodies = {name: _with_mass(scene, body) for name, body in cell.bodies.items()}
    own = {body.name: body for body in hand.bodies(Placement(f"{arm}.flange", mounted.tool))}
    near = {
        frozenset((body, f"{arm}.{link.name}")) for body in own for link in mounted.arm.links[-2:]
    }
    each_other = {frozenset((first, second)) for first in own for second in own if first != second}
    return replace(cell, bodies=bodies | own, allowed=cell.allowed | near | each_other)


def _with_mass(scene: Scene, body: Body) -> Body:
    if body.kind is not BodyKind.PART or not body.shapes:
        return body
    mass = volume_and_centre(solid_of(body))[0] * scene.density
    friction = scene.hand.friction if body.friction is None else body.friction
    return replace(body, mass_kg=mass if body.mass_kg is None else body.mass_kg, friction=friction)


def shifted_pose(T: Floats, along: tuple[float, float], turn_rad: float) -> Floats:
    """A pose (4, 4) that was shifted in the plane (m) and turned about the vertical."""
    moved_pose = T.copy()
    moved_pose[:3, :3] = transforms.rotation((0.0, 0.0, 1.0), turn_rad)[:3, :3] @ T[:3, :3]
    moved_pose[:2, 3] += along
    return moved_pose
