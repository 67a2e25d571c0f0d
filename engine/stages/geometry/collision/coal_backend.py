"""The coal library (BSD licence) as a geometry backend; an extra: `pip install
cellwright[coal]`.
"""

import coal
import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.model.geometry import CollisionScene, Contact, ConvexPiece
from cellwright.engine.stages.geometry.collision.carrier_poses import batch_of_one, split_batch
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.shapes.convex_pieces import (
    length_of,
    nearest_of_bodies,
    primitive_frame,
    refuse_rounded,
)


def _coal_geometry(piece: ConvexPiece) -> "coal.CollisionGeometry":
    """A piece as a coal geometry. Raises `ValueError` for a rounded polytope."""
    refuse_rounded(piece, "coal")
    if len(piece.vertices) == 1:
        return coal.Sphere(piece.radius_m)
    if len(piece.vertices) == 2:
        return coal.Capsule(piece.radius_m, length_of(piece))
    if piece.box:
        return coal.Box(*np.ptp(piece.vertices, axis=0))
    points = coal.StdVec_Vec3s()
    for vertex in piece.vertices:
        points.append(vertex)
    return coal.Convex.convexHull(points, True, "Qt")


class CoalChecker:
    """A scene as coal geometries. Balls around them are compared first."""

    def __init__(self, scene: CollisionScene) -> None:
        self._scene = scene
        self._geometries = [_coal_geometry(piece) for piece in scene.pieces]
        self._frames = np.array([primitive_frame(piece) for piece in scene.pieces]).reshape(
            -1, 4, 4
        )
        self._carrier = np.array([piece.carrier for piece in scene.pieces], dtype=int)
        middles = [(p.vertices.min(axis=0) + p.vertices.max(axis=0)) / 2 for p in scene.pieces]
        self._centres = np.array(
            [
                p.T_carrier_piece[:3, :3] @ m + p.T_carrier_piece[:3, 3]
                for p, m in zip(scene.pieces, middles, strict=True)
            ]
        ).reshape(-1, 3)
        self._reach = np.array(
            [
                np.linalg.norm(p.vertices - m, axis=1).max() + p.radius_m
                for p, m in zip(scene.pieces, middles, strict=True)
            ]
        )

    @property
    def scene(self) -> CollisionScene:
        """The scene that is checked."""
        return self._scene

    def collides(self, where: Floats) -> Truths:
        """Whether any pair touches (n,)."""
        where, endless = split_batch(self._scene, where)
        return (
            np.array([self._touches(poses) for poses in self._poses(where)], dtype=bool) | endless
        )

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance (n,), in metres; `beyond_m` where it would be larger."""
        where, endless = split_batch(self._scene, where)
        clearances = [
            min([beyond_m, *(c.distance_m for c in self._near(poses, beyond_m))])
            for poses in self._poses(where)
        ]
        return np.where(endless, -np.inf, np.array(clearances))

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """Every pair of bodies nearer than `within_m`, nearest first."""
        (poses,) = self._poses(batch_of_one(self._scene, where))
        return nearest_of_bodies(iter(self._near(poses, within_m)))

    def _poses(self, where: Floats) -> Floats:
        """The carrier poses (n, k + 1, 4, 4)."""
        if self._scene.free:
            return np.stack([np.broadcast_to(np.eye(4), where.shape), where], axis=1)
        return carrier_poses(self._scene.joints, np.asarray(where, dtype=float))

    def _candidates(self, poses: Floats, by: float) -> Floats:
        """The pairs (m, 2) whose balls are nearer to each other than `by`."""
        placed = poses[self._carrier]
        centres = np.einsum("pij,pj->pi", placed[:, :3, :3], self._centres) + placed[:, :3, 3]
        i, j = self._scene.pairs.T
        apart = np.linalg.norm(centres[i] - centres[j], axis=1) - self._reach[i] - self._reach[j]
        near: Floats = self._scene.pairs[apart <= by]
        return near

    def _transforms(self, poses: Floats) -> list["coal.Transform3s"]:
        return [coal.Transform3s(T[:3, :3], T[:3, 3]) for T in poses[self._carrier] @ self._frames]

    def _touches(self, poses: Floats) -> bool:
        transforms, request = self._transforms(poses), coal.CollisionRequest()
        for i, j in self._candidates(poses, 0.0):
            result = coal.CollisionResult()
            if coal.collide(
                self._geometries[i],
                transforms[i],
                self._geometries[j],
                transforms[j],
                request,
                result,
            ):
                return True
        return False

    def _near(self, poses: Floats, within_m: float) -> list[Contact]:
        transforms, request = self._transforms(poses), coal.DistanceRequest()
        request.gjk_tolerance = request.epa_tolerance = 1e-9
        request.gjk_max_iterations = request.epa_max_iterations = 256
        near = []
        for i, j in self._candidates(poses, within_m):
            result = coal.DistanceResult()
            distance = coal.distance(
                self._geometries[i],
                transforms[i],
                self._geometries[j],
                transforms[j],
                request,
                result,
            )
            if distance <= within_m:
                near.append(self._contact(i, j, float(distance), result))
        return near

    def _contact(self, i: int, j: int, distance: float, result: "coal.DistanceResult") -> Contact:
        first, second = np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
        gap = second - first
        length = float(np.linalg.norm(gap))
        normal = (
            gap / length * np.sign(distance)
            if length > 1e-9
            else np.array(result.normal).reshape(3)
        )
        pieces = self._scene.pieces
        return Contact(pieces[i].body, pieces[j].body, distance, first, second, normal)


class CoalBackend:
    """The backend that asks coal, one pair at a time."""

    name = "coal"
    exact_depths = True

    def checker(self, scene: CollisionScene) -> CoalChecker:
        """A checker with coal geometries for the scene.

        Raises `ValueError` for a rounded polytope.
        """
        return CoalChecker(scene)

    def checker_of_few(self, scene: CollisionScene) -> CoalChecker:
        """The same checker."""
        return self.checker(scene)
