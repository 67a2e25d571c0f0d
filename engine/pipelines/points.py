"""The measurements of a problem as points with normals, as its facts and its cell tell."""

from dataclasses import replace

from cellwright.engine.model.measurement import UNSAID_NORMAL, MeasurementPoint, Triple
from cellwright.engine.model.measurements import measurements_of
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.loader.amounts import standing
from cellwright.kb.model.conventions import Conventions
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function, Number, Term

PROFILE = "profile"  # the kind of measurement that tells how far a surface is from where it should be
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254}


def points(problem: Problem) -> list[MeasurementPoint]:
    """The measurements of a problem that have a position, as their facts tell; where no normal is given, the surface faces down."""
    words = problem.domain.conventions
    told: dict[tuple[str, str], tuple[Term, ...]] = {
        (fact.name, str(fact.arguments[0])): fact.arguments[1:] for fact in problem.statics if fact.arguments
    }

    def number(predicate: str, name: str) -> int | None:
        found = told.get((predicate, name))
        return found[0].value if found and isinstance(found[0], Number) else None

    def metres(predicate: str, name: str) -> float | None:
        found = number(predicate, name)
        return None if found is None else found * 1e-6

    def triple(predicate: str, name: str, scale: float) -> Triple | None:
        numbers = [each.value * scale for each in told.get((predicate, name), ()) if isinstance(each, Number)]
        return (numbers[0], numbers[1], numbers[2]) if len(numbers) == 3 else None

    kinds = {words.kind(each): each for each in ("thickness", "profile")}
    made = []
    for name in measurements_of(problem):
        if (position := triple(words.position, name, 1e-6)) is None:
            continue
        needed = str(told[words.needs, name][0]) if (words.needs, name) in told else ""
        normal = triple(words.normal, name, 1e-3) or UNSAID_NORMAL
        sizes = (metres(each, name) for each in (words.tolerance, words.bore, words.nominal))
        tolerance, bore, nominal = sizes
        kind, (tool, *_) = kinds.get(needed, needed), told.get((words.prefers, name), ("",))
        step = number(words.alignment, name) or 0
        made.append(
            MeasurementPoint(
                name, name, kind, position, normal, tolerance, bore, step, nominal_m=nominal, tool=str(tool)
            )
        )
    return made


def positions(problem: Problem) -> dict[str, tuple[float, ...]]:
    """The given positions of measurements, in metres, by name. Measurements without a position are left out."""
    return positions_in(evaluated(problem), problem.domain.conventions)


def positions_in(grounder: Grounder, words: Conventions) -> dict[str, tuple[float, ...]]:
    """The same of facts that are evaluated already."""
    given = grounder.atoms(words.position, 4)
    return {str(name): tuple(_number(each) * 1e-6 for each in at) for name, *at in given}


def _number(term: Term) -> float:
    return term.value if isinstance(term, Number) else 0.0


def with_places(problem: Problem) -> Problem:
    """The problem with a `position` added for each measurement that has none but has a place in the cell.

    The position is that of the place in micrometres, in the frame of the domain's travel, else in the world. Raises
    `InvalidInput` for a bad cell.
    """
    words, names = problem.domain.conventions, measurements_of(problem)
    if not names or words.position not in problem.domain.predicates:
        return problem
    known, point = positions(problem), standing(problem.domain)
    found = {name: point(words.place(name)) for name in names if name not in known}
    facts = tuple(
        Function(words.position, (Function(name), *map(Number, at))) for name, at in found.items() if at
    )
    return replace(problem, statics=(*problem.statics, *facts)) if facts else problem
