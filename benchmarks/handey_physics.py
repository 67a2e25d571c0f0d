"""PLACE as a whole, pegs, three fingers and an assembly, planned and carried out in MuJoCo (an
extra).
"""

import time
from collections import Counter
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from handey_scenes import separate

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply, difference, rotation, transform
from cellwright.engine.pipelines.manipulation.place_answers import Placed
from cellwright.engine.pipelines.manipulation.place_operation import place_part
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grasping.hole_insertion import HoleSearch
from cellwright.engine.stages.grasping.stable_placements import stable_placements, volume_and_centre
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.cell_model import Placement
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.targets import BUNDLED_DOMAINS

Figures = dict[str, Any]
NEAR_M = 0.003
ROOM_M = 0.02  # between things that lie on the table
# of the parts lie as they are to be placed; the others on any side on which they can lie
UPRIGHT = 0.5


def place_whole(number: int, first: int, name: str = "scene.yaml") -> Figures:
    """The bundled scene with the part on a drawn side, in a drawn place, among drawn clutter:
    what comes of it, in seconds of the processor.
    """
    scene = load_scene(BUNDLED_DOMAINS / "handey" / name)
    counts: Counter[str] = Counter()
    times, off, odd = [], [], []
    for seed in range(first, first + number):
        drawn, T = drawn_scene(scene, "angle", seed)
        started = time.process_time()
        found, _ = place_part(drawn, "angle", "base", seed)
        times.append(time.process_time() - started)
        if not isinstance(found, Placed):
            counts[f"stopped by {found.step}"] += 1
            continue
        legs = [leg for carry in found.carries for leg in carry.legs]
        counts["planned"] += 1
        counts["all legs proved"] += int(all(leg.proved for leg in legs))
        counts[f"{len(found.carries) - 1} regrasps"] += 1
        counts["wrong"] += int(difference(found.T_world_part, T)[0] > 0.002)
        if find_spec("mujoco"):
            went, metres = _executed(drawn, "angle", found)
            counts["executed to within 3 mm"] += int(went == "done")
            off.append(metres)
            if went != "done":
                odd.append([seed, went, round(1000 * metres, 2)])
    figures = {
        **counts,
        "median_s": float(np.median(times)),
        "p95_s": float(np.quantile(times, 0.95)),
        "s": times,
    }
    return {**figures, "off_mm": [round(1000 * each, 3) for each in off], "not executed": odd}


def three_fingers(number: int, first: int) -> Figures:
    """The same with the hand of three fingers."""
    return place_whole(number, first, "scenes/fingers.yaml")


def drawn_scene(scene: Scene, part: str, seed: int) -> tuple[Scene, Floats]:
    """A scene with a part and clutter in drawn places on the table, and the part's pose."""
    random = np.random.default_rng(seed)
    bodies = dict(scene.cell.bodies)
    solid = solid_of(bodies[part])
    lying = stable_placements(solid, volume_and_centre(solid)[1])
    outlines: list[Floats] = []
    found = {}
    for name in (part, *scene.clutter):
        points = solid_of(bodies[name]).vertices
        own = transforms.of_pose(bodies[name].placement.pose)
        rest = _lowered(own, points)
        if name == part and random.random() > UPRIGHT:
            rest = lying[random.integers(len(lying))].T_table_part
        while True:
            T = transform(rotation((0, 0, 1), random.uniform(-np.pi, np.pi)), np.zeros(3)) @ rest
            middle = apply(T, points)[:, :2].mean(axis=0)
            T[:2, 3] += [random.uniform(0.36, 0.56), random.uniform(0.05, 0.26)] - middle
            outline = apply(T, points)[:, :2]
            if all(separate(outline, other, ROOM_M) for other in outlines):
                break
        outlines.append(outline)
        found[name] = T
        bodies[name] = replace(bodies[name], placement=Placement("world", transforms.to_pose(T)))
    return replace(scene, cell=replace(scene.cell, bodies=bodies)), found[part]


def _lowered(T: Floats, points: Floats) -> Floats:
    """A pose without its place in the plane, at which the lowest of some points touches the
    table.
    """
    found = T.copy()
    found[:3, 3] = 0.0
    found[2, 3] = -apply(found, points)[:, 2].min()
    return found


