"""Order and poses together against tour-then-poses, on the 245 drilling targets of RoboTSP with a
UR5.

    python benchmarks/poses.py [--data FOLDER] [--seed N] [--json FILE]

FOLDER (or the environment variable CELLWRIGHT_DATA) has `robotsp/targets_245.csv`: positions in
metres, directions. The base of the UR5 stands at the origin of the targets' frame; the drill is 0.1
m long and lies along the flange's z. About its axis the drill may be turned in steps of 30 degrees,
and every branch of the inverse kinematics counts, angles in (-180, 180] degrees. The tour begins
and ends at (0, -90, 0, -90, 0, 0) degrees; a move takes as long as its slowest joint. Exits with 1
when it is not at least 15 % below tour-then-poses or takes over 2 s after inverse kinematics.

A second baseline has a near-optimal tour of the positions in place of nearest neighbour and
two-edge exchange.
"""

import argparse
import json
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from cellwright.engine.model.tour_problem import PoseProblem, Tour, TourProblem, Visit
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import ArmModel
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import InverseKinematics
from cellwright.engine.stages.sequencing import TourLimits, sequence_tour
from cellwright.engine.stages.sequencing.pose_tours import poses_for, tour_then_poses, with_poses
from cellwright.kb.loader.arm_file import bundled_arms, load_arm

DRILL_M = 0.1
TURNS = 12
HOME = np.radians([[0.0, -90.0, 0.0, -90.0, 0.0, 0.0]])
BAR, SECONDS = 0.15, 2.0


def flange_poses(target: NDArray[np.float64]) -> NDArray[np.float64]:
    """T_base_flange (12, 4, 4) for one row of the table: the drill's tip at the target, its
    axis along the direction.
    """
    z = target[3:] / np.linalg.norm(target[3:])
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    facing = np.stack([x, np.cross(z, x), z], axis=1)
    turned = [
        facing @ transforms.rotation((0.0, 0.0, 1.0), 2 * math.pi * k / TURNS) for k in range(TURNS)
    ]
    return transforms.transform(np.array(turned), target[:3] - DRILL_M * z)


def problem_of(file: Path) -> tuple[PoseProblem, float]:
    """The visits with all their poses, and the seconds that inverse kinematics took."""
    targets = np.loadtxt(file, delimiter=",", skiprows=1)
    model = ArmModel(load_arm(bundled_arms()["ur5"]))
    kinematics = InverseKinematics(model)
    flanges = np.concatenate([flange_poses(target) for target in targets])
    kinematics.solve(flanges[:1])  # loads the kernels
    started = time.perf_counter()
    found = kinematics.solve(flanges)
    spent = time.perf_counter() - started
    q, valid = found.q.reshape(len(targets), -1, 6), found.valid.reshape(len(targets), -1)
    visits = [Visit(str(i), tuple(map(float, target[:3]))) for i, target in enumerate(targets, 1)]
    poses = [q[i][valid[i]] for i in range(len(targets))]
    speeds = np.array([joint.speed for joint in model.arm.joints], float)
    return PoseProblem("robotsp", (Visit("home"), *visits), (HOME, *poses), speeds), spent


def near_optimal_then_poses(problem: PoseProblem) -> Tour:
    """The best poses for a near-optimal tour of the positions."""
    places = np.array([visit.position for visit in problem.visits[1:]])
    lines = np.rint(1e6 * np.linalg.norm(places[:, None] - places[None], axis=2)).astype(np.int64)
    tour = sequence_tour(
        TourProblem("positions", problem.visits[1:], lines, closed=False), TourLimits(proof=0)
    )
    assert isinstance(tour, Tour)
    return poses_for(problem, (0, *(visit + 1 for visit in tour.order)))


def main() -> int:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description="order and poses on robotsp")
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("CELLWRIGHT_DATA", "../shared/data"))
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    problem, kinematics = problem_of(options.data / "robotsp" / "targets_245.csv")
    with_poses(problem, TourLimits(work=1))  # loads the kernels
    baseline = tour_then_poses(problem)
    rows: list[dict[str, Any]] = []
    for name, run in (
        ("tour-then-poses", lambda: tour_then_poses(problem)),
        ("near-optimal tour, then poses", lambda: near_optimal_then_poses(problem)),
        ("together", lambda: with_poses(problem, TourLimits(seed=options.seed))),
    ):
        started = time.perf_counter()
        tour = run()
        spent = time.perf_counter() - started
        below = 1 - tour.cost / baseline.cost
        rows.append({"method": name, "tour s": tour.cost / 1e6, "below": below, "search s": spent})
    table = Table(box=None, pad_edge=False)
    for key in rows[0]:
        table.add_column(key, justify="right")
    for row in rows:
        table.add_row(
            row["method"], f"{row['tour s']:.3f}", f"{row['below']:.1%}", f"{row['search s']:.2f}"
        )
    poses = sum(map(len, problem.poses))
    Console().print(
        table, f"{len(problem.visits)} visits, {poses} poses, inverse kinematics {kinematics:.2f} s"
    )
    if options.json:
        options.json.write_text(json.dumps({"rows": rows, "kinematics s": kinematics}, indent=1))
    return 0 if rows[-1]["below"] >= BAR and rows[-1]["search s"] <= SECONDS else 1


if __name__ == "__main__":
    sys.exit(main())
