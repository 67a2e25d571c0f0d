"""Runs the constraint model of a shop and reads the schedule that it finds (CP-SAT)."""

import threading
from collections.abc import Mapping

from ortools.sat.python import cp_model

from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.schedule import Adjustment, Schedule
from cellwright.engine.model.shop import Shop
from cellwright.engine.stages.scheduling.devices import Period, Periods, add_devices
from cellwright.engine.stages.scheduling.lags import Lags
from cellwright.engine.stages.scheduling.limits import ScheduleLimits
from cellwright.engine.stages.scheduling.model import Model

POLL = 0.02  # seconds between two checks whether to stop


def improve(
    lags: Lags, bound: int, horizon: int, first: Schedule | None, limits: ScheduleLimits
) -> Schedule | Infeasible | None:
    """The best schedule that the solver finds, `first` if it finds none, or the proof that there is none.

    The result is None if there is no schedule so far and no proof.
    """
    model = Model(lags.shop, lags, horizon)
    model.add_windows()
    model.add_works()
    periods = add_devices(model)
    model.add_resources()
    model.add_objective(bound)
    if first is not None:
        _hint(model, periods, first)
    solver = cp_model.CpSolver()
    try:
        status = run(solver, model.cp, limits)
    except MemoryError:  # the schedule that there is needs no more
        if first is None:
            raise
        return first
    if status == cp_model.INFEASIBLE:
        return Infeasible("no schedule keeps to all windows")
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return first
    return _schedule(solver, model, periods, bound, status == cp_model.OPTIMAL)


def run(
    solver: cp_model.CpSolver, model: cp_model.CpModel, limits: ScheduleLimits
) -> cp_model.CpSolverStatus:
    """Solve in a thread, so that Ctrl-C and the time limit are heard meanwhile. Raises `MemoryError`."""
    parameters = solver.parameters
    parameters.random_seed = limits.seed
    parameters.max_deterministic_time = limits.work
    parameters.num_workers = limits.workers
    parameters.interleave_search = limits.workers == 1  # several strategies in turns, counted in work
    parameters.catch_sigint_signal = False
    status, short = cp_model.UNKNOWN, False

    def solve() -> None:
        nonlocal status, short
        try:
            status = solver.solve(model)
        except MemoryError:
            short = True

    thread = threading.Thread(target=solve)
    thread.start()
    while thread.is_alive():
        thread.join(POLL)
        if limits.interrupted():
            solver.stop_search()
    if short:
        raise MemoryError
    return status


def _schedule(
    solver: cp_model.CpSolver, model: Model, periods: tuple[Periods, ...], bound: int, proved: bool
) -> Schedule:
    starts = {name: solver.value(start) for name, start in model.starts.items()}
    adjustments = tuple(
        Adjustment(each.device.name, change, solver.value(period.changed))
        for each in periods
        for period in each.periods
        if period.changed is not None
        for change, taken in period.changes
        if solver.boolean_value(taken)
    )
    late = solver.value(model.tardiness)
    if not late:
        bound = max(bound, round(solver.best_objective_bound))
    makespan = ending(model.shop, starts, adjustments)
    bound = makespan if proved and not late else min(bound, makespan)
    return Schedule(starts, adjustments, makespan, bound, late, proved)


def ending(shop: Shop, starts: Mapping[str, int], adjustments: tuple[Adjustment, ...]) -> int:
    """The end of the last stage or change."""
    ends = [starts[name] + stage.duration for name, stage in shop.stages.items()]
    return max([0, *ends, *(each.end for each in adjustments)])


def _hint(model: Model, periods: tuple[Periods, ...], first: Schedule) -> None:
    """Offer a known schedule as a first solution."""
    for name, variable in model.starts.items():
        model.cp.add_hint(variable, first.starts[name])
    model.cp.add_hint(model.makespan, first.makespan)
    for each in periods:
        _hint_device(model, each, first)


def _hint_device(model: Model, each: Periods, first: Schedule) -> None:
    changes = sorted((a for a in first.adjustments if a.device == each.device.name), key=lambda a: a.start)
    for number, period in enumerate(each.periods):
        begin = 0 if not number else changes[number - 1].end if number <= len(changes) else model.horizon
        end = changes[number].start if number < len(changes) else model.horizon
        if number:
            _hint_change(model, period, changes[number - 1] if number <= len(changes) else None)
            model.cp.add_hint(period.begin, begin)
        model.cp.add_hint(period.end, end)
        for stage, need, places in each.needs:
            start = first.starts[stage]
            if number in places:
                inside = begin <= start + need.begin and start + need.end <= end and number <= len(changes)
                model.cp.add_hint(places[number], inside)


def _hint_change(model: Model, period: Period, made: Adjustment | None) -> None:
    literals = {period.present.index: (period.present, made is not None)}
    for setting, literal in period.settings.items():
        literals[literal.index] = literal, made is not None and made.change.after == setting
    for change, taken in period.changes:
        literals[taken.index] = taken, made is not None and made.change == change
    for literal, value in literals.values():
        model.cp.add_hint(literal, value)
    if period.changed is not None:
        model.cp.add_hint(period.changed, made.start if made else model.horizon)
