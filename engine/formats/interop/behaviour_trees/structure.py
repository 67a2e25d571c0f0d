"""The order of a plan as a tree of series and of parts that run side by side.

Every partial order is the order of such a tree, if some of the parts wait for steps of other parts. Few have to: a set of
steps is first split where everything before comes before everything behind, then into parts that nothing connects.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from cellwright.kb.model.plan import Plan, StepId

DEEPEST = 50  # nested deeper, parts wait for each other instead


@dataclass(frozen=True, slots=True)
class Series:
    """Parts that come one after another."""

    parts: tuple["Part", ...]


@dataclass(frozen=True, slots=True)
class Beside:
    """Parts that run side by side, in an order that can be executed. Each begins when all steps that it waits for are done."""

    parts: tuple["Part", ...]
    waits: tuple[tuple[StepId, ...], ...]


Part = StepId | Series | Beside


def structure(plan: Plan) -> Part:
    """The tree of a plan. Its order is that of the plan: no step waits for another than in the plan, and none for fewer."""
    order = _Order(plan)
    return _part(order, list(range(len(plan.steps))), 0)


class _Order:
    """What comes before each step, by places in the list of steps."""

    def __init__(self, plan: Plan) -> None:
        places = {step.id: place for place, step in enumerate(plan.steps)}
        self.ids = [step.id for step in plan.steps]
        self.before: list[int] = []  # bits: all steps before
        self.just_before: list[tuple[int, ...]] = []  # of these, those with none between
        for step in plan.steps:
            direct = [places[each] for each in step.after]
            earlier = 0
            for each in direct:
                earlier |= self.before[each]
            self.just_before.append(tuple(sorted(each for each in {*direct} if not earlier >> each & 1)))
            for each in direct:
                earlier |= 1 << each
            self.before.append(earlier)


def _part(order: _Order, places: list[int], depth: int) -> Part:
    if len(places) == 1:
        return order.ids[places[0]]
    if len(series := _in_series(order, places)) > 1 or not places:
        return Series(tuple(_part(order, each, depth + 1) for each in series))
    if len(apart := _unconnected(order, places)) > 1 and depth < DEEPEST:
        return Beside(tuple(_part(order, each, depth + 1) for each in apart), ((),) * len(apart))
    return _waiting(order, places)


def _in_series(order: _Order, places: list[int]) -> list[list[int]]:
    """The places cut wherever everything before comes before everything behind. Cuts are found from the end."""
    cuts, common, inside = [len(places)], -1, 0
    for each in places:
        inside |= 1 << each
    for at in range(len(places) - 1, 0, -1):
        common &= order.before[places[at]]
        inside &= ~(1 << places[at])
        if not inside & ~common:
            cuts.append(at)
    cuts.append(0)
    return [places[start:end] for end, start in pairwise(cuts) if start < end][::-1]


def _unconnected(order: _Order, places: list[int]) -> list[list[int]]:
    """The places in groups between which there is no order, in the order of their first places."""
    top = {each: each for each in places}

    def find(each: int) -> int:
        while top[each] != each:
            top[each] = top[top[each]]
            each = top[each]
        return each

    for each in places:
        for before in order.just_before[each]:
            if before in top:
                first, second = sorted((find(each), find(before)))
                top[second] = first
    groups: dict[int, list[int]] = {}
    for each in places:
        groups.setdefault(find(each), []).append(each)
    return list(groups.values())


def _waiting(order: _Order, places: list[int]) -> Beside:
    """Chains of steps side by side, which wait for steps of each other."""
    chains = list(_chains(order, places))
    inside = {*places}
    waits = [
        tuple(order.ids[each] for each in order.just_before[chain[0]] if each in inside) for chain in chains
    ]
    ids = [tuple(order.ids[each] for each in chain) for chain in chains]
    return Beside(tuple(each[0] if len(each) == 1 else Series(each) for each in ids), tuple(waits))


def _chains(order: _Order, places: Sequence[int]) -> Iterator[list[int]]:
    """The places as chains: a step joins the step before it if that is the only one before it and it is the only one behind."""
    inside = {*places}
    behind: dict[int, list[int]] = {}
    for each in places:
        for before in order.just_before[each]:
            behind.setdefault(before, []).append(each)
    chains: dict[int, list[int]] = {}
    for each in places:
        first = [one for one in order.just_before[each] if one in inside]
        joins = len(first) == 1 and len(behind[first[0]]) == 1
        chain = chains[first[0]] if joins else []
        chain.append(each)
        chains[each] = chain
    yield from (chain for each, chain in chains.items() if chain[0] == each)
