"""Which tools can measure a feature once more, how uncertain their values are, and what a decision is worth."""

from collections.abc import Iterator
from dataclasses import dataclass

from cellwright.engine.model.verdicts import Feature
from cellwright.engine.pipelines.measuring import Measuring
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.model.domain import Operator
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function, Variable


@dataclass(frozen=True, slots=True)
class Offer:
    """A tool, the expanded uncertainty of its values in the unit of the feature, and the worth of a decision in units of time."""

    tool: str
    uncertainty: float
    worth: float


def offers(problem: Problem, feature: Feature) -> tuple[Offer, ...]:
    """The tools of the feature's kind that the rules of the domain do not refuse for it, in the order of their names."""
    refused = {
        (str(tool), str(name))
        for tool, name, _ in evaluated(problem).atoms(problem.domain.conventions.refused, 3)
    }
    found = _all(problem, Measuring(problem), feature)
    return tuple(sorted((e for e in found if (e.tool, feature.of) not in refused), key=lambda e: e.tool))


def _all(problem: Problem, measuring: Measuring, feature: Feature) -> Iterator[Offer]:
    for operator in problem.domain.operators:
        measure = operator.command.measures if operator.command else None
        if measure is None or measure.quantity != feature.quantity or not isinstance(measure.by, Variable):
            continue
        for tool in _of_type(problem, operator, measure.by):
            asked = measuring.expected(_step(operator, measure.by, measure.of, tool, feature.of))
            if asked is not None and asked.of == feature.of and asked.uncertainty and asked.worth:
                yield Offer(tool, asked.uncertainty, asked.worth)


def _step(operator: Operator, by: object, of: object, tool: str, name: str) -> Function:
    """A step of the operator with this tool and measurement; what else it needs is left open."""
    known = {by: Function(tool), of: Function(name)}
    return Function(operator.name, tuple(known.get(each, each) for each in operator.variables))


def _of_type(problem: Problem, operator: Operator, variable: Variable) -> Iterator[str]:
    wanted = next((each.type for each in operator.parameters if each.variable == variable), "")
    for name, type_ in {**problem.domain.objects, **problem.objects}.items():
        if problem.domain.is_subtype(type_, wanted):
            yield name
