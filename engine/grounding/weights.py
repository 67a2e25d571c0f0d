"""Criticalities: how heavy each atom is as a goal, given by the domain or derived from the operators."""

from collections.abc import Sequence

import networkx as nx

from engine.model.task import GroundOperator, indices
from kb.model.domain import Domain
from kb.terms import Atom


def weights(domain: Domain, atoms: Sequence[Atom], operators: Sequence[GroundOperator]) -> tuple[int, ...]:
    """One weight per atom. A weight left out is one more than the heaviest predicate that achieving it needs.

    Predicates that need each other weigh the same (Knoblock 1994, ordered abstraction hierarchies). Complementary
    atoms weigh like their positives, stage counters more than anything.
    """
    derived = _derived(atoms, operators)
    by_predicate = {name: _given(domain, name, derived) for name in {_predicate(atom) for atom in atoms}}
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


def _derived(atoms: Sequence[Atom], operators: Sequence[GroundOperator]) -> dict[str, int]:
    needs: nx.DiGraph[str] = nx.DiGraph()
    needs.add_nodes_from(sorted({_predicate(atom) for atom in atoms}))
    edges = set()
    for operator in operators:
        needed = {_predicate(atoms[index]) for index in indices(operator.preconditions)}
        edges |= {(_predicate(atoms[index]), name) for index in indices(operator.adds) for name in needed}
    needs.add_edges_from(sorted(edges))
    condensed = nx.condensation(needs)
    level: dict[int, int] = {}
    for component in reversed(list(nx.topological_sort(condensed))):
        level[component] = 1 + max((level[below] for below in condensed.successors(component)), default=0)
    return {name: level[component] for name, component in condensed.graph["mapping"].items()}
