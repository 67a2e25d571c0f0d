"""What each step measures, its nominal value and tolerance, and whether a value conforms."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.domain_model import Domain, Measure, Operator
from cellwright.kb.model.measured_results import Measured
from cellwright.kb.model.operator_amounts import Amounts, NoAmount, NotTold, number_terms
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import (
    Function,
    Number,
    Substitution,
    Term,
    Text,
    Variable,
    match_term,
    substitute_term,
)


@dataclass(frozen=True, slots=True)
class ExpectedValue:
    """What a step measures, and what it should give; None where nobody said."""

    of: str
    quantity: str
    unit: str
    tool: str
    nominal: float | None
    lower: float | None
    upper: float | None
    uncertainty: float | None = None
    risk: float | None = None
    worth: float = 0.0  # in the domain's unit of time
    usual: float = 0.0  # about what is measured where no nominal value is known

    @property
    def about(self) -> float:
        """About what a good part gives."""
        return self.usual if self.nominal is None else self.nominal


class MeasurementJudge:
    """Judges the measurements of one problem.

    `amounts` are its numbers, if they have been made already.
    """

    def __init__(self, problem: Problem, amounts: Amounts | None = None) -> None:
        self._operators = {operator.name: operator for operator in problem.domain.operators}
        self._amounts = amounts or amounts_of(problem)

    def expected(self, step: Function) -> ExpectedValue | None:
        """What a step should measure; None if it measures nothing."""
        operator = self._operators.get(step.name)
        measure = operator.command.measures if operator and operator.command else None
        if operator is None or measure is None:
            return None
        bound = dict(zip(operator.variables, step.arguments, strict=True))
        nominal = self._number(measure.nominal, bound)
        lower, upper = self._number(measure.lower, bound), self._number(measure.upper, bound)
        width = self._number(measure.tolerance, bound)
        if nominal is not None and width is not None:
            lower, upper = nominal - width / 2, nominal + width / 2
        texts = [
            str(substitute_term(term, bound)) if term is not None else ""
            for term in (measure.of, measure.by)
        ]
        uncertainty, risk = (
            self._number(measure.uncertainty, bound),
            self._number(measure.risk, bound),
        )
        worth, usual = (self._number(term, bound) or 0.0 for term in (measure.worth, measure.usual))
        limits = (nominal, lower, upper)
        return ExpectedValue(
            texts[0],
            measure.quantity,
            measure.unit,
            texts[1],
            *limits,
            uncertainty,
            risk,
            worth,
            usual,
        )

    def measured(self, step: Function, reply: Term, at_ms: int) -> Measured | None:
        """What a step has measured by a reply to its command; None if it measures nothing or
        the reply has no number.
        """
        expected, operator = self.expected(step), self._operators.get(step.name)
        if expected is None or operator is None or operator.command is None:
            return None
        value = _measured_value(operator, step, reply)
        if value is None:
            return None
        return Measured(
            expected.of,
            expected.quantity,
            value,
            expected.unit,
            expected.nominal,
            expected.lower,
            expected.upper,
            expected.tool,
            str(step),
            at_ms,
            expected.uncertainty,
            expected.risk,
        )

    def heard(self, step: Function, reply: str, at_ms: int) -> Measured | None:
        """What a step has measured by the text of a reply."""
        operator = self._operators.get(step.name)
        if operator is None or operator.command is None or operator.command.measures is None:
            return None
        try:
            return self.measured(step, ground_term(reply), at_ms)
        except AspError:
            return None

    def _number(self, term: Term | None, bound: Substitution) -> float | None:
        """What a term amounts to; None if it is not given, or no fact tells it."""
        if term is None:
            return None
        try:
            return float(self._amounts.of(term, bound, 0))
        except NoAmount:
            return None


def _measured_value(operator: Operator, step: Function, reply: Term) -> float | None:
    """The number that a reply gives to the measured variable: a whole number, or a text such as
    "12.5".
    """
    command = operator.command
    if command is None or command.measures is None:
        return None
    bound = dict(zip(operator.variables, step.arguments, strict=True))
    pattern = substitute_term(command.reply, bound)
    heard = (
        match_term(pattern, reply, {})
        if isinstance(pattern, Function) and isinstance(reply, Function)
        else None
    )
    return _plain_number(heard, command.measures.value) if heard is not None else None


def _plain_number(heard: Mapping[Variable, Term], value: Variable) -> float | None:
    match heard.get(value):
        case Number(whole):
            return float(whole)
        case Text(text):
            try:
                number = float(text)
            except ValueError:
                return None
            return number if math.isfinite(number) else None
        case _:
            return None


def nominal_findings(problem: Problem) -> list[Diagnostic]:
    """What is wrong with the nominal values and tolerances that the facts of a problem give to
    its measurements.
    """
    measures = [
        operator.command.measures for operator in problem.domain.operators if operator.command
    ]
    measures_stated = [measured for measured in measures if measured is not None]
    if not measures_stated:
        return []
    amounts = amounts_of(problem)
    diagnostics = [
        diagnostic
        for measure in measures_stated
        for diagnostic in _measure_findings(measure, problem, amounts)
    ]
    return list(
        {(diagnostic.where, diagnostic.message): diagnostic for diagnostic in diagnostics}.values()
    )


def _measure_findings(measure: Measure, problem: Problem, amounts: Amounts) -> Iterator[Diagnostic]:
    for name in ("tolerance", "nominal", "uncertainty", "risk"):
        term = getattr(measure, name)
        for fact in number_terms(problem.domain, term):
            for arguments in _fact_keys(fact, amounts, problem.domain):
                try:
                    value = amounts.of(Function(fact.name, arguments), {}, 0)
                except NotTold:
                    continue
                except NoAmount as error:
                    yield Diagnostic(problem.where, "K316", str(error), error.hint)
                    continue
                if wrong := _number_fault(name, value):
                    fault, hint = wrong
                    sentence = f"{Function(fact.name, arguments)} is {value}, {fault}"
                    yield Diagnostic(problem.where, "K316", sentence, hint)


def _number_fault(name: str, value: int) -> tuple[str, str] | None:
    """What is wrong with a number for a tolerance, an uncertainty or a risk, and what to try."""
    if name == "tolerance" and value <= 0:
        return "so nothing can pass", "give how wide the zone is"
    if name == "uncertainty" and value < 0:
        return "and no uncertainty is negative", "give two standard deviations"
    if name == "risk" and not 0 < value < 50:
        return (
            "and a risk is more than 0 and less than 50 percent",
            "give how many percent may be wrong",
        )
    return None


def _fact_keys(fact: Function, amounts: Amounts, domain: Domain) -> list[tuple[Term, ...]]:
    """For what the facts of a predicate give a number."""
    if fact.name not in domain.predicates:
        return []
    return sorted({row[:-1] for row in amounts.facts(fact.name, len(fact.arguments) + 1)}, key=str)
