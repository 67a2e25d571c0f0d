"""Finds sub-sequences of plans: steps that causal links join, and that can run directly after one another.

Sub-sequences that recur in the plans of a domain may help a search (Botea, Enzenberger, Müller & Schaeffer
2005, who join the steps of the causal graph of a solution). Whether they do is measured elsewhere.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.terms import Function, Term, Variable, match

LONGEST = 4  # steps of the longest sub-sequence
LARGEST = 200  # steps; longer plans are not searched for sub-sequences
Positions = int
"""A set of steps of a plan by their positions, as a bitset."""


@dataclass(frozen=True, slots=True)
class Recurring:
    """The sub-sequences of one shape: how many there are, and one of them with the steps before it."""

    count: int
    before: tuple[Step, ...]
    steps: tuple[Step, ...]

    @property
    def operators(self) -> tuple[Function, ...]:
        """The operators of the one sub-sequence."""
        return tuple(step.operator for step in self.steps)


def recurring(plan: Plan) -> list[Recurring]:
    """The sub-sequences of a plan by shape. Those that would save the most steps come first."""
    kinds: dict[str, list[Positions]] = {}
    order = Order(plan)
    for found in order.subsequences:
        kinds.setdefault(shape(order.operators(found)), []).append(found)
    ranked = sorted(kinds.items(), key=lambda kind: (-len(kind[1]) * (kind[1][0].bit_count() - 1), kind[0]))
    return [Recurring(len(own), order.steps(order.before(own[0])), order.steps(own[0])) for _, own in ranked]


def occurring(
    order: "Order", pattern: Sequence[Function], but: Collection[StepId] = ()
) -> Iterator[tuple[Step, ...]]:
    """The sub-sequences of a plan that are instances of a pattern.

    They overlap neither each other nor the steps `but`.
    """
    taken = sum(1 << place for place, step in enumerate(order.plan.steps) if step.id in but)
    for found in sorted(order.subsequences):
        free = found.bit_count() == len(pattern) and not found & taken
        if free and fits(pattern, order.operators(found)):
            taken |= found
            yield order.steps(found)


def shape(operators: Iterable[Function]) -> str:
    """The shape of a sequence: its operators, and which of their arguments are equal. Names do not matter."""
    names: dict[Term, Term] = {}
    return ", ".join(str(_renamed(each, names)) for each in operators)


def _renamed(term: Term, names: dict[Term, Term]) -> Term:
    """A term whose constants, variables and numbers are replaced by variables, equal ones by the same."""
    if isinstance(term, Function) and term.arguments:
        return Function(term.name, tuple(_renamed(each, names) for each in term.arguments))
    return names.setdefault(term, Variable(f"X{len(names)}"))


def fits(pattern: Sequence[Function], operators: Sequence[Function]) -> bool:
    """Whether the operators are an instance of the pattern, step by step."""
    bindings: dict[Variable, Term] | None = {}
    for step, operator in zip(pattern, operators, strict=True):
        bindings = None if bindings is None else match(step, operator, bindings)
    return bindings is not None


class Order:
    """The steps before and after each step of a plan, and the steps to which causal links join it."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        places = {step.id: place for place, step in enumerate(plan.steps)}
        self._earlier = [0] * len(plan.steps)
        self._later = [0] * len(plan.steps)
        self._joined = [0] * len(plan.steps)
        for step, earlier in plan.predecessors().items():
            for each in earlier:
                self._earlier[places[step]] |= 1 << places[each]
                self._later[places[each]] |= 1 << places[step]
        for link in plan.links:
            if link.producer in places and link.consumer in places:
                self._joined[places[link.producer]] |= 1 << places[link.consumer]
                self._joined[places[link.consumer]] |= 1 << places[link.producer]

    @cached_property
    def subsequences(self) -> list[Positions]:
        """All connected sets of at least two steps such that no other step must come between them."""
        found: dict[Positions, None] = {}
        grown = dict.fromkeys(1 << place for place in range(len(self.plan.steps)))
        for _ in range(LONGEST - 1):
            grown = dict.fromkeys(
                each | 1 << place for each in grown for place in _places(_union(self._joined, each) & ~each)
            )
            found.update(grown)
        return [each for each in found if self._convex(each)]

    def _convex(self, positions: Positions) -> bool:
        between = _union(self._earlier, positions) & _union(self._later, positions)
        return not between & ~positions

    def before(self, positions: Positions) -> Positions:
        """The other steps that must come before at least one of these."""
        return _union(self._earlier, positions) & ~positions

    def steps(self, positions: Positions) -> tuple[Step, ...]:
        """The steps at these positions, in the order of the plan."""
        return tuple(self.plan.steps[place] for place in _places(positions))

    def operators(self, positions: Positions) -> tuple[Function, ...]:
        """The operators of the steps at these positions."""
        return tuple(step.operator for step in self.steps(positions))


def _places(positions: Positions) -> Iterator[int]:
    while positions:
        low = positions & -positions
        yield low.bit_length() - 1
        positions ^= low


def _union(sets: Sequence[Positions], positions: Positions) -> Positions:
    found = 0
    for place in _places(positions):
        found |= sets[place]
    return found
