"""Visits to be put in order: those of a TSPLIB file, or the measurements of a problem."""

from collections.abc import Sequence
from pathlib import Path

from cellwright.engine.formats.interop.tsplib import read_tsplib
from cellwright.engine.model.measurements import is_shared
from cellwright.engine.pipelines.inspection import partition, tour_problem
from cellwright.engine.pipelines.inspection.demands import known, of_options, with_demands
from cellwright.engine.pipelines.inspection.visits import Visits
from cellwright.engine.pipelines.planning import problem_of
from cellwright.engine.pipelines.points import with_places
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import is_file


def is_tsplib(target: str) -> bool:
    """Whether a target is a TSPLIB file."""
    return is_file(Path(target)) and Path(target).suffix not in (".yaml", ".yml")


def visits_of(
    target: str, windows: Sequence[str] = (), lasts: Sequence[str] = (), before: Sequence[str] = ()
) -> Visits:
    """The visits that a target names, with windows ("m3=10..90"), durations ("m3=4") and orders ("m1, m2") beside.

    Raises `InvalidInput`.
    """
    demands = of_options(list(windows), list(lasts), list(before))
    if is_tsplib(target):
        found = Visits(with_demands(read_tsplib(Path(target)), demands))
    else:
        problem = with_places(problem_of(target))
        if is_shared(problem):
            said, hint = "several arms share the measurements", "ask for a plan: it says which arm makes what"
            raise InvalidInput([Diagnostic(Source(target), "K404", said, hint)])
        parts = partition(problem)
        found = Visits(tour_problem(problem, parts, demands), parts, problem)
    known(demands, {visit.name for visit in found.tours.visits})
    return found
