"""Goals of a ground task: the ways to meet each conjunct, and the criticality weights of atoms.

If the ways of all conjuncts have few combinations, each combination becomes an alternative goal of
the task. If they have many, each conjunct gets an atom of its own, and internal operators add these
atoms at the end: `_ends` ends the plan proper, and `_meets(n, k)` says that conjunct n holds in its
k-th way. Internal operators cost nothing and never appear in a plan. Gazen & Knoblock 1997 compile
disjunctive goals in this way, too. Where derived atoms stay in the task, a conjunct that can be met
in several ways is a derived atom itself.
"""

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import prod

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.workflow_replay import ENDS, MEETS
from cellwright.engine.stages.grounding.derived_atoms import Rules, Support
from cellwright.engine.stages.grounding.numbered_atoms import Numbering, Universe
from cellwright.kb.graphs import strong_components
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.terms import Atom, Function, Number

MAX_GOAL_ALTERNATIVES = 64
NO_STAGES: Mapping[str, int] = {}
RUNNING, ENDED = Function("_running"), Function("_ended")


@dataclass(frozen=True, slots=True)
class CountedChain:
    """A chain: the bit of each count of its stages, how many are reached at the start, and what has
    to hold at the end of each number of stages.
    """

    bits: tuple[Bits, ...]
    begun: int
    lasting: tuple[Bits, ...]


@dataclass(frozen=True, slots=True)
class TaskWithoutGoals:
    """A ground task without goals, the ways to satisfy each conjunct of its problem's goal, and
    its chains by their names.
    """

    task: GroundTask
    ways: tuple[tuple[Bits, ...], ...]
    chains: Mapping[str, "CountedChain"] = field(default_factory=dict)

    def wanting(
        self,
        parts: Sequence[int],
        stages: Mapping[str, int] = NO_STAGES,
        free: Collection[str] = (),
    ) -> GroundTask | None:
        """The task with some of the conjuncts as its goal, and with chains up to so many `stages`.

        Those that are `free` may move and need not; the others do not move.

        None if there are too many combinations of the ways of conjuncts.
        """
        chosen = [self.ways[part] for part in parts]
        if prod(map(len, chosen)) > MAX_GOAL_ALTERNATIVES:
            return None
        counts = {
            name: max(stages.get(name, 0), chain.begun) for name, chain in self.chains.items()
        }
        counts |= {name: len(self.chains[name].bits) - 1 for name in free}
        beyond = _union_choice(
            b for name, chain in self.chains.items() for b in chain.bits[counts[name] + 1 :]
        )
        ends = _union_choice(self.chains[name].bits[counts[name]] for name in stages)
        ends |= _union_choice(self.chains[name].lasting[number] for name, number in stages.items())
        goals = dict.fromkeys(ends | _union_choice(choice) for choice in itertools.product(*chosen))
        operators = self.task.operators
        if beyond:
            operators = tuple(operator for operator in operators if not operator.adds & beyond)
        return replace(self.task, operators=operators, goals=tuple(goals))


@dataclass
class GoalAlternatives:
    """The ways to satisfy each conjunct of a goal.

    Additional atoms are numbered from `first` on.
    """

    parts: list[list[Support]]
    first: int
    atoms: list[Atom] = field(init=False)
    initial: Bits = field(init=False)

    def __post_init__(self) -> None:
        product = 1
        for part in self.parts:
            product = min(product * len(part), MAX_GOAL_ALTERNATIVES + 1)
        self._open = [number for number, part in enumerate(self.parts) if len(part) != 1]
        self._many = product > MAX_GOAL_ALTERNATIVES
        met = [Function("_met", (Number(number),)) for number in self._open]
        self.atoms = [RUNNING, ENDED, *met] if self._many else []
        self.initial = 1 << self.first if self._many else 0

    def compiled(
        self, operators: list[GroundOperator], numbering: Numbering
    ) -> tuple[list[Bits], list[GroundOperator]]:
        """The alternative goals, and the operators together with the internal ones."""
        if not self._many:
            alternatives = {
                _join_support_bits(choice, numbering): None
                for choice in itertools.product(*self.parts)
            }
            return list(alternatives), operators
        running, ended = 1 << self.first, 2 << self.first
        goal = ended | _join_support_bits(
            [part[0] for part in self.parts if len(part) == 1], numbering
        )
        running_operators = [
            replace(operator, preconditions=operator.preconditions | running)
            for operator in operators
        ]
        running_operators.append(GroundOperator(Function(ENDS), running, ended, running, cost=0))
        for place, number in enumerate(self._open):
            met = 4 << self.first + place
            goal |= met
            for number_of_way, support in enumerate(self.parts[number]):
                name = Function(MEETS, (Number(number), Number(number_of_way)))
                running_operators.append(
                    GroundOperator(name, numbering.bits(support) | ended, met, 0, cost=0)
                )
        return [goal], running_operators


