"""Motions of bundled arms among random blocks: how many queries end with a path, with a proof that
there is none, or open.

    python benchmarks/motion_random.py [--cells N] [--blocks N ...] [--arms NAME ...] [--first N]
        [--json FILE]

In each cell four queries go between random free configurations of the arm. Times are processor time
of one call, the scene built beforehand, with short cuts and proof. Every path is looked at again
every 1/320 rad. What stays open is planned again with ten times the work, for the table alone.
RRT-Connect of OMPL gets the same queries where it is installed, with our check, the same step, and
so many looks at configurations; beside it stands how many of our paths were found with no more.
"""

import argparse
import json
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from motion import finely
from rich.console import Console
from rich.table import Table

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import Blocked, Moved, PathQuery
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.motion.path_planner import plan_path
from cellwright.kb.loader.cell import load_cell

ARMS = ("puma_560", "manutec_r3", "t3_746", "ur5")
QUERIES, BUDGET, STEP = 4, 1_000_000, 1 / 32
CLEAR_M, BASE_M = 0.005, 0.7  # how free ends are, and how high arms stand
REACH_M = {"t3_746": 2.5}  # as far as blocks stand from the base of an arm
# blocks keep off the base; their sides, where blocks stand within 1 m
NEAR, SIDES_M = 0.45, (0.05, 0.35)


def random_cell(folder: Path, arm: str, blocks: int, rng: np.random.Generator) -> PlanningScene:
    """An arm among so many blocks, at random places beside its base."""
    size, lines = REACH_M.get(arm, 1.0), list[str]()
    while len(lines) < blocks:
        x, y, z = size * rng.uniform([-1.0, -1.0, -0.7], [1.0, 1.0, 0.9])
        if np.hypot(x, y) < NEAR * size:
            continue
        sides = ", ".join(f"{size * each:.3f}" for each in rng.uniform(*SIDES_M, 3))
        at = f"{x:.3f}, {y:.3f}, {BASE_M + z:.3f}"
        lines.append(f"  block_{len(lines)}: {{at: [{at}], shapes: [{{box: [{sides}]}}]}}")
    head = f"cell: random\narms:\n  arm: {{model: {arm}, at: [0, 0, {BASE_M}]}}\n"
    file = folder / "cell.yaml"
    file.write_text(head + "\n".join([*(["fixtures:"] if lines else []), *lines]) + "\n")
    return PlanningScene(BuiltinChecker(collision_scene_of(GeometricWorld.of(load_cell(file)))))


def ends_of(ground: PlanningScene, rng: np.random.Generator) -> Floats:
    """Random free configurations (2 n, k), at least 5 mm from all."""
    joints = ground.scene.joints
    q = rng.uniform(joints.lower, joints.upper, (400, joints.count))
    found: Floats = q[ground.clearance(q) > CLEAR_M][: 2 * QUERIES]
    return found


def asked(ground: PlanningScene, query: PathQuery) -> dict[str, Any]:
    """What comes of a query."""
    started = time.process_time()
    answer = plan_path(ground, query)
    row: dict[str, Any] = {"ms": (time.process_time() - started) * 1e3}
    match answer:
        case Moved():
            hits = int(ground.collides(finely(answer.path)).sum())
            return {
                **row,
                "end": "path",
                "proved": answer.proved,
                "hits": hits,
                "looked": answer.looked,
            }
        case Blocked():
            return {
                **row,
                "end": "no path, proved" if answer.severed else "open",
                "looked": answer.looked,
            }
    return {**row, "end": "refused"}


