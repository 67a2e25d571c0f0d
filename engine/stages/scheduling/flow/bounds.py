"""Lower bounds of the makespan of a flow: the least that each object asks of machines, places and
arms.

Every plan takes each object along some way through its graph. For any prices of resources, a way
costs at least what the cheapest one does; and all objects together cannot ask more than there is
until the end (an energetic argument; Baptiste, Le Pape & Nuijten 2001). A place that one arm fills
and empties is taken also while this arm brings an object there, or takes it away.
"""

import heapq
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.flow import Flow, Route
from cellwright.engine.stages.scheduling.flow.graph import MAX_NODES, ObjectGraph, Stride, key_of

SCALE = 1_000_000  # of prices, which are whole numbers
MAX_TIMES = 24  # before or after which nothing is counted, that are tried


@dataclass(frozen=True, slots=True)
class Arc:
    """A step from one state of an object to another: how long it lasts, and what it asks of
    resources.
    """

    after: int
    lasts: int
    asks: Mapping[str, int]
    draws: Mapping[str, int]  # from quantities


@dataclass(frozen=True)
class Demand:
    """What steps ask of resources in the graph of one object; `names` leads from each place to
    what it is a unit of.
    """

    graph: ObjectGraph
    names: Mapping[str, str]

    @property
    def is_alone(self) -> bool:
        """Whether nothing that is done without the object makes true what its steps need."""
        moving = self.graph.moving
        added = self.graph.task.initial | self.graph.own | self.graph.compared
        if self.graph.task.axioms is not None:
            added |= self.graph.task.axioms.derived
        for operator in moving:
            added |= operator.adds
        return not any(operator.preconditions & ~added for operator in moving)

    @cached_property
    def free(self) -> Mapping[int, str]:
        """The atoms not about the object that its steps change, with the places that they mean."""
        changed = 0
        for operator in self.graph.moving:
            changed |= operator.adds | operator.deletes
        shared = indices(changed & ~self.graph.own & ~self.graph.values)
        atoms = self.graph.task.atoms
        return {n: self._name(key_of(atoms[n])) for n in shared if atoms[n].name != "not"}

    def _name(self, key: str) -> str:
        return self.names.get(key, key)

    @cached_property
    def arcs(self) -> list[list[Arc]] | None:
        """The arcs from each state; None if there are too many states."""
        begin = self.graph.start()
        number, states = {begin: 0}, [begin]
        found: list[list[Arc]] = []
        for state in states:
            own = list[Arc]()
            if not self.graph.is_goal(state):
                for stride, after in self.graph.strides(state):
                    if after not in number:
                        number[after] = len(states)
                        states.append(after)
                    asks = self._asks(stride, state, after)
                    own.append(Arc(number[after], stride.duration, asks, _draws(stride)))
            found.append(own)
            if len(states) > MAX_NODES:
                return None
        self._ends.update(n for n, state in enumerate(states) if self.graph.is_goal(state))
        return found

    @cached_property
    def _ends(self) -> set[int]:
        return set()

    @cached_property
    def _locks(self) -> Bits:
        return bitset(list(self.free))

    def _asks(self, stride: Stride, before: Bits, after: Bits) -> dict[str, int]:
        """What is held during a step: places that are not free before or after it, and its
        resources.
        """
        lasts, found = stride.duration, dict[str, int]()
        held = {self.free[n] for n in indices(self._locks & ~(before & after))}
        held |= {
            self._name(str(each))
            for each in stride.operator.resources
            if each != self.graph.subject
        }
        for name in held if lasts else ():
            found[name] = lasts
        for place, more in self._carried(stride):
            found[place] = found.get(place, 0) + more
        return found

    def _carried(self, stride: Stride) -> Iterator[tuple[str, int]]:
        """What a step that ends a place asks of it more: the time to bring an object there or
        to take it away from there.
        """
        for n in indices((stride.ends | stride.makes) & self._locks):
            place = self.free[n]
            arm = self.carriers.get(place)
            if arm is not None:
                yield place, self.reach[arm][0 if stride.ends >> n & 1 else 1]

    @cached_property
    def carriers(self) -> Mapping[str, str]:
        """The places that are filled and emptied by one arm alone, with this arm."""
        found: dict[str, set[str]] = {}
        arms = self.reach
        for operator in self.graph.moving:
            own = {self._name(str(each)) for each in operator.resources}
            for n in indices((operator.adds | operator.deletes) & self._locks):
                place = self.free[n]
                if place not in arms:
                    found.setdefault(place, set()).add(next(iter(own & arms.keys()), ""))
        return {
            place: next(iter(by)) for place, by in found.items() if len(by) == 1 and "" not in by
        }

    @cached_property
    def reach(self) -> Mapping[str, tuple[int, int]]:
        """Resources that steps take and others free again: how long at least each kind of them
        lasts.
        """
        takes, gives = dict[str, int](), dict[str, int]()
        for operator in self.graph.moving:
            own = {self._name(str(each)) for each in operator.resources}
            for n in indices(operator.deletes & ~operator.adds & self._locks):
                if (name := self.free[n]) in own:
                    takes[name] = min(operator.duration, takes.get(name, operator.duration))
            for n in indices(operator.adds & self._locks):
                if (name := self.free[n]) in own:
                    gives[name] = min(operator.duration, gives.get(name, operator.duration))
        return {name: (takes[name], gives[name]) for name in takes.keys() & gives.keys()}

    def least(self, price: Callable[[Arc, int], int]) -> int:
        """The least price of a way to the goal (Dijkstra); a price is of an arc, and of the
        state where it begins.
        """
        best = self._spread({0: 0}, self._forward(price))
        return min((best[n] for n in self._ends if n in best), default=0)

    @cached_property
    def since(self) -> Mapping[int, int]:
        """The least time from the start to each state."""
        return self._spread({0: 0}, self._forward(lambda arc, _node: arc.lasts))

    @cached_property
    def until(self) -> Mapping[int, int]:
        """The least time from each state to the goal."""
        back: dict[int, list[tuple[int, int]]] = {}
        for n, own in enumerate(self.arcs or []):
            for arc in own:
                back.setdefault(arc.after, []).append((n, arc.lasts))
        return self._spread(dict.fromkeys(self._ends, 0), lambda node: back.get(node, ()))

    def _forward(
        self, price: Callable[[Arc, int], int]
    ) -> Callable[[int], Iterable[tuple[int, int]]]:
        arcs = self.arcs or [[]]
        return lambda node: ((arc.after, price(arc, node)) for arc in arcs[node])

    def _spread(
        self, best: dict[int, int], following: Callable[[int], Iterable[tuple[int, int]]]
    ) -> dict[int, int]:
        waiting = [(cost, node) for node, cost in best.items()]
        heapq.heapify(waiting)
        while waiting:
            now, node = heapq.heappop(waiting)
            if now > best[node]:
                continue
            for other, more in following(node):
                if now + more < best.get(other, now + more + 1):
                    best[other] = now + more
                    heapq.heappush(waiting, (now + more, other))
        return best

    def margins(self, arc: Arc, node: int, name: str) -> tuple[int, int]:
        """The least time before what an arc asks of a resource, and after it."""
        arm = self.carriers.get(name)
        before, after = self.reach[arm] if arm is not None else (0, 0)
        return self.since.get(node, 0) - before, self.until.get(arc.after, 0) - after

    def times(self, names: Collection[str]) -> tuple[list[int], list[int]]:
        """The different times before and after what is asked of some resources."""
        heads, tails = {0}, {0}
        for node, own in enumerate(self.arcs or []):
            for arc in own:
                for name in arc.asks.keys() & set(names):
                    head, tail = self.margins(arc, node, name)
                    heads.add(max(0, head))
                    tails.add(max(0, tail))
        return sorted(heads), sorted(tails)


