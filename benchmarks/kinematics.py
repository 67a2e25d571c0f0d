"""Inverse kinematics of the bundled arms: exactness and microseconds per pose, beside EAIK when it
is installed.

    python benchmarks/kinematics.py [--poses N] [--json FILE]

Poses are those of random configurations within the limits (seed 20). For each solver: the worst
residual of an answer (metres and radians alike), how many configurations were not among the answers
within 1e-6, and microseconds of processor time per pose on one core, one at a time and in a batch.
Exits with 1 when ours misses the bar: every residual under 1e-9, no configuration missed.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry.kinematics.arm_model import ArmModel, wrap_angles
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import InverseKinematics
from cellwright.kb.loader.arm_file import bundled_arms, load_arm

ONE_AT_A_TIME = 2000
RESIDUAL_BAR, NEAR = 1e-9, 1e-6


def best(run: Callable[[], object], count: int, runs: int = 3) -> float:
    """Least microseconds per item of a call that does `count` of them."""
    run()
    times = []
    for _ in range(runs):
        started = time.process_time()
        run()
        times.append(time.process_time() - started)
    return min(times) / count * 1e6


def judged(model: ArmModel, q: Floats, answers: list[Floats]) -> tuple[float, int]:
    """The worst residual of all answers, and how many configurations are not among their own."""
    worst, missed = 0.0, 0
    poses = model.flange_pose(q)
    for pose, one, found in zip(poses, q, answers, strict=True):
        if len(found):
            worst = max(worst, float(np.abs(model.flange_pose(found) - pose).max()))
        near = len(found) and np.abs(wrap_angles(found - one)).max(axis=1).min() < NEAR
        missed += not near
    return worst, missed


def ours(model: ArmModel, q: Floats) -> dict[str, Any]:
    """A row for the built-in solver."""
    solver, poses = InverseKinematics(model), model.flange_pose(q)
    found = solver.solve(poses)
    worst, missed = judged(model, q, [found.of(n) for n in range(len(q))])
    return {
        "solver": solver.solver.value,
        "residual": worst,
        "missed": missed,
        "branches": float(found.valid.sum(axis=1).mean()),
        "single": best(
            lambda: [solver.solve(poses[n : n + 1]) for n in range(ONE_AT_A_TIME)], ONE_AT_A_TIME
        ),
        "batch": best(lambda: solver.solve(poses), len(poses)),
    }


def eaik_robot(model: ArmModel) -> tuple[Any, Floats]:
    """EAIK's robot of the same axes, and what turns our flange into its tool, which does not
    turn at zero.
    """
    from eaik.IK_HP import HPRobot

    screws = InverseKinematics(model).form
    assert screws is not None
    points = np.vstack([np.zeros(3), screws.points, InverseKinematics(model).T_zero[None, :3, 3]])
    turned = np.eye(4)
    turned[:3, :3] = InverseKinematics(model).T_zero[:3, :3].T
    return HPRobot(screws.directions, np.diff(points, axis=0)), turned


def theirs(model: ArmModel, q: Floats) -> dict[str, Any]:
    """A row for EAIK; answers that it marks as least squares are left out."""
    robot, turned = eaik_robot(model)
    poses = model.flange_pose(q) @ turned
    found = [robot.IK(pose) for pose in poses]
    exact = [
        np.array(each.Q).reshape(-1, 6)[~np.array(each.is_LS, dtype=bool).reshape(-1)]
        for each in found
    ]
    worst, missed = judged(model, q, exact)
    return {
        "solver": "EAIK",
        "residual": worst,
        "missed": missed,
        "branches": float(np.mean([len(each) for each in exact])),
        "single": best(lambda: [robot.IK(pose) for pose in poses[:ONE_AT_A_TIME]], ONE_AT_A_TIME),
        "batch": best(lambda: robot.IK_batched(poses, 1), len(poses)),
    }


def main() -> int:
    """Measure, print, and judge."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows: list[dict[str, Any]] = []
    os.environ["CELLWRIGHT_THREADS"] = "1"
    for name, path in bundled_arms().items():
        model = ArmModel(load_arm(path))
        q = model.random(arguments.poses, np.random.default_rng(20))
        rows.append({"arm": name, **ours(model, q)})
        try:
            rows.append({"arm": name, **theirs(model, q)})
        except ImportError:
            continue
    table = Table(
        "arm", "solver", "branches", "worst residual", "missed", "us single", "us in a batch"
    )
    for row in rows:
        numbers = (f"{row['branches']:.2f}", f"{row['residual']:.1e}", str(row["missed"]))
        table.add_row(
            row["arm"], row["solver"], *numbers, f"{row['single']:.1f}", f"{row['batch']:.2f}"
        )
    Console().print(table)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")
    bad = [
        row
        for row in rows
        if row["solver"] != "EAIK" and (row["residual"] > RESIDUAL_BAR or row["missed"])
    ]
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
