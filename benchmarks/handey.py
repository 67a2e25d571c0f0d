"""Handey's figures: relations, localisation, grasps and regrasps, and PLACE as a whole.

    python benchmarks/handey.py
        [--part relations|localisation|regrasps|place|ablation|monitoring|pegs ...] [--number N]
        [--first SEED] [--json FILE]

Relations: transforms are recovered from random consistent sets, by the worst entry. Localisation: N
random scenes, of which the part must be found within 2 mm and 1 degree, and as many without the
part, in which nothing must be found; processor time of each. Regrasps: the shortest sequence of
random graphs beside brute force, and how often a grasp that was chosen without the goal's obstacles
fails there. PLACE: the bundled scene with the part in N drawn places, also executed if MuJoCo is
installed. Ablation: how often the best grasp where the part lies fails at the goal. Monitoring: N
scripted operators, half of whom spoil the goal. Pegs: N insertions in MuJoCo. Exits with 1 where an
answer is wrong.
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from handey_operators import RESTS, lying, script
from handey_peers import peers
from handey_physics import pegs_by_arm, place_whole, three_fingers
from handey_scenes import trial
from rich.console import Console

from cellwright.engine.kernels.rigid import apply, difference, rotation_by_vector
from cellwright.engine.model.manipulation_values import (
    Assembled,
    FeatureKind,
    PartFeature,
    Regrasps,
    Relation,
    RelationKind,
)
from cellwright.engine.model.vision import LocatedPart
from cellwright.engine.pipelines.manipulation.arm_monitoring import watch_events
from cellwright.engine.pipelines.manipulation.place_operation import goal_of
from cellwright.engine.pipelines.manipulation.regrasp_paths import most_vertical, possible_holds
from cellwright.engine.pipelines.manipulation.scene_camera import look_for_parts
from cellwright.engine.pipelines.manipulation.workspace import AssemblySite
from cellwright.engine.stages.assembly.part_assembly import assemble_parts
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grasping.hole_insertion import HoleSearch, Insertion, InsertionPhase
from cellwright.engine.stages.grasping.stable_placements import shortest_regrasps
from cellwright.engine.stages.vision.part_localisation import locate_in_image
from cellwright.engine.stages.vision.pose_hypotheses import PartModel

Figures = dict[str, Any]


def relations(number: int, first: int) -> Figures:
    """The worst entry by which transforms from three relations differ from those that the
    relations were made with.
    """
    worst, wrong = 0.0, 0
    for seed in range(first, first + number):
        random = np.random.default_rng(seed)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = (
            rotation_by_vector(random.normal(size=3)),
            random.uniform(-0.5, 0.5, 3),
        )
        found = assemble_parts(_consistent(random, T), "b")
        apart = np.abs(found.poses["a"] - T).max() if isinstance(found, Assembled) else np.inf
        worst, wrong = max(worst, float(apart)), wrong + int(apart > 1e-9)
    return {"sets": number, "worst": worst, "wrong": wrong}


def _consistent(random: np.random.Generator, T: Any) -> list[Relation]:
    """Three faces against or in one plane with others, at a pose T_b_a."""
    normals = rotation_by_vector(random.normal(size=3))
    made = []
    for n, normal in enumerate(normals):
        kind = RelationKind.AGAINST if random.random() < 0.5 else RelationKind.COPLANAR
        own = PartFeature(
            "a", f"f{n}", FeatureKind.PLANE, normal * random.uniform(-0.1, 0.1), normal
        )
        outward = T[:3, :3] @ normal
        at = apply(T, own.point[None])[0] + np.cross(outward, random.normal(size=3))
        sense = -outward if kind is RelationKind.AGAINST else outward
        made.append(Relation(kind, own, PartFeature("b", f"g{n}", FeatureKind.PLANE, at, sense)))
    return made


def localisation(number: int, first: int) -> Figures:
    """How many parts are found within 2 mm and 1 degree, how many wrongly, and the processor
    times in seconds.
    """
    counts: Counter[str] = Counter()
    times, wrong, missed, metres_all, radians_all = [], [], [], [], []
    for seed, present in product(range(first, first + number), (True, False)):
        made = trial(seed, present)
        model = PartModel(made.part)
        started = time.process_time()
        found = locate_in_image(model, made.image, made.ground)
        times.append(time.process_time() - started)
        if not isinstance(found, LocatedPart):
            counts["not found, is there" if present else "not found, is not there"] += 1
            if present:
                missed.append([seed, found.reason])
        elif made.T_camera_part is None:
            counts["found, is not there"] += 1
            wrong.append(seed)
        else:
            apart = [difference(each, made.T_camera_part) for each in found.equivalent]
            metres, radians = min(apart, key=lambda pair: pair[0] + 0.05 * pair[1])
            good = metres < 0.002 and radians < np.radians(1)
            counts["right" if good else "wrong"] += 1
            if good:
                metres_all.append(float(metres))
                radians_all.append(float(radians))
            else:
                wrong.append(seed)
    return {
        **counts,
        "median_s": float(np.median(times)),
        "p95_s": float(np.quantile(times, 0.95)),
        "median_mm": 1000 * float(np.median(metres_all)),
        "median_degrees": float(np.degrees(np.median(radians_all))),
        "missed": missed,
        "wrong seeds": wrong,
        "wrong in all": len(wrong),
    }


def sequences(number: int, first: int) -> Figures:
    """Shortest sequences of regrasps in random graphs, beside brute force."""
    counts: Counter[str] = Counter()
    for seed in range(first, first + number):
        random = np.random.default_rng(seed)
        holds, rests = random.integers(2, 8), random.integers(1, 5)
        start, goal = random.random((2, holds)) < 0.25
        possible = random.random((holds, rests)) < random.uniform(0.1, 0.5)
        found, least = shortest_regrasps(start, goal, possible), _brute_force(start, goal, possible)
        mine = len(found.then) if isinstance(found, Regrasps) else None
        counts["impossible" if mine is None else f"{mine} regrasps"] += 1
        counts["wrong"] += int(mine != least)
    return dict(counts)


def _brute_force(start: Any, goal: Any, possible: Any) -> int | None:
    for count in range(possible.shape[1] + 1):
        for sequence in product(range(possible.shape[1]), repeat=count):
            held = start
            for rest in sequence:
                held = possible[:, rest] & (held & possible[:, rest]).any()
            if (held & goal).any():
                return count
    return None


def ablation(number: int, first: int) -> Figures:
    """How often the grasp that is best where the wheel lies fails at its goal: without the goal's
    obstacles, it would be taken.

    The wheel lies on a drawn side in a drawn place.
    """
    best, shares = [], []
    for seed in range(first, first + number):
        random = np.random.default_rng(seed)
        drawn = lying(random, str(random.choice(sorted(RESTS))))
        world = GeometricWorld.of(drawn.cell)
        T = world.pose("world", "wheel")
        looked = look_for_parts(drawn, world, (), seed)
        goal = goal_of(drawn, world, ("wheel",), "base")
        assert isinstance(goal, Assembled)
        T_goal = world.pose("world", "base") @ goal.poses["wheel"]
        task = AssemblySite.of(drawn, world, looked, {"wheel": T}).task("wheel", (T, T_goal))
        start, end = possible_holds(task, T), possible_holds(task, T_goal)
        if start.any():
            best.append(not end[next(most_vertical(task, start))])
            shares.append(float((start & ~end).sum() / start.sum()))
    return {
        "scenes": len(best),
        "best grasps that fail at the goal": int(sum(best)),
        "share of all grasps that fail there": float(np.mean(shares)),
    }


def monitoring(number: int, first: int) -> Figures:
    """Scripted operators, every other of whom spoils the goal: who was warned, and how long one
    look ahead took.
    """
    counts: Counter[str] = Counter()
    times = []
    for seed in range(first, first + number):
        made = script(seed)
        started = time.process_time()
        warnings = [said for _, said in watch_events(made.state, made.events) if said is not None]
        times.append((time.process_time() - started) / len(made.events))
        counts[f"{made.spoils or 'not spoilt'}: {'warned' if warnings else 'silent'}"] += 1
        counts["wrong"] += int(bool(warnings) != bool(made.spoils))
    return {**counts, "median_s": float(np.median(times))}


def pegs(number: int, first: int) -> Figures:
    """Pegs up to 1.5 mm beside holes that are 0.2 mm wider, with a search and without.

    Needs the extra `mujoco`.
    """
    from benchmarks.peg_insertion import RoundPeg, simulate_insertion

    peg, counts, forces = RoundPeg(), Counter[str](), []
    times: dict[str, list[float]] = {HoleSearch.SPIRAL.value: [], HoleSearch.TILT.value: []}
    for seed in range(first, first + number):
        random = np.random.default_rng(seed)
        angle, away, tilt = (
            random.uniform(0, 2 * np.pi),
            random.uniform(0, 0.0015),
            random.normal(0, 0.002),
        )
        error = away * np.array([np.cos(angle), np.sin(angle)])
        for search in HoleSearch:
            room = peg.clearance_m / 2
            plan = Insertion(peg.depth_m, room, 0.0015, search, peg.radius_m, peg.length_m)
            found = simulate_insertion(peg, plan, error, tilt)
            counts[search.value] += int(found.phase is InsertionPhase.DONE)
            if search is not HoleSearch.NONE:
                times[search.value].append(found.seconds)
                forces.append(found.force_n)
    medians = {f"{search}_s": float(np.median(each)) for search, each in times.items()}
    return {**counts, "pegs": number, **medians, "greatest_n": float(max(forces))}


PARTS: dict[str, Callable[[int, int], Figures]] = {
    "relations": relations,
    "localisation": localisation,
    "regrasps": sequences,
    "place": place_whole,
    "fingers": three_fingers,
    "ablation": ablation,
    "monitoring": monitoring,
    "pegs": pegs,
    "arm-pegs": pegs_by_arm,
    "peers": peers,
}


def main() -> int:
    """Run the parts asked for; 1 if an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--part", nargs="*", choices=PARTS, default=[each for each in PARTS if each != "pegs"]
    )
    parser.add_argument("--number", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    figures = {part: PARTS[part](asked.number, asked.first) for part in asked.part}
    for part, found in figures.items():
        Console().print(part, found)
    if asked.json:
        asked.json.write_text(json.dumps(figures, indent=1))
    return int(
        any(found.get("wrong", 0) or found.get("wrong in all", 0) for found in figures.values())
    )


if __name__ == "__main__":
    sys.exit(main())
