"""What no arm can do becomes a condition: a step without a motion may not be taken while what is in its way stays where it is."""

from collections.abc import Iterable
from dataclasses import replace

from cellwright.engine.model.moves import Unmoved
from cellwright.kb.model.conditions import And, Comparison, Condition, Literal, Or
from cellwright.kb.model.domain import Operator
from cellwright.kb.model.problem import Problem


def without_blocked(problem: Problem, refused: Iterable[Unmoved]) -> Problem:
    """The problem in which no refused step is taken while the facts hold that its motion failed under."""
    by_name: dict[str, list[Unmoved]] = {}
    for each in refused:
        by_name.setdefault(each.operator.name, []).append(each)
    kept = []
    for operator in problem.domain.operators:
        found = _spared(operator, by_name.get(operator.name, []))
        kept += [found] if found is not None else []
    return replace(problem, domain=replace(problem.domain, operators=tuple(kept)))


def _spared(operator: Operator, refused: list[Unmoved]) -> Operator | None:
    """The operator without its refused steps; None if nothing is left of it."""
    conditions: list[Condition] = []
    for each in refused:
        others: list[Condition] = [
            Comparison(variable, "!=", value)
            for n, (variable, value) in enumerate(
                zip(operator.variables, each.operator.arguments, strict=True)
            )
            if n not in each.regardless
        ]
        others += [Literal(fact, positive=False) for fact in each.while_true]
        if not others:
            return None
        conditions.append(others[0] if len(others) == 1 else Or(tuple(others)))
    if not conditions:
        return operator
    return replace(operator, precondition=And((operator.precondition, *conditions)))


def told(refused: Iterable[Unmoved]) -> str:
    """What has no motion, and why, as one sentence for people."""
    return "; ".join(f"{each.operator} has no motion: {each.reason}" for each in refused)
