"""The hand of one arm: its pose, configurations that bring it somewhere, and straight lines."""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import CollisionScene, ConvexPiece
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import ArmModel, whole_turns
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import InverseKinematics
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld


class ArmHand:
    """The tool point of an arm, or the tip of a tool that it holds; configurations (n, k) are
    those of the whole world.
    """

    def __init__(
        self, world: GeometricWorld, scene: CollisionScene, arm: str, T_flange_end: Floats
    ) -> None:
        self._world, self._scene, self._end = world, scene, T_flange_end
        self._kinematics = InverseKinematics(world.models[arm])
        self._base = world.pose("world", f"{arm}.base")
        first, count = world.first_carriers[arm], world.models[arm].joints.count
        self.own = slice(first, first + count)

    def poses(self, q: Floats) -> Floats:
        """Where the hand is in the world (n, 4, 4)."""
        poses: Floats = matmul(
            self._base, self._kinematics.model.flange_pose(q[..., self.own]), self._end
        )
        return poses

    def reaching(self, poses: Floats, near: Floats) -> list[Floats]:
        """The configurations (m, k) within the limits for each pose (n, 4, 4), the nearest to
        `near` (k,) first.
        """
        branches = self._kinematics.solve(
            matmul(transforms.inverse(self._base), poses, transforms.inverse(self._end))
        )
        return [self._nearest_first(branches.of(n), near) for n in range(len(poses))]

    def _nearest_first(self, branches: Floats, near: Floats) -> Floats:
        """All turns of some branches (b, own joints) as configurations of the world (m, k)."""
        inside = [whole_turns(self._kinematics.model, q) for q in branches]
        own = np.round(np.concatenate(inside), 12) if inside else np.zeros((0, len(near[self.own])))
        away = np.abs(own - near[self.own]).max(axis=1)
        whole = np.repeat(near[None], len(own), axis=0)
        whole[:, self.own] = own[np.argsort(np.round(away, 9), kind="stable")]
        return whole

    def followed(self, poses: Floats, q: Floats) -> Floats:
        """The configurations (m, k) for poses (n, 4, 4), each the nearest to the one before, the
        first to `q` (k,).

        It ends before the first pose that has none within the limits.
        """
        branches = self._kinematics.solve(
            matmul(transforms.inverse(self._base), poses, transforms.inverse(self._end))
        )
        joints, path = self.model.joints, []
        whole = np.where(joints.prismatic, 0.0, 2 * np.pi)
        turn = np.where(joints.prismatic, 1.0, 2 * np.pi)
        for n in range(len(poses)):
            own = q[self.own]
            near = branches.of(n)
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
        """The arm's own configurations (b, own joints) for a pose (1, 4, 4), within its limits
        or not.
        """
        base = matmul(transforms.inverse(self._base), pose, transforms.inverse(self._end))
        return self._kinematics.solve(base).of(0)

    def boxes(self) -> tuple[Floats, Floats]:
        """The boxes around the standing pieces: poses (n, 4, 4) and half edges (n, 3)."""
        standing = [piece for piece in self._scene.pieces if piece.carrier == 0]
        pose_boxes = [_piece_box(piece) for piece in standing]
        T = np.array([pose for pose, _ in pose_boxes]).reshape(-1, 4, 4)
        return T, np.array([half for _, half in pose_boxes]).reshape(-1, 3)


def _piece_box(piece: ConvexPiece) -> tuple[Floats, Floats]:
    """The box of a piece along the axes of its own frame: its pose in the world (4, 4), and
    half its edges (3,).
    """
    low, high = piece.vertices.min(axis=0), piece.vertices.max(axis=0)
    middle = transforms.translation(*((low + high) / 2))
    half: Floats = (high - low) / 2 + piece.radius_m
    return matmul(piece.T_carrier_piece, middle), half


STRAY_M, STRAY_RAD = 5e-4, 5e-3
FIRST_M, FIRST_RAD = 0.04, 0.2  # between the first configurations
MAX_HALVINGS = 8
JUMP_RAD = 0.6  # a joint that turns farther between two neighbours has changed to another branch
# the least singular value of the Jacobian, below which the arm is as good as singular
SINGULAR_VALUE = 0.02


@dataclass(frozen=True, slots=True)
class BrokenLine:
    """A line that breaks when a share (0 to 1) of it is done: `why` is a sentence without the
    name of the place.
    """

    share: float
    why: str


def straight_line(hand: ArmHand, start: Floats, T_goal: Floats) -> Floats | BrokenLine:
    """The configurations (m, k) from `start` (k,) that take the tool to a pose (4, 4) in a
    straight line.
    """
    T_start = hand.poses(start[None])[0]
    metres, radians = transforms.difference(T_start, T_goal)
    parts = max(2, int(np.ceil(metres / FIRST_M)), int(np.ceil(radians / FIRST_RAD)))
    whole = _at_once(hand, (T_start, T_goal), start, parts)
    if whole is not None:
        return whole
    shares, path = [0.0], [start]
    for share in np.linspace(0.0, 1.0, parts + 1)[1:]:
        reached = _reach_on(
            hand, (T_start, T_goal), (shares[-1], float(share)), path[-1], MAX_HALVINGS
        )
        if isinstance(reached, BrokenLine):
            return reached
        shares.append(float(share))
        path += reached
    return np.array(path)


