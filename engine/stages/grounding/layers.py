"""The rules of derived atoms that are not replaced by their definitions, as axioms of the task."""

from collections.abc import Callable, Mapping

from cellwright.engine.model.axioms import Axiom, Axioms
from cellwright.engine.stages.grounding.derived import Rules
from cellwright.engine.stages.grounding.numbering import DERIVED, Numbering
from cellwright.kb.graphs import components


def axioms(rules: Rules, numbering: Numbering, compares: Callable[[int], bool]) -> Axioms | None:
    """The axioms of all derived atoms that have numbers, and of those that they depend on; None if there are none.

    Where an atom has to be false, all that breaks its rules gets numbers, too. An atom that `compares` quantities has no rules.
    """
    waiting = [signed for signed in numbering.added if _is_derived(signed)]
    if not waiting:
        return None
    seen = set(waiting)
    while waiting:
        signed = waiting.pop()
        needed = _needed(signed, rules)
        numbering.bits(needed)
        more = {each: None for each in needed if _is_derived(each) and each not in seen}
        seen.update(more)
        waiting += more
    ruled = [
        atom for signed in numbering.added if _is_derived(signed) and not compares(atom := _atom(signed))
    ]
    return _layered(rules, numbering, set(ruled)) if ruled else None


def _needed(signed: int, rules: Rules) -> list[int]:
    """What has to have a number because a derived atom has to be true, or false."""
    if signed >= 0:
        return [each for body in rules.get(signed, ()) for each in body]
    return [~signed, *(~each for body in rules.get(~signed, ()) for each in body)]


def _layered(rules: Rules, numbering: Numbering, kept: set[int]) -> Axioms:
    numbers = {atom: numbering.number(atom) for atom in sorted(kept)}
    needs = {
        atom: [_atom(e) for body in rules.get(atom, ()) for e in body if _atom(e) in kept] for atom in numbers
    }
    found: list[Axiom] = []
    layers: dict[int, int] = {}
    for layer, component in enumerate(components(needs)):
        for atom in sorted(component):
            layers[numbers[atom]] = layer
            found += [Axiom(numbers[atom], numbering.bits(body)) for body in rules.get(atom, ())]
    return Axioms(
        numbering.size + len(numbering.added), tuple(dict.fromkeys(found)), layers, _complements(numbering)
    )


def _complements(numbering: Numbering) -> Mapping[int, int]:
    return {
        numbering.number(~signed): number for signed, number in list(numbering.added.items()) if signed < 0
    }


def _is_derived(signed: int) -> bool:
    return _atom(signed) >= DERIVED


def _atom(signed: int) -> int:
    return signed if signed >= 0 else ~signed
