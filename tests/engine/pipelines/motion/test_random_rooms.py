"""Ten random rooms with obstacles that can be moved, beside a search that shares nothing with the
planner.

The arm has two links that turn in the plane and a spindle that goes up and down. So its inverse
kinematics is a line of trigonometry, and every collision is a distance between a segment or a
circle and a rectangle or a circle. The search goes through all placements of the things and all
parts of the free space that the arm can be in, on a grid over the joints. It is made twice: all
distances smaller by a clearance that covers the grid, and all larger by it. Only rooms on which
both agree count.
"""

import itertools
import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.model.outcome import Found
from cellwright.kb.loader import load_problem
from cellwright.kb.terms import Function
from tests.engine.pipelines.motion.test_moving_plan import DOMAIN, moving

UPPER, FORE = 0.4, 0.3  # the links (m)
LINK_R, SPINDLE_R, BOLT_R = 0.03, 0.025, 0.02
SHOULDER, ELBOW = math.radians(150), math.radians(130)
LOW, HIGH, RISE, FRONT = (
    0.105,
    0.285,
    0.02,
    0.06,
)  # heights of the tool point (m), and how far above a place its front is
TALL = 0.1  # every thing
STEP = math.radians(1.5)
CLEARANCE, CLEARANCE_UP = 0.015, 0.01  # what half a step of the grid moves at most, along and up
TURNS1, TURNS2 = np.arange(-SHOULDER, SHOULDER + 1e-9, STEP), np.arange(-ELBOW, ELBOW + 1e-9, STEP)
HEIGHTS = np.arange(LOW, HIGH + 1e-9, RISE)
THINGS, PLACES = ("bolt", "brick", "drum"), ("p0", "p1", "p2", "p3", "p4")
GOAL = PLACES[3]
SEEDS = (9, 10, 13, 14, 17, 19, 21, 30, 33, 132)

URDF = """<robot name="scara">
<link name="base"/>
<link name="upper">
 <collision><origin xyz="0.2 0 0" rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="0.03" length="0.4"/></geometry></collision>
 <collision><origin xyz="0.4 0 0"/><geometry><cylinder radius="0.03" length="0.06"/></geometry></collision></link>
<link name="fore"><collision><origin xyz="0.15 0 0" rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="0.03" length="0.3"/></geometry></collision></link>
<link name="quill"/>
<link name="spindle"><collision><origin xyz="0 0 0.245"/><geometry><cylinder radius="0.025" length="0.45"/></geometry></collision></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/><limit lower="-2.6179938" upper="2.6179938" effort="9" velocity="2"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/><limit lower="-2.268928" upper="2.268928" effort="9" velocity="2"/></joint>
<joint name="lift" type="prismatic"><parent link="fore"/><child link="quill"/><origin xyz="0.3 0 -0.5"/><axis xyz="0 0 1"/><limit lower="0.1" upper="0.29" effort="9" velocity="0.5"/></joint>
<joint name="turn" type="revolute"><parent link="quill"/><child link="spindle"/><axis xyz="0 0 1"/><limit lower="-6.3" upper="6.3" effort="9" velocity="3"/></joint>
</robot>
"""
CELL = """
cell: kiln_room
arms: {{scara: {{urdf: scara.urdf, chain: [base, spindle], tool: {{rpy: [180, 0, 0]}}, home: [0, 0, 0.285, 0]}}}}
fixtures:
{fixtures}
parts:
{parts}
places:
{places}
allowed_contacts: [[scara.fore, scara.spindle]]
locations:
  at(Item, gripper): {{body: Item, in: scara.tool}}
  at(Item, Place): {{body: Item, place: Place}}
operations:
  pick(Item, Place): {{at: Place, takes: 1 s}}
  put(Item, Place): {{at: Place, takes: 1 s}}
"""
PROBLEM = """
problem: fire
domain: kiln_room
statics: [{suits}]
initial: ["at(bolt, p0)", "at(brick, p1)", "at(drum, p2)"]
goals: ["at(bolt, p3)"]
"""

Box = tuple[
    float, float, float, float, bool
]  # its middle, its half sides; whether it reaches up to the links
Placement = tuple[str, str, str]  # where bolt, brick and drum are: a place or "gripper"
START: Placement = ("p0", "p1", "p2")


