"""Schedules and tours: when things happen, and in which order visits are made."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cellwright.answers import Answer
from cellwright.plans import Planned, plan_of
from cellwright.requests import Name, Target, limited, load

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.formats.report.timetables import Timed
    from cellwright.engine.model.outcome import GaveUp, Infeasible
    from cellwright.engine.model.schedule import Schedule, Timetable
    from cellwright.engine.model.shop import Shop
    from cellwright.engine.model.tour import Tour
    from cellwright.engine.pipelines.inspection.visits import Visits
    from cellwright.engine.stages.planning import Limits
    from cellwright.engine.stages.scheduling.limits import ScheduleLimits
    from cellwright.kb.model.plan import StepId
    from cellwright.kb.model.problem import Problem


@dataclass(frozen=True, repr=False)
class Scheduled(Answer):
    """When each step of a plan, or each stage of a shop, happens; or why there is no schedule."""

    found: "Timed | Infeasible | GaveUp"

    @property
    def timed(self) -> "Timed | None":
        """The schedule with all that belongs to it; None if there is none."""
        from cellwright.engine.formats.report.timetables import Timed

        return self.found if isinstance(self.found, Timed) else None

    @property
    def schedule(self) -> "Schedule | None":
        """The schedule: starts, makespan, bound; None if there is none."""
        return self.timed.schedule if self.timed else None

    @property
    def starts(self) -> "Mapping[StepId, int]":
        """When each step of the plan starts, in the unit of time of the domain; empty for a shop, and without a schedule."""
        table = self.timed.timetable if self.timed else None
        return table.starts if table else {}

    @property
    def status(self) -> str:
        """optimal, found, infeasible, gave up or stopped."""
        from cellwright.engine.formats.report import json

        return self.timed.status if self.timed else json.status(self._none)

    @property
    def _none(self) -> "Infeasible | GaveUp":
        from cellwright.engine.formats.report.timetables import Timed

        if isinstance(self.found, Timed):
            raise TypeError("there is a schedule")
        return self.found

    def data(self) -> Mapping[str, Any]:
        """The schedule, or the reason why there is none."""
        from cellwright.engine.formats.report.timetables import content

        return content(self.timed) if self.timed else {"reason": self._none.reason}

    def svg(self) -> str | None:
        """The schedule as a Gantt chart."""
        from cellwright.engine.formats.report.timetables import chart

        return chart(self.timed) if self.timed else None

    def _renderable(self) -> "RenderableType":
        from cellwright.engine.formats.report.timetables import text

        return text(self.timed) if self.timed else f"No schedule: {self._none.reason}."


def schedule(
    target: "Planned | Target",
    *,
    goals: str = "",
    command: str = "",
    instance: str = "",
    work: float = 60.0,
    workers: int = 1,
    seconds: float | None = None,
    expansions: int = 1_000_000,
    seed: int = 0,
) -> Scheduled:
    """Schedule a plan, the best plan for a problem, a plan file, a folder of S-LAB tables or a job-shop file.

    `instance` chooses one of a file of several job shops. `work` is about seconds of one core; the same work of one worker
    gives the same answer. Raises `InvalidInput`, `TimeoutError`.
    """
    from cellwright.engine.formats.interop.shops import shop_of
    from cellwright.engine.stages.planning import Limits
    from cellwright.engine.stages.scheduling.limits import ScheduleLimits

    with limited(seconds) as over:
        limits = ScheduleLimits(work, seed, workers, over)
        shop = shop_of(Path(target), instance) if isinstance(target, str | PathLike) else None
        if shop is not None:
            return _of_shop(shop, limits)
        problem, made = _timetable(
            target, (goals, command), Limits(expansions, interrupted=over, seed=seed), limits
        )
    return _of_plan(problem, made)


def _of_shop(shop: "Shop", limits: "ScheduleLimits") -> Scheduled:
    from cellwright.engine.formats.report.timetables import Timed
    from cellwright.engine.model.schedule import Scheduled as Made
    from cellwright.engine.stages import scheduling

    found = scheduling.schedule(shop, limits)
    return Scheduled(Timed(shop, found.schedule, found.statistics) if isinstance(found, Made) else found)


def _timetable(
    target: "Planned | Target", wanted: tuple[str, str], planning: "Limits", limits: "ScheduleLimits"
) -> "tuple[Problem, Timetable | Infeasible | GaveUp]":
    from cellwright.engine.pipelines import objective, timetable

    if isinstance(target, Planned):
        problem, plan, _, _ = plan_of(target)
        return problem, timetable.timetable(problem, plan, planning, limits)
    if isinstance(target, str | PathLike):
        problem, found = timetable.subject_of(fspath(target), *wanted)
        if found is not None:
            return problem, timetable.timetable(problem, found, planning, limits)
        return problem, objective.fastest(problem, planning, limits)
    return target, objective.fastest(load(target, *wanted), planning, limits)


def _of_plan(problem: "Problem", made: "Timetable | Infeasible | GaveUp") -> Scheduled:
    from cellwright.engine.formats.report.timetables import of_plan
    from cellwright.engine.model.schedule import Timetable

    return Scheduled(of_plan(made, problem) if isinstance(made, Timetable) else made)


@dataclass(frozen=True, repr=False)
class Toured(Answer):
    """An order of visits with a bound on the cost of any order; or why there is none."""

    visits: "Visits"
    found: "Tour | Infeasible | GaveUp"

    @property
    def tour(self) -> "Tour | None":
        """The tour: order, cost, bound; None if there is none."""
        from cellwright.engine.model.tour import Tour

        return self.found if isinstance(self.found, Tour) else None

    @property
    def names(self) -> tuple[str, ...]:
        """The visits in their order; empty if there is no tour."""
        order = self.tour.order if self.tour else ()
        return tuple(self.visits.tours.visits[each].name for each in order)

    @property
    def status(self) -> str:
        """optimal, found, infeasible, gave up or stopped."""
        from cellwright.engine.formats.report import json
        from cellwright.engine.model.tour import Tour

        found = self.found
        return ("optimal" if found.proved else "found") if isinstance(found, Tour) else json.status(found)

    def data(self) -> Mapping[str, Any]:
        """The tour, or the reason why there is none."""
        from cellwright.engine.formats.report.toured import content
        from cellwright.engine.model.tour import Tour

        found = self.found
        return content(found, self.visits) if isinstance(found, Tour) else {"reason": found.reason}

    def svg(self) -> str | None:
        """The tour on the points; None if they have no positions."""
        from cellwright.engine.formats.report import tour_svg

        return tour_svg.picture(self.tour, self.visits.tours) if self.tour else None

    def _renderable(self) -> "RenderableType":
        from cellwright.engine.formats.report.toured import text
        from cellwright.engine.model.tour import Tour

        found = self.found
        return text(found, self.visits) if isinstance(found, Tour) else f"No tour: {found.reason}."


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
    """Order the measurements of a problem, or the visits of a TSPLIB file, at the least cost that is found.

    `windows` say when visits may begin ("m3=10..90"), `lasts` how long they take ("m3=4"), `before` which order some keep
    ("m1, m2"). `work` 0 fits the number of visits. Raises `InvalidInput`, `TimeoutError`.
    """
    from cellwright.engine.formats.interop.visits import visits_of
    from cellwright.engine.stages import sequencing
    from cellwright.kb.diagnostics import InvalidInput, Source, unknown_name

    if method not in sequencing.METHODS:
        raise InvalidInput([unknown_name("method", method, set(sequencing.METHODS), Source("method"))])
    with limited(seconds) as over:
        found = visits_of(fspath(target), windows, lasts, before).ending(closed, start, end)
        return Toured(found, sequencing.sequence(found.tours, sequencing.Limits(work, seed, over), method))
