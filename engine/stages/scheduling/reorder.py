"""Runs the constraint model of an ordering: when each step of a plan starts, in the best order that is found (CP-SAT)."""

from collections.abc import Mapping
from dataclasses import dataclass

from ortools.sat.python import cp_model

from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.stages.scheduling.limits import ScheduleLimits
from cellwright.engine.stages.scheduling.orders import Ordering, OrderModel
from cellwright.engine.stages.scheduling.solver import run


@dataclass(frozen=True, slots=True)
class Reordered:
    """The start of each step that is done, by its place in what was asked; no order of these steps ends before `lower_bound`.

    `proved` says that there is no better order.
    """

    starts: Mapping[int, int]
    makespan: int
    lower_bound: int
    tardiness: int = 0
    proved: bool = False


def reordered(
    asked: Ordering, bound: int, known: Mapping[int, int], limits: ScheduleLimits
) -> Reordered | Infeasible | None:
    """The best order found, with `known` starts as a hint; None if none was found. Raises `TooLarge`."""
    model = OrderModel(asked)
    model.build(bound)
    model.hint(known)
    solver = cp_model.CpSolver()
    status = run(solver, model.cp, limits)
    if status == cp_model.INFEASIBLE:
        return Infeasible("no order of the steps keeps to all longest stays")
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return None
    starts = {
        n: solver.value(start)
        for n, start in enumerate(model.starts)
        if solver.boolean_value(model.present[n])
    }
    makespan = max((start + asked.steps[n].duration for n, start in starts.items()), default=0)
    late, proved = solver.value(model.tardiness), status == cp_model.OPTIMAL
    order = sorted(
        starts, key=lambda n: (starts[n], starts[n] + asked.steps[n].duration, _rank(solver, model, n))
    )
    least = makespan if proved and not late else bound
    return Reordered({n: starts[n] for n in order}, makespan, min(least, makespan), late, proved)


def _rank(solver: cp_model.CpSolver, model: OrderModel, step: int) -> int:
    return solver.value(model.ranks[step]) if step in model.ranks else 0
