"""Plans in the format of the planning competitions: one action per line, in order."""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

from cellwright.engine.formats.interop.pddl import PddlProblem
from cellwright.engine.formats.interop.pddl.expressions import plan_actions
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, nearest_hint
from cellwright.kb.files import File, read_file
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.domain_model import NUMERIC_TYPES, Operator
from cellwright.kb.model.operator_amounts import step_of
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.terms import Function, Number, Term, Variable, match_term, substitute_atom


def write_plan(task: PddlProblem, plan: Plan) -> str:
    """The steps in their executable order, with the names of the PDDL files and the cost."""
    operators = {operator.name: operator for operator in task.problem.domain.operators}
    lines = [
        f"({' '.join(_action_words(task, operators[step.operator.name], step.operator))})"
        for step in plan.steps
    ]
    cost = Fraction(plan.cost, task.unit_of_cost)
    said = cost if cost.denominator == 1 else float(cost)
    return "\n".join([*lines, f"; cost = {said}"]) + "\n"


def _action_words(task: PddlProblem, operator: Operator, instance: Function) -> Iterator[str]:
    yield task.names.original("operator", instance.name)
    for parameter, argument in zip(operator.parameters, instance.arguments, strict=True):
        if parameter.type not in NUMERIC_TYPES:  # in PDDL, values are not arguments
            yield task.names.original("object", str(argument))


def read_plan(task: PddlProblem, path: Path) -> Plan:
    """The plan in a file as a sequence of steps.

    Raises `InvalidInput` if a line is not an action of the task.
    """
    file = read_file(path)
    diagnostics: list[Diagnostic] = []
    steps: list[Step] = []
    amounts = amounts_of(task.problem)
    for number, (words, offset) in enumerate(plan_actions(file.text), 1):
        instance = _read_action(task, words, file, offset, diagnostics)
        after = (StepId(number - 1),) if number > 1 else ()
        steps.append(step_of(amounts, StepId(number), instance, after))
    if diagnostics:
        raise InvalidInput(diagnostics)
    return Plan(tuple(steps))


def _read_action(
    task: PddlProblem, words: list[str], file: File, offset: int, diagnostics: list[Diagnostic]
) -> Function:
    names = {task.names.original("operator", o.name): o for o in task.problem.domain.operators}
    operator = names.get(words[0])
    if operator is None:
        hint = nearest_hint(words[0], list(names))
        diagnostics.append(
            Diagnostic(file.at(offset), "K101", f"unknown action '{words[0]}'", hint)
        )
        return Function("unreadable")
    plain = [parameter for parameter in operator.parameters if parameter.type not in NUMERIC_TYPES]
    if len(plain) != len(words) - 1:
        diagnostics.append(
            Diagnostic(file.at(offset), "K102", f"{words[0]} takes {len(plain)} arguments")
        )
        return Function("unreadable")
    bindings: dict[Variable, Term] = {
        parameter.variable: Function(task.names.of("object", word))
        for parameter, word in zip(plain, words[1:], strict=True)
    }
    bindings = _function_values(task, operator, bindings)
    return Function(operator.name, tuple(bindings.get(v, Number(0)) for v in operator.variables))


def _function_values(
    task: PddlProblem, operator: Operator, bindings: dict[Variable, Term]
) -> dict[Variable, Term]:
    """The arguments that are values of functions, read from static facts."""
    values = dict(bindings)
    for part in operator.body:
        if isinstance(part, Literal):
            pattern = substitute_atom(part.atom, values)
            matched = (match_term(pattern, fact, {}) for fact in task.problem.statics)
            values |= next((binding for binding in matched if binding is not None), {})
    return values
