"""The amounts that the goals lack, as the smallest change of the initial facts that would do."""

from collections.abc import Iterator, Sequence

from cellwright.engine.model.plan_explanation import Amendment, Edit
from cellwright.engine.pipelines.explanation.amendments import INITIAL
from cellwright.engine.stages.planning.shortage import Shortage
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number


def refill(problem: Problem, lacking: Sequence[Shortage]) -> Amendment | None:
    """The change of amounts at the start with which nothing is short any more; None if their ranges
    do not allow it.

    Of several quantities that are short together, the first one that has room gets all of it.
    """
    edits = [next(_refills(problem, each), None) for each in lacking]
    enough = tuple(each for each in edits if each is not None)
    return Amendment(enough) if enough and len(enough) == len(edits) else None


def _refills(problem: Problem, short: Shortage) -> Iterator[Edit]:
    step = -short.missing if short.rise else short.missing
    for quantity, start in zip(short.quantities, short.starts, strict=True):
        bounds = problem.domain.quantities[quantity.name]
        given, wanted = _fact(quantity, start), start + step
        inside = (bounds.low is None or wanted >= bounds.low) and (
            bounds.high is None or wanted <= bounds.high
        )
        if inside and given in problem.initial:
            yield Edit(INITIAL, _fact(quantity, wanted), given)


def _fact(quantity: Function, value: int) -> Atom:
    return Function(quantity.name, (*quantity.arguments, Number(value)))
