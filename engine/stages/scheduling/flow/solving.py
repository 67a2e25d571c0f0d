"""Runs the constraint model of a flow (CP-SAT)."""

from collections.abc import Sequence

from ortools.sat.python import cp_model

from cellwright.engine.model.flow import Course, Flow, Flowed
from cellwright.engine.stages.scheduling.flow.model import FlowModel
from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits
from cellwright.engine.stages.scheduling.shop_solver import run_solver

SOLVED = (cp_model.OPTIMAL, cp_model.FEASIBLE)


def solved(
    flow: Flow, known: Sequence[Course], horizon: int, bound: int, limits: ScheduleLimits
) -> Flowed | None:
    """The best schedule of all items that is found, with its bound; None if none was found. There
    need be no schedule that is known.
    """
    model = FlowModel(flow, range(len(flow.items)), {}, horizon)
    model.order()
    model.minimise(bound)
    if known:
        model.hint(dict(enumerate(_in_order(flow, known))))
    solver = cp_model.CpSolver()
    status = run_solver(solver, model.cp, limits)
    if status not in SOLVED:
        return None
    courses = model.courses(solver)
    late = solver.value(model.wrong)
    least = 0 if late else round(solver.best_objective_bound)
    return Flowed(
        tuple(courses[n] for n in range(len(flow.items))),
        max(bound, least),
        status == cp_model.OPTIMAL,
    )


def _in_order(flow: Flow, courses: Sequence[Course]) -> list[Course]:
    """The courses, those of items that differ in names alone in the order of the items."""
    groups: dict[object, list[int]] = {}
    for number, item in enumerate(flow.items):
        groups.setdefault((item.route, item.release, item.due, item.priority), []).append(number)
    found = list(courses)
    for group in groups.values():
        ordered = sorted((courses[n] for n in group), key=lambda each: each.starts)
        for number, course in zip(group, ordered, strict=True):
            found[number] = course
    return found
