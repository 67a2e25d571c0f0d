"""The places that steps need: those of the cell, and those of measurements whose position and normal a problem gives."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.linear import norm
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.measurement import UNSAID_NORMAL
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.cell import Cell, Measuring, Place, Placement
from cellwright.kb.model.conventions import Conventions
from cellwright.kb.model.motion import Motion
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Number

MICRO = 1e-6


def measured_cell(semantics: Semantics, cell: Cell) -> Cell:
    """The cell with a place for each measurement that has a position, for the tool that the domain's rules choose.

    With several arms each of them has a place of its own.
    """
    problem, statics = semantics.problem, semantics.statics
    chosen = [each for each in statics.named(problem.domain.conventions.chosen) if len(each.arguments) == 2]
    if len(cell.arms) < 2:
        tools = {str(each.arguments[1]): str(each.arguments[0]) for each in chosen}
        return with_measured_places(cell, problem, tools)
    choices = dict[str, list[str]]()
    for each in sorted(chosen, key=str):
        choices.setdefault(str(each.arguments[1]), []).append(str(each.arguments[0]))
    owners = dict[str, frozenset[str]]()
    for each in statics.named(problem.domain.conventions.equips):
        if len(each.arguments) == 2:
            tool, arm = map(str, each.arguments)
            owners[tool] = owners.get(tool, frozenset()) | {arm}
    return with_places_of_arms(cell, problem, choices, owners)


def with_places_of_arms(
    cell: Cell,
    problem: Problem,
    choices: Mapping[str, Sequence[str]],
    owners: Mapping[str, frozenset[str]],
) -> Cell:
    """The cell with a place for each measurement that has a position and each arm, with the first of its tools that is for the arm.

    The place of an arm is named by the measurement and the arm. Arms have no place where the cell gives the measurement one.
    """
    found = dict(cell.places)
    for arm in cell.arms:
        own = {
            name: next((tool for tool in tools if arm in owners.get(tool, cell.arms)), "")
            for name, tools in choices.items()
        }
        alone = replace(cell, arms={arm: cell.arms[arm]})
        for name, place in with_measured_places(alone, problem, own).places.items():
            if name not in cell.places:
                found.setdefault(of_arm(name, arm), replace(place, name=of_arm(name, arm)))
    return replace(cell, places=found)


def of_arm(place: str, arm: str) -> str:
    """The name of the place of an arm at a measurement whose place has this name."""
    return f"{place.removesuffix(')')}, {arm})"


def with_measured_places(cell: Cell, problem: Problem, tools: Mapping[str, str]) -> Cell:
    """The cell with a place for each measurement that has a position, but no place of its own.

    `tools` names the tool of each measurement. How the tool stands there is what the cell says under `measuring`.
    """
    words, motion = problem.domain.conventions, problem.domain.motion
    points, normals = _triples(problem, words.position), _triples(problem, words.normal)
    found, widths = {}, _widths(problem, words.bore)
    for name, point in points.items():
        at, tool = words.place(name), tools.get(name, "")
        if at in cell.places or tool not in cell.measuring or not cell.arms:
            continue
        normal = normals.get(name, np.array(UNSAID_NORMAL))
        place = _place(at, point * MICRO, normal, cell.measuring[tool], _frame(motion), tool, cell)
        found[at] = replace(place, patch_m=_side(cell.measuring[tool], widths.get(name, 0.0)))
    return replace(cell, places={**cell.places, **found}) if found else cell


def _widths(problem: Problem, predicate: str) -> dict[str, float]:
    """How wide (m) the bores are that measurements lie in."""
    facts = [
        each.arguments for each in problem.statics if each.name == predicate and len(each.arguments) == 2
    ]
    return {str(name): width.value * MICRO for name, width in facts if isinstance(width, Number)}


def _side(how: Measuring, width_m: float) -> float:
    """The side of the patch that a scanner must see: as wide as a bore, else the least that it measures."""
    least, most = how.patch_m
    return min(max(width_m, least), most, how.field_m) if width_m else least


def _frame(motion: Motion | None) -> str:
    return motion.frame if motion is not None else "world"


def _triples(problem: Problem, predicate: str) -> dict[str, Floats]:
    """The three numbers that a static fact gives to each name."""
    found = {}
    for fact in problem.statics:
        if fact.name == predicate and len(fact.arguments) == 4:
            numbers = [each.value for each in fact.arguments[1:] if isinstance(each, Number)]
            if len(numbers) == 3:
                found[str(fact.arguments[0])] = np.array(numbers, dtype=float)
    return found


def _place(
    name: str, point: Floats, normal: Floats, how: Measuring, frame: str, tool: str, cell: Cell
) -> Place:
    """The tool's z goes against the normal; about it the tool may turn."""
    away = normal / max(norm(normal), 1e-9)
    T = transforms.transform(_against(away), point)
    placement = Placement(frame, transforms.to_pose(T))
    return Place(name, placement, next(iter(cell.arms)), tool, how.approach_m, True, how.touches)


def _against(normal: Floats) -> Floats:
    """A rotation (3, 3) whose z looks against a unit normal (3,)."""
    z = -normal
    beside = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(beside, z)
    x /= norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def measured_at(words: Conventions, place: str) -> str:
    """The measurement that a place belongs to, that of one arm too; empty if it is another place."""
    head, _, rest = place.partition("(")
    return rest.removesuffix(")").split(", ")[0] if head == words.meas else ""
