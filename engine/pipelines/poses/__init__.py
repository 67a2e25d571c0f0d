"""The geometric reasoner for measurements: from which stations, and in which poses, an arm takes each of them.

Its answers make the measurement knowledge base. They can be kept in a store, and are found again only where the arm, the tool,
the place or a body near the poses has changed.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.poses import MeasurementPoses
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.moves.rooms import Room
from cellwright.engine.pipelines.places import measured_at, with_measured_places
from cellwright.engine.pipelines.poses.digests import Footing, Standing
from cellwright.engine.pipelines.poses.finding import Sought, found_poses
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.kinematics.inverse import InverseKinematics
from cellwright.engine.stages.geometry.world.following import following
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.cell import Cell, Measuring, Place, Placement
from cellwright.kb.model.conventions import Conventions
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Number, Text, is_ground

Key = tuple[str, str, str]  # measurement, tool, station
TOGETHER = 64  # measurements that are looked at together


@dataclass(frozen=True, slots=True, eq=False)
class Knowledge:
    """The poses of all measurements of a problem, or of some, by measurement, tool and station.

    `kept` counts those that were known already, `made` those that were found now. Of the `unasked` measurements nothing is known;
    the arm can stand at the `standing` stations.
    """

    poses: Mapping[Key, MeasurementPoses] = field(default_factory=dict)
    kept: int = 0
    made: int = 0
    unasked: frozenset[str] = frozenset()
    standing: tuple[str, ...] = ()

    def unreached(self) -> dict[str, str]:
        """The measurements that no station reaches, each with the reasons, station by station."""
        reached = {each.measurement for each in self.poses.values() if each.reached}
        reasons: dict[str, list[str]] = {}
        for each in self.poses.values():
            if each.measurement not in reached:
                where = f"from {each.station}: " if each.station else ""
                reasons.setdefault(each.measurement, []).append(f"{where}{each.reason}")
        return {name: "; ".join(dict.fromkeys(said)) for name, said in reasons.items()}

    def stations(self) -> dict[str, tuple[str, ...]]:
        """The stations that reach each measurement; all stations for those that were not asked about."""
        found = {name: list(self.standing) for name in self.unasked}
        for each in self.poses.values():
            if each.reached and each.station:
                found.setdefault(each.measurement, []).append(each.station)
        return {name: tuple(sorted(stations)) for name, stations in found.items()}


def known_poses(
    problem: Problem,
    cell: Cell,
    backend: GeometryBackend,
    known: Mapping[Key, MeasurementPoses] | None = None,
    only: Collection[str] | None = None,
) -> Knowledge:
    """The poses of every measurement that a tool is chosen for, or of some. What is `known` and still valid is not found again."""
    semantics = PlanGate().semantics(problem)
    words = problem.domain.conventions
    tools = chosen_tools(semantics)
    whole = with_measured_places(cell, problem, tools)
    unasked = frozenset(name for name in tools if only is not None and name not in only)
    tools = {name: tool for name, tool in tools.items() if name not in unasked}
    stations = stations_of_cell(whole)
    widths = _widths(semantics)
    kinematics = {name: InverseKinematics(model) for name, model in World.of(whole).models.items()}
    found: dict[Key, MeasurementPoses] = {}
    for station, fact in stations or (("", None),):
        for places in _alike(whole, [each for each in whole.places.values() if _chosen(words, tools, each)]):
            room = Room(_standing(whole, semantics, fact, places[0]), backend, kinematics)
            asked = [
                Sought(name, place, _how(whole, place), widths.get(name, 0.0))
                for place in places
                if (name := measured_at(words, place.name))
            ]
            found |= _found(room, asked, station, known or {})
    kept = sum(found[key] is each for key, each in (known or {}).items() if key in found)
    return Knowledge(found, kept, len(found) - kept, unasked, tuple(name for name, _ in stations))


def chosen_tools(semantics: Semantics) -> dict[str, str]:
    """The tool that is chosen for each measurement."""
    name = semantics.problem.domain.conventions.chosen
    return {str(each.arguments[1]): str(each.arguments[0]) for each in semantics.statics.named(name)}


def _chosen(words: Conventions, tools: Mapping[str, str], place: Place) -> bool:
    """Whether a place is that of a measurement, with the tool that is chosen for it."""
    name = measured_at(words, place.name)
    return name in tools and place.tool == tools[name]


def _alike(cell: Cell, places: Sequence[Place]) -> list[list[Place]]:
    """The places in groups that one arm takes with one tool in one way."""
    groups: dict[object, list[Place]] = {}
    for place in places:
        way = (replace(place, name="", placement=Placement()), _how(cell, place))
        groups.setdefault(way, []).append(place)
    return list(groups.values())


def _found(
    room: Room, asked: Sequence[Sought], station: str, known: Mapping[Key, MeasurementPoses]
) -> dict[Key, MeasurementPoses]:
    """The poses of measurements that are taken alike: those that are known and still valid, and all others found now."""
    first = asked[0].place
    others, footing = Standing(room.world), Footing(room.world, first.arm, first.tool)
    found: dict[Key, MeasurementPoses] = {}
    missing = []
    for each in asked:
        key = (each.measurement, each.place.tool, station)
        old = known.get(key)
        if old is not None and _valid(old, others, footing, each):
            found[key] = old
        else:
            missing.append(each)
    for n in range(0, len(missing), TOGETHER):
        for poses in found_poses(room, others, footing, missing[n : n + TOGETHER], station):
            found[poses.measurement, poses.tool, station] = poses
    return found


def _valid(old: MeasurementPoses, others: Standing, footing: Footing, asked: Sought) -> bool:
    own = footing.digest(asked.place, asked.how)
    return old.own == own and old.near == others.digest(old.boxes)


def _how(cell: Cell, place: Place) -> Measuring:
    """How the tool is used; a place of the cell itself allows no more than what it says."""
    return cell.measuring.get(place.tool, Measuring(place.approach_m, place.touches))


def _widths(semantics: Semantics) -> dict[str, float]:
    """How wide the bores are that measurements lie in, in metres."""
    name = semantics.problem.domain.conventions.bore
    found = {}
    for fact in semantics.statics.named(name):
        if isinstance(fact.arguments[-1], Number):
            found[str(fact.arguments[0])] = fact.arguments[-1].value * 1e-6
    return found


def stations_of_cell(cell: Cell) -> list[tuple[str, Atom]]:
    """The stations of the arms: facts that put a body somewhere along its joint that carries an arm, each with its name.

    The name is the last argument of the fact.
    """
    world, found = World.of(cell), []
    carriers = {each for name in cell.arms for each in world.supports(f"{name}.base")}
    for location in cell.locations:
        if location.value is None or str(location.body) not in carriers or not location.fact.arguments:
            continue
        last = location.fact.arguments[-1]
        if isinstance(last, Function) and is_ground(last):
            found.append((str(last), location.fact))
    return found


def station_world(cell: Cell, semantics: Semantics, station: str, place: Place) -> World:
    """The cell as the problem begins, with the arm at a station ("": where it is) and the tool of a place in its hand."""
    facts = dict(stations_of_cell(cell))
    return _standing(cell, semantics, facts.get(station), place)


def _standing(cell: Cell, semantics: Semantics, fact: Atom | None, place: Place) -> World:
    """The cell as the problem begins, with the arm at a station and the tool of a place in its hand."""
    start = semantics.initial()
    world = following(World.of(cell), [each for each in start if fact is None or each.name != fact.name])
    if fact is not None:
        location = next(each for each in cell.locations if each.fact == fact)
        world = world.guided(str(location.body), location.value or 0.0)
    return world.held(place.tool, place.arm) if place.tool else world


def with_stations(problem: Problem, knowledge: Knowledge) -> Problem:
    """The problem with a fact for each station that reaches a measurement, and one for each measurement that none reaches.

    Where the problem says itself from where a measurement is reached, that counts.
    """
    words, facts = problem.domain.conventions, list[Atom]()
    said = {str(fact.arguments[-1]) for fact in problem.statics if fact.name == words.serves}
    if words.serves in problem.domain.predicates:
        for name, stations in sorted(knowledge.stations().items()):
            facts += [
                Function(words.serves, (Function(each), Function(name)))
                for each in stations
                if name not in said
            ]
    if words.impossible in problem.domain.predicates:
        for name, why in sorted(knowledge.unreached().items()):
            facts.append(Function(words.impossible, (Function(name), Text(why))))
    return replace(problem, statics=(*problem.statics, *facts))