def _at_once(
    hand: ArmHand, ends: tuple[Floats, Floats], start: Floats, parts: int
) -> Floats | None:
    """The configurations (parts + 1, k) at even shares of the line, if that suffices; most
    lines are so easy.
    """
    marks = np.linspace(0.0, 1.0, 2 * parts + 1)[1:]
    poses = _poses_on_line(ends, marks)
    path = np.concatenate([start[None], hand.followed(poses[1::2], start)])
    if len(path) <= parts or np.abs(np.diff(path, axis=0)).max() > JUMP_RAD:
        return None
    metres, radians = transforms.difference(poses[::2], hand.poses((path[1:] + path[:-1]) / 2))
    return path if (metres <= STRAY_M).all() and (radians <= STRAY_RAD).all() else None


def _reach_on(
    hand: ArmHand,
    ends: tuple[Floats, Floats],
    shares: tuple[float, float],
    q: Floats,
    halvings: int,
) -> list[Floats] | BrokenLine:
    """The configurations after `q` (k,) between two shares of the line, as many as it takes."""
    next_q = _next_configuration(hand, _poses_on_line(ends, np.array(shares[1:])), q, shares[1])
    middle = (shares[0] + shares[1]) / 2
    if isinstance(next_q, BrokenLine) and halvings == 0:
        return next_q
    if not isinstance(next_q, BrokenLine):
        halfway = hand.poses(((q + next_q) / 2)[None])[0]
        metres, radians = transforms.difference(
            _poses_on_line(ends, np.array([middle]))[0], halfway
        )
        if (metres <= STRAY_M and radians <= STRAY_RAD) or halvings == 0:
            return [next_q]
    first = _reach_on(hand, ends, (shares[0], middle), q, halvings - 1)
    if isinstance(first, BrokenLine):
        return first
    second = _reach_on(hand, ends, (middle, shares[1]), first[-1], halvings - 1)
    return second if isinstance(second, BrokenLine) else [*first, *second]


def _poses_on_line(ends: tuple[Floats, Floats], shares: Floats) -> Floats:
    """The poses (n, 4, 4) at shares (n,) of the line."""
    start, goal = ends
    vector = transforms.rotation_vector(matmul(start[:3, :3].T, goal[:3, :3]))
    angle = norm(vector)
    turns_at_all = angle > 1e-12
    axis = vector / angle if turns_at_all else np.array([0.0, 0.0, 1.0])
    turned = transforms.rotation(axis, shares * angle * turns_at_all)
    offsets = shares[:, None] * (goal[:3, 3] - start[:3, 3])
    return transforms.transform(matmul(start[:3, :3], turned), start[:3, 3] + offsets)


def _next_configuration(
    hand: ArmHand, pose: Floats, q: Floats, share: float
) -> Floats | BrokenLine:
    """The configuration (k,) next to `q` for a pose (1, 4, 4), or why there is none."""
    solutions = hand.followed(pose, q)
    if len(solutions) and np.abs(solutions[0] - q).max() <= JUMP_RAD:
        nearest: Floats = solutions[0]
        return nearest
    return BrokenLine(share, _break_reason(hand, pose, q))


def _break_reason(hand: ArmHand, pose: Floats, q: Floats) -> str:
    """Whether a limit, a singularity or another branch is in the way of the next pose (1, 4, 4)."""
    joints, own = hand.model.joints, q[hand.own]
    branches = hand.branches(pose)
    if not len(branches):
        return "the pose is out of reach there"
    whole = np.where(joints.prismatic, np.inf, 2 * np.pi)
    with np.errstate(invalid="ignore"):
        near = branches - np.nan_to_num(np.rint((branches - own) / whole) * whole)
    best = near[int(np.argmin(np.abs(near - own).max(axis=1)))]
    joint = int(np.argmax(np.maximum(joints.lower - best, best - joints.upper)))
    beyond = float(max(joints.lower[joint] - best[joint], best[joint] - joints.upper[joint]))
    if np.abs(best - own).max() <= JUMP_RAD and beyond > 0.0:
        name = hand.model.arm.joints[joint].name
        amount = (
            f"{beyond * 1000:.0f} mm"
            if joints.prismatic[joint]
            else f"{np.degrees(beyond):.1f} degrees"
        )
        return f"{name} would have to go {amount} beyond its limit"
    least = float(np.linalg.svd(hand.model.jacobian(own), compute_uv=False)[-1])
    joint = int(np.argmax(np.abs(best - own)))
    name = hand.model.arm.joints[joint].name
    if least < SINGULAR_VALUE or not len(whole_turns(hand.model, best)):
        return f"the arm comes to a singularity: {name} would have to turn at once"
    return (
        f"only another branch reaches on from there: {name} would have to jump by "
        f"{np.degrees(np.abs(best - own).max()):.0f} degrees"
    )
