"""Workflow chains with variables: which step reached which stage, and which terms this makes equal."""

from collections.abc import Sequence

from cellwright.engine.stages.macros.learning.proof import Proof
from cellwright.engine.stages.macros.lifted.facts import Facts
from cellwright.engine.stages.macros.lifted.schema import NotGeneral
from cellwright.kb.model.domain import Kind
from cellwright.kb.model.macro import MacroChain
from cellwright.kb.model.plan import GOAL, Step
from cellwright.kb.model.problem import Chain, Problem
from cellwright.kb.model.workflow import Reached, advanced, begun, holding, lasting, those_reaching
from cellwright.kb.terms import TOGETHER, Atom, Function, Term, Text, Variable, match, ordered


def lifted_chains(problem: Problem, proof: Proof) -> tuple[MacroChain, ...]:
    """The chains of a problem with variables, every stage equal to the event or consequence that reached it.

    Chains that were finished before the first step are left out.
    """
    if any(stage.name == TOGETHER for chain in problem.chains for stage in chain.stages):
        raise NotGeneral("a stage of the workflow has several conditions")
    reached = _reached(problem, proof)
    chains = [chain for chain in problem.chains if any(step is not None for step, _ in reached[chain.name])]
    names = {chain.name: _named(chain.name, proof) for chain in chains}
    subjects: dict[Term, Variable] = {}
    lasts = lasting(problem.chains, problem.domain)
    made = []
    for chain in chains:
        stages = tuple(_stage(step, atom, proof) for step, atom in reached[chain.name])
        if chain.name in lasts:
            proof.need(stages[-1], True, GOAL)
        subject = None
        if chain.subject is not None:
            subject = subjects.setdefault(chain.subject, _value(chain.subject, "Subject", proof))
        made.append(
            MacroChain(
                names[chain.name],
                stages,
                tuple(names[each] for each in chain.after if each in names),
                subject,
            )
        )
    return tuple(made)


def _named(name: str, proof: Proof) -> Variable:
    return _value(Text(name), "Chain", proof)


def _value(term: Term, base: str, proof: Proof) -> Variable:
    fresh = proof.world.schemas.fresh(Variable(base))
    proof.origin[fresh] = term
    return fresh


def _stage(step: Step | None, atom: Atom, proof: Proof) -> Atom:
    """The stage with a variable for each argument, made equal to what reached it; None is the start."""
    lifted = Function(atom.name, tuple(_value(each, "Value", proof) for each in atom.arguments))
    if proof.world.schemas.kinds.get(atom.name) is Kind.EVENT:
        assert step is not None  # no event happens before the first step
        _happening(step, atom, lifted, proof)
    elif step is not None and atom in proof.changes[step.id].adds:
        proof.produce(step.id, lifted, atom, True)
    elif atom in proof.states[GOAL]:
        proof.need(lifted, True, GOAL)
    else:
        raise NotGeneral(f"{atom} held before its turn came")
    return lifted


def _happening(step: Step, atom: Atom, lifted: Atom, proof: Proof) -> None:
    """Make an event equal to the one that a step lets happen."""
    schema = proof.schemas[step.id]
    for event in schema.events:
        known = {v: proof.origin[v] for v in proof.origin if v in set(schema.variables())}
        if match(event, atom, known) is not None:
            proof.equal.join(event, lifted)
            return
    raise NotGeneral(f"step {step.id} does not let {atom} happen")


def _reached(problem: Problem, proof: Proof) -> dict[str, list[tuple[Step | None, Atom]]]:
    """For every chain the steps that reached its stages, as soon as possible, with the atoms that did; None is the
    start."""
    found: dict[str, list[tuple[Step | None, Atom]]] = {chain.name: [] for chain in problem.chains}
    facts = Facts(ordered(proof.initial))
    counts = begun(problem.chains, holding(facts))
    _note(problem.chains, counts, None, facts, found)
    for step in proof.plan.steps:
        change = proof.changes[step.id]
        facts = change.applied(facts)
        counts, unexpected = advanced(problem.chains, counts, change.events, holding(facts))
        if unexpected:
            raise NotGeneral(f"{unexpected[0]} is not the next stage of any chain")
        _note(problem.chains, counts, step, facts, found)
    missing = next((c.name for c in problem.chains if len(found[c.name]) < len(c.stages)), None)
    if missing is not None:
        raise NotGeneral(f"the workflow of {missing} is not finished")
    return found


def _note(
    chains: Sequence[Chain],
    counts: Reached,
    step: Step | None,
    facts: Facts,
    found: dict[str, list[tuple[Step | None, Atom]]],
) -> None:
    """Note what reached the stages that are new, an event or a fact."""
    for chain in chains:
        own = found[chain.name]
        for stage in chain.stages[len(own) : counts[chain.name]]:
            own.append((step, next(those_reaching(stage, facts), stage)))
