"""Random small shops with windows, calendars and prices, against all starts of their steps."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import example, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning.plan_files import check_plan
from cellwright.engine.pipelines.planning.plan_objective import Run, plan_for_objective
from cellwright.engine.pipelines.planning.window_proofs import (
    ShortestLag,
    find_windows_too_short,
)
from cellwright.engine.stages.grounding import ground
from cellwright.kb.loader import load_problem
from cellwright.kb.model.plan_model import Claims
from tests.shares import share

DOMAIN = """domain: shop
units: {time: s}
types: {job: object, machine: object}
objects: {machine: [m1, m2]}
statics: {"first(job, machine, time)": {}, "second(job, machine, time)": {}}
fluents: {"begun(job)": {}, "done(job)": {}}
operators:
  begin(Job, Machine, Time):
    where: first(Job, Machine, Time)
    adds: begun(Job)
    resources: Machine, Job
    duration: Time
  finish(Job, Machine, Time):
    where: second(Job, Machine, Time)
    preconditions: begun(Job)
    adds: done(Job)
    resources: Machine, Job
    duration: Time
"""
WITH_EVENTS = (
    DOMAIN.replace(
        "operators:", 'events: {"first_done(job)": {}, "second_done(job)": {}}\noperators:'
    )
    .replace("adds: begun(Job)", "adds: begun(Job), first_done(Job)")
    .replace("adds: done(Job)", "adds: done(Job), second_done(Job)")
)
UNTIL = 9  # by which all is done in the slow search
STEPS = ("step begin(a)", "step finish(a)", "step begin(b)", "step finish(b)")
EVENTS = ("first_done(a)", "second_done(a)", "first_done(b)", "second_done(b)")


@dataclass(frozen=True)
class Asked:
    """A window between two steps, by their numbers and ends (1: the end)."""

    earlier: tuple[int, int]
    later: tuple[int, int]
    least: int | None
    most: int | None
    price: int | None

    def line(self, named: tuple[str, ...]) -> str:
        ends = [
            f"{('start', 'end')[end]} of {named[step]}" for step, end in (self.earlier, self.later)
        ]
        said = " ".join(
            f"at {word} {limit}"
            for word, limit in (("least", self.least), ("most", self.most))
            if limit is not None
        )
        return f"{said} from {ends[0]} to {ends[1]}" + (
            "" if self.price is None else f", price {self.price}"
        )

    def broken(self, times: list[tuple[int, int]]) -> int:
        lasts = times[self.later[0]][self.later[1]] - times[self.earlier[0]][self.earlier[1]]
        most = lasts if self.most is None else self.most
        return max(0, (self.least or 0) - lasts, lasts - most)


@st.composite
def windows(draw: st.DrawFn, priced: bool) -> Asked:
    one, other = draw(st.permutations(range(4)))[:2]
    least = draw(st.none() | st.integers(0, 4))
    most = draw(st.integers(least or 0, 5) if least is None else st.none() | st.integers(least, 5))
    price = draw(st.integers(1, 3)) if priced and draw(st.booleans()) else None
    return Asked(
        (one, draw(st.integers(0, 1))), (other, draw(st.integers(0, 1))), least, most, price
    )


@dataclass(frozen=True)
class SmallShop:
    """Two jobs of two steps: machine and duration of each; windows; when machine 1 is open."""

    steps: tuple[tuple[str, int], ...]
    asked: tuple[Asked, ...]
    open: tuple[int, int] | None

    def text(self, ordered: bool = False) -> str:
        facts = [
            f"  - {('first', 'second')[n % 2]}({'ab'[n // 2]}, {machine}, {lasts})"
            for n, (machine, lasts) in enumerate(self.steps)
        ]
        said = ["problem: p", "domain: shop", "objects: {job: [a, b]}", "statics:", *facts]
        if ordered:
            said += [
                "workflow:",
                "  - for: {J: [a, b]}",
                "    stages: first_done(J), second_done(J)",
            ]
        else:
            said += ["goals: [done(a), done(b)]"]
        said += ["windows:"] if self.asked else []
        said += [f'  - "{each.line(EVENTS if ordered else STEPS)}"' for each in self.asked]
        if self.open is not None:
            said += ["calendars:", f"  - {{of: m1, open: {self.open[0]} to {self.open[1]}}}"]
        return "\n".join(said) + "\n"

    def schedules(self) -> Iterator[list[tuple[int, int]]]:
        ranges = [range(UNTIL - lasts + 1) for _, lasts in self.steps]
        for starts in itertools.product(*ranges):
            times = [(t, t + lasts) for t, (_, lasts) in zip(starts, self.steps, strict=True)]
            if times[1][0] >= times[0][1] and times[3][0] >= times[2][1] and self.fits(times):
                yield times

    def fits(self, times: list[tuple[int, int]]) -> bool:
        for one, other in itertools.combinations(range(4), 2):
            same = self.steps[one][0] == self.steps[other][0]
            if same and times[one][0] < times[other][1] and times[other][0] < times[one][1]:
                return False
        if any(each.broken(times) for each in self.asked if each.price is None):
            return False
        on_first = (times[n] for n in range(4) if self.steps[n][0] == "m1")
        return self.open is None or all(
            self.open[0] <= start and end <= self.open[1] for start, end in on_first
        )

    def best(self) -> tuple[int, int] | None:
        values = (
            (sum((w.price or 0) * w.broken(times) for w in self.asked), max(e for _, e in times))
            for times in self.schedules()
        )
        return min(values, default=None)


@st.composite
def shops(draw: st.DrawFn, priced: bool = False) -> SmallShop:
    steps = tuple((draw(st.sampled_from(["m1", "m2"])), draw(st.integers(1, 2))) for _ in range(4))
    asked = tuple(draw(st.lists(windows(priced), min_size=1, max_size=2, unique=True)))
    opens = draw(st.none() | st.tuples(st.integers(0, 3), st.integers(5, 8)))
    return SmallShop(steps, asked, opens)


def answer(shop: SmallShop, ordered: bool = False) -> Run:
    with TemporaryDirectory() as folder:
        (Path(folder) / "domain.yaml").write_text(WITH_EVENTS if ordered else DOMAIN)
        (Path(folder) / "p.yaml").write_text(shop.text(ordered))
        problem = load_problem(Path(folder) / "p.yaml")
        run = plan_for_objective(problem)
        if isinstance(run.outcome, Found):
            assert run.timetable is not None
            claims = Claims(dict(run.timetable.starts))
            assert not check_plan(problem, run.outcome.plan, "plan", claims)
        return run


def too_short(shop: SmallShop) -> list[ShortestLag]:
    """The windows of which `check` says that no plan keeps them."""
    with TemporaryDirectory() as folder:
        (Path(folder) / "domain.yaml").write_text(WITH_EVENTS)
        (Path(folder) / "p.yaml").write_text(shop.text(ordered=True))
        problem = load_problem(Path(folder) / "p.yaml")
        return list(find_windows_too_short(problem, ground(problem)))


def value(run: Run) -> tuple[int, int] | None:
    if run.timetable is None:
        return None
    return sum(b.cost for b in run.timetable.breaches), run.timetable.schedule.makespan


@settings(max_examples=share(60), deadline=None)
@given(shop=shops())
def test_windows_are_kept_in_the_least_time(shop: SmallShop) -> None:
    run, best = answer(shop), shop.best()
    if best is not None:
        assert value(run) == best
    elif run.timetable is not None:
        assert run.timetable.schedule.makespan > UNTIL


@settings(max_examples=share(60), deadline=None)
@given(shop=shops())
@example(
    SmallShop(
        (("m1", 1), ("m1", 1), ("m2", 1), ("m2", 1)),
        (Asked((0, 1), (1, 0), None, 0, None),),
        (1, 5),
    )
)  # blocks that are shared out among machines, too, are looked at
def test_windows_of_a_workflow_are_kept_and_what_none_keeps_is_proved(shop: SmallShop) -> None:
    run, best = answer(shop, ordered=True), shop.best()
    if best is not None:
        assert value(run) == best
        assert too_short(shop) == []
    elif isinstance(run.outcome, Infeasible):
        assert "the shortest possible is" in run.outcome.reason


@settings(max_examples=share(60), deadline=None)
@given(shop=shops(priced=True))
def test_prices_are_paid_where_that_is_least(shop: SmallShop) -> None:
    run, best = answer(shop), shop.best()
    if best is not None and run.timetable is not None:
        assert value(run) == best
    else:
        assert best is None
