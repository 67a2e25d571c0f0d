"""An assembly that was planned, executed in MuJoCo: the executive sends the steps, meets exceptions, tests, repairs and plans anew."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cellwright.engine.kernels.rigid import difference
from cellwright.engine.model.execution import Finish, Record
from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.execution import Execution, Timed
from cellwright.engine.pipelines.execution.compiling import situation_of
from cellwright.engine.pipelines.execution.planned import ready
from cellwright.engine.pipelines.execution.recorder import Recorder, Watcher
from cellwright.engine.pipelines.placing.answers import Placed
from cellwright.engine.pipelines.placing.assembling import Built
from cellwright.engine.pipelines.placing.optics import Errors
from cellwright.engine.pipelines.placing.ordering import NotBuilt, Ordered, ordered
from cellwright.engine.pipelines.placing.yard import Obstacle, Spot
from cellwright.engine.pipelines.simulation import SymbolicWorld
from cellwright.engine.pipelines.simulator import Simulator, fault_base
from cellwright.engine.pipelines.witness.touches import Touched
from cellwright.engine.pipelines.workshop.carrying import Went, carry_out
from cellwright.engine.pipelines.workshop.cell import PlacingCell
from cellwright.engine.pipelines.workshop.eyes import Eyes
from cellwright.engine.pipelines.workshop.shop import Workshop, turned
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.scene import Scene

SETTLE_S = 0.5  # until parts rest
MOST = 8  # orders that are made
GONE_M = np.array([0.0, 0.0, -2.0])  # where a part goes that is taken away: below the floor


@dataclass(frozen=True, slots=True)
class Shift:
    """What somebody does to a part after it was seen: shifts it in the plane (m) and turns it, or takes it away."""

    part: str
    along_m: tuple[float, float] = (0.0, 0.0)
    turn_rad: float = 0.0
    away: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Executed:
    """How an assembly went.

    `runs` are the parts of the run: each but the last was ended by geometry, for the reason in `refused`. `off` says how far
    each part that was placed is from its goal in the end (m, rad), `touched` what touched that was not to, `seconds` how much
    time has passed in physics.
    """

    runs: tuple[Finish, ...]
    refused: tuple[Obstacle, ...]
    off: Mapping[str, tuple[float, float]]
    touched: tuple[Touched, ...]
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """How the carries of one part ended, how far (m, rad) it then is from its goal, what touched unplanned, and after how long."""

    went: Went
    off: tuple[float, float]
    touched: tuple[Touched, ...]
    seconds: float

    @property
    def status(self) -> str:
        """`reached`, or `stopped` where something was not as planned."""
        return "reached" if self.went is Went.DONE else "stopped"


def carried(scene: Scene, part: str, found: Placed, shop: Workshop | None = None) -> Carried:
    """Carry out the carries of a part in physics, until something is not as planned."""
    shop = shop or Workshop(scene)
    for carry in found.carries:
        went = carry_out(shop, part, carry)
        if went is not Went.DONE:
            break
    shop.wait(SETTLE_S)
    return Carried(went, _off(shop.pose(part), found.T_world_goal), shop.stage.touches.found, shop.seconds)


@dataclass
class _Kept:
    """The records of a run, in memory."""

    records: list[Record] = field(default_factory=list)

    def append(self, records: Sequence[Record]) -> None:
        """Keep records."""
        self.records += records


def executed(
    built: Built,
    domain: Domain,
    shifts: Sequence[Shift] = (),
    seed: int = 0,
    watchers: Sequence[Watcher] = (),
    knock: Errors = Errors(),
) -> Executed:
    """Carry out an assembly in physics, after somebody has shifted parts that were seen. `knock` is by what the camera of the scene errs.

    When a part lies elsewhere than it was seen, the executive plans anew without geometry. If geometry refutes a step of such a
    plan, nothing is moved, and an order that is proved is made for what is left.
    """
    scene = built.yard.site.scene
    shop = Workshop(scene, _shifted(Workshop(scene), shifts))
    base = fault_base(built.problem)
    assert base is not None
    spots = dict.fromkeys(built.yard.goals, Spot.FOUND)
    cell = PlacingCell(built.yard, shop, Eyes(shop, seed, knock), base, dict(built.looked.sightings), spots)
    order: Ordered | NotBuilt = Ordered(built.moves, built.obstacles, built.problem, built.plan)
    runs: list[Finish] = []
    refused: list[Obstacle] = []
    while isinstance(order, Ordered) and len(runs) < MOST:
        cell.refused = None
        cell.expect(order)
        runs.append(_run(scene.name, order, cell, watchers))
        if cell.refused is None:
            break
        refused.append(cell.refused)
        order = ordered(cell.yard, domain, cell.spots, cell.near())
    shop.wait(SETTLE_S)
    there = [part for part, spot in cell.spots.items() if spot is Spot.GOAL]
    off = {part: _off(shop.pose(part), cell.yard.goals[part]) for part in there}
    return Executed(tuple(runs), tuple(refused), off, shop.stage.touches.found, shop.seconds)


def _run(name: str, order: Ordered, cell: PlacingCell, watchers: Sequence[Watcher]) -> Finish:
    """The executive carries out one plan, handles what goes wrong, and goes on to the end, or until geometry refutes a step."""
    problem, driver = order.problem, Simulator(cell)
    found = ready(problem, order.plan, None, 0)  # not timed anew: geometry has proved this order
    recorder = Recorder(_Kept(), driver.now_ms, watchers)
    execution = Execution(name, problem, driver, recorder, Timed(), cell.model)
    return execution.start(found, SymbolicWorld.of(problem, situation_of(problem).state))


def _shifted(shop: Workshop, shifts: Sequence[Shift]) -> dict[str, Floats]:
    """Where parts are that were shifted: T_world_part."""
    found = {}
    for each in shifts:
        T = turned(shop.pose(each.part), each.along_m, each.turn_rad)
        if each.away:
            T[:3, 3] += GONE_M
        found[each.part] = T
    return found


def _off(T: Floats, goal: Floats) -> tuple[float, float]:
    metres, radians = difference(T, goal)
    return float(metres), float(radians)
