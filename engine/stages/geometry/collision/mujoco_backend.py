"""MuJoCo (Apache licence) as a geometry backend; an extra: `pip install cellwright[mujoco]`.

Carriers are bodies, joints are hinges and slides, pieces are geoms; only the scene's pairs are
compared. Blocks become convex meshes, because MuJoCo's own collider for a capsule and a block
misses a capsule that pierces a thin block, and reports the depth of one end only.
"""

import mujoco
import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.model.geometry import CollisionScene, Contact, ConvexPiece
from cellwright.engine.stages.geometry.collision.carrier_poses import batch_of_one, split_batch
from cellwright.engine.stages.geometry.shapes.convex_pieces import (
    length_of,
    nearest_of_bodies,
    primitive_frame,
    refuse_rounded,
)


class MujocoChecker:
    """A scene compiled to a MuJoCo model."""

    def __init__(self, scene: CollisionScene, native_blocks: bool = False) -> None:
        self._scene = scene
        self._model = _compile_scene(scene, native_blocks)
        self._state = mujoco.MjData(self._model)
        # geoms are numbered in the order of their bodies, pieces in the order of the scene
        geom = mujoco.mjtObj.mjOBJ_GEOM
        self._geoms = [
            mujoco.mj_name2id(self._model, geom, f"piece_{n}") for n in range(len(scene.pieces))
        ]

    @property
    def scene(self) -> CollisionScene:
        """The scene that is checked."""
        return self._scene

    def collides(self, where: Floats) -> Truths:
        """Whether any pair touches (n,)."""
        where, hits = split_batch(self._scene, where)
        for n, configuration in enumerate(where):
            self._place(configuration)
            mujoco.mj_collision(self._model, self._state)
            hits[n] |= self._state.ncon > 0
        return hits

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance (n,), in metres; `beyond_m` where it would be larger."""
        where, endless = split_batch(self._scene, where)
        least = [
            min(
                [beyond_m, *(contact.distance_m for contact in self._near(configuration, beyond_m))]
            )
            for configuration in where
        ]
        return np.where(endless, -np.inf, np.array(least))

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """Every pair of bodies nearer than `within_m`, nearest first."""
        return nearest_of_bodies(iter(self._near(batch_of_one(self._scene, where)[0], within_m)))

    def _place(self, configuration: Floats) -> None:
        if self._scene.free:
            self._state.qpos[:3] = configuration[:3, 3]
            mujoco.mju_mat2Quat(
                self._state.qpos[3:7], np.ascontiguousarray(configuration[:3, :3]).ravel()
            )
        else:
            self._state.qpos[:] = configuration
        mujoco.mj_kinematics(self._model, self._state)

    def _of(self, i: int, j: int) -> tuple["mujoco.MjModel", "mujoco.MjData", int, int]:
        return self._model, self._state, self._geoms[i], self._geoms[j]

    def _near(self, configuration: Floats, within_m: float) -> list[Contact]:
        self._place(configuration)
        pieces, ends, contacts = self._scene.pieces, np.zeros(6), []
        for i, j in self._scene.pairs:
            distance = mujoco.mj_geomDistance(*self._of(i, j), within_m + 1e-6, ends)
            if distance <= within_m:
                first, second = ends[:3].copy(), ends[3:].copy()
                gap = second - first
                length = float(np.linalg.norm(gap))
                normal = (
                    gap / length * np.sign(distance) if length > 0 else np.array([0.0, 0.0, 1.0])
                )
                contacts.append(
                    Contact(pieces[i].body, pieces[j].body, float(distance), first, second, normal)
                )
        return contacts


def _compile_scene(scene: CollisionScene, native_blocks: bool) -> "mujoco.MjModel":
    spec = mujoco.MjSpec()
    spec.option.ccd_tolerance, spec.option.ccd_iterations = 1e-9, 200
    carriers = [spec.worldbody]
    if scene.free:
        carriers.append(_add_body(spec.worldbody, np.eye(4)))
        carriers[1].add_freejoint()
    for index in range(scene.joints.count):
        body = _add_body(carriers[scene.joints.parent[index]], scene.joints.T_parent_origin[index])
        slide = scene.joints.prismatic[index]
        kind = mujoco.mjtJoint.mjJNT_SLIDE if slide else mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(type=kind, axis=scene.joints.axis[index])
        carriers.append(body)
    for number, piece in enumerate(scene.pieces):
        _add_geom(spec, carriers[piece.carrier], piece, f"piece_{number}", native_blocks)
    for i, j in scene.pairs:
        spec.add_pair(geomname1=f"piece_{i}", geomname2=f"piece_{j}", margin=0.0)
    return spec.compile()


def _add_body(parent: "mujoco.MjsBody", T: Floats) -> "mujoco.MjsBody":
    """A body at a pose. Its mass has no effect, since nothing is simulated."""
    body = parent.add_body(pos=T[:3, 3], quat=_mujoco_quaternion(T))
    body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
    return body


def _mujoco_quaternion(T: Floats) -> Floats:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(T[:3, :3]).ravel())
    return quaternion


def _add_geom(
    spec: "mujoco.MjSpec",
    body: "mujoco.MjsBody",
    piece: ConvexPiece,
    name: str,
    native_blocks: bool,
) -> None:
    """Raises `ValueError` for a rounded polytope."""
    refuse_rounded(piece, "MuJoCo")
    T = primitive_frame(piece)
    geom = body.add_geom(
        name=name, pos=T[:3, 3], quat=_mujoco_quaternion(T), contype=0, conaffinity=0
    )
    if len(piece.vertices) == 1:
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, [piece.radius_m, 0, 0]
    elif len(piece.vertices) == 2:
        geom.type, geom.size = (
            mujoco.mjtGeom.mjGEOM_CAPSULE,
            [piece.radius_m, length_of(piece) / 2, 0],
        )
    elif piece.box and native_blocks:
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_BOX, np.ptp(piece.vertices, axis=0) / 2
    else:
        spec.add_mesh(name=name, uservert=piece.vertices.ravel())
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, name


class MujocoBackend:
    """The backend that asks MuJoCo, one configuration after the other."""

    name = "mujoco"
    exact_depths = True

    def __init__(self, native_blocks: bool = False) -> None:
        self._native_blocks = native_blocks

    def checker(self, scene: CollisionScene) -> MujocoChecker:
        """A checker with a compiled model of the scene.

        Raises `ValueError` for a rounded polytope.
        """
        return MujocoChecker(scene, self._native_blocks)

    def checker_of_few(self, scene: CollisionScene) -> MujocoChecker:
        """The same checker."""
        return self.checker(scene)