def of_ompl(ground: PlanningScene, query: PathQuery, looks: int) -> dict[str, Any]:
    """What RRT-Connect of OMPL makes of it with as many looks at configurations."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LOG_NONE)
    joints, spent = ground.scene.joints, 0
    space = base.RealVectorStateSpace(joints.count)
    bounds = base.RealVectorBounds(joints.count)
    for j in range(joints.count):
        bounds.setLow(j, float(joints.lower[j]))
        bounds.setHigh(j, float(joints.upper[j]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    one = np.empty((1, joints.count))

    def free(state: Any) -> bool:
        nonlocal spent
        spent += 1
        one[0] = [state[j] for j in range(joints.count)]
        return not ground.collides(one)[0]

    information.setStateValidityChecker(free)
    information.setStateValidityCheckingResolution(STEP / space.getMaximumExtent())
    information.setup()
    ends = []
    for q in (query.start, query.goals[0]):
        state = information.allocState()
        for j in range(joints.count):
            state[j] = float(q[j])
        ends.append(state)
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(*ends)
    planner = geometric.RRTConnect(information)
    planner.setProblemDefinition(problem)
    planner.setup()
    started = time.process_time()
    solved = planner.solve(base.PlannerTerminationCondition(lambda: spent >= looks))
    exact = bool(solved) and not problem.hasApproximateSolution()
    return {"solved": exact, "ms": (time.process_time() - started) * 1e3, "looked": spent}


def measured(arm: str, blocks: int, cells: range, peer_looks: int) -> list[dict[str, Any]]:
    """All queries of an arm among so many blocks."""
    rows = []
    for seed in cells:
        rng = np.random.default_rng([seed, blocks, ARMS.index(arm)])
        with TemporaryDirectory() as folder:
            ground = random_cell(Path(folder), arm, blocks, rng)
        for start, goal in ends_of(ground, rng).reshape(-1, 2, ground.scene.joints.count):
            query = PathQuery(start, goal[None], step=STEP, budget=BUDGET)
            row = {"arm": arm, "blocks": blocks, "cell": seed, **asked(ground, query)}
            if row["end"] == "open":
                row["later"] = asked(
                    ground, PathQuery(start, goal[None], step=STEP, budget=10 * BUDGET)
                )["end"]
            if peer_looks and find_spec("ompl"):
                row["ompl"] = of_ompl(ground, query, peer_looks)
            rows.append(row)
    return rows


def shown(rows: list[dict[str, Any]], peer_looks: int) -> Table:
    """The table that people read."""
    peer = ["as few looks", "OMPL", "its ms, 50 %"] if any("ompl" in row for row in rows) else []
    table = Table(
        "arm",
        "blocks",
        "queries",
        "path",
        "none, proved",
        "open",
        "ms, 50 %",
        "95 %",
        "hits",
        *peer,
    )
    for key in dict.fromkeys((row["arm"], row["blocks"]) for row in rows):
        own = [row for row in rows if (row["arm"], row["blocks"]) == key]
        ends = [
            sum(row["end"] == each for row in own) for each in ("path", "no path, proved", "open")
        ]
        marks = np.percentile([row["ms"] for row in own], (50, 95))
        said = [f"{sum(row.get('hits', 0) > 0 for row in own)}"]
        if peer:
            said.append(
                f"{sum(row['end'] == 'path' and row['looked'] <= peer_looks for row in own)}"
            )
            solved = [row["ompl"]["ms"] for row in own if row["ompl"]["solved"]]
            said += [f"{len(solved)}", f"{np.median(solved):.1f}"]
        table.add_row(
            key[0],
            f"{key[1]}",
            f"{len(own)}",
            *map(str, ends),
            *(f"{each:.2f}" for each in marks),
            *said,
        )
    if peer:
        table.caption = f"OMPL looks at no more than {peer_looks:,} configurations"
    return table


def main() -> int:
    """Measure, print, and judge: 1 if a path touches anything at a finer look."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", type=int, default=25)
    parser.add_argument("--first", type=int, default=0, help="the number of the first cell")
    parser.add_argument("--blocks", type=int, nargs="*", default=[10, 40])
    parser.add_argument("--arms", nargs="*", choices=ARMS, default=ARMS[:2])
    parser.add_argument(
        "--ompl", type=int, default=20_000, metavar="LOOKS", help="0 leaves OMPL out"
    )
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    cells = range(arguments.first, arguments.first + arguments.cells)
    rows = [
        row
        for arm in arguments.arms
        for blocks in arguments.blocks
        for row in measured(arm, blocks, cells, arguments.ompl)
    ]
    Console().print(shown(rows, arguments.ompl))
    for row in rows:
        if row["end"] == "open":
            print(
                f"open: {row['arm']}, {row['blocks']} blocks, cell {row['cell']}; with ten "
                f"times the work: {row['later']}"
            )
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")
    return 1 if any(row.get("hits", 0) for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
