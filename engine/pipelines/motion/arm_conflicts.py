"""The space that each arm sweeps in each step, and which steps of different arms can collide."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import (
    LegKind,
    Meetings,
    MovedStep,
    SharedZone,
    StepLeg,
    StepPair,
)
from cellwright.engine.pipelines.motion.places_in_a_row import step_parts
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.collision.planning_scene import (
    PlanningScene,
    SweptBoxes,
    common_boxes,
)
from cellwright.engine.stages.geometry.world.collision_scene import scene_of_pairs
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.motion.path_proofs import ArmPath, arms_may_meet
from cellwright.kb.model.plan_model import StepId

Key = tuple[tuple[str, bytes], ...]


@dataclass(frozen=True, eq=False)
class ArmRider:
    """An arm with all that moves with it, in a world: what it holds, and what carries it."""

    world: GeometricWorld
    arm: str

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """The arm's links, and the bodies that ride on it, that carry it, or that ride on these."""
        world, arm = self.world, self.arm
        below = [
            support_name
            for support_name in world.supports(f"{arm}.base")[1:]
            if support_name in world.cell.bodies
        ]
        moving = {
            body_name for body_name in below if world.cell.bodies[body_name].guide is not None
        }
        other_arms = {f"{name}." for name in world.cell.arms if name != arm}
        links = [f"{arm}.{link.name}" for link in world.cell.arms[arm].arm.links]
        return (
            *links,
            *(body for body in world.cell.bodies if self._rides(body, moving, tuple(other_arms))),
        )

    def _rides(self, body: str, moving: set[str], other_arms: tuple[str, ...]) -> bool:
        chain = self.world.supports(body)
        if any(support_name.startswith(other_arms) for support_name in chain):
            return False
        return any(
            support_name.startswith(f"{self.arm}.") or support_name in moving
            for support_name in chain
        )

    @cached_property
    def key(self) -> Key:
        """What tells two such arms apart: where everything is on them."""
        placed = self.world.placed
        own = [body for body in self.bodies if body in placed]
        return tuple(
            (f"{body}:{placed[body].parent}", placed[body].T_parent_frame.tobytes())
            for body in (*own, f"{self.arm}.base")
        )


@dataclass(frozen=True, slots=True, eq=False)
class ArmPassage:
    """A path (m, k) of an arm, with what rides on it all the way."""

    rider: ArmRider
    path: Floats


@dataclass(frozen=True, slots=True, eq=False)
class OccupiedSpace:
    """What one arm does in one step: its passages, the last of which ends where it rests then;
    whether it rides along a rail.
    """

    step: StepId
    arm: str
    passages: tuple[ArmPassage, ...]
    rest: ArmPassage
    rides: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class StepMoment:
    """A step of the plan with the cell before and after it, with all arms, and its motion if it
    has one.
    """

    step: StepId
    before: GeometricWorld
    after: GeometricWorld
    moved: MovedStep | None
    arms: tuple[str, ...]


def occupied_tracks(
    moments: Sequence[StepMoment], homes: Mapping[str, Floats]
) -> dict[str, list[OccupiedSpace]]:
    """For each arm what it does, step by step."""
    now = dict(homes)
    tracks_of_arms: dict[str, list[OccupiedSpace]] = {arm: [] for arm in homes}
    for moment in moments:
        for arm in moment.arms if moment.moved is not None else ():
            assert moment.moved is not None
            passages = tuple(passages_of(moment, arm, now[arm]))
            rides = any(leg.kind is LegKind.DRIVE and leg.arm == arm for leg in moment.moved.legs)
            now[arm] = passages[-1].path[-1]
            rest = ArmPassage(passages[-1].rider, now[arm][None])
            tracks_of_arms[arm].append(OccupiedSpace(moment.step, arm, passages, rest, rides))
    return tracks_of_arms


def passages_of(moment: StepMoment, arm: str, q: Floats) -> Iterator[ArmPassage]:
    """Where an arm is in a step, from its configuration `q` (k,) on; at its end with what it
    holds then.
    """
    assert moment.moved is not None
    for part, before, after in step_parts(moment.moved, moment.before, moment.after):
        of_part = replace(moment, moved=part, before=before, after=after)
        for passage in _passages_at_place(of_part, arm, q):
            yield passage
            q = passage.path[-1]


