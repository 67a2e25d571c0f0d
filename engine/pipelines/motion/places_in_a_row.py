"""Steps with several places in a row, and what a step moves without a motion.

An arm takes a body up at the place where the body is before the step, and leaves it at the place
where the facts after the step have it. Between the two the body rides in the hand.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.motion_values import MovedStep, PlaceStop, StepLeg, Unmoved
from cellwright.engine.pipelines.motion.arm_progress import ArmsProgress
from cellwright.engine.pipelines.motion.cell_state import CellState
from cellwright.engine.pipelines.motion.step_motion import StepMotion
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.cell_model import Ends, Operation, Place
from cellwright.kb.model.plan_model import Step

GRIPPED_WITHIN_M = 0.01  # how far the hand may be from where a body is gripped
SAME_SIDE = 0.98  # the least cosine between the directions in which a body is gripped twice


@dataclass(frozen=True, slots=True, eq=False)
class HandledBody:
    """A body whose place a step changes: taken up at place number `taken` (-1: in the hand before
    the step), left at number `left` (as many as there are places: in the hand after the step). Both
    are None if no place of the step is where the body is.

    `T_tool_body` (4, 4) is how the hand holds it between.
    """

    body: str
    taken: int | None
    left: int | None
    T_tool_body: Floats

    @property
    def jumps(self) -> bool:
        """Whether it gets where it is after the step without an arm."""
        return self.taken is None or self.left is None


def handled_bodies(
    before: GeometricWorld, after: GeometricWorld, places: Sequence[Place]
) -> list[HandledBody]:
    """The bodies that a step takes up and leaves, by the worlds before and after it, in the order
    of the cell. What moves along its own joint is none of them, nor what rides on it.
    """
    return [
        _handled(before, after, places, name)
        for name in changed_bodies(before, after)
        if before.cell.bodies[name].guide is None
    ]


def changed_bodies(before: GeometricWorld, after: GeometricWorld) -> Iterator[str]:
    """The bodies that stand on something else after a step, or elsewhere on it."""
    for name in before.cell.bodies:
        old, new = before.placed[name], after.placed.get(name)
        if new is None or new is old:
            continue
        if old.parent != new.parent or not np.allclose(old.T_parent_frame, new.T_parent_frame):
            yield name


def _handled(
    before: GeometricWorld, after: GeometricWorld, places: Sequence[Place], body: str
) -> HandledBody:
    hands = {place.arm for place in places} or set(before.cell.arms)
    count, held = len(places), [_holder(world, body) in hands for world in (before, after)]
    grips_before = [_tool_on_body(before, place, body) for place in places]
    taken = -1 if held[0] else _first_gripped(before, body, grips_before)
    if taken is None:
        return HandledBody(body, None, None, np.eye(4))
    grip = _held_grip(before, body) if held[0] else grips_before[taken]
    left = count if held[1] else None
    if left is None:
        grips_after = [_tool_on_body(after, place, body) for place in places]
        same = [n for n in range(taken + 1, count) if _is_same_grip(grip, grips_after[n])]
        # what was set down at its own place again, turned or not, was left there
        same = same or [
            n for n in range(max(taken, 0), count) if _is_same_grip(grip, grips_after[n])
        ]
        left = same[-1] if same else None
    return HandledBody(body, taken, left, transforms.inverse(grip))


def _holder(world: GeometricWorld, body: str) -> str:
    """The arm that carries a body; empty if none does."""
    for support in world.supports(body)[1:]:
        arm, _, part = support.partition(".")
        if arm in world.cell.arms and part != "base":
            return arm
    return ""


def _held_grip(world: GeometricWorld, body: str) -> Floats:
    """T_body_tool (4, 4) of a body in a hand."""
    return world.pose(body, f"{_holder(world, body)}.tool")


def _tool_on_body(world: GeometricWorld, place: Place, body: str) -> Floats:
    """T_body_tool (4, 4) of the arm of a place, while it is there."""
    T_body_end = matmul(
        world.pose(body, place.placement.parent), transforms.of_pose(place.placement.pose)
    )
    if not place.tool:
        return T_body_end
    tip = transforms.of_pose(world.cell.bodies[place.tool].features["tip"])
    return matmul(T_body_end, transforms.inverse(tip), world.grip(place.tool))


def _first_gripped(world: GeometricWorld, body: str, grips: Sequence[Floats]) -> int | None:
    """The first place at which the hand is where a body can be gripped: at its frame, or at one of
    the poses that are named on it.
    """
    features = world.cell.bodies[body].features.values()
    points = np.array([np.zeros(3), *(transforms.of_pose(pose)[:3, 3] for pose in features)])
    near = (
        n
        for n, grip in enumerate(grips)
        if np.linalg.norm(points - grip[:3, 3], axis=1).min() <= GRIPPED_WITHIN_M
    )
    return next(near, None)


def _is_same_grip(first: Floats, second: Floats) -> bool:
    """Whether a hand holds a body at the same point from the same side; it may turn about its z."""
    apart_m = float(np.linalg.norm(first[:3, 3] - second[:3, 3]))
    return apart_m <= GRIPPED_WITHIN_M and float(first[:3, 2] @ second[:3, 2]) >= SAME_SIDE


def world_after_stop(
    before: GeometricWorld, after: GeometricWorld, arm: str, stop: PlaceStop
) -> GeometricWorld:
    """The cell when an arm leaves one of several places of a step."""
    placed = {**before.placed, **{body: after.placed[body] for body in stop.put}}
    world = replace(before, placed=placed)
    for body, T_tool_body in stop.in_hand.items():
        world = world.put(body, f"{arm}.tool", T_tool_body)
    return world


def step_parts(
    moved: MovedStep, before: GeometricWorld, after: GeometricWorld
) -> list[tuple[MovedStep, GeometricWorld, GeometricWorld]]:
    """A step as one for each of its places, each with the cell before and after it."""
    if not moved.stops:
        return [(moved, before, after)]
    parts, first, world = [], 0, before
    for number, stop in enumerate(moved.stops, 1):
        is_last = number == len(moved.stops)
        end = len(moved.legs) if is_last else first + stop.legs
        legs, takes_s = moved.legs[first:end], moved.takes_s / len(moved.stops)
        arm = moved.legs[0].arm if moved.legs else ""
        then = after if is_last or not arm else world_after_stop(before, after, arm, stop)
        part = replace(moved, place=stop.place, legs=legs, takes_s=takes_s, stops=())
        parts.append((part, world, then))
        first, world = end, then
    return parts


@dataclass(eq=False)
class PlacesInARow:
    """A step of one arm with several places in a row; `known` are straight ways by place."""

    hands: ArmsProgress
    step: Step
    operation: Operation
    places: Sequence[Place]
    before: CellState
    after: CellState
    known: Mapping[str, Sequence[Floats]]

    def moved(self) -> MovedStep | Unmoved:
        """The motion of the step, or why there is none; then the arm is where it was."""
        arm = self.places[0].arm
        if any(place.arm != arm for place in self.places):
            reason = "its places in a row belong to several arms"
            place = next(place.name for place in self.places if place.arm != arm)
            return Unmoved(self.step.id, self.step.operator, place, "reach", reason, sure=True)
        stand = arm, self.hands.now(arm), self.hands.standing(arm)
        legs, stops, room = list[StepLeg](), list[PlaceStop](), self.before
        for number, stop in enumerate(self._stops()):
            is_last = number == len(self.places) - 1
            then = self.after if is_last else self._room_after(stop)
            part = self._part(number, room, then)
            if isinstance(part, Unmoved):
                self.hands.arrive(*stand)
                return part
            legs += part.legs
            stops.append(replace(stop, legs=len(part.legs)))
            room = then
        takes_s, place_name = self.operation.takes_s * len(stops), self.places[-1].name
        return MovedStep(
            self.step.id, self.step.operator, place_name, tuple(legs), takes_s, tuple(stops)
        )

    def _part(self, number: int, room: CellState, then: CellState) -> MovedStep | Unmoved:
        place, is_last = self.places[number], number == len(self.places) - 1
        ends = self.operation.ends if is_last else Ends.OUTSIDE
        alone = replace(self.operation, at=None, then=(), ends=ends)
        known = self.known.get(place.name, ())
        return StepMotion(self.hands, self.step, alone, place, room, then, known).moved()

    def _stops(self) -> list[PlaceStop]:
        """What each stop changes; how many legs it has is not known yet."""
        handled = [
            body
            for body in handled_bodies(self.before.world, self.after.world, self.places)
            if not body.jumps
        ]
        stops = []
        for number, place in enumerate(self.places):
            in_hand, put = dict[str, Floats](), []
            for body in handled:
                assert body.taken is not None
                assert body.left is not None
                if body.left <= number:
                    put.append(body.body)
                elif body.taken <= number and body.taken >= 0:
                    in_hand[body.body] = body.T_tool_body
            stops.append(PlaceStop(place.name, 0, in_hand, tuple(put)))
        return stops

    def _room_after(self, stop: PlaceStop) -> CellState:
        arm = self.places[0].arm
        world = world_after_stop(self.before.world, self.after.world, arm, stop)
        return CellState(world, self.before.backend, self.before.kinematics)
