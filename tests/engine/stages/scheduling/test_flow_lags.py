"""Windows between the acts of a course, and calendars, against all starts of all acts."""

import itertools
from collections.abc import Iterator

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.flow import (
    Act,
    Course,
    Flow,
    Item,
    Route,
    RouteLag,
    RouteMoment,
    Use,
    price_of,
)
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.engine.stages.scheduling.flow.board import Board
from cellwright.engine.stages.scheduling.flow.search import best_flow
from cellwright.kb.model.time_windows import TimeOfWork
from cellwright.kb.terms import Function
from tests.shares import share

UNTIL = 10
machines = st.sampled_from(["one", "other"])


@st.composite
def lags(draw: st.DrawFn, counts: tuple[int, ...], priced: bool) -> RouteLag:
    """A window between two acts of a route with so many acts in its layers."""
    one = draw(st.none() | st.integers(0, len(counts) - 2))
    later = draw(st.integers(0 if one is None else one + 1, len(counts) - 1))
    ends = [
        RouteMoment()
        if layer is None
        else RouteMoment(layer, tuple(draw(st.integers(0, 2)) for _ in range(counts[layer])))
        for layer in (one, later)
    ]
    least = draw(st.integers(0, 3))
    most = draw(st.none() | st.integers(least, 5))
    return RouteLag(*ends, least, most, draw(st.integers(0, 2)) if priced else None)


@st.composite
def flows(draw: st.DrawFn, priced: bool = False) -> Flow:
    """One or two items with two layers of acts, of which each uses a machine at its start."""
    layers = []
    for before in range(2):
        acts = draw(st.lists(st.tuples(machines, st.integers(1, 3)), min_size=1, max_size=2))
        layers.append(
            tuple(
                Act(
                    "act",
                    lasts,
                    before,
                    before + 1,
                    n,
                    (Use(name, 0, lasts), *((Use("open", 0, lasts),) if name == "one" else ())),
                )
                for n, (name, lasts) in enumerate(acts)
            )
        )
    counts = tuple(map(len, layers))
    own = tuple(draw(st.lists(lags(counts, priced), max_size=2)))
    items = tuple(Item(f"item {n}", 0) for n in range(draw(st.integers(1, 2))))
    span = draw(st.tuples(st.integers(0, 2), st.integers(5, 20)))
    calendar = TimeOfWork(Function("one"), False, (span,), draw(st.none() | st.just(20)))
    return Flow(
        (Route(tuple(layers), lags=own),), items, {"one": 1, "other": 1}, {"open": calendar}
    )


def courses_of(flow: Flow) -> Iterator[tuple[Course, ...]]:
    """All courses of all items that keep everything but prices."""
    single = [
        Course(acts, starts)
        for acts in itertools.product(*flow.routes[0].layers)
        for starts in itertools.product(range(UNTIL), repeat=2)
        if starts[0] + acts[0].duration <= starts[1] and starts[1] + acts[1].duration <= UNTIL
    ]
    kept = [course for course in single if keeps(flow, course)]
    for courses in itertools.product(kept, repeat=len(flow.items)):
        spans = [
            (u.resource, start + u.begin, start + u.end)
            for course in courses
            for act, start in zip(course.acts, course.starts, strict=True)
            for u in act.uses
            if u.resource != "open"
        ]
        if not any(
            one[0] == other[0] and one[1] < other[2] and other[1] < one[2]
            for one, other in itertools.combinations(spans, 2)
        ):
            yield courses


def keeps(flow: Flow, course: Course) -> bool:
    if any(lag.breach(course) for lag in flow.routes[0].lags if lag.price is None):
        return False
    return all(
        flow.calendars["open"].soonest(start, act.duration) == start
        for act, start in zip(course.acts, course.starts, strict=True)
        if act.uses[0].resource == "one"
    )


def value(flow: Flow, courses: tuple[Course, ...]) -> tuple[int, int]:
    return price_of(flow, courses), max(course.end for course in courses)


@settings(max_examples=share(100), deadline=None)
@given(flow=flows())
def test_courses_keep_windows_and_calendars(flow: Flow) -> None:
    board = Board(flow)
    for number in range(len(flow.items)):
        course = board.earliest(number)
        if course is None:
            return
        assert keeps(flow, course)
        board.settle(number, course)


@settings(max_examples=share(100), deadline=None)
@given(flow=flows())
def test_the_least_makespan_within_windows_is_proved(flow: Flow) -> None:
    found = best_flow(flow, 0, ScheduleLimits(work=1.0))
    best = min((value(flow, courses) for courses in courses_of(flow)), default=None)
    if found is not None and found.proved and best is not None:
        assert value(flow, found.courses) == best
    elif best is not None:
        assert found is not None


@settings(max_examples=share(100), deadline=None)
@given(flow=flows(priced=True))
def test_the_least_price_comes_first(flow: Flow) -> None:
    found = best_flow(flow, 0, ScheduleLimits(work=1.0))
    best = min((value(flow, courses) for courses in courses_of(flow)), default=None)
    if found is not None and found.proved and best is not None:
        assert value(flow, found.courses) <= best  # later than the slow search looks may be cheaper
