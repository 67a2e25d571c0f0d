"""The least change of bounds or links with which a network has a policy.

Conflict by conflict (as Yu, Fang & Williams 2014): whatever changes help must make each cycle that
was found either not negative, or no proof any more. The solver picks the cheapest changes that do
that; where the changed network still has a cycle, this is another conflict. At the end no cheaper
change is enough, since each conflict is one of every such change.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from cellwright.engine.model.uncertain_times import (
    CycleEdge,
    DerivedBound,
    EdgeKind,
    NegativeCycle,
    Relaxation,
    UncertainLink,
    UncertainNetwork,
)
from cellwright.engine.stages.uncertainty.controllability import check_controllability

if TYPE_CHECKING:
    from ortools.sat.python import cp_model

MAX_CONFLICTS = 400  # cycles that are learned before the search gives up
SOLVER_SECONDS = 20.0  # for each choice of changes, of the solver's own measure of work


def relax_bounds(network: UncertainNetwork) -> Relaxation | None:
    """By how much bounds have to be wider at least, in all; None if that does not help."""
    return _Relaxing(network, widens=True).search()


def narrow_links(network: UncertainNetwork, costs: Sequence["NarrowingCost"]) -> Relaxation | None:
    """The links that have to vary less, at the least cost; None if that does not help."""
    return _Relaxing(network, widens=False, costs=costs).search()


@dataclass(frozen=True, slots=True)
class NarrowingCost:
    """What it costs to raise the least of a link by 0, 1, 2, ... units, and to lower its most."""

    least: tuple[int, ...]
    most: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Length:
    """A number, and how often each change is added to it."""

    number: int = 0
    terms: Mapping[str, int] = field(default_factory=dict)

    def plus(self, other: "_Length", times: int = 1) -> "_Length":
        terms = dict(self.terms)
        for name, factor in other.terms.items():
            terms[name] = terms.get(name, 0) + times * factor
        return _Length(self.number + times * other.number, terms)


class _Conflict:
    """A cycle as what must be so for it to be no proof: one of `ways` is at least 0."""

    def __init__(self, network: UncertainNetwork, cycle: NegativeCycle) -> None:
        self.network, self.derived, self.ways = network, list[_Length](), list[_Length]()
        for bound in cycle.derived:
            self.derived.append(self._follow(bound, waits=False))
        for bound in cycle.waits:
            self._follow(bound, waits=True)
        if cycle.edges:
            self.ways.append(self._sum(cycle.edges))

    def _follow(self, bound: DerivedBound, waits: bool) -> _Length:
        """The length of what follows, and what would keep it from following."""
        slack, total = self._slack(bound.link), self._sum(bound.path)
        if waits:
            self.ways.append(total.plus(slack, -1))
        else:
            self.ways.append(slack.plus(total, -1).plus(_Length(-1)))
        for place, edge in enumerate(bound.path):
            if edge.kind is EdgeKind.SHORTEST:
                self._keep_from_being_short(bound, place, slack)
        return total.plus(self._most(bound.link), -1)

    def _keep_from_being_short(self, bound: DerivedBound, place: int, slack: _Length) -> None:
        rest = bound.path[place + 1 :]
        for end in range(1, len(rest) + 1):
            if (piece := self._sum(rest[:end])).number < 0:
                self.ways.append(piece)
                return
        self.ways.append(self._sum(rest).plus(slack, -1))

    def _sum(self, path: Sequence[CycleEdge]) -> _Length:
        total = _Length()
        for edge in path:
            total = total.plus(self._edge(edge))
        return total

    def _edge(self, edge: CycleEdge) -> _Length:
        match edge.kind:
            case EdgeKind.BOUND:
                terms = {f"bound {edge.number}": 1}
                return _Length(self.network.bounds[edge.number].most, terms)
            case EdgeKind.SHORTEST:
                return self._least(edge.number)
            case EdgeKind.AT_LEAST:
                return _Length().plus(self._least(edge.number), -1)
            case _:
                return self.derived[edge.number]

    def _least(self, link: int) -> _Length:
        return _Length(self.network.links[link].least, {f"least {link}": 1})

    def _most(self, link: int) -> _Length:
        return _Length(self.network.links[link].most, {f"most {link}": -1})

    def _slack(self, link: int) -> _Length:
        return self._most(link).plus(self._least(link), -1)


class _Relaxing:
    def __init__(
        self, network: UncertainNetwork, widens: bool, costs: Sequence[NarrowingCost] = ()
    ) -> None:
        from ortools.sat.python import cp_model  # slow to load, and only plans without a policy ask

        self.network, self.cp, self.solver = network, cp_model.CpModel(), cp_model.CpSolver()
        self.solver.parameters.num_workers = 1
        self.solver.parameters.max_deterministic_time = SOLVER_SECONDS
        self.changes: dict[str, cp_model.IntVar] = {}
        self.prices: list[cp_model.IntVar] = []
        if widens:
            self._let_bounds_widen()
        else:
            self._let_links_narrow(costs)
        self.cp.minimize(sum(self.prices))

    def _let_bounds_widen(self) -> None:
        far = sum(link.most for link in self.network.links)
        far += sum(abs(bound.most) for bound in self.network.bounds)
        for number, bound in enumerate(self.network.bounds):
            if bound.relaxable:
                name = f"bound {number}"
                self.changes[name] = self.cp.new_int_var(0, far, name)
                self.prices.append(self.changes[name])

    def _let_links_narrow(self, costs: Sequence[NarrowingCost]) -> None:
        for number, (link, cost) in enumerate(zip(self.network.links, costs, strict=True)):
            own = []
            for name, prices in ((f"least {number}", cost.least), (f"most {number}", cost.most)):
                change = self.cp.new_int_var(0, link.slack, name)
                price = self.cp.new_int_var(0, max(prices), f"price of {name}")
                self.cp.add_element(change, list(prices), price)
                self.changes[name] = change
                self.prices.append(price)
                own.append(change)
            self.cp.add(sum(own) <= link.slack)

    def search(self) -> Relaxation | None:
        """The cheapest changes after which there is a policy."""
        for _ in range(MAX_CONFLICTS):
            status = self.solver.solve(self.cp)
            if status not in (4, 2):  # optimal, feasible
                return None
            relaxation = self._relaxation(least_proved=status == 4)
            verdict = check_controllability(relaxed_network(self.network, relaxation))
            if not isinstance(verdict, NegativeCycle):
                return relaxation
            self._learn(verdict)
        return None

    def _learn(self, cycle: NegativeCycle) -> None:
        """A conflict of the network as it is, from a cycle of the one that is changed."""
        changed = relaxed_network(self.network, self._relaxation(least_proved=True))
        ways = []
        for way in _Conflict(changed, cycle).ways:
            known = {name: by for name, by in way.terms.items() if name in self.changes and by}
            # the numbers of the changed network have the changes in them already
            number = way.number - sum(
                by * self.solver.value(self.changes[name]) for name, by in known.items()
            )
            expression: cp_model.LinearExprT = number + sum(
                by * self.changes[name] for name, by in known.items()
            )
            is_so = self.cp.new_bool_var("")
            self.cp.add(expression >= 0).only_enforce_if(is_so)
            ways.append(is_so)
        self.cp.add_bool_or(ways)

    def _relaxation(self, least_proved: bool) -> Relaxation:
        by_kind: dict[str, dict[int, int]] = {"bound": {}, "least": {}, "most": {}}
        for name, change in self.changes.items():
            kind, number = name.split()
            if value := self.solver.value(change):
                by_kind[kind][int(number)] = value
        return Relaxation(by_kind["bound"], by_kind["least"], by_kind["most"], least_proved)


def relaxed_network(network: UncertainNetwork, relaxation: Relaxation) -> UncertainNetwork:
    """A network after some changes."""
    bounds = tuple(
        replace(bound, most=bound.most + relaxation.bounds.get(number, 0))
        for number, bound in enumerate(network.bounds)
    )

    def narrowed(number: int, link: UncertainLink) -> UncertainLink:
        least = link.least + relaxation.earliest.get(number, 0)
        return replace(link, least=least, most=link.most - relaxation.latest.get(number, 0))

    links = tuple(narrowed(number, link) for number, link in enumerate(network.links))
    return replace(network, bounds=bounds, links=links)
