"""From which stations and in which poses an arm takes measurements; kept in a store.

Its answers make the measurement knowledge base. They can be kept in a store, and are found again
only where the arm, the tool, the place or a body near the poses has changed.
"""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cellwright.engine.model.arm_poses import Box, MeasurementPoses
from cellwright.engine.pipelines.inspection.measurement_places import (
    measured_at,
    with_measured_places,
)
from cellwright.engine.pipelines.motion.cell_state import CellState
from cellwright.engine.pipelines.motion.pose_digests import ArmFooting, StandingBodies
from cellwright.engine.pipelines.motion.pose_search import SoughtMeasurement, found_poses
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import InverseKinematics
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.json_text import parse_json
from cellwright.kb.model.cell_model import Cell, Measuring, Patch, Place, Placement
from cellwright.kb.model.name_conventions import Conventions
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.inspection_store import PoseStore
from cellwright.kb.terms import Atom, Function, Number, Text, is_ground

Key = tuple[str, str, str]  # measurement, tool, station
POSES_AT_A_TIME = 64  # measurements that are looked at together


@dataclass(frozen=True, slots=True, eq=False)
class PoseKnowledge:
    """The poses of all measurements of a problem, or of some, by measurement, tool and station.

    `kept` counts those that were known already, `made` those that were found now. Of the `unasked`
    measurements nothing is known; the arm can stand at the `standing` stations.
    """

    poses: Mapping[Key, MeasurementPoses] = field(default_factory=dict)
    kept: int = 0
    made: int = 0
    unasked: frozenset[str] = frozenset()
    standing: tuple[str, ...] = ()

    def unreached(self) -> dict[str, str]:
        """The measurements that no station reaches, each with the reasons, station by station."""
        reached = {poses.measurement for poses in self.poses.values() if poses.reached}
        reasons: dict[str, list[str]] = {}
        for poses in self.poses.values():
            if poses.measurement not in reached:
                where = f"from {poses.station}: " if poses.station else ""
                reasons.setdefault(poses.measurement, []).append(f"{where}{poses.reason}")
        return {
            name: "; ".join(dict.fromkeys(reasons_given)) for name, reasons_given in reasons.items()
        }

    def stations(self) -> dict[str, tuple[str, ...]]:
        """The stations that reach each measurement; all stations for those that were not asked
        about.
        """
        stations_by_name = {name: list(self.standing) for name in self.unasked}
        for poses in self.poses.values():
            if poses.reached and poses.station:
                stations_by_name.setdefault(poses.measurement, []).append(poses.station)
        return {name: tuple(sorted(stations)) for name, stations in stations_by_name.items()}


def known_poses(
    problem: Problem,
    cell: Cell,
    backend: GeometryBackend,
    known: Mapping[Key, MeasurementPoses] | None = None,
    only: Collection[str] | None = None,
) -> PoseKnowledge:
    """The poses of every measurement that a tool is chosen for, or of some.

    What is `known` and still valid is not found again.
    """
    semantics = PlanGate().semantics(problem)
    words = problem.domain.conventions
    tools = chosen_tools(semantics)
    whole = with_measured_places(cell, problem, tools)
    unasked = frozenset(name for name in tools if only is not None and name not in only)
    tools = {name: tool for name, tool in tools.items() if name not in unasked}
    stations = stations_of_cell(whole)
    widths = _widths_m(semantics)
    kinematics = {
        name: InverseKinematics(model) for name, model in GeometricWorld.of(whole).models.items()
    }
    poses_found: dict[Key, MeasurementPoses] = {}
    for station, fact in stations or (("", None),):
        for places in _alike_places(
            whole,
            [
                measured_place
                for measured_place in whole.places.values()
                if _is_chosen(words, tools, measured_place)
            ],
        ):
            room = CellState(_station_state(whole, semantics, fact, places[0]), backend, kinematics)
            asked = [
                SoughtMeasurement(name, place, _tool_use(whole, place), widths.get(name, 0.0))
                for place in places
                if (name := measured_at(words, place.name))
            ]
            poses_found |= _poses_of_alike(room, asked, station, known or {})
    reused = sum(
        poses_found[key] is old for key, old in (known or {}).items() if key in poses_found
    )
    return PoseKnowledge(
        poses_found, reused, len(poses_found) - reused, unasked, tuple(name for name, _ in stations)
    )


