"""Collision checks per second, one at a time and in batches, beside MuJoCo and coal when they are
installed.

    python benchmarks/collision.py [--data FOLDER] [--configurations N] [--cells NAME ...]
        [--json FILE]

The cells are those of MotionBenchMaker for a UR5 (`ur5_mbm` in the folder of the data, by default
$CELLWRIGHT_DATA): an arm of spheres among boxes and cylinders. All backends get the same convex
pieces and pairs; "mujoco, own boxes" may use its primitive in place of convex meshes. Random
configurations within the limits (seed 7); the best of five runs, in processor time on one core, and
for the built-in backend in real time on all cores, too. Every difference from the built-in backend
is put to the plain NumPy reference: it is *touching* when the bodies are within a micrometre of
contact, *wrong there* when the reference is with the built-in backend, else unexplained. Exits with
1 when a difference is unexplained, when the start or goal of a published problem is in collision,
or when the built-in backend in batches (on one core or on all, whichever is faster) is not three
times as fast as MuJoCo.
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
from ur5_cells import KINDS, Task, tasks

from benchmarks.reference_distances import signed_distance
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import CollisionScene
from cellwright.engine.ports import CollisionChecker, GeometryBackend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinBackend
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of

TOUCHING_M = 1e-6
BAR = 3.0
RUNS = 5
Names = frozenset[frozenset[str]]


def backends() -> dict[str, GeometryBackend]:
    """Ours first, then the peers that are installed."""
    found: dict[str, GeometryBackend] = {"builtin": BuiltinBackend()}
    try:
        from cellwright.engine.stages.geometry.collision.mujoco_backend import MujocoBackend

        found |= {"mujoco": MujocoBackend(), "mujoco, own boxes": MujocoBackend(native_blocks=True)}
    except ImportError:
        pass
    try:
        from cellwright.engine.stages.geometry.collision.coal_backend import CoalBackend

        found["coal"] = CoalBackend()
    except ImportError:
        pass
    return found


def always_touching(task: Task) -> Names:
    """Pairs of links that touch in every configuration: the spheres swell the links."""
    alone = collision_scene_of(task.world, leave_out=list(task.world.cell.bodies))
    checker = BuiltinBackend().checker(alone)
    q = task.world.models["ur5"].random(200, np.random.default_rng(1))
    touching = [{frozenset((c.first, c.second)) for c in checker.contacts(one)} for one in q]
    return frozenset(set.intersection(*touching))


def rate(
    run: Callable[[], object], count: int, clock: Callable[[], float] = time.process_time
) -> float:
    """The best rate of a call that does `count` checks."""
    run()
    times = []
    for _ in range(RUNS):
        started = clock()
        run()
        times.append(clock() - started)
    return count / min(times)


def plain_clearance(scene: CollisionScene, q: Floats) -> float:
    """The least signed distance by the plain reference, pairs farther apart than 0.1 m left out."""
    poses, least = carrier_poses(scene.joints, q), 0.1
    placed = [
        transforms.apply(poses[p.carrier] @ p.T_carrier_piece, p.vertices) for p in scene.pieces
    ]
    for i, j in scene.pairs:
        reach = scene.pieces[i].radius_m + scene.pieces[j].radius_m
        low = np.maximum(
            placed[i].min(axis=0) - placed[j].max(axis=0),
            placed[j].min(axis=0) - placed[i].max(axis=0),
        )
        if low.max() - reach < least:
            least = min(least, signed_distance(placed[i], placed[j]) - reach)
    return least


def explained(scene: CollisionScene, q: Floats, ours: bool) -> str:
    """Why another backend answers otherwise."""
    least = plain_clearance(scene, q)
    if abs(least) <= TOUCHING_M:
        return "touching"
    return "wrong there" if ours == (least <= 0) else "unexplained"


def row(name: str, checker: CollisionChecker, q: Floats, ours: np.ndarray) -> dict[str, Any]:
    """Rates and differences of a backend in one cell."""
    few = q[: 200 if name == "coal" else 2000]
    many = q[:1000] if name == "coal" else q
    differ = np.nonzero(checker.collides(q) != ours)[0]
    why = [explained(checker.scene, q[n], bool(ours[n])) for n in differ]
    return {
        "backend": name,
        "single": rate(
            lambda: [checker.collides(few[n : n + 1]) for n in range(len(few))], len(few)
        ),
        "batch": rate(lambda: checker.collides(many), len(many)),
        "differences": {each: why.count(each) for each in sorted(set(why))},
    }


def measure(task: Task, count: int, peers: dict[str, GeometryBackend]) -> dict[str, Any]:
    """All rows of one cell."""
    scene = collision_scene_of(task.world, allowed=always_touching(task))
    q = task.world.models["ur5"].random(count, np.random.default_rng(7))
    checkers = {name: backend.checker(scene) for name, backend in peers.items()}
    ours = checkers["builtin"].collides(q)
    os.environ["CELLWRIGHT_THREADS"] = "1"
    rows = [row(name, checker, q, ours) for name, checker in checkers.items()]
    del os.environ["CELLWRIGHT_THREADS"]
    threads = rate(lambda: checkers["builtin"].collides(q), count, time.perf_counter)
    rows.insert(
        1, {"backend": "builtin, all cores", "single": None, "batch": threads, "differences": {}}
    )
    return {
        "cell": task.name,
        "pieces": len(scene.pieces),
        "pairs": len(scene.pairs),
        "hits": float(ours.mean()),
        "ends": int(checkers["builtin"].collides(task.ends).sum()),
        "rows": rows,
    }


def shown(cells: list[dict[str, Any]], count: int) -> Table:
    """The table that people read."""
    table = Table("cell", "backend", "single/s", "batch/s", "builtin is", "differences")
    for cell in cells:
        said = (
            f"{cell['cell']}: {cell['pieces']} pieces, {cell['pairs']} pairs, "
            f"{cell['hits']:.0%} hits"
        )
        for each in cell["rows"]:
            ratio = cell["rows"][0]["batch"] / each["batch"]
            single = f"{each['single']:,.0f}" if each["single"] else ""
            differ = (
                ", ".join(f"{n} {why}" for why, n in each["differences"].items())
                or f"0 of {count:,}"
            )
            table.add_row(
                said, each["backend"], single, f"{each['batch']:,.0f}", f"{ratio:.2f}x", differ
            )
            said = ""
    return table


def misses(cells: list[dict[str, Any]]) -> list[str]:
    """The bars that were missed."""
    found = []
    for cell in cells:
        if cell["ends"]:
            found.append(f"{cell['cell']}: a published start or goal is in collision")
        ours = max(each["batch"] for each in cell["rows"] if each["backend"].startswith("builtin"))
        for each in cell["rows"]:
            ratio = ours / each["batch"]
            if each["backend"].startswith("mujoco") and ratio < BAR:
                found.append(f"{cell['cell']}: only {ratio:.2f} times {each['backend']}")
            if "unexplained" in each["differences"]:
                found.append(f"{cell['cell']}: unexplained differences from {each['backend']}")
    return found


def main() -> int:
    """Measure, print, and judge."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=os.environ.get("CELLWRIGHT_DATA"))
    parser.add_argument("--configurations", type=int, default=5000)
    parser.add_argument("--cells", nargs="*", choices=KINDS, default=list(KINDS))
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if arguments.data is None:
        parser.error("give --data or set CELLWRIGHT_DATA")
    chosen = [
        task
        for task in tasks(Path(arguments.data) / "ur5_mbm")
        if task.name.split()[0] in arguments.cells
    ]
    peers = backends()
    cells = [measure(task, arguments.configurations, peers) for task in chosen]
    Console().print(shown(cells, arguments.configurations))
    if arguments.json:
        arguments.json.write_text(json.dumps(cells, indent=1) + "\n")
    for miss in (missed := misses(cells)):
        Console(stderr=True).print(miss, style="red")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
