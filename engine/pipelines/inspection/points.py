"""The measurements of a problem as points with normals, as its facts tell."""

from engine.model.measurement import MeasurementPoint, Triple
from engine.model.measurements import measurements_of
from kb.model.problem import Problem
from kb.terms import Number, Term


def points(problem: Problem) -> list[MeasurementPoint]:
    """The measurements of a problem that have a position, as their facts tell; the normal is up if none is given."""
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
        normal = triple(words.normal, name, 1e-3) or (0.0, 0.0, 1.0)
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
