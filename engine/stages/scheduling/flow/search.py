"""Searches the best schedule of a flow: a first one by rule, then objects taken out and put back in
another order.

Items go on the board one after another, each as early as it fits (serial schedule generation:
Kolisch 1996). With many alike items the least time between two of them is tried as well, so that
they follow one another like a pipeline. After that, a few items at a time are put back in another
order (ruin and recreate: Schrimpf et al. 2000), and a solver arranges all if that is not too much.
What is found at any time can be done: nobody waits for what never becomes free.
"""

import itertools
import math
import random
from bisect import bisect_left, insort
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.model.flow import Course, Flow, Flowed, lateness_of, price_of
from cellwright.engine.stages.scheduling.flow.board import Board
from cellwright.engine.stages.scheduling.flow.mirror import mirror_flow, turn_back
from cellwright.engine.stages.scheduling.flow.parts import cut_in_parts
from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits

ACTS = 900_000  # that are placed in one unit of work
WHOLE = 1_500  # acts, alternatives counted, that are given to the solver at once
SHARE, MOST_SHARE = (
    0.4,
    0.9,
)  # of the work, spent on putting items back: of few acts, and of more than `EXACT`
EXACT = 400  # acts, alternatives counted, about which the solver may prove something
# of the greatest load, tried as times between items
STRETCH = (1.0, 1.02, 1.05, 1.1, 1.2, 1.35, 1.6, 2.0)
PLENTY = 33  # items from which on the average end counts more
COOLED = 0.02  # of the first temperature, at the end
POLLED = 100  # rounds after which it is asked whether to stop
REPEATED = 4  # items of which a pattern is looked for
PARTED = 0.1  # of the work, spent on objects in parts
STRAIGHT = 0.2  # of the objects that are put back wait nowhere
ONCE = 0.95  # of the others may wait at one place, the rest at all
MOVED = (2, 8)  # items that are put back at once

Value = tuple[int, int, float]


def best_flow(flow: Flow, bound: int, limits: ScheduleLimits) -> Flowed | None:
    """The best schedule found; None if none was found. No schedule ends before `bound`."""
    search = _Search(flow, bound, limits)
    if not search.by_rule():
        # what must be done by a certain time may need another order
        search.solve(limits.work)
        return search.flowed if search.best else None
    if not search.is_best and not limits.interrupted():
        search.put_back(search.share * limits.work)
    if not search.is_best and not limits.interrupted():
        search.solve((1 - search.share) * limits.work)
    return search.flowed


