"""Which of several arms makes which visits: a min-max problem of several travelling salesmen with visits that not all can make.

Few visits are shared exactly, by dynamic programming over all sets of them (Held & Karp 1962). Of more, each arm first tours what only
it can make. What several can make is then inserted: the arm that is done first takes what costs it least, compared with the others.
Then visits move from the arm that is busy longest to another one, or change places with one of its own, while that helps; the tours are
put in order again. How arms wait for each other in space is not counted here.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.tour import SharedProblem, Shares, Tour, TourProblem, busy_with
from cellwright.engine.stages.sequencing.limits import Limits
from cellwright.engine.stages.sequencing.sequence import sequence
from cellwright.engine.stages.sequencing.shares import MUCH, Paths, Ways, part

EXACT = 11  # visits of which all ways to share them are compared
ROUNDS = 40  # times that tours are put in order again
TRIED = 6  # changes that are tried in a round: those that look best

Orders = dict[
    str, tuple[int, ...]
]  # the visits of each arm, by their numbers in the tour problem of that arm


def share(problem: SharedProblem, limits: Limits = Limits()) -> Shares | Infeasible | GaveUp:
    """The shares with the least makespan that are found, and a bound; why there are none, if an arm has no tour."""
    return _Sharing(problem, replace(limits, sharp=False)).best()


@dataclass
class _Sharing:
    problem: SharedProblem
    limits: Limits
    toured: dict[tuple[str, frozenset[int]], Tour | Infeasible | GaveUp] = field(default_factory=dict)

    @cached_property
    def tours(self) -> Mapping[str, TourProblem]:
        return self.problem.tours

    @cached_property
    def place(self) -> Mapping[str, Mapping[str, int]]:
        """The number of each visit in the tour problem of each arm."""
        return {
            arm: {visit.name: n for n, visit in enumerate(each.visits)} for arm, each in self.tours.items()
        }

    @cached_property
    def arms_of(self) -> Mapping[str, tuple[str, ...]]:
        """The arms that can make each visit."""
        names = dict.fromkeys(visit.name for each in self.tours.values() for visit in each.visits)
        return {name: tuple(arm for arm in self.tours if name in self.place[arm]) for name in names}

    def best(self) -> Shares | Infeasible | GaveUp:
        """The shares that are found."""
        ordered = any(each.ordered for each in self.tours.values())
        if len(self.arms_of) <= EXACT and not ordered:
            return self._shares(self._exact(), exact=True)
        orders = self._inserted()
        if not isinstance(orders, dict):
            return orders
        for _ in range(ROUNDS):
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
            self.toured[key] = sequence(part(self.tours[arm], sorted(visits)), self.limits)
        found = self.toured[key]
        if not isinstance(found, Tour):
            return found
        members = sorted(visits)
        return tuple(members[n] for n in found.order)

    def _value(self, orders: Orders) -> tuple[int, int]:
        times = [self.busy(arm, own) for arm, own in orders.items()]
        return max(times), sum(times)

    def _inserted(self) -> Orders | Infeasible | GaveUp:
        """What only one arm can make in its tour, and the rest inserted one by one."""
        orders: Orders = {}
        for arm in self.tours:
            alone = frozenset(self.place[arm][name] for name, own in self.arms_of.items() if own == (arm,))
            found = self.order(arm, alone)
            if not isinstance(found, tuple):
                return found
            orders[arm] = found
        left = [name for name, own in self.arms_of.items() if len(own) > 1]
        while left:
            arm, name, at = self._next(orders, left)
            orders[arm] = (*orders[arm][:at], self.place[arm][name], *orders[arm][at:])
            left.remove(name)
        return self._in_order(orders)

    def _next(self, orders: Orders, left: list[str]) -> tuple[str, str, int]:
        """The arm that is done first takes, of what it can, what costs it least in comparison with the best other arm."""
        costs = {arm: self._insertions(arm, orders[arm], left) for arm in orders}
        for arm in sorted(orders, key=lambda each: self.busy(each, orders[each])):
            own, at = costs[arm]
            if own.min() >= MUCH:
                continue
            others = np.min([costs[each][0] for each in orders if each != arm], axis=0)
            best = int(np.lexsort((own, own - np.minimum(others, MUCH // 2)))[0])
            return arm, left[best], int(at[best])
        raise AssertionError("every visit has an arm")

    def _insertions(self, arm: str, order: tuple[int, ...], names: list[str]) -> tuple[Longs, Longs]:
        """What the cheapest insertion of each of some visits into an order costs, and where it is (n,); MUCH if an arm cannot."""
        own = self.place[arm]
        can = np.array([name in own for name in names])
        visits = np.array([own.get(name, 0) for name in names], np.int64)
        lasts = np.array([self.tours[arm].visits[v].duration if len(own) else 0 for v in visits], np.int64)
        if not len(order):
            return np.where(can, lasts, MUCH), np.zeros(len(names), np.int64)
        tour = np.array(order, np.int64)
        into, out = self._ways(arm, tour[:, None], visits[None]), self._ways(arm, visits[None], tour[:, None])
        between = into[:-1] + out[1:] - self._ways(arm, tour[:-1], tour[1:])[:, None]
        first = out[:1] if self.tours[arm].start is None else np.full_like(out[:1], MUCH)
        ways = np.concatenate([first, between, into[-1:]])
        at = ways.argmin(axis=0)
        return np.where(can, ways.min(axis=0) + lasts, MUCH), at.astype(np.int64)

    def _ways(self, arm: str, a: Longs, b: Longs) -> Longs:
        return self.costs[arm].between(a, b)

    @cached_property
    def costs(self) -> Mapping[str, Ways]:
        """The ways of each arm."""
        return {arm: Ways(each) for arm, each in self.tours.items()}

    def _in_order(self, orders: Orders) -> Orders | Infeasible | GaveUp:
        """The same shares, each in the best order that is found."""
        found: Orders = {}
        for arm, own in orders.items():
            order = self.order(arm, frozenset(own))
            if not isinstance(order, tuple):
                return order
            kept = self.tours[arm].ordered or self.busy(arm, order) <= self.busy(arm, own)
            found[arm] = order if kept else own
        return found

    def _better(self, orders: Orders) -> Iterator[Orders]:
        """Shares that are done sooner, or as soon with less work; changes that look best are tried first."""
        value = self._value(orders)
        changes = sorted(self._changes(orders), key=lambda each: each[0])[:TRIED]
        for estimate, changed in changes:
            if estimate >= value and not any(each.ordered for each in self.tours.values()):
                return
            found = self._in_order(changed)
            if isinstance(found, dict) and self._value(found) < value:
                yield found

    def _changes(self, orders: Orders) -> Iterator[tuple[tuple[int, int], Orders]]:
        """Orders in which the busiest arm gives a visit away, or changes it for another one, with their values."""
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
                for other in self._swaps(orders, (most, without), (arm, name)):
                    yield self._valued(other, times, (most, arm)), other

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
        other = back[int(costs.argmin())]
        left = tuple(v for v in orders[arm] if v != self.place[arm][other])
        yield {**orders, most: self._with(most, without, other), arm: self._with(arm, left, name)}

    def _with(self, arm: str, order: tuple[int, ...], name: str) -> tuple[int, ...]:
        _, at = self._insertions(arm, order, [name])
        return (*order[: int(at[0])], self.place[arm][name], *order[int(at[0]) :])

    def _valued(self, orders: Orders, times: Mapping[str, int], changed: tuple[str, str]) -> tuple[int, int]:
        """The makespan and the sum of orders of which two have changed since `times` were taken."""
        new = {**times, **{arm: self.busy(arm, orders[arm]) for arm in changed}}
        return max(new.values()), sum(new.values())

    def _exact(self) -> Orders:
        """The best shares of few visits."""
        names = list(self.arms_of)
        full = (1 << len(names)) - 1
        tables = {
            arm: Paths(self.costs[arm], [self.place[arm].get(n, -1) for n in names]) for arm in self.tours
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
                    if value < reached.get(done | subset, (MUCH, MUCH)):
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
        named = {arm: tuple(self.tours[arm].visits[v].name for v in own) for arm, own in orders.items()}
        busy = {arm: self.busy(arm, own) for arm, own in orders.items()}
        bound = max(busy.values(), default=0) if exact else self._bound()
        common = sum(len(own) > 1 for own in self.arms_of.values())
        return Shares(named, busy, min(bound, max(busy.values(), default=0)), common)

    def _bound(self) -> int:
        """No way to share the visits is done sooner: what all visits last and a cheapest forest of a tree for each arm, shared evenly."""
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
        """The least cost of trees, as many as arms, that join all visits (Prim 1957); of two ways and arms the cheaper counts."""
        near = np.full(len(names), MUCH, np.int64)
        joined, edges, now = np.zeros(len(names), bool), list[int](), 0
        for _ in range(len(names) - 1):
            joined[now] = True
            near = np.minimum(near, self._cheapest(names, now))
            now = int(np.where(joined, MUCH + 1, near).argmin())
            edges.append(int(near[now]))
        return sum(edge for edge in sorted(edges)[: len(edges) - len(self.tours) + 1] if edge < MUCH)

    def _cheapest(self, names: list[str], at: int) -> Longs:
        """The cheapest way between one visit and each other, by any arm that can make both (n,); MUCH if none can."""
        found = np.full(len(names), MUCH, np.int64)
        for arm in self.arms_of[names[at]]:
            own = self.place[arm]
            can = np.array([name in own for name in names])
            others = np.array([own.get(name, 0) for name in names], np.int64)
            here = np.full(len(names), own[names[at]], np.int64)
            ways = np.minimum(self._ways(arm, here, others), self._ways(arm, others, here))
            found = np.where(can, np.minimum(found, ways), found)
        return found
