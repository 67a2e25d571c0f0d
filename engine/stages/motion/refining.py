"""Shorter paths on demand: the more work, the nearer to the least time that the joints need. The work can end at any time.

The time of a path is that of its slowest joint on each line, added up. Two things take turns: trees grow anew, within the box
outside of which no better path can pass (informed sampling, Gammell and others 2014), and the corners of the best path are
pulled towards the straight line between their neighbours.
"""

from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.geometry.edges import Edges, free_edges
from cellwright.engine.kernels.motion.connect import Trees, connect
from cellwright.engine.kernels.motion.shorten import Route, shorten
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.motion import Moved, Query
from cellwright.engine.ports import MotionGround
from cellwright.engine.stages.motion.planner import NODES, REACH, bounds, shifted
from cellwright.engine.stages.motion.proving import WIDER_M, room_at_ends, with_proof

PULLS = (1.0, 0.5, 0.25, 0.1)  # how far a corner is pulled
SWEEPS = 30  # over all corners, before trees grow anew
BRIDGES = 200
SHARE = 0.2  # of the work that one pair of trees may take
LEAST = 1e-4  # a gain that counts, as a share of the time


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """The best path, and how its time (s) fell: after so many configurations looked at, it was so long."""

    found: Moved
    course: tuple[tuple[int, float], ...]


def time_of(path: Floats, speeds: Floats) -> float:
    """The time (s) of a path (m, k) whose joints have speeds (k,); a joint that stands still has any speed."""
    return float((np.abs(np.diff(path, axis=0)) / speeds).max(axis=1).sum())


def refined(ground: MotionGround, query: Query, first: Moved, speeds: Floats, work: int) -> Refined:
    """The path made shorter, until `work` configurations have been looked at. It is not proved."""
    lines, best = ground.lines(query.step, query.margin_m), first.path
    course, seed = [(0, time_of(best, speeds))], query.seed
    best = _pulled(lines, best, speeds, work)
    course.append((int(lines.looked), time_of(best, speeds)))
    least = (np.abs(query.goals - query.start) / speeds).max(axis=1)
    while lines.looked < work and least.min() < time_of(best, speeds) * (1.0 - LEAST):
        seed += 1
        nearer = replace(query, goals=np.ascontiguousarray(query.goals[least < time_of(best, speeds)]))
        other = _anew(ground, lines, nearer, (best, speeds), seed, work)
        if other is None:
            continue
        other = _pulled(lines, other, speeds, work)
        if time_of(other, speeds) < time_of(best, speeds):
            best = other
            course.append((int(lines.looked), time_of(best, speeds)))
    goal = int(np.argmin(np.abs(query.goals - best[-1]).max(axis=1)))
    looked = first.looked + int(lines.looked)
    return Refined(replace(first, path=best, goal=goal, looked=looked, proved=False), tuple(course))


def _anew(
    ground: MotionGround, lines: Edges, query: Query, known: tuple[Floats, Floats], seed: int, work: int
) -> Floats | None:
    """Another path, by trees in the box around all better ones."""
    best, speeds = known
    low, high = bounds(ground.scene.joints, query)
    half = time_of(best, speeds) * speeds / 2
    ends = np.vstack([query.start[None], query.goals])
    middle = (query.start + query.goals) / 2
    low = np.maximum(low, np.minimum((middle - half).min(axis=0), ends.min(axis=0)))
    high = np.minimum(high, np.maximum((middle + half).max(axis=0), ends.max(axis=0)))
    trees = Trees(query.start[None], query.goals, low, high, shifted(seed, len(low)), REACH, NODES)
    until = min(work, int(lines.looked) + max(2000, int(SHARE * work)))
    if not connect(trees, lines, until):
        return None
    route = Route(trees.path(), BRIDGES)
    shorten(route, lines, BRIDGES, work)
    return route.path()


def _pulled(lines: Edges, path: Floats, speeds: Floats, work: int) -> Floats:
    """The path with each corner pulled as far as its lines stay free, and new corners beside sharp ones."""
    for _ in range(SWEEPS):
        before = time_of(path, speeds)
        if len(path) < 3 or lines.looked >= work:
            break
        n = 1
        while n < len(path) - 1:
            path, n = _pull(lines, path, n, speeds)
        if time_of(path, speeds) > before * (1.0 - LEAST):
            if len(path) > 40:
                break
            finer = _split(path)
            if time_of(finer, speeds) > before or len(finer) == len(path):
                break
            path = finer
    return _without_idle(lines, path, speeds)


def _pull(lines: Edges, path: Floats, n: int, speeds: Floats) -> tuple[Floats, int]:
    """The path with corner `n` pulled, or left out, and the corner to look at next."""
    before, here, after = path[n - 1], path[n], path[n + 1]
    ways = [float((np.abs(here - each) / speeds).max()) for each in (before, after)]
    if _free(lines, np.array([before, after])):
        return np.delete(path, n, axis=0), n
    straight = before + (after - before) * (ways[0] / max(sum(ways), 1e-12))
    for pull in PULLS:
        there = here + pull * (straight - here)
        part = np.array([before, there, after])
        if time_of(part, speeds) < sum(ways) * (1.0 - LEAST) and _free(lines, part):
            changed = path.copy()
            changed[n] = there
            return changed, n + 1
    return path, n + 1


def _split(path: Floats) -> Floats:
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
        same = time_of(part[[0, 2]], speeds) <= time_of(part, speeds) + 1e-12
        if same and _free(lines, part[[0, 2]]):
            path = np.delete(path, n, axis=0)
        else:
            n += 1
    return path


def _free(lines: Edges, path: Floats) -> bool:
    """Whether all lines of a path (m, k) are free, by what is looked at."""
    out = np.zeros(len(path) - 1, dtype=np.uint8)
    free_edges(lines, np.ascontiguousarray(path[:-1]), np.ascontiguousarray(path[1:]), out)
    return bool(out.all())


def proved_and_refined(
    ground: MotionGround, query: Query, first: Moved, speeds: Floats, work: int
) -> Refined:
    """The same with a proof: the path keeps a little off, and the first path stays where the better one cannot be proved."""
    wider = query.margin_m + min(WIDER_M, 0.5 * room_at_ends(ground, query))
    found = refined(ground, replace(query, step=query.step / 2, margin_m=wider), first, speeds, work)
    if time_of(found.found.path, speeds) >= time_of(first.path, speeds):
        return replace(found, found=first)
    made = with_proof(ground, replace(found.found, cleared_m=wider), query.margin_m)
    return replace(found, found=made if made.proved else first)
