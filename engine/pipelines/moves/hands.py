"""The arms of a cell as they go along: where each is, the ways that it takes, and how long it takes for them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.motion import Blocked, Moved, Query
from cellwright.engine.model.moves import Leg, LegKind
from cellwright.engine.pipelines.moves.rooms import Room
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.motion.kept import KeptRoadmaps
from cellwright.engine.stages.motion.trajectory import Limits, fastest
from cellwright.kb.model.cell import Arm, BodyKind, Cell, Place

BUDGET = 400_000  # configurations that the search for a way looks at
CARRYING = 0.5  # of the full speed and acceleration: for a part that friction alone holds
UNKNOWN_SPEED = 1.0  # rad/s or m/s
SWIFT, ABRUPT = 4.0, 10.0  # 1/s: acceleration of the full speed, jerk of the full acceleration


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """The arm stands before a place, or in it; `straight` (m, k) is the way from the front into the place."""

    place: str
    straight: Floats
    inside: bool = False


Where = Mapping[str, tuple[Floats, Front | None]]  # of each arm, and what it stands before


@dataclass(eq=False)
class Hands:
    """Where the arms of a cell are, before or in which places, and the ways that they know."""

    cell: Cell
    seed: int = 0
    bridges: int = 30
    roadmaps: KeptRoadmaps = field(default_factory=KeptRoadmaps)
    _now: dict[str, Floats] = field(default_factory=dict)
    _front: dict[str, Front] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._home = World.of(self.cell).configurations
        self.go_home()

    def go_home(self) -> None:
        """Every arm is where its file has it rest."""
        self._now, self._front = dict(self._home), {}

    def where(self) -> Where:
        """Where all arms are."""
        return {arm: (q, self._front.get(arm)) for arm, q in self._now.items()}

    def put(self, where: Where) -> None:
        """Some arms are there now."""
        for arm, (q, front) in where.items():
            self.arrive(arm, q, front)

    def now(self, arm: str) -> Floats:
        """Where an arm is: its configuration (k,)."""
        return self._now[arm]

    def arrive(self, arm: str, q: Floats, front: Front | None) -> None:
        """The arm is at a configuration now, before or in a place."""
        self._now[arm] = q
        self._front.pop(arm, None)
        if front is not None:
            self._front[arm] = front

    def standing(self, arm: str) -> Front | None:
        """How an arm stands before a place, or in it; None if it is elsewhere."""
        return self._front.get(arm)

    def front(self, place: Place) -> Front | None:
        """How the arm stands before this place, or in it; None if it is elsewhere."""
        found = self._front.get(place.arm)
        return found if found is not None and found.place == place.name else None

    def leg(
        self, kind: LegKind, arm: str, path: Floats, room: Room, proved: bool = True, factor: float = 1.0
    ) -> Leg:
        """A leg in the least time, within what the joints can do."""
        corners = corners_s(self.cell.arms[arm].arm, path, factor)
        return Leg(kind, arm, path, corners, proved, held(room.world, arm))

    def way(self, room: Room, arm: str, goals: Floats, budget: int = BUDGET) -> Leg | Blocked | None:
        """The way from where the arm is to one of some configurations (n, k); None if start or goals are not free."""
        world = room.world
        first, count = world.first_carriers[arm], world.models[arm].joints.count
        query = Query(
            room.whole(arm, self.now(arm)[None])[0],
            room.whole(arm, goals),
            seed=self.seed,
            budget=budget,
            bridges=self.bridges,
            moving=tuple(range(first, first + count)),
        )
        answer = self.roadmaps.plan(room.free(arm), query)
        if isinstance(answer, Blocked):
            answer = self._by_rest(room, arm, query) or answer
        if isinstance(answer, Moved):
            path = answer.path[:, first : first + count]
            factor = CARRYING if _holds_part(world, arm) else 1.0
            return self.leg(LegKind.WAY, arm, path, room, answer.proved, factor)
        return answer if isinstance(answer, Blocked) else None

    def _by_rest(self, room: Room, arm: str, query: Query) -> Moved | None:
        """The way over where the arm rests, which is open on most sides; None if there is none, or if the arm rests now."""
        home = room.whole(arm, self._home[arm][None])[0]
        if np.abs(home - query.start).max() < 1e-9:
            return None
        back = self.roadmaps.plan(room.free(arm), replace(query, goals=home[None]))
        if not isinstance(back, Moved):
            return None
        on = self.roadmaps.plan(room.free(arm), replace(query, start=home))
        if not isinstance(on, Moved):
            return None
        path = np.concatenate([back.path, on.path[1:]])
        return replace(on, path=path, proved=back.proved and on.proved)


def corners_s(arm: Arm, path: Floats, factor: float = 1.0) -> Floats:
    """When an arm is at each configuration of a path (m, k), in the least time within what a share of its joints' limits allows."""
    return fastest(path, limits_at(arm, factor)).corners_s


def limits_at(arm: Arm, factor: float) -> Limits:
    """A share of what the joints of an arm can do."""
    speed = np.array([joint.speed or UNKNOWN_SPEED for joint in arm.joints]) * factor
    rated = np.array([joint.acceleration or SWIFT * (joint.speed or UNKNOWN_SPEED) for joint in arm.joints])
    rated = rated * factor
    return Limits(speed, rated, rated * ABRUPT)


def held(world: World, arm: str) -> tuple[str, ...]:
    """The bodies that an arm carries."""
    return tuple(body for body in world.cell.bodies if _rides(world, body, arm))


def _holds_part(world: World, arm: str) -> bool:
    return any(world.cell.bodies[body].kind is BodyKind.PART for body in held(world, arm))


def _rides(world: World, body: str, arm: str) -> bool:
    return any(each.startswith(f"{arm}.") and each != f"{arm}.base" for each in world.supports(body)[1:])
