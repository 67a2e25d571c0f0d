"""Criticality weights: how important each atom is as a goal.

The domain gives them, or they are derived from the operators.
"""

from collections.abc import Sequence

from cellwright.engine.model.task import Bits, GroundOperator, bitset
from cellwright.kb.graphs import components
from cellwright.kb.model.domain import Domain
from cellwright.kb.terms import Atom


def weights(domain: Domain, atoms: Sequence[Atom], operators: Sequence[GroundOperator]) -> tuple[int, ...]:
    """One weight per atom.

    A weight that the domain does not give is one more than the weight of the heaviest predicate that is
    needed to achieve the atom. Predicates that need each other have the same weight (Knoblock 1994, ordered
    abstraction hierarchies). A complementary atom has the weight of its positive atom. Stage counters are
    heavier than everything else.
    """
    names = {_predicate(atom) for atom in atoms}
    given = all(name in domain.predicates and domain.predicates[name].weight is not None for name in names)
    derived = {} if given else _derived(atoms, operators)
    by_predicate = {name: _given(domain, name, derived) for name in names}
    heaviest = 1 + max(by_predicate.values(), default=0)
    return tuple(heaviest if atom.name.startswith("_") else by_predicate[_predicate(atom)] for atom in atoms)


def _given(domain: Domain, name: str, derived: dict[str, int]) -> int:
    predicate = domain.predicates.get(name)
    return derived.get(name, 0) if predicate is None or predicate.weight is None else predicate.weight


def _predicate(atom: Atom) -> str:
    if atom.name == "not" and len(atom.arguments) == 1:
        inner = atom.arguments[0]
        return inner.name if isinstance(inner, Atom) else "not"
    return atom.name


def _masks(atoms: Sequence[Atom]) -> list[tuple[str, Bits]]:
    """The atoms of each predicate, as bitsets."""
    numbers: dict[str, list[int]] = {}
    for number, atom in enumerate(atoms):
        numbers.setdefault(_predicate(atom), []).append(number)
    return [(name, bitset(found)) for name, found in numbers.items()]


def _met(masks: list[tuple[str, Bits]], bits: Bits) -> tuple[str, ...]:
    """The predicates of the atoms in a bitset."""
    return tuple([name for name, mask in masks if bits & mask])


def _derived(atoms: Sequence[Atom], operators: Sequence[GroundOperator]) -> dict[str, int]:
    needs: dict[str, set[str]] = {name: set() for name in sorted({_predicate(atom) for atom in atoms})}
    masks = _masks(atoms)
    signatures = {(_met(masks, operator.adds), _met(masks, operator.preconditions)) for operator in operators}
    for adds, needed in signatures:
        for added in adds:
            needs[added].update(needed)
    level: dict[str, int] = {}
    for component in components(needs):
        below = {name for member in component for name in needs[member]} - set(component)
        height = 1 + max((level[name] for name in below), default=0)
        level |= dict.fromkeys(component, height)
    return level
