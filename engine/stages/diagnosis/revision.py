"""What a belief means for the world model: how certain assertions are now, and what changes at the end."""

from collections.abc import Iterable, Mapping

from cellwright.engine.model.cases import Diagnosis, Hypothesis, Revision
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.faults import FaultModel
from cellwright.kb.terms import Atom, Function, Term, Variable, substitute, substitute_atom

Binding = Mapping[Variable, Term]


def binding_of(model: FaultModel, exception: str, step: Function | None) -> Binding:
    """The values that the interrupted step gives to the exception's variables; empty for another operator."""
    pattern = model.exceptions[exception].operator
    if pattern is None or step is None or pattern.name != step.name:
        return {}
    pairs = zip(pattern.arguments, step.arguments, strict=True)
    return {variable: term for variable, term in pairs if isinstance(variable, Variable)}


def certainties(
    model: FaultModel, belief: Iterable[tuple[Hypothesis, float]], binding: Binding
) -> dict[Atom, float]:
    """For each assertion in doubt, the probability that no cause puts it in doubt."""
    doubted: dict[Atom, float] = {}
    for hypothesis, probability in belief:
        atoms = {a for c in hypothesis.causes for a in bound(model.causes[c].doubts, binding)}
        for atom in sorted(atoms, key=str):
            doubted[atom] = doubted.get(atom, 0.0) + probability
    return {atom: max(0.0, 1.0 - doubt) for atom, doubt in doubted.items()}


def revision(model: FaultModel, made: Diagnosis, binding: Binding, repaired: str | None = None) -> Revision:
    """The changes that the cause makes to the world model, then those of its repair.

    Assertions that were doubted without reason are restored.
    """
    causes = list(made.hypotheses[0][0].causes) if made.isolated and made.hypotheses else []
    withdrawn: dict[Atom, str] = {}
    asserted: dict[Atom, str] = {}
    lost: list[str] = []
    for cause in causes:
        entry = model.causes[cause]
        withdrawn |= {atom: f"{cause}: {entry.say}" for atom in bound(entry.denies, binding)}
        asserted |= {atom: f"{cause}: {entry.say}" for atom in bound(entry.adds, binding)}
        lost += [str(substitute(term, binding)) for term in entry.loses]
    if repaired is not None:
        repair = model.repairs[repaired]
        withdrawn |= {atom: f"{repaired}: {repair.say}" for atom in bound(repair.denies, binding)}
        for atom in bound(repair.adds, binding):
            withdrawn.pop(atom, None)
            asserted[atom] = f"{repaired}: {repair.say}"
    if made.cured or repaired:
        lost = [str(substitute(term, binding)) for term in model.repairs[repaired].loses] if repaired else []
    possible = {cause for hypothesis, _ in made.hypotheses for cause in hypothesis.causes}
    restored = {
        atom: f"{cause} is ruled out"
        for cause in model.exceptions[made.exception].counts
        if cause not in possible
        for atom in bound(model.causes[cause].doubts, binding)
        if atom not in withdrawn and not _doubted(model, possible, atom, binding)
    }
    return Revision(tuple(withdrawn.items()), tuple(asserted.items()), tuple(restored.items()), tuple(lost))


def presupposed(domain: Domain, model: FaultModel, exception: str, binding: Binding) -> tuple[Atom, ...]:
    """The facts that the precondition of the interrupted operator names, with what is known of its arguments."""
    header = model.exceptions[exception].operator
    operator = next((each for each in domain.operators if header and each.name == header.name), None)
    if operator is None or header is None:
        return ()
    names = dict(zip(operator.variables, header.arguments, strict=True))
    parts = (
        part for part in goal_parts(operator.precondition) if isinstance(part, Literal) and part.positive
    )
    return bound((substitute_atom(part.atom, names) for part in parts), binding)


def bound(atoms: Iterable[Atom], binding: Binding) -> tuple[Atom, ...]:
    """The atoms with variables replaced by the arguments of the step."""
    return tuple(substitute_atom(atom, binding) for atom in atoms)


def _doubted(model: FaultModel, causes: Iterable[str], atom: Atom, binding: Binding) -> bool:
    return any(atom in bound(model.causes[cause].doubts, binding) for cause in causes)
