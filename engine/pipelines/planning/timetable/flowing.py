"""Schedules all objects of a workflow at once (a flow), and chooses their steps, arms, machines and
places together with the times.

No plan is made first. Each kind of object has its shortest ways through the cell, and the scheduler
chooses among machines, arms and places while it puts the objects on the board. What comes of it is
a plan that passes the gate.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

from cellwright.engine.model.flow import (
    Course,
    Flowed,
    RouteLag,
    holds_of_course,
    lateness_of,
)
from cellwright.engine.model.outcome import Infeasible, Statistics
from cellwright.engine.model.shop_scheduling import (
    Hold,
    Resource,
    Schedule,
    Shop,
    ShopJob,
    ShopStage,
    StageMoment,
    StageWindow,
    Timetable,
    chain_windows,
)
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.timetable.flow_steps import (
    plan_of_steps,
    steps_of,
    unit_names,
)
from cellwright.engine.pipelines.planning.timetable.flows import (
    CellFlow,
    RunsOut,
    cell_flow,
    meets_others,
)
from cellwright.engine.pipelines.planning.timetable.step_order import SCOPE_ALL_PLANS
from cellwright.engine.pipelines.planning.window_keeping import judge_times
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.engine.stages.scheduling.checker import check_schedule
from cellwright.engine.stages.scheduling.flow.bounds import Demand, least_of_all
from cellwright.engine.stages.scheduling.flow.graph import NoRoute
from cellwright.engine.stages.scheduling.flow.search import best_flow
from cellwright.engine.stages.scheduling.shop_translation import Mislaid
from cellwright.kb.model.planning_problem import Problem

WAYS = "of all schedules of these objects on their shortest ways, with any machine, arm and place"
LEVEL = "level of "


def by_flow(problem: Problem, limits: ScheduleLimits) -> Timetable | Infeasible | str:
    """The best timetable found of all objects on their shortest ways, that there is no plan at
    all, or why this is no way.
    """
    started = time.perf_counter()
    gate = PlanGate()
    known = gate.semantics(problem)
    try:
        cell = cell_flow(problem, known)
        bound = _floor(cell)
        prepared = time.perf_counter()
        found = best_flow(cell.flow, bound, limits)
        if found is None:
            return "no object fits behind another"
        searched = time.perf_counter()
        made = _as_plan(gate, cell, found, bound)
    except RunsOut as error:
        return Infeasible(str(error))
    except (NoRoute, Mislaid) as error:
        return str(error)
    seconds = {
        "routes": prepared - started,
        "search": searched - prepared,
        "plan and check": time.perf_counter() - searched,
    }
    counts = {"objects": len(cell.flow.items), "kinds": len(cell.kinds)}
    return replace(made, statistics=Statistics(counts, seconds))


def _floor(cell: CellFlow) -> int:
    """No plan ends before this; 0 if objects may need one another, or what else is done."""
    demands = [Demand(kind.maker.graph, cell.names) for kind in cell.kinds]
    if meets_others(cell.problem) or not all(each.is_alone for each in demands):
        return 0
    return least_of_all(cell.flow, demands)[0]


def _as_plan(gate: PlanGate, cell: CellFlow, found: Flowed, floor: int) -> Timetable:
    """The courses as a plan that both checkers accept. Raises `Mislaid`."""
    steps = steps_of(cell, found.courses)
    plan = plan_of_steps(cell, steps, cell.levels)
    starts = {step.id: each.start for step, each in zip(plan.steps, steps, strict=True)}
    ends = {step.id: each.end for step, each in zip(plan.steps, steps, strict=True)}
    if any(ends[before] > starts[step.id] for step in plan.steps for before in step.after):
        raise Mislaid("a step starts before one that it waits for has ended")
    shop, schedule = _shop(cell, found)
    if wrong := check_schedule(shop, schedule):
        raise Mislaid(wrong[0])
    if findings := gate.findings(cell.problem, plan):
        raise Mislaid(findings[0].message)
    judged = judge_times(cell.problem, Timetable(plan, starts, shop, schedule, WAYS, floor=floor))
    if not judged.keeps_hours:
        raise Mislaid("a window between objects is not kept")
    least = floor >= found.makespan and not schedule.tardiness and judged.keeps_all
    return replace(judged, scope=SCOPE_ALL_PLANS if least else WAYS)


def _stage_name(cell: CellFlow, item: int, place: int, course: Course) -> str:
    return f"{cell.flow.items[item].name} {place + 1} {course.acts[place].name}"


def _lag_windows(
    names: Sequence[str], course: Course, lags: Sequence[RouteLag]
) -> Iterator[StageWindow]:
    """The windows between acts, those that the course keeps."""
    for lag in lags:
        if lag.earlier.layer is None or lag.later.layer is None or lag.breach(course):
            continue
        one, other = (
            StageMoment(names[layer], moment.offsets[course.acts[layer].number])
            for moment, layer in ((lag.earlier, lag.earlier.layer), (lag.later, lag.later.layer))
        )
        yield StageWindow(one, other, lag.least, lag.most)


def _shop(cell: CellFlow, found: Flowed) -> tuple[Shop, Schedule]:
    """The shop in which every act is done as it was chosen, and its schedule."""
    jobs, holds, windows = list[ShopJob](), list[Hold](), list[StageWindow]()
    starts, units = dict[str, int](), dict[Hold, str]()
    named = unit_names(cell, found.courses)
    for item, course in enumerate(found.courses):
        own = cell.flow.items[item]
        names = [_stage_name(cell, item, n, course) for n in range(len(course.acts))]
        stages = []
        for name, act, start in zip(names, course.acts, course.starts, strict=True):
            shared = [
                u
                for u in act.uses
                if u.resource in cell.flow.capacity and not u.resource.startswith(LEVEL)
            ]
            whole = tuple(u.resource for u in shared if (u.begin, u.end) == (0, act.duration))
            holds += [
                Hold(u.resource, StageMoment(name, u.begin), StageMoment(name, u.end))
                for u in shared
                if (u.begin, u.end) != (0, act.duration)
            ]
            stages.append(ShopStage(name, act.duration, whole))
            starts[name] = start
        jobs.append(ShopJob(own.name, tuple(stages), own.release, own.due, own.priority))
        windows += chain_windows(tuple(stages))
        route = cell.flow.route(item)
        for held in holds_of_course(course.acts, route.held):
            begin = None if held.first is None else StageMoment(names[held.first], held.begin)
            end = None if held.last is None else StageMoment(names[held.last], held.end)
            if held.place in cell.flow.capacity:
                hold = Hold(held.place, begin, end)
                holds.append(hold)
                if (item, held) in named:
                    units[hold] = named[item, held]
            if held.place in route.stays and held.first is not None and held.last is not None:
                came, left = (
                    StageMoment(names[held.first], held.came),
                    StageMoment(names[held.last], held.left),
                )
                windows.append(StageWindow(came, left, 0, route.stays[held.place]))
        windows += _lag_windows(names, course, route.lags)
    used = {name for job in jobs for stage in job.stages for name in stage.resources}
    used |= {hold.resource for hold in holds}
    resources = tuple(
        Resource(name, capacity, units=tuple(map(str, cell.pools.get(name, ()))))
        for name, capacity in cell.flow.capacity.items()
        if name in used
    )
    shop = Shop(tuple(jobs), resources, tuple(windows), tuple(holds))
    late = lateness_of(cell.flow, found.courses)
    return shop, Schedule(starts, (), found.makespan, found.lower_bound, late, found.proved, units)
