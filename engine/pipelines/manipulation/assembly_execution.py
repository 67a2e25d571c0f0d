"""Execution of an assembly in MuJoCo: steps, exceptions, tests, repairs, and new plans.

A step is planned on what is believed, and carried out in what is there. Tests and repairs really
look, lift and close.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import difference
from cellwright.engine.model.run_protocol import Finish, JournalRecord
from cellwright.engine.model.vision import LocatedPart, Sighting
from cellwright.engine.pipelines.execution import RunExecution, TimedOrders
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.executable_plan import compile_ready_plan
from cellwright.engine.pipelines.execution.run_journal import Recorder, Watcher
from cellwright.engine.pipelines.manipulation.assembly_moves import (
    AssemblyYard,
    MoveObstacle,
    PartMove,
    PartSpot,
)
from cellwright.engine.pipelines.manipulation.assembly_order import (
    Built,
    Key,
    NotBuilt,
    OrderedMoves,
    key_of,
    move_of,
    order_moves,
)
from cellwright.engine.pipelines.manipulation.camera_cell import camera_answer
from cellwright.engine.pipelines.manipulation.camera_optics import CameraErrors
from cellwright.engine.pipelines.manipulation.carry_execution import (
    CarryEnd,
    execute_carry,
    searched_on,
)
from cellwright.engine.pipelines.manipulation.mujoco_cameras import WorkshopCameras
from cellwright.engine.pipelines.manipulation.mujoco_cell import MujocoCell, shifted_pose
from cellwright.engine.pipelines.manipulation.place_answers import Carry, Placed
from cellwright.engine.pipelines.manipulation.place_operation import (
    STILL_M,
    STILL_RAD,
    likeliest_pose,
)
from cellwright.engine.pipelines.manipulation.pose_uncertainty import brought_covariance, within_m
from cellwright.engine.pipelines.manipulation.scene_camera import SceneView
from cellwright.engine.pipelines.manipulation.workspace import AssemblySite
from cellwright.engine.pipelines.recovery import SymbolicWorld
from cellwright.engine.pipelines.simulators import Simulator, fault_base
from cellwright.engine.pipelines.simulators.mujoco_replay.replay_contacts import ForbiddenContact
from cellwright.engine.stages.diagnosis.fault_problems import CURED, NOT_CURED
from cellwright.kb.asp import ground_term
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.terms import Function

NO_WAY_REPLY = "no_way"  # no reply of the fault base: the order of the steps is made anew
UNSURE_REPLY = "unsure"  # the reply where a part may come to lie too far from its goal
CLOSED_M = 0.003  # fingers that are nearer to each other hold nothing


@dataclass
class PlacingCell:
    """The belief (`yard`, `spots`, `seen`), and the workshop where things are as they are.

    `model` is the domain's fault base.
    """

    yard: AssemblyYard
    shop: MujocoCell
    eyes: WorkshopCameras
    model: FaultModel
    seen: dict[str, Sighting]
    spots: dict[str, PartSpot]
    known: dict[Key, tuple[Carry, ...]] = field(default_factory=dict)
    about: str = ""  # the part of the last step
    refused: MoveObstacle | None = None  # why a step has no motion
    held: Carry | None = None  # how the part is held that did not go into its hole

    def expect(self, order: OrderedMoves) -> None:
        """The motions of a plan are carried out as they were proved, as long as they fit."""
        spots, near = dict(self.spots), self.near()
        for move, carries in order.moves:
            self.known[key_of(move, spots, near)] = carries
            spots[move.part], near = move.end, carries[-1].legs[-1].path[-1]

    def take(self, text: str, expects: str, part: Sequence[float] = ()) -> str | None:  # noqa: ARG002 - it moves bodies, not parts
        """Carry out a step: its reply."""
        step = _step_instance(text)
        if (reply := self.eyes.seeing.carry_out(step.name)) is not None:
            return self._see_all() if step.name == "take_depth_map" else reply
        move = move_of(step)
        self.about = move.part
        carries = self._planned(move)
        if isinstance(carries, MoveObstacle):
            self.refused = carries
            return NO_WAY_REPLY
        if move.end is PartSpot.GOAL:
            doubted = self._doubted(move, carries)
            if within_m(doubted) > self.yard.site.scene.tolerance_m:
                return UNSURE_REPLY
            fit = self.yard.insertion(move, self.spots, doubted, carries[-1].T_part_hand)
            carries = (*carries[:-1], replace(carries[-1], insertion=fit))
        for carry in carries:
            went = execute_carry(self.shop, move.part, carry)
            if went is not CarryEnd.DONE:
                self.held = carry if self.shop.load == move.part else None
                return went
        self.spots[move.part] = move.end
        return expects or "done"

    def _planned(self, move: PartMove) -> tuple[Carry, ...] | MoveObstacle:
        near = self.near()
        key = key_of(move, self.spots, near)
        carries = self.known.get(key) or self.yard.moved(move, self.spots, near)
        if not isinstance(carries, MoveObstacle):
            self.known[key] = carries
        return carries

    def near(self) -> Floats:
        """Where the arm is: all joints of the world (k,)."""
        return self.yard.site.world.moved(self.shop.arm, self.shop.q).configuration

    def _doubted(self, move: PartMove, carries: Sequence[Carry]) -> Floats:
        """The covariance (6, 6) of where the part will be."""
        sighting = self.seen[move.part]
        assert isinstance(sighting, LocatedPart)
        return brought_covariance(sighting, carries, self.yard.pose(move.part, move.end))

    def told(self) -> Mapping[str, Any]:
        """Replies tell nothing beside their text."""
        return {}

    def missing(self, looked_at: Sequence[str]) -> str:  # noqa: ARG002 - the domain has no conditions that are watched
        """The first of some facts that is not so; none is looked at here."""
        return ""

    def say(self, choices: Sequence[str]) -> str:
        """What a person answers, who has looked and seen nothing else."""
        return choices[-1] if choices else "done"

    def answer(self, action: str) -> str:
        """The outcome of a test or a repair."""
        acts: Mapping[str, Callable[[], str]] = {
            "look_again": self._look_again,
            "look_from_the_hand": self._look_near,
            "look_at_the_goal": self._look_at_goal,
            "look_along_the_way": self._look_along,
            "close_on_nothing": self._close,
            "find_and_plan_anew": self._find,
            "search_for_the_hole": self._search,
            "correct_the_pose": lambda: self._found(
                self.eyes.look_near(self.yard, self.spots, self.about)
            ),
        }
        if (reply := camera_answer(self.eyes.seeing, action)) or action in acts:
            return reply or acts[action]()
        if action in self.model.tests:
            return self.model.tests[action].otherwise
        if action == "go_on_without":
            self.spots.pop(self.about, None)
        return CURED

    def _look_again(self) -> str:
        looked = self.eyes.look(self.yard, self.spots, self.about)
        if not isinstance(looked.sightings[self.about], LocatedPart):
            return "nowhere"
        return "elsewhere" if self._has_moved(looked, self.about) else "there"

    def _look_along(self) -> str:
        """Whether another part that has not been moved yet was pushed aside."""
        other_parts = [
            name
            for name, spot in self.spots.items()
            if spot is PartSpot.FOUND and name != self.about
        ]
        looked = self.eyes.look(self.yard, self.spots, *other_parts)
        seen = (name for name in other_parts if isinstance(looked.sightings[name], LocatedPart))
        return (
            "pushed_aside" if any(self._has_moved(looked, part) for part in seen) else "as_before"
        )

    def _look_near(self) -> str:
        looked = self.eyes.look_near(self.yard, self.spots, self.about)
        sighting, before = looked.sightings[self.about], self.seen[self.about]
        if not isinstance(sighting, LocatedPart):
            return "nothing"
        if self._has_moved(looked, self.about):
            return "elsewhere"
        surer = isinstance(before, LocatedPart) and np.trace(sighting.covariance) < np.trace(
            before.covariance
        )
        return "corrected" if surer else "as_before"

    def _look_at_goal(self) -> str:
        if self.held is not None:  # what is seen there is the part itself, in the hand
            return "free"
        return "occupied" if self.eyes.goal_is_taken(self.yard, self.spots, self.about) else "free"

    def _close(self) -> str:
        width = self.shop.close()
        self.shop.open_wide()
        return "closed" if width < CLOSED_M else "wrong"

    def _has_moved(self, looked: SceneView, part: str) -> bool:
        sighting = looked.sightings[part]
        assert isinstance(sighting, LocatedPart)
        before = self.yard.site.found[part]
        apart = [
            difference(before, looked.T_world_camera @ T_camera_part)
            for T_camera_part in sighting.equivalent
        ]
        return not any(metres < STILL_M and radians < STILL_RAD for metres, radians in apart)

    def _found(self, looked: SceneView) -> str:
        """Believe what was seen of the part from now on; whether it was found."""
        if not isinstance(looked.sightings[self.about], LocatedPart):
            return NOT_CURED
        self._believe(looked)
        self.spots[self.about] = PartSpot.FOUND
        return CURED

    def _search(self) -> str:
        """Search for the hole with the part that is still held, wider than before."""
        if self.held is None or searched_on(self.shop, self.about, self.held) is not CarryEnd.DONE:
            return NOT_CURED
        self.spots[self.about], self.held = PartSpot.GOAL, None
        return CURED

    def _find(self) -> str:
        """Look for the part anew; where it is seen where it was believed, nothing has been put
        right.
        """
        looked = self.eyes.look(self.yard, self.spots, self.about)
        if isinstance(looked.sightings[self.about], LocatedPart) and not self._has_moved(
            looked, self.about
        ):
            return NOT_CURED
        return self._found(looked)

    def _see_all(self) -> str:
        """An image is taken, and all parts that have not been moved yet are believed where it
        shows them.
        """
        parts = [name for name, spot in self.spots.items() if spot is PartSpot.FOUND]
        looked = self.eyes.look(self.yard, self.spots, *parts)
        self._believe(looked)
        return (
            f"map({self.eyes.seeing.looks}, {round(1000 * float((looked.image.depth > 0).mean()))})"
        )

    def _believe(self, looked: SceneView) -> None:
        """Believe what was seen of parts; those that are not found are believed where they were."""
        old, poses, world = self.yard.site, dict(self.yard.site.found), self.yard.site.world
        for part, sighting in looked.sightings.items():
            if isinstance(sighting, LocatedPart):
                T = poses[part] = likeliest_pose(
                    sighting, looked.T_world_camera, self.yard.goals[part]
                )
                world = world.put(part, "world", T)
                self.seen[part] = sighting
        site = AssemblySite(
            self.eyes.seeing.scene, world, self.eyes.wide(looked, old.looked), poses
        )
        asides = {name: at for name, at in self.yard.asides.items() if name not in looked.sightings}
        self.yard = replace(self.yard, site=site, asides=asides)
        self.known.clear()


def _step_instance(text: str) -> Function:
    term = ground_term(text)
    assert isinstance(term, Function)
    return term


PART_REST_S = 0.5  # until parts rest
MAX_ORDERS = 8  # orders that are made
GONE_M = np.array([0.0, 0.0, -2.0])  # where a part goes that is taken away: below the floor


@dataclass(frozen=True, slots=True)
class PartShift:
    """What somebody does to a part after it was seen: shifts it in the plane (m) and turns it,
    or takes it away.
    """

    part: str
    along_m: tuple[float, float] = (0.0, 0.0)
    turn_rad: float = 0.0
    away: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class AssemblyRun:
    """How an assembly went.

    `runs` are the parts of the run: each but the last was ended by geometry, for the reason in
    `refused`. `off` says how far each part that was placed is from its goal in the end (m, rad),
    `touched` what touched that was not to, `seconds` how much time has passed in physics.
    """

    runs: tuple[Finish, ...]
    refused: tuple[MoveObstacle, ...]
    off: Mapping[str, tuple[float, float]]
    touched: tuple[ForbiddenContact, ...]
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class CarriedPart:
    """How the carries of one part ended, how far (m, rad) it then is from its goal, what
    touched unplanned, and after how long.
    """

    went: CarryEnd
    off: tuple[float, float]
    touched: tuple[ForbiddenContact, ...]
    seconds: float

    @property
    def status(self) -> str:
        """`reached`, or `stopped` where something was not as planned."""
        return "reached" if self.went is CarryEnd.DONE else "stopped"


def execute_carries(
    scene: Scene, part: str, placed: Placed, shop: MujocoCell | None = None
) -> CarriedPart:
    """Carry out the carries of a part in physics, until something is not as planned."""
    shop = shop or MujocoCell(scene)
    for carry in placed.carries:
        went = execute_carry(shop, part, carry)
        if went is not CarryEnd.DONE:
            break
    shop.wait(PART_REST_S)
    return CarriedPart(
        went,
        _pose_gap(shop.pose(part), placed.T_world_goal),
        shop.stage.touches.found,
        shop.seconds,
    )


@dataclass
class _MemoryLedger:
    """The records of a run, in memory."""

    records: list[JournalRecord] = field(default_factory=list)

    def append(self, records: Sequence[JournalRecord]) -> None:
        """Keep records."""
        self.records += records


def execute_assembly(
    built: Built,
    domain: Domain,
    shifts: Sequence[PartShift] = (),
    seed: int = 0,
    watchers: Sequence[Watcher] = (),
    knock: CameraErrors = CameraErrors(),
) -> AssemblyRun:
    """Carry out an assembly in physics, after somebody has shifted parts that were seen. `knock` is
    by what the camera of the scene errs.

    When a part lies elsewhere than it was seen, the executive plans anew without geometry. If
    geometry refutes a step of such a plan, nothing is moved, and an order that is proved is made
    for what is left.
    """
    scene = built.yard.site.scene
    shop = MujocoCell(scene, _shift_parts(MujocoCell(scene), shifts))
    base = fault_base(built.problem)
    assert base is not None
    spots = dict.fromkeys(built.yard.goals, PartSpot.FOUND)
    cell = PlacingCell(
        built.yard,
        shop,
        WorkshopCameras(shop, seed, knock),
        base,
        dict(built.looked.sightings),
        spots,
    )
    order: OrderedMoves | NotBuilt = OrderedMoves(
        built.moves, built.obstacles, built.problem, built.plan
    )
    runs: list[Finish] = []
    refused: list[MoveObstacle] = []
    while isinstance(order, OrderedMoves) and len(runs) < MAX_ORDERS:
        cell.refused = None
        cell.expect(order)
        runs.append(_run_order(scene.name, order, cell, watchers))
        if cell.refused is None:
            break
        refused.append(cell.refused)
        order = order_moves(cell.yard, domain, cell.spots, cell.near())
    shop.wait(PART_REST_S)
    at_goal = [part for part, spot in cell.spots.items() if spot is PartSpot.GOAL]
    off = {part: _pose_gap(shop.pose(part), cell.yard.goals[part]) for part in at_goal}
    return AssemblyRun(tuple(runs), tuple(refused), off, shop.stage.touches.found, shop.seconds)


def _run_order(
    name: str, order: OrderedMoves, cell: PlacingCell, watchers: Sequence[Watcher]
) -> Finish:
    """The executive carries out one plan, handles what goes wrong, and goes on to the end, or
    until geometry refutes a step.
    """
    problem, driver = order.problem, Simulator(cell)
    ready_plan = compile_ready_plan(
        problem, order.plan, None, 0
    )  # not timed anew: geometry has proved this order
    recorder = Recorder(_MemoryLedger(), driver.now_ms, watchers)
    execution = RunExecution(name, problem, driver, recorder, TimedOrders(), cell.model)
    return execution.start(ready_plan, SymbolicWorld.of(problem, initial_situation(problem).state))


def _shift_parts(shop: MujocoCell, shifts: Sequence[PartShift]) -> dict[str, Floats]:
    """Where parts are that were shifted: T_world_part."""
    poses = {}
    for shift in shifts:
        T = shifted_pose(shop.pose(shift.part), shift.along_m, shift.turn_rad)
        if shift.away:
            T[:3, 3] += GONE_M
        poses[shift.part] = T
    return poses


def _pose_gap(T: Floats, goal: Floats) -> tuple[float, float]:
    metres, radians = difference(T, goal)
    return float(metres), float(radians)