def _passages_at_place(moment: StepMoment, arm: str, q: Floats) -> Iterator[ArmPassage]:
    assert moment.moved is not None
    before, after = ArmRider(moment.before, arm), ArmRider(moment.after, arm)
    yield ArmPassage(before, q[None])
    for leg in _legs_of_arm(moment.moved.legs, arm):
        q = leg.path[-1]
        if leg.kind is LegKind.DRAG:
            body = _dragged_body(moment, arm)
            world_held = moment.before.moved(arm, leg.path[0])
            yield ArmPassage(
                ArmRider(world_held.affix(body, f"{arm}.tool") if body else world_held, arm),
                leg.path,
            )
        elif leg.kind is LegKind.CARRY:
            world_held = moment.before.moved(arm, leg.path[0])
            for body in leg.holding:
                world_held = (
                    world_held.affix(body, f"{arm}.tool")
                    if body in world_held.cell.bodies
                    else world_held
                )
            yield ArmPassage(ArmRider(world_held, arm), leg.path)
        else:
            yield ArmPassage(after if leg.kind is LegKind.OUT else before, leg.path)
    yield ArmPassage(after, q[None])


def _legs_of_arm(legs: Sequence[StepLeg], arm: str) -> Iterator[StepLeg]:
    for leg in legs:
        for own_leg in (leg, *leg.beside):
            if own_leg.arm == arm:
                yield own_leg


def _dragged_body(moment: StepMoment, arm: str) -> str:
    """The body whose place along its joint a step changes, in whose place the arm is; empty if
    none.
    """
    for name, body in moment.before.cell.bodies.items():
        moved = moment.before.placed[name].T_parent_frame, moment.after.placed[name].T_parent_frame
        own = any(
            support_name.startswith(f"{arm}.") for support_name in moment.before.supports(name)
        )
        if (
            body.guide is not None
            and not body.guide.follows
            and not own
            and not np.array_equal(*moved)
        ):
            return name
    return ""


ARM_MARGIN_M = 0.005  # arms of different steps stay so far apart: servos lag


@dataclass(eq=False)
class ArmEncounters:
    """What is known of two arms that pass each other.

    What was found for one plan serves the next.
    """

    backend: GeometryBackend
    _grounds: dict[tuple[str, Key, str, Key], PlanningScene] = field(default_factory=dict)
    _swept: dict[tuple[str, Key], SweptBoxes] = field(default_factory=dict)
    _boxes: dict[tuple[str, Key, bytes], Floats] = field(default_factory=dict)
    _met: dict[tuple[str, Key, bytes, str, Key, bytes], bool] = field(default_factory=dict)

    def boxes(self, passage: ArmPassage) -> Floats:
        """The boxes (n, 6) that an arm sweeps on a passage."""
        rider = passage.rider
        key = (rider.arm, rider.key, passage.path.tobytes())
        if key not in self._boxes:
            whole = _all_joints(rider, passage.path)
            if key[:2] not in self._swept:
                self._swept[key[:2]] = SweptBoxes(rider.world, rider.bodies)
            self._boxes[key] = self._swept[key[:2]].boxes(whole)
        return self._boxes[key]

    def meet(self, first: ArmPassage, second: ArmPassage) -> bool:
        """Whether it is not proved that two arms stay apart, wherever each is on its passage."""
        a, b = first.rider, second.rider
        key = (a.arm, a.key, first.path.tobytes(), b.arm, b.key, second.path.tobytes())
        if key not in self._met:
            near = len(common_boxes(self.boxes(first), self.boxes(second) + _growth(ARM_MARGIN_M)))
            self._met[key] = bool(near) and arms_may_meet(
                self._ground(a, b),
                ArmPath(_all_joints(a, first.path)),
                ArmPath(_all_joints(b, second.path)),
                ARM_MARGIN_M,
            )
        return self._met[key]

    def apart(
        self, first: tuple[ArmRider, Floats, Floats], second: tuple[ArmRider, Floats, Floats]
    ) -> tuple[Floats, Floats]:
        """How far apart (m, at most 1) two arms are at configurations (n, k) of each taken
        together, and how far both move at most.

        The third of each says how much its joints turn (n, k).
        """
        (a, mine, my_turn), (b, theirs, their_turn) = first, second
        ground = self._ground(a, b)
        moved = ground.travels(_all_joints(a, my_turn)) + ground.travels(_all_joints(b, their_turn))
        return ground.clearance(_all_joints(a, mine) + _all_joints(b, theirs)), moved

    def _ground(self, a: ArmRider, b: ArmRider) -> PlanningScene:
        key = (a.arm, a.key, b.arm, b.key)
        if key not in self._grounds:
            own = set(a.bodies)
            other_bodies = [body for body in b.bodies if body not in own]
            world = a.world
            for name in (*other_bodies, f"{b.arm}.base"):
                if name in world.placed:
                    fixed = b.world.placed[name]
                    world = (
                        world.put(name, fixed.parent, fixed.T_parent_frame)
                        if name in world.cell.bodies
                        else world
                    )
            pairs = frozenset(frozenset((x, y)) for x in own for y in other_bodies)
            self._grounds[key] = PlanningScene(
                self.backend.checker_of_few(scene_of_pairs(world, pairs))
            )
        return self._grounds[key]

    def blocked(self, body: str, T_world_body: Floats, passage: ArmPassage) -> bool:
        """Whether a body that stands somewhere is in the way of a passage, for all that is
        proved.
        """
        rider = passage.rider
        if body in rider.bodies:
            return False
        world = rider.world.put(body, "world", T_world_body)
        body_boxes = SweptBoxes(world, [body]).boxes(np.zeros((1, world.joints.count)))
        if not len(common_boxes(body_boxes, self.boxes(passage))):
            return False
        pairs = frozenset(frozenset((body, other_body)) for other_body in rider.bodies)
        ground = PlanningScene(self.backend.checker_of_few(scene_of_pairs(world, pairs)))
        rest = ArmPath(np.zeros((1, world.joints.count)))
        return arms_may_meet(ground, rest, ArmPath(_all_joints(rider, passage.path)))


