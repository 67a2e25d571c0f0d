"""Who goes first where arms meet: against all orders that there are, one by one."""

import itertools
import random

from cellwright.engine.model.motion_values import Meetings, PassingOrder
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.stages.scheduling.arm_crossing import Crossing, schedule_crossing
from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits
from cellwright.kb.model.plan_model import StepId

Stay = tuple[StepId | None, StepId | None, StepId]


def test_arms_that_never_meet_work_at_once() -> None:
    found = schedule_crossing(crossing([3, 3], [2, 4], (), ()), ScheduleLimits(1.0))
    assert isinstance(found, PassingOrder)
    assert found.makespan == 6
    assert found.proved
    assert not found.orders


def test_of_two_steps_that_meet_one_waits() -> None:
    found = schedule_crossing(crossing([3], [2], [(1, 2)], ()), ScheduleLimits(1.0))
    assert isinstance(found, PassingOrder)
    assert found.makespan == 5
    assert len(found.orders) == 1


def test_an_arm_that_rests_in_the_way_for_good_goes_last() -> None:
    found = schedule_crossing(crossing([3], [2], [(1, 2)], [("a", 1, 2)]), ScheduleLimits(1.0))
    assert isinstance(found, PassingOrder)
    assert found.orders == {(2, 1)}


def test_two_arms_that_rest_in_each_others_way_cannot_pass() -> None:
    rests = [("a", 1, 2), ("b", 2, 1)]
    assert isinstance(
        schedule_crossing(crossing([3], [2], [(1, 2)], rests), ScheduleLimits(1.0)), Infeasible
    )


def test_the_makespan_is_that_of_the_best_of_all_orders() -> None:
    drawn = random.Random(7)
    for _ in range(60):
        first = [drawn.randint(1, 5) for _ in range(drawn.randint(1, 3))]
        second = [drawn.randint(1, 5) for _ in range(drawn.randint(1, 3))]
        a, b = range(1, len(first) + 1), range(len(first) + 1, len(first) + len(second) + 1)
        meets = {pair for pair in itertools.product(a, b) if drawn.random() < 0.4}
        rests = {("a", i, j) for i, j in meets if (i + 1, j) in meets and drawn.random() < 0.5}
        rests |= {("b", j, i) for i, j in meets if (i, j + 1) in meets and drawn.random() < 0.5}
        asked = crossing(first, second, meets, rests)
        found, least = schedule_crossing(asked, ScheduleLimits(1.0)), brute(asked)
        assert (found.makespan if isinstance(found, PassingOrder) else None) == least
        if isinstance(found, PassingOrder):
            assert found.lower_bound == least
            assert not any(clash(asked, stay, found.starts) for stay in stays(asked))


def crossing(first: list[int], second: list[int], meets: object, rests: object) -> Crossing:
    """Arms `a` and `b`, whose steps are numbered one after the other."""
    durations = {StepId(n): lasts for n, lasts in enumerate([*first, *second], 1)}
    own = tuple(durations)
    tracks = {"a": own[: len(first)], "b": own[len(first) :]}
    meetings = Meetings(tracks, frozenset(meets), frozenset(rests))  # type: ignore[call-overload]
    return Crossing(durations, frozenset(), meetings)


def stays(asked: Crossing) -> list[Stay]:
    """Steps or rests of an arm, and the step of the other that it is in the way of."""
    found: list[Stay] = [(one, one, other) for one, other in asked.meetings.steps]
    for arm, after, other in asked.meetings.rests:
        track = asked.meetings.tracks[arm]
        at = -1 if after is None else track.index(after)
        found.append((after, track[at + 1] if at + 1 < len(track) else None, other))
    return found


def clash(asked: Crossing, stay: Stay, starts: object) -> bool:
    """Whether an arm is in the way of a step while this goes on."""
    first, last, other = stay
    times: dict[StepId, int] = dict(starts)  # type: ignore[call-overload]
    begins, ends = times[other], times[other] + asked.durations[other]
    until = times[last] + asked.durations[last] if last is not None else 10**6
    return begins < until and ends > (times[first] if first is not None else -1)


def brute(asked: Crossing) -> int | None:
    """The least makespan over all ways to order each step with each stay."""
    best: int | None = None
    each = stays(asked)
    tracks = asked.meetings.tracks.values()
    turns = {pair for track in tracks for pair in itertools.pairwise(track)}
    for after in itertools.product((False, True), repeat=len(each)):
        orders = set(turns)
        possible = True
        for (first, last, other), late in zip(each, after, strict=True):
            end = (last, other) if late else (other, first)
            possible &= None not in end
            orders.add(end)  # type: ignore[arg-type]
        last_end = longest(asked, orders) if possible else None
        if last_end is not None and (best is None or last_end < best):
            best = last_end
    return best


def longest(asked: Crossing, orders: set[tuple[StepId, StepId]]) -> int | None:
    """The makespan of some orders; None if they go in a circle."""
    starts = dict.fromkeys(asked.durations, 0)
    for _ in range(len(starts) + 1):
        before = dict(starts)
        for one, other in orders:
            starts[other] = max(starts[other], starts[one] + asked.durations[one])
        if starts == before:
            return max(starts[n] + lasts for n, lasts in asked.durations.items())
    return None