@dataclass(frozen=True)
class Plot:
    """One random room: where the places are, how thick the things, what stands about, and what
    may be put where.
    """

    spots: tuple[tuple[float, float], ...]
    radii: tuple[float, float, float]
    boxes: tuple[Box, ...]
    suits: frozenset[tuple[str, str]]


def plot(seed: int) -> Plot:
    """A random room. The goal is near another place, so that what stands there is often in the
    way.
    """
    chance = random.Random(seed)

    def spot() -> tuple[float, float]:
        far, turn = chance.uniform(0.32, 0.62), chance.uniform(-1.8, 1.8)
        return far * math.cos(turn), far * math.sin(turn)

    spots = [spot() for _ in PLACES]
    beside, away = chance.uniform(-math.pi, math.pi), chance.uniform(0.05, 0.16)
    spots[3] = spots[1][0] + away * math.cos(beside), spots[1][1] + away * math.sin(beside)
    boxes = []
    for _ in range(chance.randint(1, 3)):
        x, y = spot() if chance.random() < 0.7 else chance.choice(spots)
        high = chance.random() < 0.6
        boxes.append((x, y, chance.uniform(0.02, 0.06), chance.uniform(0.02, 0.06), high))
    radii = BOLT_R, chance.uniform(0.05, 0.09), chance.uniform(0.05, 0.09)
    suits = {each for each in itertools.product(THINGS, PLACES) if chance.random() < 0.7}
    return Plot(tuple(spots), radii, tuple(boxes), frozenset({*suits, ("bolt", GOAL)}))


def from_box(points: Floats, box: Box) -> Floats:
    """How far points (..., 2) are from a rectangle."""
    outside = np.abs(points - np.array(box[:2])) - np.array(box[2:4])
    found: Floats = np.linalg.norm(np.maximum(outside, 0.0), axis=-1)
    return found


def segment_from_box(start: Floats, end: Floats, box: Box) -> Floats:
    """How far segments (..., 2) are from a rectangle: looked at every 2 cm, which the clearance
    covers.
    """
    count = int(np.ceil(np.linalg.norm(end - start, axis=-1).max() / 0.02)) + 1
    found: Floats = np.min(
        [from_box(start + share * (end - start), box) for share in np.linspace(0, 1, count)], axis=0
    )
    return found


