"""Places of the tool at measurements with known points, and which arms reach them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.linear import norm
from cellwright.engine.model.part_measurements import UNSAID_NORMAL
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.reach.place_reachability import (
    PlaceReachability,
    UnreachedPlace,
)
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.cell_model import Cell, Measuring, Place, Placement
from cellwright.kb.model.domain_model import Motion
from cellwright.kb.model.name_conventions import Conventions
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Number

METRES_PER_MICRON = 1e-6


def measured_cell(semantics: Semantics, cell: Cell) -> Cell:
    """The cell with a place for each measurement that has a position, for the tool that the
    domain's rules choose.

    With several arms each of them has a place of its own.
    """
    problem, statics = semantics.problem, semantics.statics
    chosen = [
        fact
        for fact in statics.named(problem.domain.conventions.chosen)
        if len(fact.arguments) == 2
    ]
    if len(cell.arms) < 2:
        tools = {str(fact.arguments[1]): str(fact.arguments[0]) for fact in chosen}
        return with_measured_places(cell, problem, tools)
    choices = dict[str, list[str]]()
    for fact in sorted(chosen, key=str):
        choices.setdefault(str(fact.arguments[1]), []).append(str(fact.arguments[0]))
    owners = dict[str, frozenset[str]]()
    for fact in statics.named(problem.domain.conventions.equips):
        if len(fact.arguments) == 2:
            tool, arm = map(str, fact.arguments)
            owners[tool] = owners.get(tool, frozenset()) | {arm}
    return with_places_of_arms(cell, problem, choices, owners)


def with_places_of_arms(
    cell: Cell,
    problem: Problem,
    choices: Mapping[str, Sequence[str]],
    owners: Mapping[str, frozenset[str]],
) -> Cell:
    """The cell with a place for each measurement that has a position and each arm, with the first
    of its tools that is for the arm.

    The place of an arm is named by the measurement and the arm. Arms have no place where the cell
    gives the measurement one.
    """
    places = dict(cell.places)
    for arm in cell.arms:
        own = {
            name: next((tool for tool in tools if arm in owners.get(tool, cell.arms)), "")
            for name, tools in choices.items()
        }
        alone = replace(cell, arms={arm: cell.arms[arm]})
        for name, place in with_measured_places(alone, problem, own).places.items():
            if name not in cell.places:
                places.setdefault(of_arm(name, arm), replace(place, name=of_arm(name, arm)))
    return replace(cell, places=places)


def of_arm(place: str, arm: str) -> str:
    """The name of the place of an arm at a measurement whose place has this name."""
    return f"{place.removesuffix(')')}, {arm})"


def with_measured_places(cell: Cell, problem: Problem, tools: Mapping[str, str]) -> Cell:
    """The cell with a place for each measurement that has a position, but no place of its own.

    `tools` names the tool of each measurement. How the tool stands there is what the cell says
    under `measuring`.
    """
    words, motion = problem.domain.conventions, problem.domain.motion
    points, normals = (
        _triples_by_name(problem, words.position),
        _triples_by_name(problem, words.normal),
    )
    places, widths = {}, _bore_widths_m(problem, words.bore)
    for name, point in points.items():
        at, tool = words.place(name), tools.get(name, "")
        if at in cell.places or tool not in cell.measuring or not cell.arms:
            continue
        normal = normals.get(name, np.array(UNSAID_NORMAL))
        place = _measuring_place(
            at,
            point * METRES_PER_MICRON,
            normal,
            cell.measuring[tool],
            _frame_of(motion),
            tool,
            cell,
        )
        places[at] = replace(
            place, patch_m=_patch_side_m(cell.measuring[tool], widths.get(name, 0.0))
        )
    return replace(cell, places={**cell.places, **places}) if places else cell


def _bore_widths_m(problem: Problem, predicate: str) -> dict[str, float]:
    """How wide (m) the bores are that measurements lie in."""
    facts = [
        fact.arguments
        for fact in problem.statics
        if fact.name == predicate and len(fact.arguments) == 2
    ]
    return {
        str(name): width.value * METRES_PER_MICRON
        for name, width in facts
        if isinstance(width, Number)
    }


def _patch_side_m(how: Measuring, width_m: float) -> float:
    """The side of the patch that a scanner must see: as wide as a bore, else the least that it
    measures.
    """
    least, most = how.patch_m
    return min(max(width_m, least), most, how.field_m) if width_m else least


def _frame_of(motion: Motion | None) -> str:
    return motion.frame if motion is not None else "world"


def _triples_by_name(problem: Problem, predicate: str) -> dict[str, Floats]:
    """The three numbers that a static fact gives to each name."""
    triples = {}
    for fact in problem.statics:
        if fact.name == predicate and len(fact.arguments) == 4:
            numbers = [
                argument.value for argument in fact.arguments[1:] if isinstance(argument, Number)
            ]
            if len(numbers) == 3:
                triples[str(fact.arguments[0])] = np.array(numbers, dtype=float)
    return triples


def _measuring_place(
    name: str, point: Floats, normal: Floats, how: Measuring, frame: str, tool: str, cell: Cell
) -> Place:
    """The tool's z goes against the normal; about it the tool may turn."""
    away = normal / max(norm(normal), 1e-9)
    T = transforms.transform(_looking_against(away), point)
    placement = Placement(frame, transforms.to_pose(T))
    return Place(name, placement, next(iter(cell.arms)), tool, how.approach_m, True, how.touches)


def _looking_against(normal: Floats) -> Floats:
    """A rotation (3, 3) whose z looks against a unit normal (3,)."""
    z = -normal
    beside = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(beside, z)
    x /= norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def measured_at(words: Conventions, place: str) -> str:
    """The measurement that a place belongs to, that of one arm too; empty if it is another
    place.
    """
    head, _, rest = place.partition("(")
    return rest.removesuffix(")").split(", ")[0] if head == words.meas else ""


NO_PLACE = "the cell has no place for it there"


def unreached_reasons(
    problem: Problem,
    cell: Cell,
    names: Sequence[str],
    tools: Mapping[str, Sequence[str]],
    owners: Mapping[str, frozenset[str]],
) -> dict[str, dict[str, str]]:
    """For each arm why it does not reach a measurement, empty if it does; nothing of
    measurements without any place.
    """
    words = problem.domain.conventions
    whole = with_places_of_arms(cell, problem, tools, owners)
    places = {
        name: {arm: _arm_place(whole, words.place(name), arm) for arm in cell.arms}
        for name in names
    }
    reasons_by_arm = dict[str, dict[str, str]]()
    for arm in cell.arms:
        ask = PlaceReachability(GeometricWorld.of(whole).of_arms((arm,)), geometry_backend())
        for name, own in places.items():
            place = own[arm]
            if any(own.values()):
                reasons_by_arm.setdefault(name, {})[arm] = (
                    NO_PLACE if place is None else _unreached_reason(ask, place)
                )
    return reasons_by_arm


def _arm_place(cell: Cell, name: str, arm: str) -> Place | None:
    """The place of an arm at a measurement: its own, or the only one if it belongs to the arm."""
    only = cell.places.get(name)
    return cell.places.get(of_arm(name, arm)) or (
        only if only is not None and only.arm == arm else None
    )


def _unreached_reason(ask: PlaceReachability, place: Place) -> str:
    answer = ask.at(place)
    return answer.reason if isinstance(answer, UnreachedPlace) else ""