def _growth(by_m: float) -> Floats:
    return np.array([-by_m] * 3 + [by_m] * 3)


def _all_joints(rider: ArmRider, path: Floats) -> Floats:
    """Configurations of all joints (m, all) of which those of one arm (m, k) are given; the
    others are 0.
    """
    world, first = rider.world, rider.world.first_carriers[rider.arm]
    whole = np.zeros((len(path), world.joints.count))
    whole[:, first : first + path.shape[1]] = path
    return whole


@dataclass(frozen=True, eq=False)
class ArmMeetings:
    """Where arms can meet, and the space that they then share."""

    meetings: Meetings
    zones: tuple[SharedZone, ...]


def find_meetings(
    moments: Sequence[StepMoment], before: frozenset[StepPair], encounters: ArmEncounters
) -> ArmMeetings:
    """The meetings of a plan whose steps come in this order.

    `before` are pairs of steps that are in order anyway.
    """
    homes = moments[0].before.configurations if moments else {}
    own = occupied_tracks(moments, homes)
    arms = {moment.step: set(moment.arms) for moment in moments}
    steps, rests = set[StepPair](), set[tuple[str, StepId | None, StepId]]()
    shared: dict[StepPair, Floats] = {}
    looked = near = 0
    around = {arm: _swept_box(encounters, track) for arm, track in own.items()}
    for first, second in combinations(own, 2):
        for first_occupied, mine in zip(own[first], around[first], strict=True):
            for n in np.nonzero(_overlaps(mine, around[second]))[0]:
                second_occupied = own[second][n]
                if second in arms[first_occupied.step] or first in arms[second_occupied.step]:
                    continue
                common = _shared_space(encounters, first_occupied, second_occupied)
                near += bool(len(common))
                if len(common) and _can_meet(
                    encounters,
                    first_occupied.passages,
                    second_occupied.passages,
                    first_occupied.rides or second_occupied.rides,
                ):
                    steps |= {(first_occupied.step, second_occupied.step)}
                    shared[first_occupied.step, second_occupied.step] = common
        alone = {
            arm: [occupied for occupied in own[arm] if rival not in arms[occupied.step]]
            for arm, rival in ((first, second), (second, first))
        }
        looked += len(alone[first]) * len(alone[second])
        for arm, rival in ((first, second), (second, first)):
            joint = {occupied.step for occupied in own[arm] if rival in arms[occupied.step]}
            rests |= set(
                _blocking_rests(encounters, arm, own[arm], alone[rival], moments[0], steps, joint)
            )
    orders = frozenset(_clearing_orders(moments, own, before, encounters))
    meetings = Meetings(
        {arm: tuple(occupied.step for occupied in track) for arm, track in own.items()},
        frozenset(steps),
        frozenset(rests),
        orders,
        looked,
        near,
    )
    return ArmMeetings(meetings, _shared_zones(meetings, shared))


def _shared_space(encounters: ArmEncounters, first: OccupiedSpace, second: OccupiedSpace) -> Floats:
    """The space (n, 6) that two arms share in two steps, by the boxes around what they sweep."""
    mine, theirs = (
        np.concatenate([encounters.boxes(p) for p in occupied.passages])
        for occupied in (first, second)
    )
    return common_boxes(mine, theirs + _growth(ARM_MARGIN_M))


def _can_meet(
    encounters: ArmEncounters,
    mine: Sequence[ArmPassage],
    theirs: Sequence[ArmPassage],
    rides: bool = False,
) -> bool:
    """Whether two arms can meet on some passages; an arm that rides on a rail is taken to."""
    return rides or any(encounters.meet(a, b) for a in mine for b in theirs)


