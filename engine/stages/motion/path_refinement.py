"""Shorter paths on demand: the more work, the nearer to the least time that the joints need.

The time of a path is that of its slowest joint on each line, added up. Two things take turns: trees
grow anew, within the box outside of which no better path can pass (informed sampling, Gammell and
others 2014), and the corners of the best path are pulled towards the straight line between their
neighbours.
"""

from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.edges import Edges, free_edges
from cellwright.engine.kernels.motion.connect import Trees, connect
from cellwright.engine.kernels.motion.shorten import Route, shorten
from cellwright.engine.model.motion_values import Moved, PathQuery
from cellwright.engine.ports import MotionScene
from cellwright.engine.stages.motion.path_planner import (
    MAX_BRANCH,
    MAX_TREE_NODES,
    sampling_bounds,
    seed_shift,
)
from cellwright.engine.stages.motion.path_proofs import WIDER_M, prove_moved, spare_margin_at_ends

CORNER_PULLS = (1.0, 0.5, 0.25, 0.1)  # how far a corner is pulled
CORNER_SWEEPS = 30  # over all corners, before trees grow anew
BRIDGES_TRIED = 200
MAX_TREE_WORK_SHARE = 0.2  # of the work that one pair of trees may take
MIN_TIME_GAIN = 1e-4  # a gain that counts, as a share of the time


@dataclass(frozen=True, slots=True, eq=False)
class RefinedPath:
    """The best path, and how its time (s) fell: after so many configurations looked at, it was
    so long.
    """

    found: Moved
    course: tuple[tuple[int, float], ...]


def path_time_s(path: Floats, speeds: Floats) -> float:
    """The time (s) of a path (m, k) whose joints have speeds (k,); a joint that stands still
    has any speed.
    """
    return float((np.abs(np.diff(path, axis=0)) / speeds).max(axis=1).sum())


def refine_path(
    ground: MotionScene, query: PathQuery, first: Moved, speeds: Floats, work: int
) -> RefinedPath:
    """The path made shorter, until `work` configurations have been looked at. It is not proved."""
    lines, best = ground.lines(query.step, query.margin_m), first.path
    course, seed = [(0, path_time_s(best, speeds))], query.seed
    best = _pull_corners(lines, best, speeds, work)
    course.append((int(lines.looked), path_time_s(best, speeds)))
    least = (np.abs(query.goals - query.start) / speeds).max(axis=1)
    while lines.looked < work and least.min() < path_time_s(best, speeds) * (1.0 - MIN_TIME_GAIN):
        seed += 1
        nearer = replace(
            query, goals=np.ascontiguousarray(query.goals[least < path_time_s(best, speeds)])
        )
        another = _plan_anew(ground, lines, nearer, (best, speeds), seed, work)
        if another is None:
            continue
        another = _pull_corners(lines, another, speeds, work)
        if path_time_s(another, speeds) < path_time_s(best, speeds):
            best = another
            course.append((int(lines.looked), path_time_s(best, speeds)))
    goal = int(np.argmin(np.abs(query.goals - best[-1]).max(axis=1)))
    looked = first.looked + int(lines.looked)
    return RefinedPath(
        replace(first, path=best, goal=goal, looked=looked, proved=False), tuple(course)
    )


def _plan_anew(
    ground: MotionScene,
    lines: Edges,
    query: PathQuery,
    known: tuple[Floats, Floats],
    seed: int,
    work: int,
) -> Floats | None:
    """Another path, by trees in the box around all better ones."""
    best, speeds = known
    low, high = sampling_bounds(ground.scene.joints, query)
    half = path_time_s(best, speeds) * speeds / 2
    ends = np.vstack([query.start[None], query.goals])
    middle = (query.start + query.goals) / 2
    low = np.maximum(low, np.minimum((middle - half).min(axis=0), ends.min(axis=0)))
    high = np.minimum(high, np.maximum((middle + half).max(axis=0), ends.max(axis=0)))
    trees = Trees(
        query.start[None],
        query.goals,
        low,
        high,
        seed_shift(seed, len(low)),
        MAX_BRANCH,
        MAX_TREE_NODES,
    )
    until = min(work, int(lines.looked) + max(2000, int(MAX_TREE_WORK_SHARE * work)))
    if not connect(trees, lines, until):
        return None
    route = Route(trees.path(), BRIDGES_TRIED)
    shorten(route, lines, BRIDGES_TRIED, work)
    return route.path()