@dataclass(frozen=True, eq=False)
class Search:
    """Everything that can be done in a room, with all distances asked to be greater than
    `spare` (m, which may be below 0).
    """

    plot: Plot
    spare: float
    _flat: dict[float, Truths] = field(default_factory=dict)
    _parts: dict[Placement, Truths] = field(default_factory=dict)

    def stands(self, q1: Floats, q2: Floats, radius: float) -> Truths:
        """Whether the arm with something of a radius below the spindle touches no box."""
        elbow = UPPER * np.stack([np.cos(q1), np.sin(q1)], -1)
        wrist = elbow + FORE * np.stack([np.cos(q1 + q2), np.sin(q1 + q2)], -1)
        free = np.ones(np.shape(q1), dtype=bool)
        for box in self.plot.boxes:
            free &= from_box(wrist, box) > SPINDLE_R + self.spare
            if box[4]:
                free &= from_box(wrist, box) > radius + self.spare
                free &= segment_from_box(np.zeros_like(elbow), elbow, box) > LINK_R + self.spare
                free &= segment_from_box(elbow, wrist, box) > LINK_R + self.spare
        return free

    @cached_property
    def wrists(self) -> Floats:
        q1, q2 = np.meshgrid(TURNS1, TURNS2, indexing="ij")
        return np.stack(
            [
                UPPER * np.cos(q1) + FORE * np.cos(q1 + q2),
                UPPER * np.sin(q1) + FORE * np.sin(q1 + q2),
            ],
            -1,
        )

    def flat(self, radius: float) -> Truths:
        """What is free of boxes on the grid of both turning joints."""
        if radius not in self._flat:
            q1, q2 = np.meshgrid(TURNS1, TURNS2, indexing="ij")
            self._flat[radius] = self.stands(q1, q2, radius)
        return self._flat[radius]

    def parts_of_space(self, placed: Placement) -> Truths:
        """The free space in a placement: each cell of the grid (q1, q2, height) has the number of
        its part, 0 if it is not free.

        Where distances are asked to be small, cells that share a corner are one part; where large,
        those that share a side.
        """
        if placed not in self._parts:
            self._parts[placed] = self._found_parts(placed)
        return self._parts[placed]

    def _found_parts(self, placed: Placement) -> Truths:
        radius = self.radius(placed)
        free = np.repeat(self.flat(radius)[:, :, None], len(HEIGHTS), axis=2)
        low = LOW + math.copysign(CLEARANCE_UP, self.spare) >= HEIGHTS - TALL
        for spot, thick in self.standing(placed):
            if radius:
                near = (
                    np.linalg.norm(self.wrists - np.array(spot), axis=-1)
                    <= radius + thick + self.spare
                )
                free &= ~(near[:, :, None] & low)
        structure = ndimage.generate_binary_structure(3, 3 if self.spare < 0 else 1)
        found: Truths = ndimage.label(free, structure)[0]
        return found

    def radius(self, placed: Placement) -> float:
        """How thick the thing in the hand is; 0 if there is none."""
        return next(
            (r for r, at in zip(self.plot.radii, placed, strict=True) if at == "gripper"), 0.0
        )

    def standing(self, placed: Placement) -> Iterator[tuple[tuple[float, float], float]]:
        for radius, at in zip(self.plot.radii, placed, strict=True):
            if at != "gripper":
                yield self.plot.spots[PLACES.index(at)], radius

    def fronts(self, place: str) -> list[tuple[float, float]]:
        """The turns of both joints with which the spindle is above a place: elbow on one side,
        and on the other.
        """
        x, y = self.plot.spots[PLACES.index(place)]
        cosine = (x * x + y * y - UPPER**2 - FORE**2) / (2 * UPPER * FORE)
        if abs(cosine) > 1:
            return []
        found = []
        for q2 in (math.acos(cosine), -math.acos(cosine)):
            q1 = math.atan2(y, x) - math.atan2(FORE * math.sin(q2), UPPER + FORE * math.cos(q2))
            q1 = math.remainder(q1, math.tau)
            if abs(q1) <= SHOULDER and abs(q2) <= ELBOW:
                found.append((q1, q2))
        return found

    def part_at(self, placed: Placement, q: tuple[float, float], height: float) -> int:
        """The part of the free space that the arm is in; 0 if something touches it."""
        i, j, k = (
            round((q[0] + SHOULDER) / STEP),
            round((q[1] + ELBOW) / STEP),
            round((height - LOW) / RISE),
        )
        return int(self.parts_of_space(placed)[i, j, k])

    def goes_in(self, placed: Placement, place: str, q: tuple[float, float]) -> bool:
        """Whether the straight way up from a place is free for what is in the hand."""
        x, y = self.plot.spots[PLACES.index(place)]
        radius = self.radius(placed)
        apart = ((math.dist((x, y), spot), thick) for spot, thick in self.standing(placed))
        beside = all(far > radius + thick + self.spare for far, thick in apart) if radius else True
        return beside and bool(self.stands(np.array(q[0]), np.array(q[1]), radius))

    def after(
        self, part: int, placed: Placement, thing: int, place: str
    ) -> Iterator[tuple[int, Placement]]:
        """Where the arm may be after it has picked a thing at a place, or has put it there."""
        picks = placed[thing] == place
        there: Placement = tuple(  # type: ignore[assignment]
            ("gripper" if picks else place) if n == thing else at for n, at in enumerate(placed)
        )
        for q in self.fronts(place):
            if (
                part
                and self.part_at(placed, q, LOW + FRONT) == part
                and self.goes_in(placed, place, q)
                and self.goes_in(there, place, q)
            ):
                yield self.part_at(there, q, LOW + FRONT), there

    def choices(self, placed: Placement) -> Iterator[tuple[int, str]]:
        """The steps that the symbols allow: pick anything with an empty hand, put it where it
        suits and nothing is.
        """
        for thing, at in enumerate(placed):
            if at == "gripper":
                free = (each for each in PLACES if each not in placed)
                yield from (
                    (thing, each) for each in free if (THINGS[thing], each) in self.plot.suits
                )
            elif "gripper" not in placed:
                yield thing, at

    def begins(self) -> tuple[int, Placement]:
        return self.part_at(START, (0.0, 0.0), HIGH), START

    def solved(self, movable: Sequence[int] = (0, 1, 2)) -> bool:
        """Whether the bolt gets to its goal if only some of the things may be moved: breadth
        first.
        """
        waiting, seen = [self.begins()], {self.begins()}
        for part, placed in waiting:
            if placed[0] == GOAL:
                return True
            for thing, place in self.choices(placed):
                for reached in self.after(part, placed, thing, place) if thing in movable else ():
                    if reached[0] and reached not in seen:
                        seen.add(reached)
                        waiting.append(reached)
        return False

    def follows(self, steps: Sequence[Function]) -> bool:
        """Whether the arm can take these steps in this order, and the bolt is at its goal then."""
        now = {self.begins()}
        for step in steps:
            thing, place = THINGS.index(str(step.arguments[0])), str(step.arguments[1])
            now = {
                found
                for part, placed in now
                if (thing, place) in self.choices(placed)
                for found in self.after(part, placed, thing, place)
            }
        return any(placed[0] == GOAL for _, placed in now)