def _executed(scene: Scene, part: str, found: Placed) -> tuple[str, float]:
    """How physics carries out a plan (`done`: within 3 mm, and nothing else was touched), and
    how far the part then is from its goal.
    """
    from cellwright.engine.pipelines.manipulation.assembly_execution import execute_carries
    from cellwright.engine.pipelines.manipulation.mujoco_cell import MujocoCell

    done = execute_carries(scene, part, found, MujocoCell(scene))
    if done.status != "reached":
        return str(done.went), done.off[0]
    if done.touched:
        each = done.touched[0]
        return f"{each.first} touched {each.second}, {each.force_n} N", done.off[0]
    return "done" if done.off[0] < NEAR_M else "too far", done.off[0]


PEGS = {"square": "peg.yaml", "round": "round_peg.yaml"}
SEARCHES = {"square": (HoleSearch.NONE, HoleSearch.SPIRAL), "round": (HoleSearch.TILT,)}
MOST_M, IN_M, DEEP_M = (
    0.0015,
    0.0005,
    0.003,
)  # beside the hole at first, and from the goal in the end, across and up


def pegs_by_arm(number: int, first: int) -> Figures:
    """The arm puts pegs into a hole up to 1.5 mm beside where it is believed, 0.2 mm wider than the
    peg.

    Without compliance it goes straight down; with it, it searches on a spiral, or with a tilted
    peg. The arm takes the peg from the table once; each try goes on from where it then holds it
    above the hole.
    """
    counts: Counter[str] = Counter()
    seconds: dict[str, list[float]] = {}
    shops = {kind: _Held(kind) for kind in SEARCHES}
    for seed in range(first, first + number):
        random = np.random.default_rng(seed)
        angle, away = random.uniform(0, 2 * np.pi), random.uniform(0, MOST_M)
        beside = away * np.array([np.cos(angle), np.sin(angle), 0.0])
        for kind, searches in SEARCHES.items():
            for search in searches:
                went, lasted = shops[kind].inserted(search, beside)
                counts[f"{kind}, {search.value}: {went}"] += 1
                seconds.setdefault(f"{kind}, {search.value}", []).append(lasted)
    medians = {name: float(np.median(each)) for name, each in seconds.items()}
    return {"pegs": number, **counts, "simulated_s": medians}


class _Held:
    """A peg in the hand, above where its hole is believed."""

    def __init__(self, kind: str) -> None:
        from cellwright.engine.pipelines.manipulation.carry_execution import CarryEnd, take_up
        from cellwright.engine.pipelines.manipulation.mujoco_cell import MujocoCell

        scene = load_scene(BUNDLED_DOMAINS / "handey" / "scenes" / PEGS[kind])
        scene = replace(scene, hand=replace(scene.hand, accuracy_m=MOST_M / 3))
        found, _ = place_part(scene, "peg", "block")
        assert isinstance(found, Placed)
        self.scene, self.goal, self.carry = scene, found.T_world_goal[:3, 3], found.carries[-1]
        shop = MujocoCell(scene)
        assert take_up(shop, "peg", self.carry) is CarryEnd.DONE
        self.then, self.q = shop.stage.data, shop.q

    def inserted(self, search: HoleSearch, beside: Floats) -> tuple[str, float]:
        """How a peg ends whose hole is beside where it is believed: `in`, or how it went; and
        after how many seconds.
        """
        import mujoco

        from cellwright.engine.pipelines.manipulation.carry_execution import put_down
        from cellwright.engine.pipelines.manipulation.mujoco_cell import MujocoCell

        plan, moved = (
            self.carry.insertion,
            GeometricWorld.of(self.scene.cell).pose("world", "block").copy(),
        )
        assert plan is not None
        moved[:3, 3] += beside
        shop = MujocoCell(self.scene, {"block": moved})
        data = shop.stage.data
        for name in ("qpos", "qvel", "ctrl", "act", "qacc_warmstart"):
            getattr(data, name)[:] = getattr(self.then, name)
        mujoco.mj_forward(shop.stage.model, data)
        shop.q, shop.load = self.q, "peg"
        began = shop.seconds
        tried = replace(self.carry, insertion=replace(plan, search=search, doubt_m=MOST_M))
        went = put_down(shop, "peg", tried)
        shop.wait(0.5)
        apart = shop.pose("peg")[:3, 3] - self.goal - beside
        inside = np.abs(apart[:2]).max() < IN_M and apart[2] < DEEP_M
        return "in" if inside else str(went), shop.seconds - began
