"""The costs of actions as whole numbers, in whatever form the metric gives them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from math import lcm

from unified_planning import model as up
from unified_planning.model.walkers import Simplifier

from cellwright.engine.formats.interop.up.conditions import Unsupported

Row = tuple[str, ...]  # names of objects


@dataclass(frozen=True, slots=True)
class CostTable:
    """The cost of an action for each choice of objects for its parameters at the positions `columns`."""

    columns: tuple[int, ...]
    costs: Mapping[Row, Fraction]


@dataclass(frozen=True, slots=True)
class Costs:
    """The tables of all actions, and the factor that makes every cost a whole number."""

    tables: Mapping[str, CostTable]
    scale: int

    def of(self, action: str, objects: Row) -> Fraction:
        """The cost of an action with these objects."""
        table = self.tables[action]
        return table.costs[tuple(objects[column] for column in table.columns)]


def costs(problem: up.Problem) -> Costs | None:
    """The costs that a problem minimises; None if every action costs the same. Raises `Unsupported`."""
    if len(problem.quality_metrics) > 1:
        raise Unsupported("more than one quality metric")
    metric = next(iter(problem.quality_metrics), None)
    if metric is None or not metric.is_minimize_action_costs():
        return None
    simplifier = Simplifier(problem.environment, problem)
    tables = {action.name: _table(problem, action, metric, simplifier) for action in problem.actions}
    everything = [cost for table in tables.values() for cost in table.costs.values()]
    if any(cost < 0 for cost in everything):
        raise Unsupported("negative costs")
    return Costs(tables, lcm(*(cost.denominator for cost in everything)))


def _table(
    problem: up.Problem, action: up.Action, metric: up.metrics.MinimizeActionCosts, simplifier: Simplifier
) -> CostTable:
    cost = metric.get_action_cost(action)
    if cost is None:
        return CostTable((), {(): Fraction(0)})
    used = set(_parameters(cost))
    columns = tuple(place for place, each in enumerate(action.parameters) if each in used)
    chosen = [action.parameters[place] for place in columns]
    rows: dict[Row, Fraction] = {}
    for objects in product(*(list(problem.objects(each.type)) for each in chosen)):
        value = simplifier.simplify(cost.substitute(dict(zip(chosen, objects, strict=True))))
        if not (value.is_int_constant() or value.is_real_constant()):
            raise Unsupported(f"the cost {cost}, which is not a static number")
        rows[tuple(each.name for each in objects)] = Fraction(value.constant_value())
    return CostTable(columns, rows)


def _parameters(at: up.FNode) -> Iterator[up.Parameter]:
    if at.is_parameter_exp():
        yield at.parameter()
    for argument in at.args:
        yield from _parameters(argument)
