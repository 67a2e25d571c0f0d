"""What grounding finds wrong, as diagnostics: violated constraints, operators that contradict themselves, amounts that are none."""

from collections.abc import Iterator

from cellwright.engine.model.task import Bits, indices
from cellwright.engine.stages.grounding.closure import Deduction
from cellwright.engine.stages.grounding.instances import Instances
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.vocabulary import VIOLATED
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function, Number


def violations(problem: Problem, grounder: Grounder) -> Iterator[Diagnostic]:
    """One diagnostic per constraint of the domain that the problem violates."""
    hint = f"change the facts of {problem.name} or of its domain that break this constraint"
    violated = [number.value for (number,) in grounder.atoms(VIOLATED, 1) if isinstance(number, Number)]
    for number in sorted(violated):
        constraint = problem.domain.asp[number]
        said = constraint.under("").strip()
        message = f"the problem {problem.name} violates {said}"
        yield Diagnostic(constraint.where, "K204", message, hint)


def contradictions(made: Instances, universe: Universe) -> Iterator[Diagnostic]:
    """One diagnostic per operator whose consequences contradict each other (Meaning 4)."""
    for operator, found in made.contradictions.items():
        atom = universe.atoms[indices(found.atoms)[0]]
        chain = _chain(made.deduction, universe, found.adds, atom)
        message = f"{found.instance} both adds and denies {atom}: {chain}"
        yield Diagnostic(
            found.operator.where,
            "K301",
            message,
            f"add conditions to the deductive operators that {operator} triggers",
        )


def amiss(made: Instances) -> Iterator[Diagnostic]:
    """One diagnostic per operator and fault, for an instance whose duration or cost is no amount."""
    for each in made.amiss.values():
        yield Diagnostic(each.operator.where, each.code, each.message, each.hint)


def _chain(deduced: Deduction, universe: Universe, adds: Bits, atom: Function) -> str:
    bit = 1 << universe.index[atom]
    adder = next((i for i in indices(adds) if deduced.implied[i] & bit), None)
    denier = next((i for i in indices(adds) if deduced.denied[i] & bit), None)
    said = [
        f"{universe.atoms[i]} {verb} it"
        for i, verb in ((adder, "adds or implies"), (denier, "denies"))
        if i is not None
    ]
    return ", ".join(said) or "this follows from what it denies"
