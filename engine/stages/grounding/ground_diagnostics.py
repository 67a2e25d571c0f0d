"""Diagnostics of grounding: broken constraints, contradictions, invalid amounts, doubts."""

from collections.abc import Iterator, Sequence

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.stages.grounding.atom_deduction import Deduction
from cellwright.engine.stages.grounding.numbered_atoms import Universe
from cellwright.engine.stages.grounding.operator_instances import DoubtfulDenial, Instances
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.static_program import VIOLATED
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.domain_model import Domain, Operator
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number


def find_ambiguities(
    domain: Domain, doubts: Sequence[DoubtfulDenial], atoms: Sequence[Atom], groups: Sequence[Bits]
) -> Iterator[Diagnostic]:
    """One diagnostic for each operator that denies an atom which may or may not have been true
    before.

    This is open if the preconditions neither contain the atom nor exclude it.
    """
    rivals = _Rivals(groups)
    schemas: dict[str, Operator] = {operator.name: operator for operator in domain.operators}
    reported: set[str] = set()
    for doubt in doubts:
        name = doubt.instance.name
        if name in reported or not (open_atoms := doubt.atoms & ~rivals.of(doubt.preconditions)):
            continue
        reported.add(name)
        atom = indices(open_atoms)[0]
        message = (
            f"{doubt.instance} denies {atoms[atom]}; what follows depends on whether it was "
            "true before"
        )
        hint = f"add this atom, or one that excludes it, to the preconditions of {name}"
        yield Diagnostic(schemas[name].where, "K302", message, hint)


class _Rivals:
    """The atoms that are never true together with a given atom; they are looked up once for
    each atom.
    """

    def __init__(self, groups: Sequence[Bits]) -> None:
        self.groups = groups
        self.known: dict[int, Bits] = {}

    def of(self, atoms: Bits) -> Bits:
        """All atoms that are excluded by at least one atom of a set."""
        rivals = 0
        for atom in indices(atoms):
            if atom not in self.known:
                self.known[atom] = self._excluded(1 << atom)
            rivals |= self.known[atom]
        return rivals

    def _excluded(self, bit: Bits) -> Bits:
        excluded = 0
        for group in self.groups:
            if group & bit:
                excluded |= group & ~bit
        return excluded


def violated_constraints(problem: Problem, grounder: Grounder) -> Iterator[Diagnostic]:
    """One diagnostic per constraint of the domain that the problem violates."""
    hint = f"change the facts of {problem.name} or of its domain that break this constraint"
    violated = [
        number.value for (number,) in grounder.atoms(VIOLATED, 1) if isinstance(number, Number)
    ]
    for number in sorted(violated):
        constraint = problem.domain.asp[number]
        wording = constraint.under("").strip()
        message = f"the problem {problem.name} violates {wording}"
        yield Diagnostic(constraint.where, "K204", message, hint)


def report_contradictions(instances: Instances, universe: Universe) -> Iterator[Diagnostic]:
    """One diagnostic per operator whose consequences contradict each other (Meaning 4)."""
    for operator, contradiction in instances.contradictions.items():
        atom = universe.atoms[indices(contradiction.atoms)[0]]
        chain = _consequence_chain(instances.deduction, universe, contradiction.adds, atom)
        message = f"{contradiction.instance} both adds and denies {atom}: {chain}"
        yield Diagnostic(
            contradiction.operator.where,
            "K301",
            message,
            f"add conditions to the deductive operators that {operator} triggers",
        )


def report_invalid_amounts(instances: Instances) -> Iterator[Diagnostic]:
    """One diagnostic per operator and fault, for an instance whose duration or cost is no
    amount.
    """
    for fault in instances.amiss.values():
        yield Diagnostic(fault.operator.where, fault.code, fault.message, fault.hint)


def _consequence_chain(deduced: Deduction, universe: Universe, adds: Bits, atom: Function) -> str:
    bit = 1 << universe.index[atom]
    adder = next((i for i in indices(adds) if deduced.implied[i] & bit), None)
    denier = next((i for i in indices(adds) if deduced.denied[i] & bit), None)
    clauses = [
        f"{universe.atoms[i]} {verb} it"
        for i, verb in ((adder, "adds or implies"), (denier, "denies"))
        if i is not None
    ]
    return ", ".join(clauses) or "this follows from what it denies"