def derive_alternative_goals(
    parts: Iterable[list[Support]], universe: Universe, rules: Rules
) -> list[list[Support]]:
    """The conjuncts with one way each: what can be met in several ways is an additional derived
    atom with `rules`.
    """
    conjuncts = []
    for number, ways in enumerate(parts):
        if len(ways) > 1:
            met = universe.derive(Function("_met", (Number(number),)))
            rules[met] = [tuple(sorted(support)) for support in ways]
            ways = [frozenset([met])]
        conjuncts.append(ways)
    return conjuncts


def _join_support_bits(choice: Iterable[Support], numbering: Numbering) -> Bits:
    return _union_choice(numbering.bits(support) for support in choice)


def _union_choice(choice: Iterable[Bits]) -> Bits:
    joined = 0
    for mask in choice:
        joined |= mask
    return joined


def criticality_weights(
    domain: Domain, atoms: Sequence[Atom], operators: Sequence[GroundOperator]
) -> tuple[int, ...]:
    """One weight per atom.

    A weight that the domain does not give is one more than the weight of the heaviest predicate
    that is needed to achieve the atom. Predicates that need each other have the same weight
    (Knoblock 1994, ordered abstraction hierarchies). A complementary atom has the weight of its
    positive atom. Stage counters are heavier than everything else.
    """
    names = {_predicate_name(atom) for atom in atoms}
    all_given = all(
        name in domain.predicates and domain.predicates[name].weight is not None for name in names
    )
    derived = {} if all_given else _derive_weights(atoms, operators)
    by_predicate = {name: _given_weight(domain, name, derived) for name in names}
    heaviest = 1 + max(by_predicate.values(), default=0)
    return tuple(
        heaviest if atom.name.startswith("_") else by_predicate[_predicate_name(atom)]
        for atom in atoms
    )


def _given_weight(domain: Domain, name: str, derived: dict[str, int]) -> int:
    predicate = domain.predicates.get(name)
    return (
        derived.get(name, 0) if predicate is None or predicate.weight is None else predicate.weight
    )


def _predicate_name(atom: Atom) -> str:
    if atom.name == "not" and len(atom.arguments) == 1:
        inner = atom.arguments[0]
        return inner.name if isinstance(inner, Atom) else "not"
    return atom.name


def _predicate_masks(atoms: Sequence[Atom]) -> list[tuple[str, Bits]]:
    """The atoms of each predicate, as bitsets."""
    numbers: dict[str, list[int]] = {}
    for number, atom in enumerate(atoms):
        numbers.setdefault(_predicate_name(atom), []).append(number)
    return [(name, bitset(own_numbers)) for name, own_numbers in numbers.items()]


def _predicates_in(masks: list[tuple[str, Bits]], bits: Bits) -> tuple[str, ...]:
    """The predicates of the atoms in a bitset."""
    return tuple([name for name, mask in masks if bits & mask])


def _derive_weights(atoms: Sequence[Atom], operators: Sequence[GroundOperator]) -> dict[str, int]:
    needs: dict[str, set[str]] = {
        name: set() for name in sorted({_predicate_name(atom) for atom in atoms})
    }
    masks = _predicate_masks(atoms)
    signatures = {
        (_predicates_in(masks, operator.adds), _predicates_in(masks, operator.preconditions))
        for operator in operators
    }
    for adds, needed in signatures:
        for added in adds:
            needs[added].update(needed)
    level: dict[str, int] = {}
    for component in strong_components(needs):
        below = {name for member in component for name in needs[member]} - set(component)
        height = 1 + max((level[name] for name in below), default=0)
        level |= dict.fromkeys(component, height)
    return level