def chosen_tools(semantics: Semantics) -> dict[str, str]:
    """The tool that is chosen for each measurement."""
    name = semantics.problem.domain.conventions.chosen
    return {
        str(fact.arguments[1]): str(fact.arguments[0]) for fact in semantics.statics.named(name)
    }


def _is_chosen(words: Conventions, tools: Mapping[str, str], place: Place) -> bool:
    """Whether a place is that of a measurement, with the tool that is chosen for it."""
    name = measured_at(words, place.name)
    return name in tools and place.tool == tools[name]


def _alike_places(cell: Cell, places: Sequence[Place]) -> list[list[Place]]:
    """The places in groups that one arm takes with one tool in one way."""
    groups: dict[object, list[Place]] = {}
    for place in places:
        use_key = (replace(place, name="", placement=Placement()), _tool_use(cell, place))
        groups.setdefault(use_key, []).append(place)
    return list(groups.values())


def _poses_of_alike(
    room: CellState,
    asked: Sequence[SoughtMeasurement],
    station: str,
    known: Mapping[Key, MeasurementPoses],
) -> dict[Key, MeasurementPoses]:
    """The poses of measurements that are taken alike: those that are known and still valid, and
    all others found now.
    """
    first = asked[0].place
    standing_bodies, footing = (
        StandingBodies(room.world),
        ArmFooting(room.world, first.arm, first.tool),
    )
    poses_found: dict[Key, MeasurementPoses] = {}
    missing = []
    for measurement in asked:
        key = (measurement.measurement, measurement.place.tool, station)
        old = known.get(key)
        if old is not None and _is_valid(old, standing_bodies, footing, measurement):
            poses_found[key] = old
        else:
            missing.append(measurement)
    for n in range(0, len(missing), POSES_AT_A_TIME):
        for poses in found_poses(
            room, standing_bodies, footing, missing[n : n + POSES_AT_A_TIME], station
        ):
            poses_found[poses.measurement, poses.tool, station] = poses
    return poses_found


def _is_valid(
    old: MeasurementPoses,
    standing_bodies: StandingBodies,
    footing: ArmFooting,
    asked: SoughtMeasurement,
) -> bool:
    own = footing.digest(asked.place, asked.how)
    return old.own == own and old.near == standing_bodies.digest(old.boxes)


def _tool_use(cell: Cell, place: Place) -> Measuring:
    """How the tool is used; a place of the cell itself allows no more than what it says."""
    return cell.measuring.get(place.tool, Measuring(place.approach_m, place.touches))


def _widths_m(semantics: Semantics) -> dict[str, float]:
    """How wide the bores are that measurements lie in, in metres."""
    name = semantics.problem.domain.conventions.bore
    widths = {}
    for fact in semantics.statics.named(name):
        if isinstance(fact.arguments[-1], Number):
            widths[str(fact.arguments[0])] = fact.arguments[-1].value * 1e-6
    return widths


def stations_of_cell(cell: Cell) -> list[tuple[str, Atom]]:
    """The stations of the arms: facts that put a body somewhere along its joint that carries an
    arm, each with its name.

    The name is the last argument of the fact.
    """
    world, stations = GeometricWorld.of(cell), []
    carriers = {
        support_name for name in cell.arms for support_name in world.supports(f"{name}.base")
    }
    for location in cell.locations:
        if (
            location.value is None
            or str(location.body) not in carriers
            or not location.fact.arguments
        ):
            continue
        last = location.fact.arguments[-1]
        if isinstance(last, Function) and is_ground(last):
            stations.append((str(last), location.fact))
    return stations


def station_world(cell: Cell, semantics: Semantics, station: str, place: Place) -> GeometricWorld:
    """The cell as the problem begins, with the arm at a station ("": where it is) and the tool
    of a place in its hand.
    """
    facts = dict(stations_of_cell(cell))
    return _station_state(cell, semantics, facts.get(station), place)


