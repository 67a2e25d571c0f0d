"""Courses on a board against plain replays, and the search against the solver, on random flows."""

import itertools
from array import array
from collections.abc import Sequence
from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.taken import Row, Taken
from cellwright.engine.model.flow import FOREVER, Act, Course, Flow, Item, Leave, Route, Take, Use
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.engine.stages.scheduling.flow.board import Board, spans
from cellwright.engine.stages.scheduling.flow.cycles import best_pattern
from cellwright.engine.stages.scheduling.flow.mirror import mirror_flow, turn_back
from cellwright.engine.stages.scheduling.flow.parts import cut_in_parts
from cellwright.engine.stages.scheduling.flow.search import best_flow
from cellwright.engine.stages.scheduling.flow.solving import solved

intervals = st.lists(st.tuples(st.integers(0, 30), st.integers(1, 12)), max_size=10)


@given(
    taken=intervals, capacity=st.integers(1, 3), begin=st.integers(0, 40), lasts=st.integers(1, 10)
)
def test_what_clashes_is_told_as_a_plain_count_tells_it(
    taken: list[tuple[int, int]], capacity: int, begin: int, lasts: int
) -> None:
    kept = Taken([capacity])
    for start, size in taken:
        kept.add(0, start, start + size, 1)
    full = [sum(s <= t < s + size for s, size in taken) >= capacity for t in range(80)]
    hits = [t for t in range(begin, begin + lasts) if full[t]]
    expected = -1 if not hits else next(t for t in range(hits[-1], 80) if not full[t])
    assert kept.clash(0, begin, begin + lasts) == expected


@given(taken=intervals, gone=intervals)
def test_what_is_given_back_leaves_no_trace(
    taken: list[tuple[int, int]], gone: list[tuple[int, int]]
) -> None:
    kept, plain = Taken([9]), Taken([9])
    for start, size in taken:
        kept.add(0, start, start + size, 1)
        plain.add(0, start, start + size, 1)
    for change in (1, -1):
        for start, size in gone:
            kept.add(0, start, start + size, change)
    assert list(kept.sizes) == list(plain.sizes) if hasattr(kept, "sizes") else True


@given(taken=intervals, first=st.integers(1, 6), second=st.integers(1, 6), most=st.integers(0, 8))
def test_starts_are_the_least_that_fit(
    taken: list[tuple[int, int]], first: int, second: int, most: int
) -> None:
    kept = Taken([1])
    for start, size in taken:
        kept.add(0, start, start + size, 1)
    row = Row([first, second], [(0, 0, 0, first)], [(-1, 0, 0, first, 1, 0, second, most)], True)
    starts = array("q", [0, 0])
    assert kept.raised(row, starts)
    free = [not any(s <= t < s + size for s, size in taken) for t in range(200)]
    earliest = next(t for t in range(100) if all(free[t : t + first]))
    assert list(starts) == [earliest, earliest + first]


def flow(lengths: list[tuple[int, int, int]], shelves: int) -> Flow:
    """Items that an arm brings to one of two machines and back, by way of a shelf."""

    def carried(before: int, after: int, takes: str, leaves: str, number: int) -> Act:
        taken = (Take(takes, 1, 2),) if takes else ()
        left = (Leave(leaves, 0, 1),) if leaves else ()
        return Act("carry", 2, before, after, number, (Use("arm", 0, 2),), taken, left)

    routes = []
    for one, other, after in lengths:
        routes.append(
            Route(
                (
                    (carried(0, 1, "one", "", 0), carried(0, 2, "other", "", 1)),
                    (Act("work", one, 1, 3, 0), Act("work", other, 2, 4, 1)),
                    (carried(3, 5, "shelf", "one", 0), carried(4, 5, "shelf", "other", 1)),
                    (Act("cool", after, 5, 6, 0),),
                    (carried(6, 7, "", "shelf", 0),),
                ),
                stays={"shelf": after + 1},
            )
        )
    items = tuple(Item(f"item {n}", n) for n in range(len(lengths)))
    return Flow(tuple(routes), items, {"arm": 1, "one": 1, "other": 1, "shelf": shelves})


def is_sound(of: Flow, courses: tuple[Course, ...]) -> bool:
    """Whether courses keep all capacities and stays, by counting at every time."""
    taken = [each for n, course in enumerate(courses) for each in spans(course, of.route(n).held)]
    ends = max(course.end for course in courses)
    for name, capacity in of.capacity.items():
        for t in range(ends):
            if (
                sum(place == name and begin <= t < min(end, FOREVER) for place, begin, end in taken)
                > capacity
            ):
                return False
    for n, course in enumerate(courses):
        for one, other, start, later in zip(
            course.acts, course.acts[1:], course.starts, course.starts[1:], strict=False
        ):
            if one.after != other.before or start + one.duration > later:
                return False
        if course.starts[4] - course.starts[2] - 2 > of.route(n).stays["shelf"]:
            return False
    return True


sizes = st.lists(
    st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 5)), min_size=1, max_size=4
)


@given(lengths=sizes, shelves=st.integers(1, 2))
def test_courses_on_a_board_keep_everything(
    lengths: list[tuple[int, int, int]], shelves: int
) -> None:
    made = flow(lengths, shelves)
    board = Board(made)
    for number in range(len(lengths)):
        course = board.earliest(number)
        assert course is not None
        board.settle(number, course)
    assert is_sound(made, tuple(board.courses[n] for n in range(len(lengths))))