def _pull_corners(lines: Edges, path: Floats, speeds: Floats, work: int) -> Floats:
    """The path with each corner pulled as far as its lines stay free, and new corners beside
    sharp ones.
    """
    for _ in range(CORNER_SWEEPS):
        before = path_time_s(path, speeds)
        if len(path) < 3 or lines.looked >= work:
            break
        n = 1
        while n < len(path) - 1:
            path, n = _pull_corner(lines, path, n, speeds)
        if path_time_s(path, speeds) > before * (1.0 - MIN_TIME_GAIN):
            if len(path) > 40:
                break
            finer = _split_lines(path)
            if path_time_s(finer, speeds) > before or len(finer) == len(path):
                break
            path = finer
    return _without_idle(lines, path, speeds)


def _pull_corner(lines: Edges, path: Floats, n: int, speeds: Floats) -> tuple[Floats, int]:
    """The path with corner `n` pulled, or left out, and the corner to look at next."""
    before, corner, after = path[n - 1], path[n], path[n + 1]
    ways = [float((np.abs(corner - neighbour) / speeds).max()) for neighbour in (before, after)]
    if _lines_free(lines, np.array([before, after])):
        return np.delete(path, n, axis=0), n
    straight = before + (after - before) * (ways[0] / max(sum(ways), 1e-12))
    for pull in CORNER_PULLS:
        moved_corner = corner + pull * (straight - corner)
        part = np.array([before, moved_corner, after])
        if path_time_s(part, speeds) < sum(ways) * (1.0 - MIN_TIME_GAIN) and _lines_free(
            lines, part
        ):
            changed = path.copy()
            changed[n] = moved_corner
            return changed, n + 1
    return path, n + 1


def _split_lines(path: Floats) -> Floats:
    """The path with a new corner in the middle of each line, which changes nothing by itself."""
    middles = (path[1:] + path[:-1]) / 2
    rows = np.empty((2 * len(path) - 1, path.shape[1]))
    rows[::2], rows[1::2] = path, middles
    return rows


def _without_idle(lines: Edges, path: Floats, speeds: Floats) -> Floats:
    """The path without corners that can be left out at no cost."""
    n = 1
    while n < len(path) - 1:
        part = path[n - 1 : n + 2]
        same = path_time_s(part[[0, 2]], speeds) <= path_time_s(part, speeds) + 1e-12
        if same and _lines_free(lines, part[[0, 2]]):
            path = np.delete(path, n, axis=0)
        else:
            n += 1
    return path


def _lines_free(lines: Edges, path: Floats) -> bool:
    """Whether all lines of a path (m, k) are free, by what is looked at."""
    out = np.zeros(len(path) - 1, dtype=np.uint8)
    free_edges(lines, np.ascontiguousarray(path[:-1]), np.ascontiguousarray(path[1:]), out)
    return bool(out.all())


def refine_and_prove(
    ground: MotionScene, query: PathQuery, first: Moved, speeds: Floats, work: int
) -> RefinedPath:
    """The same with a proof: the path keeps a little off, and the first path stays where the
    better one cannot be proved.
    """
    wider = query.margin_m + min(WIDER_M, 0.5 * spare_margin_at_ends(ground, query))
    refinement = refine_path(
        ground, replace(query, step=query.step / 2, margin_m=wider), first, speeds, work
    )
    if path_time_s(refinement.found.path, speeds) >= path_time_s(first.path, speeds):
        return replace(refinement, found=first)
    proved_path = prove_moved(ground, replace(refinement.found, cleared_m=wider), query.margin_m)
    return replace(refinement, found=proved_path if proved_path.proved else first)
