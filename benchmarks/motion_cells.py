"""Motions in the two bundled cells: the three strategies side by side, shorter paths for more work,
and travel times.

    python benchmarks/motion_cells.py [--part PART] [--queries N] [--json FILE]

Half of the queries go from place to place of the cell, at random configurations that reach them,
and half between random free configurations of the arm. Every strategy gets the same queries, with
the same short cuts and the same proof. Times are processor time of one call, scenes built
beforehand. The length of a path is in rad, beside the shortest of the three. Every path is looked
at again every 1/320 rad. Handey's planner assumes that the last three joints may change all at
once; the last table counts where that fails, and how. `refining` shows how paths get shorter with
the work, `travel` what the travel times between many points cost with one roadmap and one by one,
and what it costs to repair that roadmap after a body was put elsewhere.
"""

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from cellwright.engine import plugins
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.motion_values import FINEST_M, Blocked, Moved, PathQuery, Strategy
from cellwright.engine.pipelines.motion.arm_motion import limits_of
from cellwright.engine.pipelines.motion.travel_times import near_one_another, travel_stations
from cellwright.engine.pipelines.planning.target_files import initial_facts
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.reach.arm_hand import ArmHand
from cellwright.engine.stages.geometry.reach.place_reachability import (
    PlaceReachability,
    ReachedPlace,
)
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.engine.stages.motion.path_planner import plan_path
from cellwright.engine.stages.motion.path_refinement import refine_path
from cellwright.engine.stages.motion.roadmap import (
    map_nodes,
    nearest_node_pairs,
    repair_roadmap,
    travel_times,
)
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.body_shapes import Pose
from cellwright.kb.model.cell_model import Place

CELLS = {"themse": "themse/one", "bulkhead": "bulkhead/one_point"}
FINER = 1 / 320
WORK = (0, 3_000, 10_000, 30_000, 100_000, 300_000)  # configurations looked at for shorter paths
NEAR, SAMPLE = 20, 200  # neighbours of each point, and pairs that are planned for one by one
RIBS, CLEAR_M = (-0.35, 0.35), 0.08  # across the web, and how far points are from them
# bodies that are put elsewhere, so that the roadmap has to be repaired
MOVED = ("slra", "jig", "ribs")
BUDGET = 100_000  # configurations that one query may look at


class Bench:
    """One cell with what plans in it: nothing is in hand but what the arm holds from the start."""

    def __init__(self, target: str) -> None:
        self.world = world_after_facts(GeometricWorld.of(cell_of(target)), initial_facts(target))
        self.reach = PlaceReachability(self.world, plugins.geometry_backend())
        self.arm = next(iter(self.world.cell.arms))
        self.places = [each for each in self.world.cell.places.values() if each.arm == self.arm]
        tools = Counter(each.tool for each in self.places)
        self.tool = tools.most_common(1)[0][0]
        self.places = [each for each in self.places if each.tool == self.tool]
        self.checker = self.reach.checker(self.places[0])
        self.ground = PlanningScene(self.checker)
        end = self.reach.flange_to_end(self.places[0])
        self.hand = ArmHand(self.world, self.ground.scene, self.arm, end)

    def queries(self, count: int, rng: np.random.Generator) -> list[PathQuery]:
        """Pairs of ends that are free."""
        at_places = [
            answer.q
            for each in self.places
            if isinstance(answer := self.reach.at(each), ReachedPlace)
        ]
        free = [self._free(q) for q in at_places]
        free = [q for q in free if len(q)]
        joints = self.ground.scene.joints
        drawn = rng.uniform(joints.lower, joints.upper, (8 * count, joints.count))
        drawn = drawn[self.ground.clearance(drawn) > 0.005]
        found = []
        for n in range(count):
            if n % 2:
                start, goal = drawn[n - 1], drawn[n]
            else:
                a, b = rng.choice(len(free), 2, replace=False)
                start, goal = (
                    free[a][rng.integers(len(free[a]))],
                    free[b][rng.integers(len(free[b]))],
                )
            found.append(PathQuery(start, goal[None]))
        return found

    def moved(self, body: str) -> PlanningScene:
        """The ground after a body was put 10 cm beside its place."""
        at = self.world.placed[body]
        T = matmul(at.T_parent_frame, transforms.translation(0.1, 0.0, 0.0))
        reach = PlaceReachability(self.world.put(body, at.parent, T), plugins.geometry_backend())
        return PlanningScene(reach.checker(replace(self.places[0], touches=())))

    def _free(self, q: Floats) -> Floats:
        found: Floats = q[self.ground.clearance(q, 0.01) > 0.0]
        return found


