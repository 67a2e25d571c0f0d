"""Shares of visits among several arms: a min-max problem of several travelling salesmen."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.tour_problem import (
    Metric,
    SharedProblem,
    Shares,
    Tour,
    TourProblem,
    busy_with,
)
from cellwright.engine.stages.sequencing.search_limits import TourLimits
from cellwright.engine.stages.sequencing.tour_solver import sequence_tour

IMPOSSIBLE_COST = 1 << 50  # what costs as much cannot be done


@dataclass(frozen=True)
class VisitWays:
    """The ways between the visits of a tour problem, changes of tools and stations with them."""

    problem: TourProblem

    def between(self, a: Longs, b: Longs) -> Longs:
        """What it costs to go from each visit of `a` to that of `b` at the same place; shapes
        are broadcast.
        """
        travel = self.problem.travel
        if isinstance(travel, Metric):
            way_costs = travel.between(a.astype(np.int32), b.astype(np.int32))
        else:
            way_costs = travel[a, b]
        if self.problem.changes or self.problem.shifts:
            kind, extra = self._kinds
            way_costs = way_costs + extra[kind[a], kind[b]]
        return np.asarray(way_costs)

    @cached_property
    def _kinds(self) -> tuple[Longs, Longs]:
        kind, extra = self.problem.kinds
        return kind.astype(np.int64), extra


class LeastPaths:
    """The least time that one arm takes for each set of visits; sets are bits."""

    def __init__(self, ways: "VisitWays", own: list[int]) -> None:
        """`own` is the number of each visit in the problem of the arm; -1 if it cannot make it."""
        problem, self.own = ways.problem, own
        self.start = -1 if problem.start is None else problem.start
        self.can = sum(1 << n for n, own in enumerate(self.own) if own >= 0)
        self.lasts = [problem.visits[own].duration if own >= 0 else 0 for own in self.own]
        index = np.array([max(own, 0) for own in self.own], np.int64)
        empty = np.zeros((len(own), len(own)), np.int64)
        self.arcs = ways.between(index[:, None], index[None]) if problem.visits else empty
        self.ends: dict[tuple[int, int], tuple[int, int]] = {}
        self.least: dict[int, int] = {0: 0}
        for bits in range(1, 1 << len(own)):
            if not bits & ~self.can:
                self.least[bits] = min(self._ending(bits, n)[0] for n in _set_members(bits))

    def _ending(self, bits: int, last: int) -> tuple[int, int]:
        """The least time for a set whose last visit is given, and the visit before that."""
        if (bits, last) not in self.ends:
            rest, own = bits & ~(1 << last), self.lasts[last]
            ways = (
                (self.ends[rest, n][0] + int(self.arcs[n, last]) + own, n)
                for n in _set_members(rest)
            )
            starts = self.start < 0 or (self.own[last] == self.start) == (not rest)
            best_ending = min(ways) if rest else (own, -1)
            self.ends[bits, last] = (
                best_ending
                if starts or best_ending[0] >= IMPOSSIBLE_COST
                else (IMPOSSIBLE_COST, best_ending[1])
            )
        return self.ends[bits, last]

    def order(self, bits: int) -> tuple[int, ...]:
        """The visits of a set in the order that takes least time."""
        visit_order = list[int]()
        last = min(_set_members(bits), key=lambda n: self.ends[bits, n][0], default=-1)
        while bits:
            visit_order.append(self.own[last])
            bits, last = bits & ~(1 << last), self.ends[bits, last][1]
        return tuple(reversed(visit_order))


def _set_members(bits: int) -> list[int]:
    return [n for n in range(bits.bit_length()) if bits >> n & 1]


def part_problem(problem: TourProblem, members: list[int]) -> TourProblem:
    """The tour problem of some visits; pairs of which one is left out are left out."""
    number = {old: new for new, old in enumerate(members)}
    travel = problem.travel
    less = travel.part(members) if isinstance(travel, Metric) else travel[np.ix_(members, members)]
    pairs = tuple(
        (number[a], number[b]) for a, b in problem.precedence if a in number and b in number
    )
    visits = tuple(problem.visits[n] for n in members)
    start = None if problem.start is None else number.get(problem.start)
    return replace(problem, visits=visits, travel=less, precedence=pairs, start=start)


MAX_EXACT_SHARED_VISITS = 11  # visits of which all ways to share them are compared
REORDER_ROUNDS = 40  # times that tours are put in order again
TRIED_CHANGES = 6  # changes that are tried in a round: those that look best

Orders = dict[
    str, tuple[int, ...]
]  # the visits of each arm, by their numbers in the tour problem of that arm


def share_visits(
    problem: SharedProblem, limits: TourLimits = TourLimits()
) -> Shares | Infeasible | GaveUp:
    """The shares with the least makespan that are found, and a bound; why there are none, if an
    arm has no tour.
    """
    return _ShareSearch(problem, replace(limits, sharp=False)).best()


@dataclass
class _ShareSearch:
    problem: SharedProblem
    limits: TourLimits
    toured: dict[tuple[str, frozenset[int]], Tour | Infeasible | GaveUp] = field(
        default_factory=dict
    )

    @cached_property
    def tours(self) -> Mapping[str, TourProblem]:
        return self.problem.tours

    @cached_property
    def place(self) -> Mapping[str, Mapping[str, int]]:
        """The number of each visit in the tour problem of each arm."""
        return {
            arm: {visit.name: n for n, visit in enumerate(arm_tour.visits)}
            for arm, arm_tour in self.tours.items()
        }

    @cached_property
    def arms_of(self) -> Mapping[str, tuple[str, ...]]:
        """The arms that can make each visit."""
        names = dict.fromkeys(visit.name for tour in self.tours.values() for visit in tour.visits)
        return {name: tuple(arm for arm in self.tours if name in self.place[arm]) for name in names}

    def best(self) -> Shares | Infeasible | GaveUp:
        """The shares that are found."""
        ordered = any(tour.ordered for tour in self.tours.values())
        if len(self.arms_of) <= MAX_EXACT_SHARED_VISITS and not ordered:
            return self._shares(self._exact(), exact=True)
        orders = self._inserted()
        if not isinstance(orders, dict):
            return orders
        for _ in range(REORDER_ROUNDS):
            if self.limits.interrupted():
                break
            better = next(self._better(orders), None)
            if better is None:
                break
            orders = better
        return self._shares(orders)

    def busy(self, arm: str, order: tuple[int, ...]) -> int:
        """How long an arm takes for visits in an order."""
        return busy_with(self.tours[arm], order)

    def order(self, arm: str, visits: frozenset[int]) -> tuple[int, ...] | Infeasible | GaveUp:
        """Some visits of an arm in the best order that is found."""
        key = (arm, visits)
        if key not in self.toured:
            self.toured[key] = sequence_tour(
                part_problem(self.tours[arm], sorted(visits)), self.limits
            )
        arm_order = self.toured[key]
        if not isinstance(arm_order, Tour):
            return arm_order
        members = sorted(visits)
        return tuple(members[n] for n in arm_order.order)

    def _value(self, orders: Orders) -> tuple[int, int]:
        times = [self.busy(arm, own) for arm, own in orders.items()]
        return max(times), sum(times)

    def _inserted(self) -> Orders | Infeasible | GaveUp:
        """What only one arm can make in its tour, and the rest inserted one by one."""
        orders: Orders = {}
        for arm in self.tours:
            alone = frozenset(
                self.place[arm][name] for name, own in self.arms_of.items() if own == (arm,)
            )
            alone_order = self.order(arm, alone)
            if not isinstance(alone_order, tuple):
                return alone_order
            orders[arm] = alone_order
        unplaced = [name for name, own in self.arms_of.items() if len(own) > 1]
        while unplaced:
            arm, name, at = self._next(orders, unplaced)
            orders[arm] = (*orders[arm][:at], self.place[arm][name], *orders[arm][at:])
            unplaced.remove(name)
        return self._in_order(orders)

    def _next(self, orders: Orders, unplaced: list[str]) -> tuple[str, str, int]:
        """The arm that is done first takes, of what it can, what costs it least in comparison
        with the best other arm.
        """
        costs = {arm: self._insertions(arm, orders[arm], unplaced) for arm in orders}
        for arm in sorted(
            orders, key=lambda candidate_arm: self.busy(candidate_arm, orders[candidate_arm])
        ):
            own, at = costs[arm]
            if own.min() >= IMPOSSIBLE_COST:
                continue
            other_costs = np.min(
                [costs[other_arm][0] for other_arm in orders if other_arm != arm], axis=0
            )
            best = int(np.lexsort((own, own - np.minimum(other_costs, IMPOSSIBLE_COST // 2)))[0])
            return arm, unplaced[best], int(at[best])
        raise AssertionError("every visit has an arm")

    def _insertions(
        self, arm: str, order: tuple[int, ...], names: list[str]
    ) -> tuple[Longs, Longs]:
        """What the cheapest insertion of each of some visits into an order costs, and where it
        is (n,); MUCH if an arm cannot.
        """
        own = self.place[arm]
        can = np.array([name in own for name in names])
        visits = np.array([own.get(name, 0) for name in names], np.int64)
        lasts = np.array(
            [self.tours[arm].visits[v].duration if len(own) else 0 for v in visits], np.int64
        )
        if not len(order):
            return np.where(can, lasts, IMPOSSIBLE_COST), np.zeros(len(names), np.int64)
        tour = np.array(order, np.int64)
        into, out = (
            self._ways(arm, tour[:, None], visits[None]),
            self._ways(arm, visits[None], tour[:, None]),
        )
        between = into[:-1] + out[1:] - self._ways(arm, tour[:-1], tour[1:])[:, None]
        first = out[:1] if self.tours[arm].start is None else np.full_like(out[:1], IMPOSSIBLE_COST)
        ways = np.concatenate([first, between, into[-1:]])
        at = ways.argmin(axis=0)
        return np.where(can, ways.min(axis=0) + lasts, IMPOSSIBLE_COST), at.astype(np.int64)

    def _ways(self, arm: str, a: Longs, b: Longs) -> Longs:
        return self.costs[arm].between(a, b)

    @cached_property
    def costs(self) -> Mapping[str, VisitWays]:
        """The ways of each arm."""
        return {arm: VisitWays(arm_tour) for arm, arm_tour in self.tours.items()}

    def _in_order(self, orders: Orders) -> Orders | Infeasible | GaveUp:
        """The same shares, each in the best order that is found."""
        reordered: Orders = {}
        for arm, own in orders.items():
            order = self.order(arm, frozenset(own))
            if not isinstance(order, tuple):
                return order
            keeps_order = self.tours[arm].ordered or self.busy(arm, order) <= self.busy(arm, own)
            reordered[arm] = order if keeps_order else own
        return reordered

    def _better(self, orders: Orders) -> Iterator[Orders]:
        """Shares that are done sooner, or as soon with less work; changes that look best are
        tried first.
        """
        value = self._value(orders)
        changes = sorted(self._changes(orders), key=lambda change: change[0])[:TRIED_CHANGES]
        for estimate, changed in changes:
            if estimate >= value and not any(tour.ordered for tour in self.tours.values()):
                return
            changed_orders = self._in_order(changed)
            if isinstance(changed_orders, dict) and self._value(changed_orders) < value:
                yield changed_orders

    def _changes(self, orders: Orders) -> Iterator[tuple[tuple[int, int], Orders]]:
        """Orders in which the busiest arm gives a visit away, or changes it for another one,
        with their values.
        """
        times = {arm: self.busy(arm, own) for arm, own in orders.items()}
        most = max(times, key=lambda arm: times[arm])
        given = [
            self.tours[most].visits[v].name
            for v in orders[most]
            if len(self.arms_of[self.tours[most].visits[v].name]) > 1
        ]
        for name in given:
            without = tuple(v for v in orders[most] if v != self.place[most][name])
            for arm in self.arms_of[name]:
                if arm == most:
                    continue
                changed = {**orders, most: without, arm: self._with(arm, orders[arm], name)}
                yield self._valued(changed, times, (most, arm)), changed
                for swap in self._swaps(orders, (most, without), (arm, name)):
                    yield self._valued(swap, times, (most, arm)), swap

    def _swaps(
        self, orders: Orders, giver: tuple[str, tuple[int, ...]], taker: tuple[str, str]
    ) -> Iterator[Orders]:
        """The taker gives one visit back: that which costs the giver least."""
        (most, without), (arm, name) = giver, taker
        back = [
            self.tours[arm].visits[v].name
            for v in orders[arm]
            if self.tours[arm].visits[v].name in self.place[most]
        ]
        if not back:
            return
        costs, _ = self._insertions(most, without, back)
        swapped_visit = back[int(costs.argmin())]
        remaining = tuple(v for v in orders[arm] if v != self.place[arm][swapped_visit])
        yield {
            **orders,
            most: self._with(most, without, swapped_visit),
            arm: self._with(arm, remaining, name),
        }

    def _with(self, arm: str, order: tuple[int, ...], name: str) -> tuple[int, ...]:
        _, at = self._insertions(arm, order, [name])
        return (*order[: int(at[0])], self.place[arm][name], *order[int(at[0]) :])

    def _valued(
        self, orders: Orders, times: Mapping[str, int], changed: tuple[str, str]
    ) -> tuple[int, int]:
        """The makespan and the sum of orders of which two have changed since `times` were taken."""
        new = {**times, **{arm: self.busy(arm, orders[arm]) for arm in changed}}
        return max(new.values()), sum(new.values())

    def _exact(self) -> Orders:
        """The best shares of few visits."""
        names = list(self.arms_of)
        full = (1 << len(names)) - 1
        tables = {
            arm: LeastPaths(self.costs[arm], [self.place[arm].get(n, -1) for n in names])
            for arm in self.tours
        }
        best = {0: (0, 0)}
        chosen: list[dict[int, int]] = []
        for table in tables.values():
            reached: dict[int, tuple[int, int]] = {}
            taken: dict[int, int] = {}
            for done, (most, total) in best.items():
                rest = subset = full & ~done & table.can
                while True:
                    own = table.least[subset]
                    value = max(most, own), total + own
                    if value < reached.get(done | subset, (IMPOSSIBLE_COST, IMPOSSIBLE_COST)):
                        reached[done | subset], taken[done | subset] = value, subset
                    if not subset:
                        break
                    subset = (subset - 1) & rest
            best = reached
            chosen.append(taken)
        orders, done = Orders(), full
        for (arm, table), taken in reversed(list(zip(tables.items(), chosen, strict=True))):
            orders[arm] = table.order(taken[done])
            done &= ~taken[done]
        return {arm: orders[arm] for arm in self.tours}

    def _shares(self, orders: Orders, exact: bool = False) -> Shares:
        named = {
            arm: tuple(self.tours[arm].visits[v].name for v in own) for arm, own in orders.items()
        }
        busy = {arm: self.busy(arm, own) for arm, own in orders.items()}
        bound = max(busy.values(), default=0) if exact else self._bound()
        common = sum(len(own) > 1 for own in self.arms_of.values())
        return Shares(named, busy, min(bound, max(busy.values(), default=0)), common)

    def _bound(self) -> int:
        """No way to share the visits is done sooner: what all visits last and a cheapest forest
        of a tree for each arm, shared evenly.
        """
        names = list(self.arms_of)
        lasts = sum(
            min(self.tours[arm].visits[self.place[arm][name]].duration for arm in own)
            for name, own in self.arms_of.items()
        )
        spread = -(-(lasts + self._forest(names)) // len(self.tours))
        single = [
            sum(
                self.tours[arm].visits[self.place[arm][name]].duration
                for name, own in self.arms_of.items()
                if own == (arm,)
            )
            for arm in self.tours
        ]
        return max(spread, *single)

    def _forest(self, names: list[str]) -> int:
        """The least cost of trees, as many as arms, that join all visits (Prim 1957); of two
        ways and arms the cheaper counts.
        """
        near = np.full(len(names), IMPOSSIBLE_COST, np.int64)
        joined, edges, now = np.zeros(len(names), bool), list[int](), 0
        for _ in range(len(names) - 1):
            joined[now] = True
            near = np.minimum(near, self._cheapest(names, now))
            now = int(np.where(joined, IMPOSSIBLE_COST + 1, near).argmin())
            edges.append(int(near[now]))
        return sum(
            edge
            for edge in sorted(edges)[: len(edges) - len(self.tours) + 1]
            if edge < IMPOSSIBLE_COST
        )

    def _cheapest(self, names: list[str], at: int) -> Longs:
        """The cheapest way between one visit and each other, by any arm that can make both
        (n,); MUCH if none can.
        """
        least_costs = np.full(len(names), IMPOSSIBLE_COST, np.int64)
        for arm in self.arms_of[names[at]]:
            own = self.place[arm]
            can = np.array([name in own for name in names])
            other_positions = np.array([own.get(name, 0) for name in names], np.int64)
            from_positions = np.full(len(names), own[names[at]], np.int64)
            ways = np.minimum(
                self._ways(arm, from_positions, other_positions),
                self._ways(arm, other_positions, from_positions),
            )
            least_costs = np.where(can, np.minimum(least_costs, ways), least_costs)
        return least_costs
