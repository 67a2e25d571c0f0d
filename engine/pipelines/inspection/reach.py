"""Which arms reach measurements whose places the cell describes, by geometry: each arm alone, the others out of the way."""

from collections.abc import Mapping, Sequence

from cellwright.engine.pipelines.places import of_arm, with_places_of_arms
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.reach.reach import Reachability, Unreached
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Cell, Place
from cellwright.kb.model.problem import Problem

NO_PLACE = "the cell has no place for it there"


def reached_by(
    problem: Problem,
    cell: Cell,
    names: Sequence[str],
    tools: Mapping[str, Sequence[str]],
    owners: Mapping[str, frozenset[str]],
) -> dict[str, dict[str, str]]:
    """For each arm why it does not reach a measurement, empty if it does; nothing of measurements without any place."""
    words = problem.domain.conventions
    whole = with_places_of_arms(cell, problem, tools, owners)
    places = {name: {arm: _place(whole, words.place(name), arm) for arm in cell.arms} for name in names}
    found = dict[str, dict[str, str]]()
    for arm in cell.arms:
        ask = Reachability(World.of(whole).of_arms((arm,)), geometry_backend())
        for name, own in places.items():
            place = own[arm]
            if any(own.values()):
                found.setdefault(name, {})[arm] = NO_PLACE if place is None else _why(ask, place)
    return found


def _place(cell: Cell, name: str, arm: str) -> Place | None:
    """The place of an arm at a measurement: its own, or the only one if it belongs to the arm."""
    only = cell.places.get(name)
    return cell.places.get(of_arm(name, arm)) or (only if only is not None and only.arm == arm else None)


def _why(ask: Reachability, place: Place) -> str:
    answer = ask.at(place)
    return answer.reason if isinstance(answer, Unreached) else ""
