"""The path of a hand to its grasp in the grasp plane, among what is seen around the part.

The plane is midway between the two facets that are held. The hand moves in it by y and z and turns
about the closing direction. Fingers, cross-piece and sensor each lie in their own layer along this
direction, so each meets only the obstacles of its layer. `complete` looks at all poses of a grid,
so it finds a way if the grid has one. `by_potential` is the seed's way: quick, and stuck where pull
and push are in balance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.model.manipulation_values import ApproachAnswer, HandApproach, NoApproach
from cellwright.engine.ports import Gripper


@dataclass(frozen=True, slots=True, eq=False)
class GraspPlane:
    """What stands around a grasp: obstacle points (n, 3) in the frame of the hand at the grasp,
    and how it is opened.
    """

    points: Floats
    hand: Gripper
    opening: tuple[float, ...]

    def layers(self) -> list[tuple[Floats, Floats, Floats]]:
        """For each block of the hand: its middle (2,) and half extents (2,) in the plane, and
        its obstacles (m, 2).
        """
        layers = []
        for middle, half in zip(*self.hand.blocks(self.opening), strict=True):
            inside = np.abs(self.points[:, 0] - middle[0]) < half[0]
            layers.append((middle[1:], half[1:], self.points[inside, 1:]))
        return layers

    def free(self, poses: Floats) -> Truths:
        """Whether the hand meets no obstacle at poses (n, 3) as y, z and turn (n,)."""
        is_free = np.ones(len(poses), dtype=bool)
        for middle, half, points in self.layers():
            local = _turned_back(points[None] - poses[:, None, :2], poses[:, 2]) - middle
            inside: Truths = np.asarray((np.abs(local) < half).all(axis=2))
            is_free &= ~inside.any(axis=1)
        return is_free


def _turned_back(points: Floats, turn: Floats) -> Floats:
    """Points (n, m, 2) in frames turned by (n,)."""
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    y, z = points[..., 0], points[..., 1]
    turned_points: Floats = np.stack([c * y + s * z, -s * y + c * z], axis=2)
    return turned_points


@dataclass(frozen=True, slots=True)
class ApproachGrid:
    """The poses that `complete` looks at: within `reach_m` of the grasp, every `step_m`, at
    `turns` angles of a whole turn.
    """

    reach_m: float = 0.3
    step_m: float = 0.005
    turns: int = 36

    @property
    def side(self) -> int:
        """The number of places along y, and along z."""
        return 2 * round(self.reach_m / self.step_m) + 1

    def pose(self, cell: tuple[int, ...]) -> Floats:
        """The pose (3,) of a cell (turn, y, z)."""
        turn, y, z = cell
        middle = self.side // 2
        angle = (turn + self.turns // 2) % self.turns - self.turns // 2
        return np.array(
            [(y - middle) * self.step_m, (z - middle) * self.step_m, angle * 2 * np.pi / self.turns]
        )

    def cell(self, pose: Floats) -> tuple[int, int, int]:
        """The nearest cell of a pose (3,)."""
        middle = self.side // 2
        y, z = (round(float(x) / self.step_m) + middle for x in pose[:2])
        return round(float(pose[2]) / (2 * np.pi) * self.turns) % self.turns, y, z


def plan_approach(
    plane: GraspPlane, start: Floats, grid: ApproachGrid | None = None
) -> ApproachAnswer:
    """A shortest way on a grid from a pose (3,) to the grasp, which is (0, 0, 0)."""
    grid = grid or ApproachGrid()
    blocked = _blocked_cells(plane, grid)
    begin, end = grid.cell(start), grid.cell(np.zeros(3))
    if not all(0 <= x < grid.side for x in begin[1:]):
        return NoApproach("the start lies outside the grid", start)
    for name, cell in (("start", begin), ("grasp", end)):
        if blocked[cell]:
            return NoApproach(f"at the {name} the hand meets something", grid.pose(cell))
    distance = _distance_wave(blocked, end, begin)
    if distance[begin] < 0:
        inner = np.argwhere(distance >= 0)
        near = inner[np.argmin(np.abs(inner[:, 1:] - begin[1:]).sum(axis=1))]
        return NoApproach(
            "what stands around the part closes every way", grid.pose(tuple(map(int, near)))
        )
    cells = _descend_to_grasp(distance, begin)
    return HandApproach(np.array([start, *(grid.pose(cell) for cell in cells[1:-1]), np.zeros(3)]))


def _blocked_cells(plane: GraspPlane, grid: ApproachGrid) -> Truths:
    """Which cells (turns, side, side) the hand may not take, widened by half a cell."""
    blocked = np.zeros((grid.turns, grid.side, grid.side), dtype=bool)
    places = np.asarray((np.arange(grid.side) - grid.side // 2) * grid.step_m, dtype=float)
    for turn in range(grid.turns):
        angle = grid.pose((turn, 0, 0))[2]
        c, s = np.cos(angle), np.sin(angle)
        for middle, half, points in plane.layers():
            _mark_rectangles(
                blocked[turn],
                points - np.array([[c, -s], [s, c]]) @ middle,
                half + grid.step_m / 2,
                (c, s),
                places,
            )
    return blocked


def _mark_rectangles(
    layer: Truths, centres: Floats, half: Floats, turned: tuple[float, float], places: Floats
) -> None:
    """Mark the places (side, side) within a turned rectangle about each of some points (m, 2)."""
    if not len(centres):
        return
    c, s = turned
    step = places[1] - places[0]
    shown = np.zeros(layer.shape, dtype=bool)
    at = np.rint(centres / step).astype(int) + len(places) // 2
    inside = ((at >= -80) & (at < len(places) + 80)).all(axis=1)
    wide = np.pad(shown, 80)
    wide[at[inside, 0] + 80, at[inside, 1] + 80] = True
    reach = int(np.ceil(np.linalg.norm(half) / step))
    y, z = np.mgrid[-reach : reach + 1, -reach : reach + 1] * step
    stamp = (np.abs(c * y + s * z) < half[0] + step / 2) & (
        np.abs(-s * y + c * z) < half[1] + step / 2
    )

    layer |= _dilate_marks(wide, stamp)[80:-80, 80:-80]


def _dilate_marks(marks: Truths, stamp: Truths) -> Truths:
    """Where a stamp (2a + 1, 2b + 1) reaches that is centred at each of the marks (n, m)."""
    sizes = [
        next_fast_len(n + k - 1, real=True) for n, k in zip(marks.shape, stamp.shape, strict=True)
    ]
    spectra = (rfft2(picture.astype(np.float32), sizes) for picture in (marks, stamp))
    first, second = (k // 2 for k in stamp.shape)
    counted = irfft2(next(spectra) * next(spectra), sizes)
    dilated: Truths = (
        counted[first : first + marks.shape[0], second : second + marks.shape[1]] > 0.5
    )
    return dilated


def _distance_wave(blocked: Truths, end: tuple[int, ...], begin: tuple[int, ...]) -> Longs:
    """The number of steps from each free cell to the end, until the beginning is reached; -1
    beyond.
    """
    distance = np.full(blocked.shape, -1, dtype=np.int64)
    front = np.zeros(blocked.shape, dtype=bool)
    front[end], distance[end], step = True, 0, 0
    while front.any() and distance[begin] < 0:
        step += 1
        wide = front.copy()
        wide |= np.roll(front, 1, axis=0) | np.roll(front, -1, axis=0)
        wide[:, 1:] |= front[:, :-1]
        wide[:, :-1] |= front[:, 1:]
        wide[:, :, 1:] |= front[:, :, :-1]
        wide[:, :, :-1] |= front[:, :, 1:]
        front = wide & ~blocked & (distance < 0)
        distance[front] = step
    return distance


def _descend_to_grasp(distance: Longs, begin: tuple[int, int, int]) -> list[tuple[int, int, int]]:
    """The cells from the beginning down to the end."""
    cells, at = [begin], begin
    turns, side, _ = distance.shape
    while distance[at] > 0:
        turn, y, z = at
        options = [((turn + 1) % turns, y, z), ((turn - 1) % turns, y, z)]
        options += [(turn, y + a, z + b) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        at = next(
            cell
            for cell in options
            if 0 <= cell[1] < side and 0 <= cell[2] < side and distance[cell] == distance[at] - 1
        )
        cells.append(at)
    return cells


def approach_by_potential(plane: GraspPlane, start: Floats, rounds: int = 600) -> ApproachAnswer:
    """The way that pull towards the grasp and push from obstacles lead (Khatib 1986); stuck in a
    balance of both.

    The pull acts on the point between the tips, and on the turn. Each block is pushed by the
    nearest of its obstacles.
    """
    pose, path = np.array(start, dtype=float), [np.array(start, dtype=float)]
    if not plane.free(np.zeros((1, 3)))[0] or not plane.free(pose[None])[0]:
        return NoApproach("at the start or at the grasp the hand meets something", pose)
    for _ in range(rounds):
        if np.linalg.norm(pose[:2]) < 0.002 and abs(pose[2]) < 0.02:
            return HandApproach(np.array([*path, np.zeros(3)]))
        force = _pull_to_grasp(pose) + _push_from_obstacles(plane, pose)
        length = float(np.linalg.norm(force * [1.0, 1.0, 0.1]))
        step = (
            force
            / max(length, 1e-9)
            * min(0.004, 0.3 * max(float(np.linalg.norm(pose * [1, 1, 0.1])), 0.002))
        )
        moved = next(
            (pose + step * k for k in (1.0, 0.3, 0.1) if plane.free((pose + step * k)[None])[0]),
            None,
        )
        if moved is None or (len(path) > 20 and np.abs(moved - path[-20]).max() < 0.002):
            return NoApproach("pull and push are in balance before the grasp", pose)
        pose = moved
        path.append(pose)
    return NoApproach("the hand did not arrive", pose)


def _pull_to_grasp(pose: Floats) -> Floats:
    away = float(np.linalg.norm(pose[:2]))
    return -np.array([*(pose[:2] / max(away, 0.02)), 8.0 * pose[2]])


def _push_from_obstacles(plane: GraspPlane, pose: Floats, reach_m: float = 0.02) -> Floats:
    """Pushes on the hand (3,) from the nearest obstacle of each block."""
    force = np.zeros(3)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    R = np.array([[c, -s], [s, c]])
    for middle, half, points in plane.layers():
        if not len(points):
            continue
        local = (points - pose[:2]) @ R - middle
        nearest = np.clip(local, -half, half)
        away = np.linalg.norm(local - nearest, axis=1)
        n = int(np.argmin(away))
        if 0 < away[n] < reach_m:
            push = (
                R
                @ (nearest[n] - local[n])
                / away[n]
                * 0.6
                * (reach_m / away[n] - 1)
                * reach_m
                / 0.02
            )
            arm = R @ (nearest[n] + middle)
            force += [push[0], push[1], 20.0 * (arm[0] * push[1] - arm[1] * push[0])]
    return force
