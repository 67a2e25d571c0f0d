"""The hand of one arm in a world: where it is, which configurations bring it somewhere, and the boxes around it that stand."""

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats, Piece, Scene
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arms import ArmModel
from cellwright.engine.stages.geometry.kinematics.inverse import InverseKinematics
from cellwright.engine.stages.geometry.kinematics.turning import turns
from cellwright.engine.stages.geometry.world.model import World


class ArmHand:
    """The tool point of an arm, or the tip of a tool that it holds; configurations (n, k) are those of the whole world."""

    def __init__(self, world: World, scene: Scene, arm: str, T_flange_end: Floats) -> None:
        self._world, self._scene, self._end = world, scene, T_flange_end
        self._kinematics = InverseKinematics(world.models[arm])
        self._base = world.pose("world", f"{arm}.base")
        first, count = world.first_carriers[arm], world.models[arm].joints.count
        self.own = slice(first, first + count)

    def poses(self, q: Floats) -> Floats:
        """Where the hand is in the world (n, 4, 4)."""
        found: Floats = matmul(self._base, self._kinematics.model.flange_pose(q[..., self.own]), self._end)
        return found

    def reaching(self, poses: Floats, near: Floats) -> list[Floats]:
        """The configurations (m, k) within the limits for each pose (n, 4, 4), the nearest to `near` (k,) first."""
        found = self._kinematics.solve(
            matmul(transforms.inverse(self._base), poses, transforms.inverse(self._end))
        )
        return [self._nearest_first(found.of(n), near) for n in range(len(poses))]

    def _nearest_first(self, branches: Floats, near: Floats) -> Floats:
        """All turns of some branches (b, own joints) as configurations of the world (m, k)."""
        inside = [turns(self._kinematics.model, q) for q in branches]
        own = np.round(np.concatenate(inside), 12) if inside else np.zeros((0, len(near[self.own])))
        away = np.abs(own - near[self.own]).max(axis=1)
        whole = np.repeat(near[None], len(own), axis=0)
        whole[:, self.own] = own[np.argsort(np.round(away, 9), kind="stable")]
        return whole

    def followed(self, poses: Floats, q: Floats) -> Floats:
        """The configurations (m, k) for poses (n, 4, 4), each the nearest to the one before, the first to `q` (k,).

        It ends before the first pose that has none within the limits.
        """
        found = self._kinematics.solve(
            matmul(transforms.inverse(self._base), poses, transforms.inverse(self._end))
        )
        joints, path = self.model.joints, []
        whole = np.where(joints.prismatic, 0.0, 2 * np.pi)
        turn = np.where(joints.prismatic, 1.0, 2 * np.pi)
        for n in range(len(poses)):
            own = q[self.own]
            near = found.of(n)
            near = near + np.rint((own - near) / turn) * whole
            near = near[self.model.within_limits(near)]
            if not len(near):
                break
            q = q.copy()
            q[self.own] = near[int(np.argmin(np.abs(near - own).max(axis=1)))]
            path.append(q)
        return np.array(path).reshape(-1, len(q))

    @property
    def model(self) -> ArmModel:
        """The arm; `own` are its joints among those of the world."""
        return self._kinematics.model

    def branches(self, pose: Floats) -> Floats:
        """The arm's own configurations (b, own joints) for a pose (1, 4, 4), within its limits or not."""
        base = matmul(transforms.inverse(self._base), pose, transforms.inverse(self._end))
        return self._kinematics.solve(base).of(0)

    def boxes(self) -> tuple[Floats, Floats]:
        """The boxes around the standing pieces: poses (n, 4, 4) and half edges (n, 3)."""
        standing = [piece for piece in self._scene.pieces if piece.carrier == 0]
        found = [_box(piece) for piece in standing]
        T = np.array([each for each, _ in found]).reshape(-1, 4, 4)
        return T, np.array([half for _, half in found]).reshape(-1, 3)


def _box(piece: Piece) -> tuple[Floats, Floats]:
    """The box of a piece along the axes of its own frame: its pose in the world (4, 4), and half its edges (3,)."""
    low, high = piece.vertices.min(axis=0), piece.vertices.max(axis=0)
    middle = transforms.translation(*((low + high) / 2))
    half: Floats = (high - low) / 2 + piece.radius_m
    return matmul(piece.T_carrier_piece, middle), half
