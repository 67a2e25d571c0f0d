"""Which tools can measure an undecided feature again, and what one more measurement is worth."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import NormalDist

from cellwright.engine.model.verdicts import MeasuredFeature
from cellwright.engine.pipelines.inspection.nominal_values import MeasurementJudge
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.model.domain_model import Operator
from cellwright.kb.model.measured_results import (
    COVERAGE_FACTOR,
    RISK_PERCENT,
    Conformity,
    check_conformity,
)
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Variable


@dataclass(frozen=True, slots=True)
class RemeasurementOffer:
    """A tool, the expanded uncertainty of its values in the unit of the feature, and the worth
    of a decision in units of time.
    """

    tool: str
    uncertainty: float
    worth: float


def remeasurement_offers(
    problem: Problem, feature: MeasuredFeature
) -> tuple[RemeasurementOffer, ...]:
    """The tools of the feature's kind that the rules of the domain do not refuse for it, in the
    order of their names.
    """
    refused = {
        (str(tool), str(name))
        for tool, name, _ in evaluate_statics(problem).atoms(problem.domain.conventions.refused, 3)
    }
    offers_found = _all_offers(problem, MeasurementJudge(problem), feature)
    return tuple(
        sorted(
            (e for e in offers_found if (e.tool, feature.of) not in refused), key=lambda e: e.tool
        )
    )


def _all_offers(
    problem: Problem, measuring: MeasurementJudge, feature: MeasuredFeature
) -> Iterator[RemeasurementOffer]:
    for operator in problem.domain.operators:
        measure = operator.command.measures if operator.command else None
        if (
            measure is None
            or measure.quantity != feature.quantity
            or not isinstance(measure.by, Variable)
        ):
            continue
        for tool in _of_type(problem, operator, measure.by):
            asked = measuring.expected(
                _measuring_step(operator, measure.by, measure.of, tool, feature.of)
            )
            if asked is not None and asked.of == feature.of and asked.uncertainty and asked.worth:
                yield RemeasurementOffer(tool, asked.uncertainty, asked.worth)


def _measuring_step(operator: Operator, by: object, of: object, tool: str, name: str) -> Function:
    """A step of the operator with this tool and measurement; what else it needs is left open."""
    known_terms = {by: Function(tool), of: Function(name)}
    return Function(
        operator.name, tuple(known_terms.get(variable, variable) for variable in operator.variables)
    )


def _of_type(problem: Problem, operator: Operator, variable: Variable) -> Iterator[str]:
    wanted_type = next(
        (parameter.type for parameter in operator.parameters if parameter.variable == variable), ""
    )
    for name, type_ in {**problem.domain.objects, **problem.objects}.items():
        if problem.domain.is_subtype(type_, wanted_type):
            yield name


EQUAL_DRAWS = 99  # equally probable means


def chance_of_decision(feature: MeasuredFeature, uncertainty: float, common: float = 0.0) -> float:
    """How probable it is that one more value, with an expanded uncertainty of its own, decides.

    `common` is the part of the feature's expanded uncertainty that all its values share, such as
    that of where the part lies.
    """
    if feature.value is None or not feature.uncertainty or uncertainty <= 0:
        return 0.0
    sigma2 = max(0.0, feature.uncertainty**2 - common**2) / COVERAGE_FACTOR**2
    one2, shared2 = (uncertainty / COVERAGE_FACTOR) ** 2, (common / COVERAGE_FACTOR) ** 2
    if not sigma2:
        return 0.0
    after2 = 1.0 / (1.0 / sigma2 + 1.0 / one2)
    moves, then = math.sqrt(sigma2 - after2), COVERAGE_FACTOR * math.sqrt(after2 + shared2)
    risk = RISK_PERCENT if feature.risk is None else feature.risk
    decided = 0
    for number in range(EQUAL_DRAWS):
        mean = feature.value + moves * NormalDist().inv_cdf((number + 0.5) / EQUAL_DRAWS)
        shown = check_conformity(mean, feature.lower, feature.upper, then, risk)
        decided += shown is not None and shown is not Conformity.UNDECIDED
    return decided / EQUAL_DRAWS
