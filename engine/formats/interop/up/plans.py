"""Translation of plans between unified-planning and the model."""

import networkx as nx
from unified_planning import model as up
from unified_planning.plans import ActionInstance, PartialOrderPlan, SequentialPlan
from unified_planning.plans import Plan as UpPlan

from cellwright.engine.formats.interop.up.problem import Translated
from cellwright.kb.loader.amounts import amounts_of
from cellwright.kb.model.plan import Plan, StepId
from cellwright.kb.model.traits import step_of
from cellwright.kb.terms import Function, Number, Term


def instance_of(problem: Translated, operator: Function) -> ActionInstance:
    """An operator instance as an action instance, without the cost argument, which only our operators have."""
    action = problem.theirs.action(problem.names.original("operator", operator.name))
    names = (problem.names.original("object", str(argument)) for argument in operator.arguments)
    chosen = zip(action.parameters, names, strict=False)
    expressions = problem.theirs.environment.expression_manager
    return ActionInstance(
        action, tuple(expressions.ObjectExp(problem.theirs.object(name)) for _, name in chosen)
    )


def sequential(problem: Translated, plan: Plan) -> SequentialPlan:
    """The steps in the order in which they are listed."""
    instances = [instance_of(problem, step.operator) for step in plan.steps]
    return SequentialPlan(instances, problem.theirs.environment)


def partially_ordered(problem: Translated, plan: Plan) -> PartialOrderPlan:
    """The steps with only the orders that they need."""
    instances = {step.id: instance_of(problem, step.operator) for step in plan.steps}
    following: dict[ActionInstance, list[ActionInstance]] = {each: [] for each in instances.values()}
    for step in plan.steps:
        for before in step.after:
            following[instances[before]].append(instances[step.id])
    return PartialOrderPlan(following, problem.theirs.environment)


def read(problem: Translated, plan: UpPlan) -> tuple[Plan, list[ActionInstance]]:
    """A sequential or partial-order plan as a plan of the model, and the action instance of each step, in order."""
    if isinstance(plan, SequentialPlan):
        instances = list(plan.actions)
        before = [[place - 1] if place else [] for place, _ in enumerate(instances)]
    else:
        graph: nx.DiGraph[ActionInstance] = nx.DiGraph(plan.get_adjacency_list)
        instances = list(nx.lexicographical_topological_sort(graph, key=str))
        places = {each: place for place, each in enumerate(instances)}
        before = [sorted(places[other] for other in graph.predecessors(each)) for each in instances]
    amounts = amounts_of(problem.ours)
    steps = (
        step_of(
            amounts,
            StepId(place + 1),
            operator_of(problem, each),
            tuple(StepId(other + 1) for other in before[place]),
        )
        for place, each in enumerate(instances)
    )
    return Plan(tuple(steps)), instances


def operator_of(problem: Translated, instance: ActionInstance) -> Function:
    """An action instance as an operator instance."""
    objects = [_object(each) for each in instance.actual_parameters]
    terms: list[Term] = [Function(problem.names.of("object", each)) for each in objects]
    table = problem.costs.tables.get(instance.action.name) if problem.costs else None
    if problem.costs and table and table.columns:
        terms.append(
            Number(int(problem.costs.of(instance.action.name, tuple(objects)) * problem.costs.scale))
        )
    return Function(problem.names.of("operator", instance.action.name), tuple(terms))


def _object(at: up.FNode) -> str:
    return str(at.object().name)