@settings(max_examples=15, deadline=None)
@given(lengths=sizes, shelves=st.integers(1, 2))
def test_the_search_is_as_good_as_the_solver(
    lengths: list[tuple[int, int, int]], shelves: int
) -> None:
    made = flow(lengths, shelves)
    limits = ScheduleLimits(work=0.2)
    found = best_flow(made, 0, limits)
    assert found is not None
    assert is_sound(made, found.courses)
    if found.proved:
        best = solved(made, found.courses, found.makespan, 0, ScheduleLimits(work=1.0))
        assert best is not None
        assert best.makespan == found.makespan


@given(lengths=sizes, shelves=st.integers(1, 2))
def test_a_schedule_seen_from_its_end_is_one_of_the_flow(
    lengths: list[tuple[int, int, int]], shelves: int
) -> None:
    forward = flow(lengths, shelves)
    backward = mirror_flow(forward)
    assert backward is not None
    board = Board(backward)
    for number in range(len(lengths)):
        course = board.earliest(number)
        assert course is not None
        board.settle(number, course)
    courses = [board.courses[n] for n in range(len(lengths))]
    turned = turn_back(forward, courses)
    assert is_sound(forward, turned)
    assert max(c.end for c in turned) == max(c.end for c in courses)


def waiting_flow(count: int, first: int, second: int, third: int) -> Flow:
    """Items that one machine serves before and after an oven, and that may wait at home in
    between.
    """

    def carried(before: int, after: int, takes: str, leaves: str, number: int) -> Act:
        taken = (Take(takes, 1, 2),) if takes else ()
        left = (Leave(leaves, 0, 1),) if leaves else ()
        return Act("carry", 2, before, after, number, (Use("arm", 0, 2),), taken, left)

    route = Route(
        (
            (carried(0, 1, "machine", "home", 0),),
            (Act("mark", first, 1, 2),),
            (carried(2, 3, "oven", "machine", 0),),
            (Act("bake", second, 3, 4),),
            (carried(4, 5, "machine", "oven", 0), carried(4, 6, "home", "oven", 1)),
            (Act("go on", 0, 5, 5), carried(6, 5, "machine", "home", 1)),
            (Act("look", third, 5, 7),),
            (carried(7, 8, "home", "machine", 0),),
        ),
        ("home",),
        {"oven": second},
    )
    items = tuple(Item(f"item {n}", 0) for n in range(count))
    return Flow((route,), items, {"arm": 1, "machine": 1, "oven": 2})


waiting = st.builds(
    waiting_flow, st.integers(1, 5), st.integers(1, 9), st.integers(1, 30), st.integers(1, 9)
)


def keeps_capacities(of: Flow, courses: Sequence[Course]) -> bool:
    taken = [each for n, course in enumerate(courses) for each in spans(course, of.route(n).held)]
    ends = max(course.end for course in courses)
    return all(
        sum(place == name and begin <= t < end for place, begin, end in taken) <= capacity
        for name, capacity in of.capacity.items()
        for t in range(ends)
    )


@given(of=waiting)
def test_items_in_parts_are_put_together_again(of: Flow) -> None:
    (cut,) = cut_in_parts(of)
    for word in itertools.islice(cut.words(), 10):
        courses = cut.place_parts(word)
        assert courses is not None
        assert keeps_capacities(of, courses)
        for course in courses:
            pairs = itertools.pairwise(zip(course.acts, course.starts, strict=True))
            assert all(
                one.after == other.before and start + one.duration <= later
                for (one, start), (other, later) in pairs
            )


@given(of=waiting)
def test_who_waits_nowhere_goes_on_at_once(of: Flow) -> None:
    (wait,) = of.routes[0].waits
    straight = Board(of).earliest(0, 0, frozenset())
    free = Board(of).earliest(0, 0, frozenset({wait}))
    assert straight is not None
    assert free is not None
    assert straight.acts[wait].after == 5
    assert free.end == straight.end  # alone, nobody needs to wait


@settings(max_examples=8, deadline=None)
@given(of=waiting)
def test_waiting_is_as_good_as_the_solver_finds_it(of: Flow) -> None:
    found = best_flow(of, 0, ScheduleLimits(work=0.3))
    assert found is not None
    assert keeps_capacities(of, found.courses)
    best = solved(of, found.courses, found.makespan, 0, ScheduleLimits(work=1.0))
    assert best is not None
    if found.proved and best.proved:
        assert best.makespan == found.makespan


@settings(max_examples=5, deadline=None)
@given(of=waiting, shared=st.integers(1, 3))
def test_a_pattern_can_be_repeated_for_ever(of: Flow, shared: int) -> None:
    many = replace(
        of,
        items=tuple(Item(f"item {n}", 0) for n in range(9)),
        capacity={**of.capacity, "oven": shared},
    )
    pattern = best_pattern(many, 8, ScheduleLimits(work=0.5))
    assert pattern is not None
    courses = pattern.courses(9)
    assert keeps_capacities(many, tuple(courses))
    assert max(course.end for course in courses) == pattern.makespan(9)
    again = [(c.starts[0], tuple(s - c.starts[0] for s in c.starts)) for c in courses]
    assert {later[0] - first[0] for first, later in itertools.pairwise(again)} == {pattern.period}
    assert len({offsets for _, offsets in again}) == 1
    if pattern.period > 1:  # no shorter one serves the machine or the arm
        busy = sum(act.duration for act in pattern.course.acts if act.uses)
        assert pattern.period >= busy