def _draws(stride: Stride) -> dict[str, int]:
    """What a step takes from quantities, where that is a constant."""
    changes = {
        str(each.level.quantity): each.to.without(each.level) for each in stride.operator.changes
    }
    return {name: -to.constant for name, to in changes.items() if not to.parts and to.constant < 0}


def least_of_all(flow: Flow, demands: Sequence[Demand]) -> tuple[int, str]:
    """No plan ends before this, and the resources that say so; 0 if that is not known."""
    if any(each.arcs is None for each in demands):
        return 0, ""
    found = [(0, "")]
    lasts = [each.least(lambda arc, _node: arc.lasts) for each in demands]
    found += [(item.release + lasts[item.route], item.name) for item in flow.items]
    counts = [sum(item.route == n for item in flow.items) for n in range(len(demands))]
    found += [
        (_Energy(flow, demands, counts, prices).least, " and ".join(prices))
        for prices in _prices(flow)
    ]
    return max(found, key=lambda each: each[0])


@dataclass(frozen=True)
class _Energy:
    """What all objects ask of some resources, shared out among them."""

    flow: Flow
    demands: Sequence[Demand]
    counts: Sequence[int]
    prices: Mapping[str, int]

    @property
    def least(self) -> int:
        """The best bound over times before and after which nothing is counted."""
        release = min(item.release for item in self.flow.items)
        times = [each.times(self.prices) for each in self.demands]
        heads = _few({t for own, _ in times for t in own})
        tails = _few({t for _, own in times for t in own})
        tail = max(tails, key=lambda each: self._from(0, each))
        return release + max(self._from(head, tail) for head in heads)

    def _from(self, head: int, tail: int) -> int:
        """What is asked no sooner than `head`, and no later than `tail` before the end, lies
        between both.
        """
        whole = 0
        for demand, count in zip(self.demands, self.counts, strict=True):

            def price(arc: Arc, node: int, demand: Demand = demand) -> int:
                found = 0
                for name, lasts in arc.asks.items():
                    if name in self.prices:
                        before, after = demand.margins(arc, node, name)
                        if before >= head and after >= tail:
                            found += self.prices[name] * lasts
                return found

            whole += count * demand.least(price)
        there = sum(price * self.flow.capacity[name] for name, price in self.prices.items())
        return head + tail - -whole // there if whole else 0


