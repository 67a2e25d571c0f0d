"""Paths of a UR5 on the problems of MotionBenchMaker: time, length, proof, and an independent check
at a finer step.

    python benchmarks/motion.py [--data FOLDER] [--numbers N] [--first N] [--kinds NAME ...]
        [--json FILE]
    python benchmarks/motion.py --certified 1000 [--data FOLDER] [--numbers N] [--json FILE]

The problems are read from `ur5_mbm` in the folder of the data, by default $CELLWRIGHT_DATA. Scenes
are built beforehand; times are processor time on one core, the best of three calls. Beside ours
stands RRT-Connect of OMPL, where it is installed, with the same step: once with our compiled check
of one configuration per call, and once with MuJoCo's, where that is installed. Problems whose start
or goal is in collision are refused, and counted. Every path is checked again every 1/320 rad, by
coal or MuJoCo where one is installed, else by the plain reference's carrier poses and the batch
check. Exits with 1 when a problem is not solved or a finer look finds a collision.

With `--certified` so many paths are planned and proved, from as many seeds as that takes, and each
that is proved is looked at every hundredth of the step by the batch check in double precision, and
every tenth of it by the other library. It tells how many needed a second plan, or stretches shorter
than the step, and what proofs cost.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from collision import always_touching
from rich.console import Console
from rich.table import Table
from ur5_cells import KINDS, Task, tasks

from cellwright.engine import plugins
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.model.geometry import CollisionScene
from cellwright.engine.model.motion_values import FINEST_M, Moved, PathQuery, RefusedQuery
from cellwright.engine.ports import CollisionChecker
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.motion.path_planner import plan_path, search_path

STEP, FINER, RUNS = 1 / 32, 1 / 320, 3
HUNDREDTH = STEP / 100
DECLARED_M = 0.002  # a margin that paths are planned with
BRIDGES = (200, 600, 2000)  # short cuts tried for the shortest paths known


def timed(run: Callable[[], Any]) -> tuple[float, Any]:
    """The least processor time of a call in milliseconds, and its answer."""
    times = []
    for _ in range(RUNS):
        started = time.process_time()
        answer = run()
        times.append((time.process_time() - started) * 1e3)
    return min(times), answer


def timed_once(run: Callable[[], Any]) -> tuple[float, Any]:
    """The processor time of one call in milliseconds, and its answer."""
    started = time.process_time()
    answer = run()
    return (time.process_time() - started) * 1e3, answer


def independent(scene: CollisionScene) -> CollisionChecker:
    """A checker by another library, where one is installed."""
    name = next((each for each in ("mujoco", "coal") if find_spec(each)), "builtin")
    return plugins.geometry_backend(name).checker(scene)


def finely(path: Floats, step: float = FINER) -> Floats:
    """Configurations of a path at a finer step."""
    parts = [
        a + np.linspace(0, 1, int(np.linalg.norm(b - a) / step) + 2)[:, None] * (b - a)
        for a, b in pairwise(path)
    ]
    return np.concatenate(parts)


def long(path: Floats) -> float:
    """How long a path is, in rad."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def ompl_ms(checker: CollisionChecker, task: Task, seconds: float = 2.0) -> float | None:
    """Milliseconds of OMPL's RRT-Connect with a checker; None where it finds nothing."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LOG_NONE)
    joints, count = checker.scene.joints, checker.scene.joints.count
    space = base.RealVectorStateSpace(count)
    bounds = base.RealVectorBounds(count)
    for j in range(count):
        bounds.setLow(j, float(joints.lower[j]))
        bounds.setHigh(j, float(joints.upper[j]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    one = np.empty((1, count))

    def free(state: Any) -> bool:
        for j in range(count):
            one[0, j] = state[j]
        return not checker.collides(one)[0]

    information.setStateValidityChecker(free)
    information.setStateValidityCheckingResolution(STEP / space.getMaximumExtent())
    information.setup()
    ends = []
    for q in task.ends:
        state = information.allocState()
        for j in range(count):
            state[j] = float(q[j])
        ends.append(state)
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(*ends)
    planner = geometric.RRTConnect(information)
    planner.setProblemDefinition(problem)
    planner.setup()
    started = time.process_time()
    solved = planner.solve(seconds)
    return (time.process_time() - started) * 1e3 if solved else None


def measure(task: Task, allowed: frozenset[frozenset[str]], peers: bool) -> dict[str, Any]:
    """What one problem takes."""
    scene = collision_scene_of(task.world, allowed=allowed)
    ground = PlanningScene(BuiltinChecker(scene))
    ground.lines(STEP)
    ground.proof(0.0, 1.0)
    query = PathQuery(task.ends[0], task.ends[1:], step=STEP)
    row: dict[str, Any] = {"problem": task.name}
    if isinstance(plan_path(ground, query), RefusedQuery):
        return {**row, "status": "refused"}
    bare = PathQuery(task.ends[0], task.ends[1:], step=STEP, bridges=0)
    row["search_ms"], found = timed(lambda: search_path(ground, bare))
    if not isinstance(found, Moved):
        return {**row, "status": "not found"}
    row["short_ms"], short = timed(lambda: search_path(ground, query))
    row["whole_ms"], whole = timed(lambda: plan_path(ground, query))
    row["declared_ms"], _ = timed(lambda: plan_path(ground, replace(query, margin_m=DECLARED_M)))
    more = [timed_once(lambda n=n: search_path(ground, replace(query, bridges=n))) for n in BRIDGES]
    row |= {
        "status": "solved",
        "lengths": [long(each.path) for each in (found, short, whole, *(each for _, each in more))],
        "refining_ms": [spent for spent, _ in more],
        "proved": whole.proved,
        "looked": found.looked,
        "stretches": whole.stretches,
        "again": whole.cleared_m > 0.0,
        "hits": int(independent(scene).collides(finely(whole.path)).sum()),
    }
    if peers:
        row["ompl_ms"] = ompl_ms(ground, task)
    if peers and find_spec("mujoco"):
        row["ompl_mujoco_ms"] = ompl_ms(plugins.geometry_backend("mujoco").checker(scene), task)
    return row


def certified(
    ground: PlanningScene, other: CollisionChecker, task: Task, seed: int
) -> dict[str, Any] | None:
    """A path from a seed, planned, proved, and looked at every hundredth of the step; None where
    the ends are refused.

    Another library looks, too, at the finer step.
    """
    query = PathQuery(task.ends[0], task.ends[1:], step=STEP, seed=seed)
    spent, found = timed_once(lambda: plan_path(ground, query))
    if isinstance(found, RefusedQuery):
        return None
    row = {
        "problem": task.name,
        "seed": seed,
        "proved": isinstance(found, Moved) and found.proved,
        "plan_ms": spent,
    }
    if not row["proved"]:
        return row
    proof = ground.proof(0.0, FINEST_M)
    spent, _ = timed_once(lambda: proved(proof, found.path))
    looks, others = finely(found.path, HUNDREDTH), finely(found.path)
    return {
        **row,
        "proof_ms": spent,
        "again": found.cleared_m > 0.0,
        "shorter": proof.shortest < STEP,
        "halved": proof.refined,
        "looks": len(looks),
        "hits": int(ground.collides(looks).sum()),
        "others": len(others),
        "other_hits": int(other.collides(others).sum()),
    }


def trial(
    chosen: list[Task], allowed: frozenset[frozenset[str]], count: int
) -> list[dict[str, Any]]:
    """So many certified paths, of the problems in turn and of ever more seeds."""
    grounds = [
        PlanningScene(BuiltinChecker(collision_scene_of(task.world, allowed=allowed)))
        for task in chosen
    ]
    others = [independent(ground.scene) for ground in grounds]
    rows: list[dict[str, Any]] = []
    for seed in range(count):
        for ground, other, task in zip(grounds, others, chosen, strict=True):
            row = certified(ground, other, task, seed) if len(rows) < count else None
            rows += [row] if row else []
    return rows


def told(rows: list[dict[str, Any]]) -> str:
    """What the trial of certification found."""
    sure = [row for row in rows if row["proved"]]
    marks = np.percentile([row["proof_ms"] for row in sure], (50, 95, 100))
    return (
        f"{len(sure)} of {len(rows)} paths proved; {sum(row['hits'] > 0 for row in sure)} of "
        "them touch something in "
        f"{sum(row['looks'] for row in sure):,} looks every hundredth of the step, "
        f"{sum(row['other_hits'] > 0 for row in sure)} "
        f"in {sum(row['others'] for row in sure):,} looks every tenth of it by another library; "
        f"{np.mean([not row['again'] for row in sure]):.1%} needed no second plan, "
        f"{np.mean([not row['shorter'] for row in sure]):.1%} no stretch shorter than the step; "
        f"a proof takes {marks[0]:.2f} ms in the median, {marks[1]:.2f} at 95 %, {marks[2]:.2f} "
        "at most"
    )


def shown(rows: list[dict[str, Any]]) -> Table:
    """The table that people read."""
    table = Table("what", "median", "95 %", "most")
    solved = [row for row in rows if row["status"] == "solved"]
    names = {
        "search_ms": "search, ms",
        "short_ms": "with short cuts, ms",
        "whole_ms": "with checked ends and proof, ms",
        "declared_ms": f"the same, {DECLARED_M * 1000:.0f} mm kept everywhere, ms",
    }
    peers = {
        "ompl_ms": "RRT-Connect of OMPL, our check, ms",
        "ompl_mujoco_ms": "the same, MuJoCo's check, ms",
    }
    for key, said in {**names, **peers, "looked": "configurations"}.items():
        values = [row[key] for row in solved if row.get(key) is not None]
        if values:
            marks = (np.median(values), np.percentile(values, 95), np.max(values))
            table.add_row(said, *(f"{each:,.2f}" for each in marks))
    said_of = {0: "length of the first path", 1: "with short cuts", 2: "proved"}
    said_of |= {3 + n: f"with {tried} bridges tried" for n, tried in enumerate(BRIDGES)}
    for n, tried in enumerate(BRIDGES):
        spent = [row["refining_ms"][n] for row in solved]
        marks = (np.median(spent), np.percentile(spent, 95), np.max(spent))
        table.add_row(f"with {tried} bridges tried, ms", *(f"{each:,.2f}" for each in marks))
    for at, said in said_of.items():
        ratios = [row["lengths"][at] / min(row["lengths"]) for row in solved]
        table.add_row(
            f"{said}, of the best known",
            f"{np.median(ratios):.3f}",
            f"{np.percentile(ratios, 95):.3f}",
            f"{max(ratios):.3f}",
        )
    return table


def main() -> int:
    """Measure, print, and judge."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=os.environ.get("CELLWRIGHT_DATA"))
    parser.add_argument("--numbers", type=int, default=20, help="problems of each kind")
    parser.add_argument(
        "--first", type=int, default=1, help="the number of the first problem of each kind"
    )
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=list(KINDS))
    parser.add_argument(
        "--certified",
        type=int,
        default=0,
        metavar="N",
        help="paths that are proved and looked at finely",
    )
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if arguments.data is None:
        parser.error("give --data or set CELLWRIGHT_DATA")
    chosen = tasks(
        Path(arguments.data) / "ur5_mbm",
        range(arguments.first, arguments.first + arguments.numbers),
    )
    chosen = [task for task in chosen if task.name.split()[0] in arguments.kinds]
    allowed, peers = always_touching(chosen[0]), find_spec("ompl") is not None
    if arguments.certified:
        rows = trial(chosen, allowed, arguments.certified)
        print(told(rows))
        if arguments.json:
            arguments.json.write_text(json.dumps(rows, indent=1) + "\n")
        return 1 if any(row.get("hits", 0) + row.get("other_hits", 0) for row in rows) else 0
    rows = [measure(task, allowed, peers) for task in chosen]
    Console().print(shown(rows))
    counts = {
        each: sum(row["status"] == each for row in rows)
        for each in ("solved", "refused", "not found")
    }
    sure = sum(row.get("proved", False) for row in rows)
    hits = sum(row.get("hits", 0) > 0 for row in rows)
    print(f"{counts}, {sure} proved, {hits} in collision at a finer step")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")
    return 1 if hits or counts["not found"] else 0


if __name__ == "__main__":
    sys.exit(main())
