"""Solves the constraint model of a shop and reads the schedule from it (CP-SAT)."""

import threading
from collections.abc import Mapping

from ortools.sat.python import cp_model

from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.shop_scheduling import Adjustment, Schedule, Shop
from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits
from cellwright.engine.stages.scheduling.shop_analysis import Lags
from cellwright.engine.stages.scheduling.shop_model import Period, Periods, ShopModel, add_devices

SOLVER_POLL_S = 0.02  # seconds between two checks whether to stop


def improve_schedule(
    lags: Lags, bound: int, horizon: int, first: Schedule | None, limits: ScheduleLimits
) -> Schedule | Infeasible | None:
    """The best schedule that the solver finds, `first` if it finds none, or the proof that there is
    none.

    The result is None if there is no schedule so far and no proof.
    """
    model = ShopModel(lags.shop, lags, horizon)
    model.add_windows()
    model.add_works()
    periods = add_devices(model)
    model.add_resources()
    model.add_objective(bound)
    if first is not None:
        _hint_schedule(model, periods, first)
    solver = cp_model.CpSolver()
    try:
        status = run_solver(solver, model.cp, limits)
    except MemoryError:  # the schedule that there is needs no more
        if first is None:
            raise
        return first
    if status == cp_model.INFEASIBLE:
        return Infeasible("no schedule keeps to all windows")
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return first
    return _read_schedule(solver, model, periods, bound, status == cp_model.OPTIMAL)


def run_solver(
    solver: cp_model.CpSolver,
    model: cp_model.CpModel,
    limits: ScheduleLimits,
    in_turns: bool = True,
) -> cp_model.CpSolverStatus:
    """Solve in a thread, so that Ctrl-C and the time limit are heard meanwhile. One worker tries
    several strategies `in_turns`, or keeps to one.

    Raises `MemoryError`.
    """
    parameters = solver.parameters
    parameters.random_seed = limits.seed
    parameters.max_deterministic_time = limits.work
    parameters.num_workers = limits.workers
    # several strategies in turns, counted in work
    parameters.interleave_search = in_turns and limits.workers == 1
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
        thread.join(SOLVER_POLL_S)
        if limits.interrupted():
            solver.stop_search()
    if short:
        raise MemoryError
    return status


def _read_schedule(
    solver: cp_model.CpSolver,
    model: ShopModel,
    periods: tuple[Periods, ...],
    bound: int,
    proved: bool,
) -> Schedule:
    starts = {name: solver.value(start) for name, start in model.starts.items()}
    adjustments = tuple(
        Adjustment(device_periods.device.name, change, solver.value(period.changed))
        for device_periods in periods
        for period in device_periods.periods
        if period.changed is not None
        for change, taken in period.changes
        if solver.boolean_value(taken)
    )
    late = solver.value(model.tardiness)
    if not late:
        bound = max(bound, round(solver.best_objective_bound))
    makespan = schedule_end(model.shop, starts, adjustments)
    bound = makespan if proved and not late else min(bound, makespan)
    return Schedule(starts, adjustments, makespan, bound, late, proved)


def schedule_end(shop: Shop, starts: Mapping[str, int], adjustments: tuple[Adjustment, ...]) -> int:
    """The end of the last stage or change."""
    ends = [starts[name] + stage.duration for name, stage in shop.stages.items()]
    return max([0, *ends, *(adjustment.end for adjustment in adjustments)])


def _hint_schedule(model: ShopModel, periods: tuple[Periods, ...], first: Schedule) -> None:
    """Offer a known schedule as a first solution."""
    for name, variable in model.starts.items():
        model.cp.add_hint(variable, first.starts[name])
    model.cp.add_hint(model.makespan, first.makespan)
    for device_periods in periods:
        _hint_device(model, device_periods, first)


def _hint_device(model: ShopModel, device_periods: Periods, first: Schedule) -> None:
    changes = sorted(
        (a for a in first.adjustments if a.device == device_periods.device.name),
        key=lambda a: a.start,
    )
    for number, period in enumerate(device_periods.periods):
        begin = (
            0
            if not number
            else changes[number - 1].end
            if number <= len(changes)
            else model.horizon
        )
        end = changes[number].start if number < len(changes) else model.horizon
        if number:
            _hint_change(model, period, changes[number - 1] if number <= len(changes) else None)
            model.cp.add_hint(period.begin, begin)
        model.cp.add_hint(period.end, end)
        for stage, need, places in device_periods.needs:
            start = first.starts[stage]
            if number in places:
                inside = (
                    begin <= start + need.begin
                    and start + need.end <= end
                    and number <= len(changes)
                )
                model.cp.add_hint(places[number], inside)


def _hint_change(model: ShopModel, period: Period, made: Adjustment | None) -> None:
    literals = {period.present.index: (period.present, made is not None)}
    for setting, literal in period.settings.items():
        literals[literal.index] = literal, made is not None and made.change.after == setting
    for change, taken in period.changes:
        literals[taken.index] = taken, made is not None and made.change == change
    for literal, value in literals.values():
        model.cp.add_hint(literal, value)
    if period.changed is not None:
        model.cp.add_hint(period.changed, made.start if made else model.horizon)
