"""What a belief means for the world model: certainty of assertions, and the changes at the end."""

from collections.abc import Iterable, Mapping

from cellwright.engine.model.troubleshooting import CaseDiagnosis, CaseHypothesis, Revision
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.terms import Atom, Function, Term, Variable, substitute_atom, substitute_term

Binding = Mapping[Variable, Term]


def binding_of(model: FaultModel, exception: str, step: Function | None) -> Binding:
    """The values that the interrupted step gives to the exception's variables; empty for
    another operator.
    """
    pattern = model.exceptions[exception].operator
    if pattern is None or step is None or pattern.name != step.name:
        return {}
    pairs = zip(pattern.arguments, step.arguments, strict=True)
    return {variable: term for variable, term in pairs if isinstance(variable, Variable)}


def assertion_certainties(
    model: FaultModel, belief: Iterable[tuple[CaseHypothesis, float]], binding: Binding
) -> dict[Atom, float]:
    """For each assertion in doubt, the probability that no cause puts it in doubt."""
    doubted: dict[Atom, float] = {}
    for hypothesis, probability in belief:
        atoms = {a for c in hypothesis.causes for a in bind_atoms(model.causes[c].doubts, binding)}
        for atom in sorted(atoms, key=str):
            doubted[atom] = doubted.get(atom, 0.0) + probability
    return {atom: max(0.0, 1.0 - doubt) for atom, doubt in doubted.items()}


def world_revision(
    model: FaultModel, diagnosis: CaseDiagnosis, binding: Binding, repaired: str | None = None
) -> Revision:
    """The changes that the cause makes to the world model, then those of its repair.

    Assertions that were doubted without reason are restored.
    """
    causes = (
        list(diagnosis.hypotheses[0][0].causes)
        if diagnosis.isolated and diagnosis.hypotheses
        else []
    )
    withdrawn: dict[Atom, str] = {}
    asserted: dict[Atom, str] = {}
    lost: list[str] = []
    for cause in causes:
        entry = model.causes[cause]
        withdrawn |= {atom: f"{cause}: {entry.say}" for atom in bind_atoms(entry.denies, binding)}
        asserted |= {atom: f"{cause}: {entry.say}" for atom in bind_atoms(entry.adds, binding)}
        lost += [str(substitute_term(term, binding)) for term in entry.loses]
    if repaired is not None:
        repair = model.repairs[repaired]
        withdrawn |= {
            atom: f"{repaired}: {repair.say}" for atom in bind_atoms(repair.denies, binding)
        }
        for atom in bind_atoms(repair.adds, binding):
            withdrawn.pop(atom, None)
            asserted[atom] = f"{repaired}: {repair.say}"
    if diagnosis.cured or repaired:
        lost = (
            [str(substitute_term(term, binding)) for term in model.repairs[repaired].loses]
            if repaired
            else []
        )
    possible = {cause for hypothesis in diagnosis.counted_on for cause in hypothesis.causes}
    restored = {
        atom: f"{cause} is ruled out"
        for cause in model.exceptions[diagnosis.exception].counts
        if cause not in possible
        for atom in bind_atoms(model.causes[cause].doubts, binding)
        if atom not in withdrawn and not _is_doubted(model, possible, atom, binding)
    }
    return Revision(
        tuple(withdrawn.items()), tuple(asserted.items()), tuple(restored.items()), tuple(lost)
    )


def presupposed_facts(
    domain: Domain, model: FaultModel, exception: str, binding: Binding
) -> tuple[Atom, ...]:
    """The facts that the precondition of the interrupted operator names, with what is known of
    its arguments.
    """
    header = model.exceptions[exception].operator
    operator = next(
        (
            interrupted
            for interrupted in domain.operators
            if header and interrupted.name == header.name
        ),
        None,
    )
    if operator is None or header is None:
        return ()
    names = dict(zip(operator.variables, header.arguments, strict=True))
    parts = (
        part
        for part in goal_parts(operator.precondition)
        if isinstance(part, Literal) and part.positive
    )
    return bind_atoms((substitute_atom(part.atom, names) for part in parts), binding)


def bind_atoms(atoms: Iterable[Atom], binding: Binding) -> tuple[Atom, ...]:
    """The atoms with variables replaced by the arguments of the step."""
    return tuple(substitute_atom(atom, binding) for atom in atoms)


def _is_doubted(model: FaultModel, causes: Iterable[str], atom: Atom, binding: Binding) -> bool:
    return any(atom in bind_atoms(model.causes[cause].doubts, binding) for cause in causes)
