"""Whether there is enough of each quantity (reagents, stock) in every order of the acts of a flow.

Of each quantity all that acts may add and draw is known. A condition that holds whatever else has
been added and drawn before holds in every order. Steps that change one quantity still do so one at
a time.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.kernels.bits import indices
from cellwright.engine.model.ground_axioms import (
    OPPOSITE_SIGNS,
    Comparing,
    QuantityLevel,
    never_holds,
)
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.stages.scheduling.flow.bounds import Arc, Demand
from cellwright.engine.stages.scheduling.flow.graph import Edge, NoRoute, RouteMaker, Stride
from cellwright.kb.terms import Function


@dataclass(frozen=True, slots=True)
class Shortage:
    """Less of a quantity is there than all objects draw from it at least, whatever is done with
    them.
    """

    quantity: Function
    there: int
    drawn: int

    def __str__(self) -> str:
        return (
            f"{self.quantity} is {self.there} at the start and only falls, but all objects "
            f"together draw {self.drawn} at least"
        )


def shortages(demands: Sequence[tuple[Demand, int]]) -> Iterator[Shortage]:
    """The quantities that run out in every plan: nothing fills them up.

    Each demand comes with how many objects have it.
    """
    drawn: dict[str, int] = {}
    levels: dict[str, QuantityLevel] = {}
    rising = set[str]()
    for demand, count in demands:
        task = demand.graph.task
        rising |= {name for operator in task.operators for name in _rising(operator)}
        for operator in demand.graph.moving:
            levels |= {str(each.level.quantity): each.level for each in operator.changes}
        for name in levels:
            drawn[name] = drawn.get(name, 0) + count * demand.least(_drawing(name))
    for name, level in levels.items():
        there = (
            level.of(demands[0][0].graph.task.initial)
            if level.mask & demands[0][0].graph.task.initial
            else None
        )
        if there is not None and name not in rising and drawn[name] > there - level.low:
            yield Shortage(level.quantity, there, drawn[name])


def _drawing(name: str) -> Callable[[Arc, int], int]:
    """What an arc draws from a quantity, as its price."""
    return lambda arc, _node: arc.draws.get(name, 0)


def _rising(operator: GroundOperator) -> Iterator[str]:
    """The quantities that an operator may make greater."""
    for each in operator.changes:
        change = each.to.without(each.level)
        if change.parts or change.constant > 0:
            yield str(each.level.quantity)


@dataclass(frozen=True)
class Levels:
    """The quantities of objects of some kinds: the task of one object, its ways, and how many
    objects are of the kind.
    """

    kinds: Sequence[tuple[GroundTask, RouteMaker, int]]

    def __post_init__(self) -> None:
        for task, maker, _ in self.kinds:
            for layer in maker.ways.layers:
                for edge in layer:
                    for stride in edge.strides:
                        self._require(task, maker, stride)

    @cached_property
    def totals(self) -> dict[str, tuple[int, int]]:
        """What all objects together draw from each quantity at most, and what they add."""
        found: dict[str, tuple[int, int]] = {}
        for _, maker, count in self.kinds:
            for layer in maker.ways.layers:
                low, high = dict[str, int](), dict[str, int]()
                for edge in layer:
                    for name, change in _changes_of(edge).items():
                        low[name] = min(low.get(name, 0), change)
                        high[name] = max(high.get(name, 0), change)
                for name in low:
                    drawn, added = found.get(name, (0, 0))
                    found[name] = drawn + count * low[name], added + count * high[name]
        return found

    def held(self, stride: Stride) -> list[str]:
        """The quantities that a step changes and that others change as well, which it does
        alone.
        """
        return [
            f"level of {name}" for name, _ in _changed_by(stride) if self.totals.get(name) != (0, 0)
        ]

    def _require(self, task: GroundTask, maker: RouteMaker, stride: Stride) -> None:
        """Refuse a step whose conditions on quantities may fail in some order. Raises `NoRoute`."""
        own = dict(_changed_by(stride))
        for atom in indices(stride.compared):
            test, positive = maker.graph.test_of(atom)
            if not self._always(task, test, positive, own):
                raise NoRoute(
                    f"whether there is enough for {stride.operator.instance.name} depends on "
                    "the order"
                )

    def _always(
        self, task: GroundTask, test: Comparing, positive: bool, own: dict[str, int]
    ) -> bool:
        low = high = test.sum.constant
        for level, factor in test.sum.parts:
            name, value = str(level.quantity), level.of(task.initial)
            drawn, added = self.totals.get(name, (0, 0))
            change = own.get(name, 0)
            least, most = value + drawn - min(0, change), value + added - max(0, change)
            ends = sorted((factor * least, factor * most))
            low, high = low + ends[0], high + ends[1]
        relation = test.relation if positive else OPPOSITE_SIGNS[test.relation]
        return never_holds(OPPOSITE_SIGNS[relation], low, high)


def _changes_of(edge: Edge) -> dict[str, int]:
    found: dict[str, int] = {}
    for stride in edge.strides:
        for name, change in _changed_by(stride):
            found[name] = found.get(name, 0) + change
    return found


def _changed_by(stride: Stride) -> Iterator[tuple[str, int]]:
    """What a step adds to quantities. Raises `NoRoute` if that depends on quantities."""
    for each in stride.operator.changes:
        change = each.to.without(each.level)
        if change.parts:
            raise NoRoute(f"{stride.operator.instance.name} changes a quantity by what it is")
        yield str(each.level.quantity), change.constant