def _station_state(
    cell: Cell, semantics: Semantics, fact: Atom | None, place: Place
) -> GeometricWorld:
    """The cell as the problem begins, with the arm at a station and the tool of a place in its
    hand.
    """
    start = semantics.initial()
    world = world_after_facts(
        GeometricWorld.of(cell),
        [
            fact_at_start
            for fact_at_start in start
            if fact is None or fact_at_start.name != fact.name
        ],
    )
    if fact is not None:
        location = next(location for location in cell.locations if location.fact == fact)
        world = world.guided(str(location.body), location.value or 0.0)
    return world.held(place.tool, place.arm) if place.tool else world


def with_stations(problem: Problem, knowledge: PoseKnowledge) -> Problem:
    """The problem with a fact for each station that reaches a measurement, and one for each
    measurement that none reaches.

    Where the problem says itself from where a measurement is reached, that counts.
    """
    words, facts = problem.domain.conventions, list[Atom]()
    served_names = {
        str(fact.arguments[-1]) for fact in problem.statics if fact.name == words.serves
    }
    if words.serves in problem.domain.predicates:
        for name, stations in sorted(knowledge.stations().items()):
            facts += [
                Function(words.serves, (Function(station), Function(name)))
                for station in stations
                if name not in served_names
            ]
    if words.impossible in problem.domain.predicates:
        for name, why in sorted(knowledge.unreached().items()):
            facts.append(Function(words.impossible, (Function(name), Text(why))))
    return replace(problem, statics=(*problem.statics, *facts))


def kept_poses(
    store: str,
    problem: Problem,
    cell: Cell,
    backend: GeometryBackend,
    only: Collection[str] | None = None,
) -> PoseKnowledge:
    """The poses of a problem's measurements, or of some: those of the store that are still valid,
    the others found and kept there.

    Raises `InvalidInput` if the store cannot be used. A document that cannot be read counts as
    missing.
    """
    with PoseStore(store) as poses:
        documents = poses.of(problem.domain.name, problem.name)
        documents = {key: text for key, text in documents.items() if only is None or key[0] in only}
        kept_before = {
            key: poses_read
            for key, text in documents.items()
            if (poses_read := _read_poses(text)) is not None
        }
        knowledge = known_poses(problem, cell, backend, kept_before, only)
        if knowledge.made or knowledge.poses.keys() != documents.keys():
            fresh: dict[Key, str] = {
                key: _poses_text(poses) for key, poses in knowledge.poses.items()
            }
            poses.keep(problem.domain.name, problem.name, fresh, only)
    return knowledge


def _poses_text(poses: MeasurementPoses) -> str:
    patch = poses.patch
    entry = {
        "measurement": poses.measurement,
        "tool": poses.tool,
        "station": poses.station,
        "straight": [way_in.tolist() for way_in in poses.straight],
        "tilt_rad": poses.tilt_rad,
        "patch": None if patch is None else [patch.at_m, patch.size_m],
        "reason": poses.reason,
        "boxes": poses.boxes,
        "own": poses.own,
        "near": poses.near,
        "sigma_m": poses.sigma_m,
    }
    return json.dumps(entry)


def _read_poses(text: str) -> MeasurementPoses | None:
    try:
        entry = parse_json(text)
        return MeasurementPoses(
            str(entry["measurement"]),
            str(entry["tool"]),
            str(entry["station"]),
            tuple(np.array(way_in, dtype=float) for way_in in entry["straight"]),
            float(entry["tilt_rad"]),
            _read_patch(entry["patch"]),
            str(entry["reason"]),
            tuple(map(_read_box, entry["boxes"])),
            str(entry["own"]),
            str(entry["near"]),
            float(entry["sigma_m"]),
        )
    except (ValueError, KeyError, TypeError, IndexError):
        return None


def _read_patch(entry: Any) -> Patch | None:
    return None if entry is None else Patch((entry[0][0], entry[0][1]), (entry[1][0], entry[1][1]))


def _read_box(entry: Any) -> Box:
    (a, b, c), (d, e, f) = entry
    return ((float(a), float(b), float(c)), (float(d), float(e), float(f)))
