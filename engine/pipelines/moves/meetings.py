"""Which steps of different arms can meet: found from the space that the arms sweep, and proved for those that cannot.

Boxes around what is swept are compared first. What they leave open is decided on the paths (`cellwright.engine.stages.motion.meeting`): two steps
never meet if no place of the one arm on its path is near any place of the other on its own, whatever the times. What an arm moves
while it does not hold it (a part before it is taken and after it is put down, a drawer) is in the way of others, too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.passing import Meetings, Pair, Zone
from cellwright.engine.pipelines.moves.tracks import Key, Moment, Occupied, Passage, Rider, tracks
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.engine.stages.geometry.collision.swept import Swept, crossed
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.geometry.world.scenes import scene_of_pairs
from cellwright.engine.stages.motion.meeting import Course, meet
from cellwright.kb.model.plan import StepId

MARGIN_M = 0.005  # arms of different steps stay so far apart: servos lag


@dataclass(eq=False)
class Encounters:
    """What is known of two arms that pass each other. What was found for one plan serves the next."""

    backend: GeometryBackend
    _grounds: dict[tuple[str, Key, str, Key], Ground] = field(default_factory=dict)
    _swept: dict[tuple[str, Key], Swept] = field(default_factory=dict)
    _boxes: dict[tuple[str, Key, bytes], Floats] = field(default_factory=dict)
    _met: dict[tuple[str, Key, bytes, str, Key, bytes], bool] = field(default_factory=dict)

    def boxes(self, passage: Passage) -> Floats:
        """The boxes (n, 6) that an arm sweeps on a passage."""
        rider = passage.rider
        key = (rider.arm, rider.key, passage.path.tobytes())
        if key not in self._boxes:
            whole = _whole(rider, passage.path)
            if key[:2] not in self._swept:
                self._swept[key[:2]] = Swept(rider.world, rider.bodies)
            self._boxes[key] = self._swept[key[:2]].boxes(whole)
        return self._boxes[key]

    def meet(self, one: Passage, other: Passage) -> bool:
        """Whether it is not proved that two arms stay apart, wherever each is on its passage."""
        a, b = one.rider, other.rider
        key = (a.arm, a.key, one.path.tobytes(), b.arm, b.key, other.path.tobytes())
        if key not in self._met:
            near = len(crossed(self.boxes(one), self.boxes(other) + _grown(MARGIN_M)))
            self._met[key] = bool(near) and meet(
                self._ground(a, b), Course(_whole(a, one.path)), Course(_whole(b, other.path)), MARGIN_M
            )
        return self._met[key]

    def apart(
        self, one: tuple[Rider, Floats, Floats], other: tuple[Rider, Floats, Floats]
    ) -> tuple[Floats, Floats]:
        """How far apart (m, at most 1) two arms are at configurations (n, k) of each taken together, and how far both move at most.

        The third of each says how much its joints turn (n, k).
        """
        (a, mine, my_turn), (b, theirs, their_turn) = one, other
        ground = self._ground(a, b)
        moved = ground.travels(_whole(a, my_turn)) + ground.travels(_whole(b, their_turn))
        return ground.clearance(_whole(a, mine) + _whole(b, theirs)), moved

    def _ground(self, a: Rider, b: Rider) -> Ground:
        key = (a.arm, a.key, b.arm, b.key)
        if key not in self._grounds:
            own = set(a.bodies)
            others = [body for body in b.bodies if body not in own]
            world = a.world
            for name in (*others, f"{b.arm}.base"):
                if name in world.placed:
                    fixed = b.world.placed[name]
                    world = (
                        world.put(name, fixed.parent, fixed.T_parent_frame)
                        if name in world.cell.bodies
                        else world
                    )
            pairs = frozenset(frozenset((x, y)) for x in own for y in others)
            self._grounds[key] = Ground(self.backend.checker_of_few(scene_of_pairs(world, pairs)))
        return self._grounds[key]

    def blocked(self, body: str, T_world_body: Floats, passage: Passage) -> bool:
        """Whether a body that stands somewhere is in the way of a passage, for all that is proved."""
        rider = passage.rider
        if body in rider.bodies:
            return False
        world = rider.world.put(body, "world", T_world_body)
        here = Swept(world, [body]).boxes(np.zeros((1, world.joints.count)))
        if not len(crossed(here, self.boxes(passage))):
            return False
        pairs = frozenset(frozenset((body, each)) for each in rider.bodies)
        ground = Ground(self.backend.checker_of_few(scene_of_pairs(world, pairs)))
        rest = Course(np.zeros((1, world.joints.count)))
        return meet(ground, rest, Course(_whole(rider, passage.path)))


def _grown(by_m: float) -> Floats:
    return np.array([-by_m] * 3 + [by_m] * 3)


def _whole(rider: Rider, path: Floats) -> Floats:
    """Configurations of all joints (m, all) of which those of one arm (m, k) are given; the others are 0."""
    world, first = rider.world, rider.world.first_carriers[rider.arm]
    whole = np.zeros((len(path), world.joints.count))
    whole[:, first : first + path.shape[1]] = path
    return whole


@dataclass(frozen=True, eq=False)
class Found:
    """Where arms can meet, and the space that they then share."""

    meetings: Meetings
    zones: tuple[Zone, ...]


def found(moments: Sequence[Moment], before: frozenset[Pair], encounters: Encounters) -> Found:
    """The meetings of a plan whose steps come in this order. `before` are pairs of steps that are in order anyway."""
    homes = moments[0].before.configurations if moments else {}
    own = tracks(moments, homes)
    arms = {each.step: set(each.arms) for each in moments}
    steps, rests = set[Pair](), set[tuple[str, StepId | None, StepId]]()
    shared: dict[Pair, Floats] = {}
    looked = near = 0
    around = {arm: _around(encounters, track) for arm, track in own.items()}
    for first, second in combinations(own, 2):
        for one, mine in zip(own[first], around[first], strict=True):
            for n in np.nonzero(_overlap(mine, around[second]))[0]:
                other = own[second][n]
                if second in arms[one.step] or first in arms[other.step]:
                    continue
                common = _common(encounters, one, other)
                near += bool(len(common))
                if len(common) and _meets(encounters, one.passages, other.passages, one.rides or other.rides):
                    steps |= {(one.step, other.step)}
                    shared[one.step, other.step] = common
        alone = {
            arm: [each for each in own[arm] if rival not in arms[each.step]]
            for arm, rival in ((first, second), (second, first))
        }
        looked += len(alone[first]) * len(alone[second])
        for arm, rival in ((first, second), (second, first)):
            joint = {each.step for each in own[arm] if rival in arms[each.step]}
            rests |= set(_rests(encounters, arm, own[arm], alone[rival], moments[0], steps, joint))
    orders = frozenset(_cleared(moments, own, before, encounters))
    meetings = Meetings(
        {arm: tuple(each.step for each in track) for arm, track in own.items()},
        frozenset(steps),
        frozenset(rests),
        orders,
        looked,
        near,
    )
    return Found(meetings, _zones(meetings, shared))


def _common(encounters: Encounters, one: Occupied, other: Occupied) -> Floats:
    """The space (n, 6) that two arms share in two steps, by the boxes around what they sweep."""
    mine, theirs = (np.concatenate([encounters.boxes(p) for p in each.passages]) for each in (one, other))
    return crossed(mine, theirs + _grown(MARGIN_M))


def _meets(
    encounters: Encounters, mine: Sequence[Passage], theirs: Sequence[Passage], rides: bool = False
) -> bool:
    """Whether two arms can meet on some passages; an arm that rides on a rail is taken to."""
    return rides or any(encounters.meet(a, b) for a in mine for b in theirs)


def _rests(
    encounters: Encounters,
    arm: str,
    track: Sequence[Occupied],
    rivals: Sequence[Occupied],
    start: Moment,
    steps: set[Pair],
    joint: set[StepId],
) -> Iterator[tuple[str, StepId | None, StepId]]:
    """Where an arm rests in the way of another one's steps.

    Where it rests after a step it was in the step, too; what that meets is known of the `steps`, but not of those of both arms (`joint`).
    """
    home = Passage(Rider(start.before, arm), start.before.configurations[arm][None])
    rests = [(None, home), *((each.step, each.rest) for each in track)]
    for after, rest in rests:
        for other in rivals:
            open_ = after is None or after in joint
            near = open_ or (after, other.step) in steps or (other.step, after) in steps
            if near and _meets(encounters, [rest], other.passages, other.rides):
                yield arm, after, other.step


def _around(encounters: Encounters, track: Sequence[Occupied]) -> Floats:
    """A box (n, 6) around all that an arm sweeps in each step."""
    found = [np.concatenate([encounters.boxes(p) for p in each.passages]) for each in track]
    boxes = [np.concatenate([each[:, :3].min(axis=0), each[:, 3:].max(axis=0)]) for each in found]
    return np.array(boxes).reshape(len(track), 6)


def _overlap(box: Floats, others: Floats) -> Floats:
    """Which of some boxes (n, 6) are within the margin of one (6,)."""
    low, high = np.maximum(box[:3], others[:, :3]), np.minimum(box[3:], others[:, 3:])
    return np.asarray((low <= high + MARGIN_M).all(axis=1))


def _cleared(
    moments: Sequence[Moment], own: dict[str, list[Occupied]], before: frozenset[Pair], encounters: Encounters
) -> Iterator[Pair]:
    """Steps that put something in the way of a step of another arm, or take it away, stay in their order."""
    rank = {each.step: n for n, each in enumerate(moments)}
    for moment in moments:
        changes = list(_changes(moment))
        for arm, track in own.items() if changes else ():
            for other in track if arm not in moment.arms else ():
                first, second = sorted((moment.step, other.step), key=rank.__getitem__)
                if (first, second) in before:
                    continue
                for body, was, now in changes:
                    T = was if first == moment.step else now
                    if T is not None and any(encounters.blocked(body, T, p) for p in other.passages):
                        yield first, second


def _changes(moment: Moment) -> Iterator[tuple[str, Floats | None, Floats | None]]:
    """The bodies that a step moves, and where each stands before and after it; None where it rides on an arm."""
    for body in moment.before.cell.bodies:
        was, now = (_standing(world, body) for world in (moment.before, moment.after))
        if was is None and now is None:
            continue
        if was is None or now is None or not np.allclose(was, now, atol=1e-9):
            yield body, was, now


def _standing(world: World, body: str) -> Floats | None:
    """Where a body stands in the world (4, 4); None if it rides on an arm."""
    if world.locate(body).carrier:
        return None
    return world.pose("world", body)


def _zones(meetings: Meetings, shared: dict[Pair, Floats]) -> tuple[Zone, ...]:
    """Steps that meet, directly or through others, share a zone."""
    zone_of: dict[StepId, StepId] = {}

    def root(step: StepId) -> StepId:
        while zone_of.setdefault(step, step) != step:
            step = zone_of[step]
        return step

    for one, other in sorted(meetings.steps):
        zone_of[root(other)] = root(one)
    groups: dict[StepId, list[Pair]] = {}
    for pair in sorted(meetings.steps):
        groups.setdefault(root(pair[0]), []).append(pair)
    return tuple(_zone(f"shared_{n}", pairs, meetings, shared) for n, pairs in enumerate(groups.values(), 1))


def _zone(name: str, pairs: list[Pair], meetings: Meetings, shared: dict[Pair, Floats]) -> Zone:
    boxes = np.concatenate([shared[pair] for pair in pairs])
    low, high = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    inside = {step for pair in pairs for step in pair}
    steps = {
        arm: tuple(step for step in track if step in inside)
        for arm, track in meetings.tracks.items()
        if inside & set(track)
    }
    return Zone(
        name,
        (float(low[0]), float(low[1]), float(low[2])),
        (float(high[0]), float(high[1]), float(high[2])),
        steps,
    )
