"""Time limits in a plan: dwell times of objects, and windows and order of measurements."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cellwright.engine.model.part_measurements import measurements_of, names_in_goal
from cellwright.engine.model.window_breaches import WindowBreach, breach_lines
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Number, Term

MAX_LISTED_STAYS = 6  # things that are named


@dataclass(frozen=True, slots=True)
class Stay:
    """What one step brings may stay for so many units of time until another takes it: the `thing`
    in the `place`.

    What is there when the plan begins has the source 0, and `since_ms` on the run's clock.
    """

    source: StepId
    target: StepId
    most: int
    since_ms: int | None = None
    thing: str = ""
    place: str = ""


@dataclass(frozen=True, slots=True)
class Overstay:
    """A thing that stays in a place longer than the most that is allowed there, in the domain's
    unit of time.
    """

    thing: str
    place: str
    lasts: int
    most: int

    def entry(self) -> dict[str, Any]:
        """The same for JSON."""
        return {
            "thing": self.thing,
            "place": self.place,
            "lasts": self.lasts,
            "longest_stay": self.most,
        }


def overstay_lines(overstays: Sequence[Overstay], unit: str) -> Iterator[str]:
    """What stays too long, in words, and what to do about it; nothing if nothing does."""
    if not overstays:
        return
    named = [
        f"{o.thing} in {o.place} for {o.lasts} {unit}, at most {o.most}"
        for o in overstays[:MAX_LISTED_STAYS]
    ]
    more = len(overstays) - MAX_LISTED_STAYS
    listed = "; ".join(named) + (f"; and {more} more (--format json has all)" if more > 0 else "")
    yield f"Longer than longest_stay allows: {listed}."
    yield (
        "Allow more time there, ask for less of what is done there, or change what takes things "
        "away."
    )


MeasurementWindow = tuple[int, int]  # earliest and latest beginning, in the unit of the costs
MeasurementPair = tuple[str, str]  # the first measurement is asked for before the second
MAX_WINDOWS_LISTED = 12  # measurements, or pairs of them, that are named


@dataclass(frozen=True, slots=True)
class Unmet:
    """What is asked of the times of measurements and of stays, and a plan does not keep.

    `missed` are the measurements that begin outside their windows, each with when it begins after
    the start of the tour. `turned` are pairs whose second measurement begins before the first.
    `overstays` are things that stay too long in a place, `breaches` windows between events that are
    broken.
    """

    missed: Mapping[str, int] = field(default_factory=dict)
    turned: tuple[MeasurementPair, ...] = ()
    overstays: tuple[Overstay, ...] = ()
    breaches: tuple[WindowBreach, ...] = ()

    def entry(self) -> dict[str, Any]:
        """What is not kept, for JSON; empty if everything is."""
        missed = {"missed_windows": dict(self.missed)} if self.missed else {}
        stays = (
            {"overstays": [overstay.entry() for overstay in self.overstays]}
            if self.overstays
            else {}
        )
        return (
            missed
            | (
                {"broken_orders": [list(turned_pair) for turned_pair in self.turned]}
                if self.turned
                else {}
            )
            | stays
            | (
                {"broken_windows": [each.entry() for each in self.breaches]}
                if self.breaches
                else {}
            )
        )

    def lines(self, unit: str) -> Iterator[str]:
        """What is not kept, in words, for a domain with this unit of time."""
        if self.missed:
            yield missed_windows_text(self.missed, unit)
        if self.turned:
            names = [
                f"{first} is not before {second}"
                for first, second in self.turned[:MAX_WINDOWS_LISTED]
            ]
            yield (
                "Not in the order that is asked for: "
                f"{', '.join(names)}{_and_more(len(self.turned))}."
            )
        yield from overstay_lines(self.overstays, unit)
        yield from breach_lines(self.breaches, unit)


def windows_of(facts: Iterable[Sequence[Term]]) -> dict[str, MeasurementWindow]:
    """The windows that facts give measurements, by the arguments of these facts."""
    return {
        str(name): (first.value, last.value)
        for name, first, last in facts
        if isinstance(first, Number) and isinstance(last, Number)
    }


def measured_steps(problem: Problem, plan: Plan) -> dict[StepId, str]:
    """The measurement that each step makes for the goals, in the order of the plan."""
    known, measured = set(measurements_of(problem)), problem.domain.conventions.measured
    makes: dict[StepId, str] = {}
    for link in plan.links:
        if (
            link.consumer == GOAL_STEP
            and link.producer != INITIAL_STEP
            and link.condition.name == measured
        ):
            for name in names_in_goal(Literal(link.condition), known):
                makes[link.producer] = name
    return {step.id: makes[step.id] for step in plan.steps if step.id in makes}


def missed_windows(
    windows: Mapping[str, MeasurementWindow],
    visits: Mapping[StepId, str],
    starts: Mapping[StepId, int],
    begin: int | None = None,
) -> dict[str, int]:
    """The measurements that begin outside their windows, each with when it begins after the start
    of the tour.

    The tour starts at `begin`, if that is known.
    """
    begin = tour_begin(windows, visits, starts) if begin is None else begin
    after = {name: starts[step] - begin for step, name in visits.items() if name in windows}
    return {
        name: at for name, at in after.items() if not windows[name][0] <= at <= windows[name][1]
    }


def turned_pairs(
    pairs: Iterable[MeasurementPair], visits: Mapping[StepId, str], starts: Mapping[StepId, int]
) -> tuple[MeasurementPair, ...]:
    """The pairs of measurements whose second one begins before the first; those with one that
    no step makes are left out.
    """
    begins = {name: starts[step] for step, name in visits.items()}
    known = dict.fromkeys(pair for pair in pairs if begins.keys() >= {*pair})
    return tuple((first, second) for first, second in known if begins[second] < begins[first])


def tour_begin(
    windows: Mapping[str, MeasurementWindow],
    visits: Mapping[StepId, str],
    starts: Mapping[StepId, int],
) -> int:
    """When the tour begins, by the starts of steps: an arm that is too early for the first
    visit has waited for it.
    """
    if not visits:
        return 0
    first = min(visits, key=lambda step: starts[step])
    return max(0, starts[first] - windows.get(visits[first], (0, 0))[0])


def missed_windows_text(missed: Mapping[str, int], unit: str) -> str:
    """The measurements outside their windows, in words."""
    names = [f"{name} at {at} {unit}" for name, at in list(missed.items())[:MAX_WINDOWS_LISTED]]
    return (
        "Outside their windows, counted from the start of the tour: "
        f"{', '.join(names)}{_and_more(len(missed))}."
    )


def _and_more(count: int) -> str:
    return (
        f" and {count - MAX_WINDOWS_LISTED} more (--format json has all)"
        if count > MAX_WINDOWS_LISTED
        else ""
    )


def opening_delays(
    windows: Mapping[str, MeasurementWindow], visits: Mapping[StepId, str]
) -> dict[StepId, int]:
    """How long after the start of the tour each step may begin that makes a measurement; 0
    where nothing is said.
    """
    return {step: max(0, windows.get(name, (0, 0))[0]) for step, name in visits.items()}


def tour_begin_so_far(
    problem: Problem, windows: Mapping[str, MeasurementWindow], begins: Mapping[Atom, int]
) -> int | None:
    """When the tour has begun whose measurements are made as far as the initial state says; None if
    none is.

    `begins` says when they began.
    """
    known, measured = set(measurements_of(problem)), problem.domain.conventions.measured
    made = {atom for atom in problem.initial if atom.name == measured} & begins.keys()
    firsts = [
        (begins[atom], windows.get(name, (0, 0))[0])
        for atom in made
        for name in names_in_goal(Literal(atom), known)
    ]
    return max(0, min(firsts)[0] - min(firsts)[1]) if firsts else None