def _blocking_rests(
    encounters: ArmEncounters,
    arm: str,
    track: Sequence[OccupiedSpace],
    rivals: Sequence[OccupiedSpace],
    start: StepMoment,
    steps: set[StepPair],
    joint: set[StepId],
) -> Iterator[tuple[str, StepId | None, StepId]]:
    """Where an arm rests in the way of another one's steps.

    Where it rests after a step it was in the step, too; what that meets is known of the `steps`,
    but not of those of both arms (`joint`).
    """
    home = ArmPassage(ArmRider(start.before, arm), start.before.configurations[arm][None])
    rests = [(None, home), *((occupied.step, occupied.rest) for occupied in track)]
    for after, rest in rests:
        for rival in rivals:
            open_ = after is None or after in joint
            near = open_ or (after, rival.step) in steps or (rival.step, after) in steps
            if near and _can_meet(encounters, [rest], rival.passages, rival.rides):
                yield arm, after, rival.step


def _swept_box(encounters: ArmEncounters, track: Sequence[OccupiedSpace]) -> Floats:
    """A box (n, 6) around all that an arm sweeps in each step."""
    boxes_of_steps = [
        np.concatenate([encounters.boxes(p) for p in occupied.passages]) for occupied in track
    ]
    boxes = [
        np.concatenate([step_boxes[:, :3].min(axis=0), step_boxes[:, 3:].max(axis=0)])
        for step_boxes in boxes_of_steps
    ]
    return np.array(boxes).reshape(len(track), 6)


def _overlaps(box: Floats, other_boxes: Floats) -> Floats:
    """Which of some boxes (n, 6) are within the margin of one (6,)."""
    low, high = np.maximum(box[:3], other_boxes[:, :3]), np.minimum(box[3:], other_boxes[:, 3:])
    return np.asarray((low <= high + ARM_MARGIN_M).all(axis=1))


def _clearing_orders(
    moments: Sequence[StepMoment],
    own: dict[str, list[OccupiedSpace]],
    before: frozenset[StepPair],
    encounters: ArmEncounters,
) -> Iterator[StepPair]:
    """Steps that put something in the way of a step of another arm, or take it away, stay in
    their order.
    """
    rank = {moment_.step: n for n, moment_ in enumerate(moments)}
    for moment in moments:
        changes = list(_moved_bodies(moment))
        for arm, track in own.items() if changes else ():
            for later_occupied in track if arm not in moment.arms else ():
                first, second = sorted((moment.step, later_occupied.step), key=rank.__getitem__)
                if (first, second) in before:
                    continue
                for body, was, now in changes:
                    T = was if first == moment.step else now
                    if T is not None and any(
                        encounters.blocked(body, T, p) for p in later_occupied.passages
                    ):
                        yield first, second


def _moved_bodies(moment: StepMoment) -> Iterator[tuple[str, Floats | None, Floats | None]]:
    """The bodies that a step moves, and where each stands before and after it; None where it
    rides on an arm.
    """
    for body in moment.before.cell.bodies:
        was, now = (_body_pose(world, body) for world in (moment.before, moment.after))
        if was is None and now is None:
            continue
        if was is None or now is None or not np.allclose(was, now, atol=1e-9):
            yield body, was, now


def _body_pose(world: GeometricWorld, body: str) -> Floats | None:
    """Where a body stands in the world (4, 4); None if it rides on an arm."""
    if world.locate(body).carrier:
        return None
    return world.pose("world", body)


def _shared_zones(meetings: Meetings, shared: dict[StepPair, Floats]) -> tuple[SharedZone, ...]:
    """Steps that meet, directly or through others, share a zone."""
    zone_of: dict[StepId, StepId] = {}

    def root(step: StepId) -> StepId:
        while zone_of.setdefault(step, step) != step:
            step = zone_of[step]
        return step

    for first_step, second_step in sorted(meetings.steps):
        zone_of[root(second_step)] = root(first_step)
    groups: dict[StepId, list[StepPair]] = {}
    for pair in sorted(meetings.steps):
        groups.setdefault(root(pair[0]), []).append(pair)
    return tuple(
        _zone_of_pairs(f"shared_{n}", pairs, meetings, shared)
        for n, pairs in enumerate(groups.values(), 1)
    )


def _zone_of_pairs(
    name: str, pairs: list[StepPair], meetings: Meetings, shared: dict[StepPair, Floats]
) -> SharedZone:
    boxes = np.concatenate([shared[pair] for pair in pairs])
    low, high = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    inside = {step for pair in pairs for step in pair}
    steps = {
        arm: tuple(step for step in track if step in inside)
        for arm, track in meetings.tracks.items()
        if inside & set(track)
    }
    return SharedZone(
        name,
        (float(low[0]), float(low[1]), float(low[2])),
        (float(high[0]), float(high[1]), float(high[2])),
        steps,
    )