def agreed(drawn: Plot) -> tuple[bool, bool] | None:
    """Whether there is a plan, and whether there is one in which only the bolt moves; None if
    that depends on the clearance.
    """
    strict, lenient = Search(drawn, CLEARANCE), Search(drawn, -CLEARANCE)
    if not strict.begins()[0] or any(
        math.dist(drawn.spots[a], drawn.spots[b]) < drawn.radii[a] + drawn.radii[b] + CLEARANCE
        for a, b in ((0, 1), (0, 2), (1, 2))
    ):
        return None
    both = [(each.solved(), each.solved((0,))) for each in (strict, lenient)]
    return both[0] if both[0] == both[1] else None


def written(drawn: Plot, folder: Path) -> Path:
    """The room as the planner reads it: its problem."""
    (folder / "problems").mkdir()
    objects = f"item: [{', '.join(THINGS)}], place: [{', '.join(PLACES)}]"
    (folder / "domain.yaml").write_text(
        DOMAIN.replace("fits(item, place): {facts: []}", '"suits(item, place)": {}').replace(
            "item: [bolt, brick], place: [bench, kiln, top, shelf]", objects
        )
    )
    (folder / "scara.urdf").write_text(URDF)
    fixtures = [
        f"  box_{n}: {{at: [{x}, {y}, {0.5 if tall else 0.35}], shapes: [{{box: [{2 * w}, "
        f"{2 * d}, {1.0 if tall else 0.02}]}}]}}"
        for n, (x, y, w, d, tall) in enumerate(drawn.boxes)
    ]
    parts = [
        f"  {name}: {{at: [{n}, 3, 0], shapes: [{{cylinder: {{radius: {r}, length: {TALL}}}}}],"
        f" features: {{grip: {{at: [0, 0, {TALL / 2}], rpy: [180, 0, 0]}}}}}}"
        for n, (name, r) in enumerate(zip(THINGS, drawn.radii, strict=True))
    ]
    places = [
        f"  {name}: {{at: [{x}, {y}, {LOW}], rpy: [180, 0, 0], approach: {FRONT}}}"
        for name, (x, y) in zip(PLACES, drawn.spots, strict=True)
    ]
    text = CELL.format(
        fixtures="\n".join(fixtures), parts="\n".join(parts), places="\n".join(places)
    )
    (folder / "cell.yaml").write_text(text)
    suits = ", ".join(f'"suits({item}, {place})"' for item, place in sorted(drawn.suits))
    (folder / "problems" / "fire.yaml").write_text(PROBLEM.format(suits=suits))
    return folder / "problems" / "fire.yaml"


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_a_plan_that_moves_is_found_exactly_where_the_search_through_all_placements_finds_one(
    seed: int, tmp_path: Path
) -> None:
    drawn = plot(seed)
    expected = agreed(drawn)
    assert expected is not None, "the seeds are those of rooms in which no clearance decides"
    solvable, with_bolt_alone = expected
    found = moving(load_problem(str(written(drawn, tmp_path))), tmp_path / "cell.yaml")
    outcome = found.run.outcome
    assert isinstance(outcome, Found) == solvable
    if not isinstance(outcome, Found):
        assert found.refused
        assert "has no motion" in outcome.reason
        return
    steps = [step.operator for step in outcome.plan.steps]
    assert Search(drawn, -CLEARANCE).follows(steps)
    assert with_bolt_alone or any(str(step.arguments[0]) != "bolt" for step in steps)
