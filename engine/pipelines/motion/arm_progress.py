"""The arms of a cell during a plan: where each is, the paths that it takes, and their times."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import Blocked, LegKind, Moved, PathQuery, StepLeg
from cellwright.engine.pipelines.motion.cell_state import CellState
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.motion.roadmap import KeptRoadmaps
from cellwright.engine.stages.motion.timed_paths import JointLimits, fastest_trajectory
from cellwright.kb.model.cell_model import Arm, BodyKind, Cell, Place

PATH_BUDGET = 400_000  # configurations that the search for a way looks at
CARRYING_FACTOR = 0.5  # of the full speed and acceleration: for a part that friction alone holds
ASSUMED_SPEED = 1.0  # rad/s or m/s
SWIFT, ABRUPT = 4.0, 10.0  # 1/s: acceleration of the full speed, jerk of the full acceleration


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """The arm stands before a place, or in it; `straight` (m, k) is the way from the front into
    the place.
    """

    place: str
    straight: Floats
    inside: bool = False


Where = Mapping[str, tuple[Floats, Front | None]]  # of each arm, and what it stands before


@dataclass(eq=False)
class ArmsProgress:
    """Where the arms of a cell are, before or in which places, and the ways that they know."""

    cell: Cell
    seed: int = 0
    bridges: int = 30
    roadmaps: KeptRoadmaps = field(default_factory=KeptRoadmaps)
    _now: dict[str, Floats] = field(default_factory=dict)
    _front: dict[str, Front] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._home = GeometricWorld.of(self.cell).configurations
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
        front = self._front.get(place.arm)
        return front if front is not None and front.place == place.name else None

    def leg(
        self,
        kind: LegKind,
        arm: str,
        path: Floats,
        room: CellState,
        proved: bool = True,
        factor: float = 1.0,
    ) -> StepLeg:
        """A leg in the least time, within what the joints can do."""
        corners = corners_s(self.cell.arms[arm].arm, path, factor)
        return StepLeg(kind, arm, path, corners, proved, bodies_held(room.world, arm))

    def way(
        self, room: CellState, arm: str, goals: Floats, budget: int = PATH_BUDGET
    ) -> StepLeg | Blocked | None:
        """The way from where the arm is to one of some configurations (n, k); None if start or
        goals are not free.
        """
        world = room.world
        first, count = world.first_carriers[arm], world.models[arm].joints.count
        query = PathQuery(
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
            factor = CARRYING_FACTOR if _holds_part(world, arm) else 1.0
            return self.leg(LegKind.WAY, arm, path, room, answer.proved, factor)
        return answer if isinstance(answer, Blocked) else None

    def _by_rest(self, room: CellState, arm: str, query: PathQuery) -> Moved | None:
        """The way over where the arm rests, which is open on most sides; None if there is none,
        or if the arm rests now.
        """
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
    """When an arm is at each configuration of a path (m, k), in the least time within what a
    share of its joints' limits allows.
    """
    return fastest_trajectory(path, limits_at(arm, factor)).corners_s


def limits_at(arm: Arm, factor: float) -> JointLimits:
    """A share of what the joints of an arm can do."""
    speed = np.array([joint.speed or ASSUMED_SPEED for joint in arm.joints]) * factor
    rated = np.array(
        [joint.acceleration or SWIFT * (joint.speed or ASSUMED_SPEED) for joint in arm.joints]
    )
    rated = rated * factor
    return JointLimits(speed, rated, rated * ABRUPT)


def bodies_held(world: GeometricWorld, arm: str) -> tuple[str, ...]:
    """The bodies that an arm carries."""
    return tuple(body for body in world.cell.bodies if _rides_on(world, body, arm))


def _holds_part(world: GeometricWorld, arm: str) -> bool:
    return any(world.cell.bodies[body].kind is BodyKind.PART for body in bodies_held(world, arm))


def _rides_on(world: GeometricWorld, body: str, arm: str) -> bool:
    return any(
        support_name.startswith(f"{arm}.") and support_name != f"{arm}.base"
        for support_name in world.supports(body)[1:]
    )
