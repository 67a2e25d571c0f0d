"""Durations and costs of a problem, from its static facts and the places of its cell."""

from collections.abc import Callable
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.kb.asp import Grounder
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.diagnostics import InvalidInput, unknown_name
from cellwright.kb.files import is_file
from cellwright.kb.model.domain_model import Domain, Point
from cellwright.kb.model.operator_amounts import Amounts, Facts, Standing
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import CELL_FILE

if TYPE_CHECKING:  # only travel needs cells, and they take a while to load
    from cellwright.kb.model.cell_model import Cell


def amounts_of(problem: Problem, facts: Facts | None = None) -> Amounts:
    """The durations and costs of a problem. Nothing is evaluated before it is needed.

    `facts` gives its static facts if they have been evaluated already.
    """
    return Amounts(
        problem.domain,
        facts or _lazy_facts(problem),
        cell_points(problem.domain),
        problem.durations,
    )


def cell_points(domain: Domain) -> Standing:
    """The points of the places in the cell beside a domain, in micrometres, in the frame of its
    travel.

    The cell is read when a point is first asked for. Raises `InvalidInput` then for a bad cell or
    an unknown frame.
    """
    cell = cache(lambda: _cell_with_frame(domain))

    def point(place: str) -> Point | None:
        if (framed := cell()) is None:
            return None
        from cellwright.kb.model.cell_model import place_position

        at = place_position(framed[0], place, framed[1])
        return None if at is None else (round(at[0] * 1e6), round(at[1] * 1e6), round(at[2] * 1e6))

    return point


def _lazy_facts(problem: Problem) -> Facts:
    """The static facts, evaluated by clingo when the first of them is asked for."""

    def grounded() -> Grounder:
        return evaluate_statics(problem)

    ask: Callable[[], Grounder] = cache(grounded)
    return lambda name, arity: ask().atoms(name, arity)


def _cell_with_frame(domain: Domain) -> "tuple[Cell, str] | None":
    """The cell beside a domain, and the frame of its travel; None if there is no cell. Raises
    `InvalidInput`.
    """
    version = version_of_cell(domain)
    if version is None:
        return None
    from cellwright.kb.model.cell_model import is_fixed
    from cellwright.kb.model.domain_model import WORLD_FRAME

    frame, cell = (
        domain.motion.frame if domain.motion else WORLD_FRAME,
        _load_cell_version(*version),
    )
    if domain.motion is not None and not is_fixed(cell, frame):
        fixed_names = [name for name in (*cell.frames, *cell.bodies) if is_fixed(cell, name)]
        raise InvalidInput(
            [unknown_name("frame", frame, [WORLD_FRAME, *fixed_names], domain.motion.where)]
        )
    return cell, frame


def version_of_cell(domain: Domain) -> tuple[Path, int, int] | None:
    """The file of the cell beside a domain, with the time of its last change and its size; None
    if there is none.
    """
    path = Path(domain.path).with_name(CELL_FILE) if domain.path else None
    if path is None or not is_file(path):
        return None
    status = path.stat()
    return path, status.st_mtime_ns, status.st_size


@lru_cache(maxsize=4)
def _load_cell_version(path: Path, _changed: int, _size: int) -> "Cell":
    """The cell in a file; a program that plans piece by piece reads it once for each version of
    the file.
    """
    from cellwright.kb.loader.cell import load_cell

    return load_cell(path)
