"""Positions of measurements that only the cell file gives."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from engine.pipelines.inspection import measurements_of, positions
from engine.stages.geometry import transforms
from engine.stages.geometry.world.model import World
from kb.loader import CELL_FILE
from kb.loader.cell import load_cell
from kb.model.cell import WORLD
from kb.model.problem import Problem
from kb.terms import Function, Number


def with_places(problem: Problem) -> Problem:
    """The problem with a `position` added for each measurement that has none but has a place in the cell.

    The position is that of the place in the world frame, in micrometres. Raises `InvalidInput` for a bad cell.
    """
    path = Path(problem.domain.path).with_name(CELL_FILE) if problem.domain.path else None
    words, names = problem.domain.conventions, measurements_of(problem)
    if path is None or not path.is_file() or not names or words.position not in problem.domain.predicates:
        return problem
    places, known = load_cell(path), positions(problem)
    world = World.of(places)
    facts = tuple(
        Function(words.position, (Function(name), *map(Number, _micrometres(world, words.place(name)))))
        for name in names
        if name not in known and words.place(name) in places.places
    )
    return replace(problem, statics=(*problem.statics, *facts)) if facts else problem


def _micrometres(world: World, place: str) -> list[int]:
    at = world.cell.places[place].placement
    T_world_place = world.pose(WORLD, at.parent) @ transforms.of_pose(at.pose)
    return [int(each) for each in np.rint(T_world_place[:3, 3] * 1e6)]
