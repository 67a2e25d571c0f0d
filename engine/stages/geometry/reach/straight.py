"""Straight lines of the tool: configurations along one, or the reason why it breaks.

The tool goes on a straight line and turns evenly. Between two configurations all joints move in proportion, so the tool leaves
the line a little there; configurations are added until it leaves it by no more than `STRAY_M` and `STRAY_RAD`.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.turning import turns
from cellwright.engine.stages.geometry.reach.hand import ArmHand

STRAY_M, STRAY_RAD = 5e-4, 5e-3
FIRST_M, FIRST_RAD = 0.04, 0.2  # between the first configurations
HALVINGS = 8
JUMP_RAD = 0.6  # a joint that turns farther between two neighbours has changed to another branch
SINGULAR = 0.02  # the least singular value of the Jacobian, below which the arm is as good as singular


@dataclass(frozen=True, slots=True)
class Broken:
    """A line that breaks when a share (0 to 1) of it is done: `why` is a sentence without the name of the place."""

    share: float
    why: str


def straight(hand: ArmHand, start: Floats, T_goal: Floats) -> Floats | Broken:
    """The configurations (m, k) from `start` (k,) that take the tool to a pose (4, 4) in a straight line."""
    T_start = hand.poses(start[None])[0]
    metres, radians = transforms.difference(T_start, T_goal)
    parts = max(2, int(np.ceil(metres / FIRST_M)), int(np.ceil(radians / FIRST_RAD)))
    whole = _at_once(hand, (T_start, T_goal), start, parts)
    if whole is not None:
        return whole
    shares, path = [0.0], [start]
    for share in np.linspace(0.0, 1.0, parts + 1)[1:]:
        found = _reach_on(hand, (T_start, T_goal), (shares[-1], float(share)), path[-1], HALVINGS)
        if isinstance(found, Broken):
            return found
        shares.append(float(share))
        path += found
    return np.array(path)


def _at_once(hand: ArmHand, ends: tuple[Floats, Floats], start: Floats, parts: int) -> Floats | None:
    """The configurations (parts + 1, k) at even shares of the line, if that suffices; most lines are so easy."""
    marks = np.linspace(0.0, 1.0, 2 * parts + 1)[1:]
    poses = _on(ends, marks)
    path = np.concatenate([start[None], hand.followed(poses[1::2], start)])
    if len(path) <= parts or np.abs(np.diff(path, axis=0)).max() > JUMP_RAD:
        return None
    metres, radians = transforms.difference(poses[::2], hand.poses((path[1:] + path[:-1]) / 2))
    return path if (metres <= STRAY_M).all() and (radians <= STRAY_RAD).all() else None


def _reach_on(
    hand: ArmHand, ends: tuple[Floats, Floats], shares: tuple[float, float], q: Floats, halvings: int
) -> list[Floats] | Broken:
    """The configurations after `q` (k,) between two shares of the line, as many as it takes."""
    there = _next(hand, _on(ends, np.array(shares[1:])), q, shares[1])
    middle = (shares[0] + shares[1]) / 2
    if isinstance(there, Broken) and halvings == 0:
        return there
    if not isinstance(there, Broken):
        halfway = hand.poses(((q + there) / 2)[None])[0]
        metres, radians = transforms.difference(_on(ends, np.array([middle]))[0], halfway)
        if (metres <= STRAY_M and radians <= STRAY_RAD) or halvings == 0:
            return [there]
    first = _reach_on(hand, ends, (shares[0], middle), q, halvings - 1)
    if isinstance(first, Broken):
        return first
    second = _reach_on(hand, ends, (middle, shares[1]), first[-1], halvings - 1)
    return second if isinstance(second, Broken) else [*first, *second]


def _on(ends: tuple[Floats, Floats], shares: Floats) -> Floats:
    """The poses (n, 4, 4) at shares (n,) of the line."""
    start, goal = ends
    vector = transforms.rotation_vector(matmul(start[:3, :3].T, goal[:3, :3]))
    angle = norm(vector)
    turns_at_all = angle > 1e-12
    axis = vector / angle if turns_at_all else np.array([0.0, 0.0, 1.0])
    turned = transforms.rotation(axis, shares * angle * turns_at_all)
    way = shares[:, None] * (goal[:3, 3] - start[:3, 3])
    return transforms.transform(matmul(start[:3, :3], turned), start[:3, 3] + way)


def _next(hand: ArmHand, pose: Floats, q: Floats, share: float) -> Floats | Broken:
    """The configuration (k,) next to `q` for a pose (1, 4, 4), or why there is none."""
    found = hand.followed(pose, q)
    if len(found) and np.abs(found[0] - q).max() <= JUMP_RAD:
        nearest: Floats = found[0]
        return nearest
    return Broken(share, _why(hand, pose, q))


def _why(hand: ArmHand, pose: Floats, q: Floats) -> str:
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
        amount = f"{beyond * 1000:.0f} mm" if joints.prismatic[joint] else f"{np.degrees(beyond):.1f} degrees"
        return f"{name} would have to go {amount} beyond its limit"
    least = float(np.linalg.svd(hand.model.jacobian(own), compute_uv=False)[-1])
    joint = int(np.argmax(np.abs(best - own)))
    name = hand.model.arm.joints[joint].name
    if least < SINGULAR or not len(turns(hand.model, best)):
        return f"the arm comes to a singularity: {name} would have to turn at once"
    return f"only another branch reaches on from there: {name} would have to jump by {np.degrees(np.abs(best - own).max()):.0f} degrees"