def long(path: Floats) -> float:
    """How long a path is, in rad."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def finely(path: Floats) -> Floats:
    """Configurations of a path at the finer step."""
    parts = [
        a + np.linspace(0, 1, int(np.linalg.norm(b - a) / FINER) + 2)[:, None] * (b - a)
        for a, b in pairwise(path)
    ]
    return np.concatenate(parts)


def asked(bench: Bench, query: PathQuery, strategy: Strategy) -> dict[str, Any]:
    """What one strategy makes of a query."""
    mine = PathQuery(query.start, query.goals, strategy=strategy, budget=BUDGET)
    started = time.process_time()
    answer = plan_path(bench.ground, mine, bench.hand)
    row: dict[str, Any] = {
        "ms": (time.process_time() - started) * 1e3,
        "solved": isinstance(answer, Moved),
    }
    if isinstance(answer, Moved):
        hits = int(bench.ground.collides(finely(answer.path)).sum())
        row |= {
            "length": long(answer.path),
            "proved": answer.proved,
            "hits": hits,
            "straight": len(answer.path) == 2,
        }
    if isinstance(answer, Blocked):
        row["why"] = _why(answer)
    return row


def _why(answer: Blocked) -> str:
    """Why there is no path: a proof, what the strategy says, or that its work has ended."""
    if answer.severed is None:
        return answer.why or "budget"
    touching = answer.severed.contacts[0]
    return f"there is none, that is proved: {touching.first} cannot pass {touching.second}"


def shown(cell: str, rows: dict[str, list[dict[str, Any]]]) -> Table:
    """The table of one cell."""
    columns = (
        "strategy",
        "solved",
        "proved",
        "ms, median",
        "95 %",
        "length, median",
        "of the shortest",
        "hits",
    )
    table = Table(*columns, title=f"{cell}: {len(rows['connect'])} queries")
    best = [
        min((each.get("length", np.inf) for each in of), default=np.inf)
        for of in zip(*rows.values(), strict=True)
    ]
    for name, own in rows.items():
        solved = [row for row in own if row["solved"]]
        ratios = [
            row["length"] / least
            for row, least in zip(own, best, strict=True)
            if row["solved"] and least > 0
        ]
        times = [row["ms"] for row in own]
        table.add_row(
            name,
            f"{len(solved)}",
            f"{sum(row['proved'] for row in solved)}",
            f"{np.median(times):.1f}",
            f"{np.percentile(times, 95):.1f}",
            f"{np.median([row['length'] for row in solved]):.2f}",
            f"{np.median(ratios):.3f}",
            f"{sum(row['hits'] > 0 for row in solved)}",
        )
    return table


def refining(cell: str, bench: Bench, queries: list[PathQuery]) -> Table:
    """How the time of paths falls with the work, beside the shortest known; straight lines are
    left out.
    """
    speeds = np.ones(bench.ground.scene.joints.count)
    speeds[bench.hand.own] = limits_of(bench.world, bench.arm).speed
    courses, spent = [], []
    for query in queries:
        mine = replace(query, budget=BUDGET)
        first = plan_path(bench.ground, mine)
        if not isinstance(first, Moved) or len(first.path) == 2:
            continue
        started = time.process_time()
        found = refine_path(bench.ground, mine, first, speeds, WORK[-1])
        spent.append((time.process_time() - started) * 1e3)
        courses.append(found.course)
    table = Table(
        "configurations looked at", "time, of the shortest known: median", "95 %", "ms", title=cell
    )
    for work in WORK:
        left = [
            [t for looked, t in course if looked <= work][-1] / course[-1][1] for course in courses
        ]
        ms = np.median(spent) * work / WORK[-1]
        table.add_row(
            f"{work:,}", f"{np.median(left):.3f}", f"{np.percentile(left, 95):.3f}", f"{ms:.0f}"
        )
    return table


def travelling(points: int, near: int, rng: np.random.Generator) -> Table:
    """All travel times of points of the bulkhead to their nearest neighbours, by one roadmap,
    and one by one.
    """
    table = Table(
        "what", "processor s", "s", title=f"bulkhead: {points} points, {near} neighbours each"
    )
    bench, began = Bench("bulkhead/one_point"), (time.process_time(), time.time())

    def row(what: str) -> None:
        nonlocal began
        now = time.process_time(), time.time()
        table.add_row(what, *(f"{b - a:.2f}" for a, b in zip(began, now, strict=True)))
        began = time.process_time(), time.time()

    web = next(each for each in bench.places if each.approach_m and each.touches == ("web",))
    places = {name: _placed(web, name, rng) for name in (f"p{n}" for n in range(points))}
    row("cell read")
    own, _ = near_one_another(bench.reach, bench.world, places)
    row("configurations that reach the points")
    kept = {name: places[name] for name in own}
    at = travel_stations(bench.world, bench.reach, bench.arm, kept, list(own.values()))
    row("straight lines out of the points")
    limits, joints = at.limits, bench.hand.own
    pairs = nearest_node_pairs(at.nodes[:, joints], limits, near)
    roadmap = map_nodes(at.ground, at.nodes, pairs)
    found, _ = travel_times(at.ground, roadmap, pairs, limits, joints)
    row(f"{len(pairs)} travel times, proved")
    for body in MOVED:
        now = bench.moved(body)
        now.lines(1 / 32)
        now.proof(0.0, FINEST_M)
        began = time.process_time(), time.time()
        mended, looked = repair_roadmap(roadmap, at.ground, now)
        row(f"after {body} has moved: {looked} edges repaired")
        fresh = map_nodes(now, at.nodes, pairs)
        row("the same roadmap made anew")
        assert (mended.free == fresh.free).all(), "a repaired roadmap is what a new one would be"
    some = pairs[:: max(1, len(pairs) // SAMPLE)]
    for a, b in some:
        plan_path(at.ground, PathQuery(at.nodes[a], at.nodes[b][None]))
    spent = (time.process_time() - began[0]) * len(pairs) / len(some)
    table.add_row(f"each by itself, from {len(some)} of them", f"{spent:.2f}", "")
    known = np.isfinite(found.time_s)
    table.add_row(
        "pairs without a way, planned one by one", f"{(~known).sum()}", f"{found.planned}"
    )
    table.add_row("times too long by at most, as a share", f"{found.error():.5f}", "")
    return table


def _placed(web: Place, name: str, rng: np.random.Generator) -> Place:
    """A point on the web, off the ribs."""
    y = 0.0
    while min(abs(y - each) for each in RIBS) < CLEAR_M or y == 0.0:
        y = float(rng.uniform(-0.9, 0.9))
    placement = replace(web.placement, pose=Pose((float(rng.uniform(-0.4, 0.4)), y, 0.0)))
    return replace(web, name=name, placement=placement)


def main() -> int:
    """Measure, print, and judge: 1 if a path touches anything at a finer look."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--queries", type=int, default=200, help="in each cell")
    parser.add_argument("--points", type=int, default=1000, help="for the travel times")
    parser.add_argument(
        "--part", choices=("strategies", "refining", "travel"), default="strategies"
    )
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    console, kept, hits = Console(), {}, 0
    if arguments.part == "travel":
        console.print(travelling(arguments.points, NEAR, np.random.default_rng(18)))
        return 0
    for cell, target in CELLS.items():
        bench = Bench(target)
        queries = bench.queries(arguments.queries, np.random.default_rng(18))
        if arguments.part == "refining":
            console.print(refining(cell, bench, queries))
            continue
        rows = {str(each): [asked(bench, query, each) for query in queries] for each in Strategy}
        console.print(shown(cell, rows))
        for name, own in rows.items():
            for why, count in Counter(row["why"] for row in own if "why" in row).most_common():
                console.print(f"{name}: {count} times: {why}", soft_wrap=True)
        straight = sum(row.get("straight", False) for row in rows["connect"])
        console.print(f"{straight} of the queries are solved by the straight line")
        hits += sum(row.get("hits", 0) > 0 for own in rows.values() for row in own)
        kept[cell] = rows
    if arguments.json:
        arguments.json.write_text(json.dumps(kept, indent=1) + "\n")
    return 1 if hits else 0


if __name__ == "__main__":
    sys.exit(main())
