"""Schedules and tours: when steps happen, and in which order visits are made."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cellwright.engine.formats import interop, report
from cellwright.engine.pipelines import planning as planning_room
from cellwright.kb.diagnostics import InvalidInput, Source, unknown_name
from cellwright.library_base import Answer, Name, Target, limit_seconds, load
from cellwright.plan_functions import Planned, plan_of

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.formats.report.plans.schedule_report import ScheduleAnswer
    from cellwright.engine.model.outcome import GaveUp, Infeasible
    from cellwright.engine.model.shop_scheduling import Schedule, Shop, Timetable
    from cellwright.engine.model.tour_problem import Tour
    from cellwright.engine.pipelines.inspection.tool_tours import TourVisits
    from cellwright.engine.stages.planning import SearchLimits
    from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits
    from cellwright.kb.model.plan_model import StepId
    from cellwright.kb.model.planning_problem import Problem


@dataclass(frozen=True, repr=False)
class Scheduled(Answer):
    """When each step of a plan, or each stage of a shop, happens; or why there is no schedule."""

    found: "ScheduleAnswer | Infeasible | GaveUp"

    @property
    def timed(self) -> "ScheduleAnswer | None":
        """The schedule with all that belongs to it; None if there is none."""
        return self.found if isinstance(self.found, report.ScheduleAnswer) else None

    @property
    def schedule(self) -> "Schedule | None":
        """The schedule: starts, makespan, bound; None if there is none."""
        return self.timed.schedule if self.timed else None

    @property
    def starts(self) -> "Mapping[StepId, int]":
        """When each step of the plan starts, in the unit of time of the domain; empty for a
        shop, and without a schedule.
        """
        table = self.timed.timetable if self.timed else None
        return table.starts if table else {}

    @property
    def status(self) -> str:
        """optimal, found, infeasible, gave up or stopped."""
        return self.timed.status if self.timed else report.outcome_status(self._none)

    @property
    def _none(self) -> "Infeasible | GaveUp":
        if isinstance(self.found, report.ScheduleAnswer):
            raise TypeError("there is a schedule")
        return self.found

    def data(self) -> Mapping[str, Any]:
        """The schedule, or the reason why there is none."""
        return report.schedule_content(self.timed) if self.timed else {"reason": self._none.reason}

    def svg(self) -> str | None:
        """The schedule as a Gantt chart."""
        return report.schedule_svg(self.timed) if self.timed else None

    def _renderable(self) -> "RenderableType":
        return (
            report.schedule_text(self.timed) if self.timed else f"No schedule: {self._none.reason}."
        )


def schedule(
    target: "Planned | Target",
    *,
    goals: str = "",
    command: str = "",
    instance: str = "",
    work: float = 60.0,
    workers: int = 1,
    seconds: float | None = None,
    expansions: int | None = None,
    seed: int = 0,
) -> Scheduled:
    """Schedule a plan, the best plan for a problem, a plan file, a folder of S-LAB tables or a
    job-shop file.

    `instance` chooses one of a file of several job shops. `work` is about seconds of one core; the
    same work of one worker gives the same answer. Raises `InvalidInput`, `TimeoutError`.
    """
    from cellwright.engine.stages.planning import SearchLimits, expansions_within
    from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits

    with limit_seconds(seconds) as over:
        limits = ScheduleLimits(work, seed, workers, over)
        planning = SearchLimits(expansions_within(expansions, seconds), interrupted=over, seed=seed)
        shop = (
            interop.shop_of(Path(target), instance) if isinstance(target, str | PathLike) else None
        )
        if shop is not None:
            return _of_shop(shop, limits)
        problem, timetable_made = _timetable_of(target, (goals, command), planning, limits)
    return _of_plan(problem, timetable_made)


def _of_shop(shop: "Shop", limits: "ScheduleLimits") -> Scheduled:
    from cellwright.engine.model.shop_scheduling import ValidSchedule as Made
    from cellwright.engine.stages import scheduling

    shop_schedule = scheduling.schedule_shop(shop, limits)
    return Scheduled(
        report.ScheduleAnswer(shop, shop_schedule.schedule, shop_schedule.statistics)
        if isinstance(shop_schedule, Made)
        else shop_schedule
    )


def _timetable_of(
    target: "Planned | Target",
    wanted: tuple[str, str],
    planning: "SearchLimits",
    limits: "ScheduleLimits",
) -> "tuple[Problem, Timetable | Infeasible | GaveUp]":
    if isinstance(target, Planned):
        problem, plan, _, _ = plan_of(target)
        return problem, planning_room.make_timetable(problem, plan, planning, limits)
    if isinstance(target, str | PathLike):
        problem, subject = planning_room.subject_of(fspath(target), *wanted)
        if subject is not None:
            return problem, planning_room.make_timetable(problem, subject, planning, limits)
        return problem, planning_room.plan_fastest(problem, planning, limits)
    return target, planning_room.plan_fastest(load(target, *wanted), planning, limits)


def _of_plan(problem: "Problem", made: "Timetable | Infeasible | GaveUp") -> Scheduled:
    from cellwright.engine.model.shop_scheduling import Timetable

    return Scheduled(report.of_plan(made, problem) if isinstance(made, Timetable) else made)


@dataclass(frozen=True, repr=False)
class Toured(Answer):
    """An order of visits with a bound on the cost of any order; or why there is none."""

    visits: "TourVisits"
    found: "Tour | Infeasible | GaveUp"

    @property
    def tour(self) -> "Tour | None":
        """The tour: order, cost, bound; None if there is none."""
        from cellwright.engine.model.tour_problem import Tour

        return self.found if isinstance(self.found, Tour) else None

    @property
    def names(self) -> tuple[str, ...]:
        """The visits in their order; empty if there is no tour."""
        order = self.tour.order if self.tour else ()
        return tuple(self.visits.tours.visits[visit].name for visit in order)

    @property
    def status(self) -> str:
        """optimal, found, infeasible, gave up or stopped."""
        from cellwright.engine.model.tour_problem import Tour

        tour = self.found
        return (
            ("optimal" if tour.proved else "found")
            if isinstance(tour, Tour)
            else report.outcome_status(tour)
        )

    def data(self) -> Mapping[str, Any]:
        """The tour, or the reason why there is none."""
        from cellwright.engine.model.tour_problem import Tour

        tour = self.found
        return (
            report.visits_tour_content(tour, self.visits)
            if isinstance(tour, Tour)
            else {"reason": tour.reason}
        )

    def svg(self) -> str | None:
        """The tour on the points; None if they have no positions."""
        return report.draw_tour(self.tour, self.visits.tours) if self.tour else None

    def _renderable(self) -> "RenderableType":
        from cellwright.engine.model.tour_problem import Tour

        tour = self.found
        return (
            report.visits_tour_text(tour, self.visits)
            if isinstance(tour, Tour)
            else f"No tour: {tour.reason}."
        )


def sequence(
    target: Name,
    *,
    method: Literal["auto", "chain1987", "exact"] = "auto",
    closed: bool | None = None,
    start: str = "",
    end: str = "",
    windows: Sequence[str] = (),
    lasts: Sequence[str] = (),
    before: Sequence[str] = (),
    seconds: float | None = None,
    work: int = 0,
    seed: int = 0,
) -> Toured:
    """Order the measurements of a problem, or the visits of a TSPLIB file, at the least cost that
    is found.

    `windows` say when visits may begin ("m3=10..90"), `lasts` how long they take ("m3=4"), `before`
    which order some keep ("m1, m2"). `work` 0 fits the number of visits. Raises `InvalidInput`,
    `TimeoutError`.
    """
    from cellwright.engine.stages import sequencing

    if method not in sequencing.METHODS:
        raise InvalidInput(
            [unknown_name("method", method, set(sequencing.METHODS), Source("method"))]
        )
    with limit_seconds(seconds) as over:
        visit_problem = interop.visits_of_target(fspath(target), windows, lasts, before).ending(
            closed, start, end
        )
        return Toured(
            visit_problem,
            sequencing.sequence_tour(
                visit_problem.tours, sequencing.TourLimits(work, seed, over), method
            ),
        )
