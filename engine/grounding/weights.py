"""Criticalities: how heavy each atom is as a goal, given by the domain or derived from the operators."""

from collections.abc import Sequence

import networkx as nx

from engine.model.task import Bits, GroundOperator, bitset
from kb.model.domain import Domain
from kb.terms import Atom


def weights(domain: Domain, atoms: Sequence[Atom], operators: Sequence[GroundOperator]) -> tuple[int, ...]:
    """One weight per atom. A weight left out is one more than the heaviest predicate that achieving it needs.

    Predicates that need each other weigh the same (Knoblock 1994, ordered abstraction hierarchies). Complementary
    atoms weigh like their positives, stage counters more than anything.
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
    """The atoms of each predicate."""
    numbers: dict[str, list[int]] = {}
    for number, atom in enumerate(atoms):
        numbers.setdefault(_predicate(atom), []).append(number)
    return [(name, bitset(found)) for name, found in numbers.items()]


def _met(masks: list[tuple[str, Bits]], bits: Bits) -> tuple[str, ...]:
    """The predicates of the atoms in a bitset."""
    return tuple([name for name, mask in masks if bits & mask])


def _derived(atoms: Sequence[Atom], operators: Sequence[GroundOperator]) -> dict[str, int]:
    needs: nx.DiGraph[str] = nx.DiGraph()
    needs.add_nodes_from(sorted({_predicate(atom) for atom in atoms}))
    masks = _masks(atoms)
    signatures = {(_met(masks, operator.adds), _met(masks, operator.preconditions)) for operator in operators}
    needs.add_edges_from(
        sorted({(added, name) for adds, needed in signatures for added in adds for name in needed})
    )
    condensed = nx.condensation(needs)
    level: dict[int, int] = {}
    for component in reversed(list(nx.topological_sort(condensed))):
        level[component] = 1 + max((level[below] for below in condensed.successors(component)), default=0)
    return {name: level[component] for name, component in condensed.graph["mapping"].items()}