def _few(times: Collection[int]) -> list[int]:
    """At most `MAX_TIMES` of some times, spread among them."""
    ordered = sorted(times)
    step = max(1, -(-len(ordered) // MAX_TIMES))
    return sorted({*ordered[::step], ordered[-1]})


def _prices(flow: Flow) -> Iterator[dict[str, int]]:
    """Resources to ask for, with their prices: each alone, and those that may take each other's
    place.
    """
    for name in flow.capacity:
        yield {name: 1}
    for group in dict.fromkeys(group for route in flow.routes for group in _groups(route)):
        if len(group) > 1 and all(name in flow.capacity for name, _ in group):
            yield {name: SCALE // max(1, lasts) for name, lasts in group}


def _groups(route: Route) -> Iterator[tuple[tuple[str, int], ...]]:
    """The places that acts of one layer take, each with how long the next act there lasts."""
    if not route.layers:  # the object is where it shall be
        return
    for layer, following in zip(route.layers, (*route.layers[1:], ()), strict=True):
        taken = dict[str, int]()
        for act in layer:
            for take in act.takes:
                after = [each.duration for each in following if each.before == act.after]
                taken[take.place] = act.duration - take.begin + min(after, default=0)
        yield tuple(sorted(taken.items()))
        used = dict[str, int]()
        for act in layer:
            for use in act.uses:
                used[use.resource] = use.end - use.begin
        yield tuple(sorted(used.items()))