@dataclass
class _Search:
    flow: Flow
    bound: int
    limits: ScheduleLimits
    best: tuple[Course, ...] = ()
    proved: bool = False
    least: int = 0  # bound of these routes
    draw: random.Random = field(default_factory=random.Random)

    def __post_init__(self) -> None:
        self._worth: Value = (1 << 60, 0, 0.0)
        self.draw = random.Random(self.limits.seed)
        self.least = self.bound

    @property
    def share(self) -> float:
        """The share of the work that is spent on putting items back."""
        acts = sum(self._sizes)
        return SHARE if acts <= EXACT else MOST_SHARE if acts <= WHOLE else 1.0

    @cached_property
    def _sizes(self) -> list[int]:
        return [sum(map(len, self.flow.route(n).layers)) for n in range(len(self.flow.items))]

    @property
    def is_best(self) -> bool:
        """Whether nothing better can be found."""
        return self.proved or self._worth[:2] <= (0, self.bound)

    @property
    def flowed(self) -> Flowed:
        """What was found."""
        value = self.value(self.best)
        return Flowed(self.best, min(self.least, value[1]), self.is_best)

    def value(self, courses: Sequence[Course]) -> Value:
        """Lateness and prices, then the makespan, then how late items end on average."""
        ends = [course.end for course in courses]
        wrong = lateness_of(self.flow, courses) + price_of(self.flow, courses)
        return wrong, max(ends, default=0), sum(ends) / max(1, len(ends))

    def keep(self, courses: Sequence[Course]) -> None:
        """Keep a schedule if it is the best so far."""
        if (worth := self.value(courses)) < self._worth:
            self.best, self._worth = tuple(courses), worth

    # by rule

    def by_rule(self) -> bool:
        """Items one after another, in several orders and with several times between them.

        Whether one led to a schedule. The flow is also looked at from its end.
        """
        back = mirror_flow(self.flow)
        for order in self._orders():
            for lag in self._lags():
                for flow in (self.flow, back):
                    courses = None if flow is None else _in_turn(flow, order, lag)
                    if courses is not None:
                        self.keep(turn_back(self.flow, courses) if flow is back else courses)
                    if self.best and (self.is_best or self.limits.interrupted()):
                        return True
        self._by_parts()
        self._by_pattern()
        return bool(self.best)

    def _by_pattern(self) -> None:
        """All items alike, each so long after the one before."""
        if len(self.flow.items) < REPEATED or self.is_best or self.limits.interrupted():
            return
        from cellwright.engine.stages.scheduling.flow.cycles import (
            best_pattern,  # the solver takes a while to load
        )

        pattern = best_pattern(self.flow, self._lags()[1], self.limits)
        if pattern is not None:
            self.keep(pattern.courses(len(self.flow.items)))

    def _by_parts(self) -> None:
        """Items in parts, in several orders."""
        left = int(self.limits.work * PARTED * ACTS / (1 + sum(self._sizes)))
        for cut in cut_in_parts(self.flow):
            for word in cut.words():
                left -= 1
                if left < 0 or self.is_best or self.limits.interrupted():
                    return
                if (courses := cut.place_parts(word)) is not None:
                    self.keep(courses)

    def _orders(self) -> Iterator[list[int]]:
        items = self.flow.items
        named = sorted(range(len(items)), key=lambda n: (items[n].release, n))
        orders = [named]
        if any(item.due is not None for item in items):
            far = max(item.due or 0 for item in items) + 1
            orders.append(
                sorted(named, key=lambda n: far if items[n].due is None else items[n].due or 0)
            )
        lasts = [_least_time(self.flow, n) for n in range(len(items))]
        if len(set(lasts)) > 1:
            orders.append(sorted(named, key=lambda n: -lasts[n]))
            orders.append(sorted(named, key=lambda n: lasts[n]))
        return iter(orders)

    def _lags(self) -> list[int]:
        load = max((_load(self.flow, name) for name in self.flow.capacity), default=0)
        lag = load / max(1, len(self.flow.items))
        return list(dict.fromkeys([0, *(math.ceil(lag * each) for each in STRETCH)]))

    # putting back

    def put_back(self, work: float) -> None:
        """Take some items off the board and put them back, again and again, as in annealing."""
        board, most = _Table(self.flow, self.best), work * ACTS
        value, warm = board.value, self._warmth()
        for number in itertools.count():
            done = board.board.effort / most if most else 1.0
            if self.is_best or done >= 1 or len(self.best) < 2:
                return
            if number % POLLED == 0 and self.limits.interrupted():
                return
            chosen = self._chosen(board)
            old = {item: board.remove(item) for item in chosen}
            if self._put(board, old):
                now = board.value
                if self._accepts(value, now, warm * max(COOLED, 1 - done)):
                    value = now
                    self._note(board)
                    continue
                for item in chosen:
                    board.remove(item)
            for item, course in old.items():
                board.settle(item, course)

    def _note(self, board: "_Table") -> None:
        if board.value < self._worth:
            self.best, self._worth = board.courses, board.value

    def _warmth(self) -> float:
        """How much worse a schedule may become at first: a third of the time between two items,
        a sixth of many.
        """
        count = len(self.best)
        return (
            self.value(self.best)[1] / (3 * count + 3) / min(2.0, max(1.0, count / (1.5 * PLENTY)))
        )

    def _accepts(self, before: Value, now: Value, warm: float) -> bool:
        early = max(1.0, len(self.best) / PLENTY)  # of many items, one moves the average by less
        more = (now[0] - before[0]) * 10 + now[1] - before[1] + early * (now[2] - before[2])
        return more <= 0 or self.draw.random() < math.exp(-more / max(warm, 1e-9))

    def _chosen(self, board: "_Table") -> list[int]:
        """Some items: mostly neighbours in time."""
        order = board.order
        count = min(len(order), self.draw.randint(*MOVED))
        if self.draw.random() < 0.3:
            return [item for _, item in self.draw.sample(order, count)]
        first = self.draw.randrange(len(order) - count + 1)
        return [item for _, item in order[first : first + count]]

    def _put(self, board: "_Table", old: dict[int, Course]) -> bool:
        """Put items back in another order, some of them not as early as they fit; if one does
        not fit, none is put back.
        """
        chosen = list(old)
        self.draw.shuffle(chosen)
        first = min((course.starts[0] for course in old.values() if course.starts), default=0)
        span = max(1, round(6 * self._warmth()))
        done: list[int] = []
        for item in chosen:
            chance, soonest = self.draw.random(), 0
            if chance > 0.8:
                soonest = max(0, old[item].starts[0] + self.draw.randint(-span // 4, span // 4))
            elif chance > 0.5:
                soonest = max(0, first - self.draw.randint(0, span))
            course = board.earliest(item, soonest, self._waits(item))
            if course is None:
                for each in done:
                    board.remove(each)
                return False
            board.settle(item, course)
            done.append(item)
        return True

    def _waits(self, item: int) -> frozenset[int]:
        """Where an object may wait that is put back: mostly nowhere, or at one place."""
        own = self._all_waits[self.flow.items[item].route]
        if not own or self.draw.random() < STRAIGHT:
            return frozenset()
        return frozenset(self.draw.sample(own, 1 if self.draw.random() < ONCE else len(own)))

    @cached_property
    def _all_waits(self) -> list[tuple[int, ...]]:
        return [route.waits for route in self.flow.routes]

    # solving

    def solve(self, work: float) -> None:
        """Give all items to the solver, if they are not too many."""
        if sum(self._sizes) <= WHOLE:
            self._solve_whole(work)

    def _solve_whole(self, work: float) -> None:
        from cellwright.engine.stages.scheduling.flow.solving import (
            solved,  # the solver takes a while to load
        )

        horizon = self.flow.horizon
        if self.best:
            wrong, makespan, _ = self.value(self.best)
            longest = horizon if price_of(self.flow, self.best) else 2 * makespan
            horizon = makespan if not wrong else max(longest, makespan)
        found = solved(self.flow, self.best, horizon, self.bound, replace(self.limits, work=work))
        if found is not None:
            self.keep(found.courses)
            self.least = max(self.least, found.lower_bound)
            self.proved = found.proved


class _Table:
    """A board with all items on it, in the order in which they begin, and with what its
    schedule is worth.
    """

    def __init__(self, flow: Flow, courses: Sequence[Course]) -> None:
        self.flow, self.board = flow, Board(flow)
        self.order: list[tuple[int, int]] = []
        self.ends = [0] * len(courses)
        self.late = [0] * len(courses)
        self.sum = 0
        for item, course in enumerate(courses):
            self.settle(item, course)

    @property
    def value(self) -> Value:
        """Lateness and prices, then the makespan, then how late items end on average."""
        return sum(self.late), max(self.ends), self.sum / len(self.ends)

    @property
    def courses(self) -> tuple[Course, ...]:
        """The course of each item."""
        return tuple(self.board.courses[n] for n in range(len(self.ends)))

    def earliest(self, item: int, soonest: int, waits: frozenset[int]) -> Course | None:
        """The course of an item that ends first."""
        return self.board.earliest(item, soonest, waits)

    def settle(self, item: int, course: Course) -> None:
        """Put an item on the board."""
        self.board.settle(item, course)
        insort(self.order, (course.starts[0] if course.starts else 0, item))
        self._note(item, course.end, self._price(item, course))

    def remove(self, item: int) -> Course:
        """Take an item off the board."""
        course = self.board.remove(item)
        del self.order[bisect_left(self.order, (course.starts[0] if course.starts else 0, item))]
        self._note(item, 0, 0)
        return course

    def _price(self, item: int, course: Course) -> int:
        lags = self.flow.route(item).lags
        return sum(lag.price * lag.breach(course) for lag in lags if lag.price)

    def _note(self, item: int, end: int, price: int) -> None:
        own = self.flow.items[item]
        self.sum += end - self.ends[item]
        self.ends[item] = end
        late = 0 if own.due is None else own.priority * max(0, end - own.due)
        self.late[item] = late + price


def _in_turn(flow: Flow, order: Sequence[int], lag: int) -> list[Course] | None:
    """Courses of all items, put on the board one after another, begun so long after another."""
    board, soonest = Board(flow), 0
    for item in order:
        course = board.earliest(item, soonest)
        if course is None:
            return None
        board.settle(item, course)
        soonest = course.starts[0] + lag if course.starts else soonest
    return [board.courses[n] for n in range(len(order))]


def _least_time(flow: Flow, item: int) -> int:
    return sum(min((act.duration for act in layer), default=0) for layer in flow.route(item).layers)


def _load(flow: Flow, resource: str) -> float:
    """What items ask of a resource if acts that do not need it are not preferred; places are
    held until the next act.
    """
    return (
        sum(_resource_work(flow, n, resource) for n in range(len(flow.items)))
        / flow.capacity[resource]
    )


def _resource_work(flow: Flow, item: int, resource: str) -> float:
    whole, held = 0.0, False
    for layer in flow.route(item).layers:
        asks: list[float] = []
        after = held
        for act in layer:
            own = sum(use.end - use.begin for use in act.uses if use.resource == resource)
            takes = any(take.place == resource for take in act.takes)
            leaves = any(leave.place == resource for leave in act.leaves)
            if takes or leaves or held:
                own = act.duration
            after = takes or (held and not leaves)
            asks.append(own)
        whole += sum(asks) / max(1, len(asks))
        held = after
    return whole
