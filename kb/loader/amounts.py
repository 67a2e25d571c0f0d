"""The durations and costs of a problem: its static facts, and the places of the cell beside its domain."""

from collections.abc import Callable
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.kb.asp import Grounder
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.diagnostics import InvalidInput, unknown_name
from cellwright.kb.files import is_file
from cellwright.kb.model.amounts import Amounts, Facts, Standing
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.motion import Point
from cellwright.kb.model.problem import Problem
from cellwright.kb.targets import CELL_FILE

if TYPE_CHECKING:  # only travel needs cells, and they take a while to load
    from cellwright.kb.model.cell import Cell


def amounts_of(problem: Problem, facts: Facts | None = None) -> Amounts:
    """The durations and costs of a problem. Nothing is evaluated before it is needed.

    `facts` gives its static facts if they have been evaluated already.
    """
    return Amounts(problem.domain, facts or _evaluated(problem), standing(problem.domain), problem.durations)


def standing(domain: Domain) -> Standing:
    """The points of the places in the cell beside a domain, in micrometres, in the frame of its travel.

    The cell is read when a point is first asked for. Raises `InvalidInput` then for a bad cell or an unknown frame.
    """
    cell = cache(lambda: _framed(domain))

    def point(place: str) -> Point | None:
        if (found := cell()) is None:
            return None
        from cellwright.kb.model.positions import position

        at = position(found[0], place, found[1])
        return None if at is None else (round(at[0] * 1e6), round(at[1] * 1e6), round(at[2] * 1e6))

    return point


def _evaluated(problem: Problem) -> Facts:
    """The static facts, evaluated by clingo when the first of them is asked for."""

    def grounded() -> Grounder:
        return evaluated(problem)

    ask: Callable[[], Grounder] = cache(grounded)
    return lambda name, arity: ask().atoms(name, arity)


def _framed(domain: Domain) -> "tuple[Cell, str] | None":
    """The cell beside a domain, and the frame of its travel; None if there is no cell. Raises `InvalidInput`."""
    version = version_of_cell(domain)
    if version is None:
        return None
    from cellwright.kb.model.cell import WORLD
    from cellwright.kb.model.positions import is_fixed

    frame, cell = domain.motion.frame if domain.motion else WORLD, _cell(*version)
    if domain.motion is not None and not is_fixed(cell, frame):
        known = [name for name in (*cell.frames, *cell.bodies) if is_fixed(cell, name)]
        raise InvalidInput([unknown_name("frame", frame, [WORLD, *known], domain.motion.where)])
    return cell, frame


def version_of_cell(domain: Domain) -> tuple[Path, int, int] | None:
    """The file of the cell beside a domain, with the time of its last change and its size; None if there is none."""
    path = Path(domain.path).with_name(CELL_FILE) if domain.path else None
    if path is None or not is_file(path):
        return None
    said = path.stat()
    return path, said.st_mtime_ns, said.st_size


@lru_cache(maxsize=4)
def _cell(path: Path, _changed: int, _size: int) -> "Cell":
    """The cell in a file; a program that plans piece by piece reads it once for each version of the file."""
    from cellwright.kb.loader.cell import load_cell

    return load_cell(path)
