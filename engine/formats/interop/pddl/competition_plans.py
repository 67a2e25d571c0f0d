"""Plans in the format of the planning competitions: one action per line, in order."""

from collections.abc import Iterator
from pathlib import Path

from cellwright.engine.formats.interop.pddl import PddlProblem
from cellwright.engine.formats.interop.pddl.expressions import plan_actions
from cellwright.engine.formats.interop.pddl.task_files import PLAN, require_file
from cellwright.engine.model.task_costs import cost_text
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, nearest_hint
from cellwright.kb.files import File, read_file
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.conditions import Comparison, Literal
from cellwright.kb.model.domain_model import NUMERIC_TYPES, Operator
from cellwright.kb.model.operator_amounts import step_of
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.terms import (
    Function,
    Number,
    Term,
    Variable,
    match_term,
    substitute_atom,
    substitute_term,
)


def write_plan(task: PddlProblem, plan: Plan) -> str:
    """The steps in their executable order, with the names of the PDDL files and the cost."""
    operators = {operator.name: operator for operator in task.problem.domain.operators}
    lines = [
        f"({' '.join(_action_words(task, operators[step.operator.name], step.operator))})"
        for step in plan.steps
    ]
    return "\n".join([*lines, f"; cost = {cost_text(plan.cost, task.problem.domain)}"]) + "\n"


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
    require_file(file, PLAN)
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
    operators: dict[str, list[Operator]] = {}
    for each in task.problem.domain.operators:
        operators.setdefault(task.names.original("operator", each.name), []).append(each)
    if words[0] not in operators:
        hint = nearest_hint(words[0], list(operators))
        diagnostics.append(
            Diagnostic(file.at(offset), "K101", f"unknown action '{words[0]}'", hint)
        )
        return Function("unreadable")
    first, *variants = operators[words[0]]
    plain = [parameter for parameter in first.parameters if parameter.type not in NUMERIC_TYPES]
    if len(plain) != len(words) - 1:
        diagnostics.append(
            Diagnostic(file.at(offset), "K102", f"{words[0]} takes {len(plain)} arguments")
        )
        return Function("unreadable")
    bindings: dict[Variable, Term] = {
        parameter.variable: Function(task.names.of("object", word))
        for parameter, word in zip(plain, words[1:], strict=True)
    }
    operator = next((each for each in (first, *variants) if _fits(each, bindings)), first)
    bindings = _function_values(task, operator, bindings)
    return Function(operator.name, tuple(bindings.get(v, Number(0)) for v in operator.variables))


def _fits(operator: Operator, bindings: dict[Variable, Term]) -> bool:
    """Whether the arguments are equal, or differ, as an operator wants it."""
    return all(
        (substitute_term(part.left, bindings) == substitute_term(part.right, bindings))
        == (part.relation == "=")
        for part in operator.body
        if isinstance(part, Comparison)
    )


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
