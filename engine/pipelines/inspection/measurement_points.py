"""The measurements of a problem as points with normals, as its facts and its cell tell."""

from dataclasses import replace

from cellwright.engine.model.part_measurements import (
    UNSAID_NORMAL,
    MeasurementPoint,
    Triple,
    measurements_of,
)
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.loader.problem_amounts import cell_points
from cellwright.kb.model.name_conventions import Conventions
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Number, Term

# the kind of measurement that tells how far a surface is from where it should be
PROFILE_KIND = "profile"
METRES_PER_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254}


def points_of_problem(problem: Problem) -> list[MeasurementPoint]:
    """The measurements of a problem that have a position, as their facts tell; where no normal
    is given, the surface faces down.
    """
    words = problem.domain.conventions
    told_facts: dict[tuple[str, str], tuple[Term, ...]] = {
        (fact.name, str(fact.arguments[0])): fact.arguments[1:]
        for fact in problem.statics
        if fact.arguments
    }

    def number(predicate: str, name: str) -> int | None:
        arguments = told_facts.get((predicate, name))
        return arguments[0].value if arguments and isinstance(arguments[0], Number) else None

    def metres(predicate: str, name: str) -> float | None:
        length = number(predicate, name)
        return None if length is None else length * 1e-6

    def triple(predicate: str, name: str, scale: float) -> Triple | None:
        numbers = [
            term.value * scale
            for term in told_facts.get((predicate, name), ())
            if isinstance(term, Number)
        ]
        return (numbers[0], numbers[1], numbers[2]) if len(numbers) == 3 else None

    kinds = {words.kind(kind): kind for kind in ("thickness", "profile")}
    points_made = []
    for name in measurements_of(problem):
        if (position := triple(words.position, name, 1e-6)) is None:
            continue
        needed = str(told_facts[words.needs, name][0]) if (words.needs, name) in told_facts else ""
        normal = triple(words.normal, name, 1e-3) or UNSAID_NORMAL
        sizes = (
            metres(predicate, name) for predicate in (words.tolerance, words.bore, words.nominal)
        )
        tolerance, bore, nominal = sizes
        kind, (tool, *_) = kinds.get(needed, needed), told_facts.get((words.prefers, name), ("",))
        step = number(words.alignment, name) or 0
        points_made.append(
            MeasurementPoint(
                name,
                name,
                kind,
                position,
                normal,
                tolerance,
                bore,
                step,
                nominal_m=nominal,
                tool=str(tool),
            )
        )
    return points_made


def given_positions_m(problem: Problem) -> dict[str, tuple[float, ...]]:
    """The given positions of measurements, in metres, by name.

    Measurements without a position are left out.
    """
    return positions_in(evaluate_statics(problem), problem.domain.conventions)


def positions_in(grounder: Grounder, words: Conventions) -> dict[str, tuple[float, ...]]:
    """The same of facts that are evaluated already."""
    given_rows = grounder.atoms(words.position, 4)
    return {str(name): tuple(_point_number(term) * 1e-6 for term in at) for name, *at in given_rows}


def _point_number(term: Term) -> float:
    return term.value if isinstance(term, Number) else 0.0


def with_places(problem: Problem) -> Problem:
    """The problem with a `position` added for each measurement that has none but has a place in the
    cell.

    The position is that of the place in micrometres, in the frame of the domain's travel, else in
    the world. Raises `InvalidInput` for a bad cell.
    """
    words, names = problem.domain.conventions, measurements_of(problem)
    if not names or words.position not in problem.domain.predicates:
        return problem
    given_points, point = given_positions_m(problem), cell_points(problem.domain)
    places = {name: point(words.place(name)) for name in names if name not in given_points}
    facts = tuple(
        Function(words.position, (Function(name), *map(Number, at)))
        for name, at in places.items()
        if at
    )
    return replace(problem, statics=(*problem.statics, *facts)) if facts else problem
