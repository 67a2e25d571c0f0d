"""Plans and validation results between unified-planning and the model."""

from fractions import Fraction

import networkx as nx
from unified_planning import model as up
from unified_planning.engines import LogLevel, LogMessage, ValidationResultStatus
from unified_planning.engines.results import FailedValidationReason, ValidationResult
from unified_planning.plans import ActionInstance, PartialOrderPlan, SequentialPlan
from unified_planning.plans import Plan as UpPlan

from cellwright.engine.formats.interop.up.up_problem import Translated
from cellwright.engine.model.outcome import Counterexample, OrderCheck
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.operator_amounts import step_of
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.terms import Function, Number, Term


def instance_of(problem: Translated, operator: Function) -> ActionInstance:
    """An operator instance as an action instance, without the cost argument, which only our
    operators have.
    """
    action = problem.theirs.action(problem.names.original("operator", operator.name))
    names = (problem.names.original("object", str(argument)) for argument in operator.arguments)
    chosen = zip(action.parameters, names, strict=False)
    expressions = problem.theirs.environment.expression_manager
    return ActionInstance(
        action, tuple(expressions.ObjectExp(problem.theirs.object(name)) for _, name in chosen)
    )


def sequential_plan(problem: Translated, plan: Plan) -> SequentialPlan:
    """The steps in the order in which they are listed."""
    instances = [instance_of(problem, step.operator) for step in plan.steps]
    return SequentialPlan(instances, problem.theirs.environment)


def partially_ordered(problem: Translated, plan: Plan) -> PartialOrderPlan:
    """The steps with only the orders that they need."""
    instances = {step.id: instance_of(problem, step.operator) for step in plan.steps}
    following: dict[ActionInstance, list[ActionInstance]] = {
        instance: [] for instance in instances.values()
    }
    for step in plan.steps:
        for before in step.after:
            following[instances[before]].append(instances[step.id])
    return PartialOrderPlan(following, problem.theirs.environment)


def read_up_plan(problem: Translated, plan: UpPlan) -> tuple[Plan, list[ActionInstance]]:
    """A sequential or partial-order plan as a plan of the model, and the action instance of
    each step, in order.
    """
    if isinstance(plan, SequentialPlan):
        instances = list(plan.actions)
        before = [[place - 1] if place else [] for place, _ in enumerate(instances)]
    else:
        graph: nx.DiGraph[ActionInstance] = nx.DiGraph(plan.get_adjacency_list)
        instances = list(nx.lexicographical_topological_sort(graph, key=str))
        places = {instance: place for place, instance in enumerate(instances)}
        before = [
            sorted(places[earlier] for earlier in graph.predecessors(instance))
            for instance in instances
        ]
    amounts = amounts_of(problem.ours)
    steps = (
        step_of(
            amounts,
            StepId(place + 1),
            operator_of(problem, instance),
            tuple(StepId(earlier + 1) for earlier in before[place]),
        )
        for place, instance in enumerate(instances)
    )
    return Plan(tuple(steps)), instances


def operator_of(problem: Translated, instance: ActionInstance) -> Function:
    """An action instance as an operator instance."""
    objects = [_object_name(argument) for argument in instance.actual_parameters]
    terms: list[Term] = [Function(problem.names.of("object", name)) for name in objects]
    table = problem.costs.tables.get(instance.action.name) if problem.costs else None
    if problem.costs and table and table.columns:
        terms.append(
            Number(
                int(problem.costs.of(instance.action.name, tuple(objects)) * problem.costs.scale)
            )
        )
    return Function(problem.names.of("operator", instance.action.name), tuple(terms))


def _object_name(at: up.FNode) -> str:
    return str(at.object().name)


VALIDATION_STATUS = {
    True: ValidationResultStatus.VALID,
    False: ValidationResultStatus.INVALID,
    None: ValidationResultStatus.UNKNOWN,
}


def validation_result(
    problem: Translated, instances: list[ActionInstance], verdict: OrderCheck, name: str
) -> ValidationResult:
    """The result for a plan whose step n is `instances[n - 1]`, given a verdict on all its
    orders.
    """
    counterexample = verdict.counterexample
    if counterexample is None:
        said = (
            []
            if verdict.valid
            else [LogMessage(LogLevel.WARNING, "too many orders to try them all")]
        )
        values = _metric_values(problem, instances) if verdict.valid else None
        return ValidationResult(VALIDATION_STATUS[verdict.valid], name, said, values)
    order = [instances[step - 1] for step in counterexample.order]
    message = LogMessage(LogLevel.INFO, _counterexample_text(counterexample, order))
    if counterexample.at_the_goal:
        reason, culprit = FailedValidationReason.UNSATISFIED_GOALS, None
    else:
        reason, culprit = FailedValidationReason.INAPPLICABLE_ACTION, order[-1]
    return ValidationResult(VALIDATION_STATUS[False], name, [message], None, reason, culprit)


def _counterexample_text(counterexample: Counterexample, order: list[ActionInstance]) -> str:
    said = ", ".join(map(str, order))
    if counterexample.at_the_goal:
        return f"the goals do not hold after {said or 'no action'}"
    return f"{order[-1]} cannot be done last in this order: {said}"


def _metric_values(
    problem: Translated, instances: list[ActionInstance]
) -> dict[object, int | Fraction]:
    """The value of each metric for a plan.

    The values are sums, so they do not depend on the order.
    """
    values: dict[object, int | Fraction] = {}
    for metric in problem.theirs.quality_metrics:
        if metric.is_minimize_sequential_plan_length():
            values[metric] = len(instances)
        elif problem.costs is not None:
            values[metric] = sum(
                (
                    problem.costs.of(
                        instance.action.name,
                        tuple(str(p.object().name) for p in instance.actual_parameters),
                    )
                    for instance in instances
                ),
                Fraction(0),
            )
    return values
