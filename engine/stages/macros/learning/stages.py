"""Workflow chains with variables: which step reached which stage, and which terms this makes equal."""

from engine.stages.macros.learning.proof import Proof
from engine.stages.macros.lifted.schema import NotGeneral
from kb.model.domain import Kind
from kb.model.macro import MacroChain
from kb.model.plan import GOAL, Step
from kb.model.problem import Problem
from kb.model.workflow import advanced, lasting
from kb.terms import Atom, Function, Term, Text, Variable, match


def lifted_chains(problem: Problem, proof: Proof) -> tuple[MacroChain, ...]:
    """The chains of a problem with variables. Each stage equals the event or consequence that reached it."""
    names = {chain.name: _named(chain.name, proof) for chain in problem.chains}
    subjects: dict[Term, Variable] = {}
    lasts = lasting(problem.chains, problem.domain)
    reached = _reached(problem, proof)
    made = []
    for chain in problem.chains:
        pairs = zip(chain.stages, reached[chain.name], strict=True)
        stages = tuple(_stage(stage, step, atom, proof) for stage, (step, atom) in pairs)
        if chain.name in lasts:
            proof.need(stages[-1], True, GOAL)
        subject = None
        if chain.subject is not None:
            subject = subjects.setdefault(chain.subject, _value(chain.subject, "Subject", proof))
        made.append(
            MacroChain(names[chain.name], stages, tuple(names[each] for each in chain.after), subject)
        )
    return tuple(made)


def _named(name: str, proof: Proof) -> Variable:
    return _value(Text(name), "Chain", proof)


def _value(term: Term, base: str, proof: Proof) -> Variable:
    fresh = proof.world.schemas.fresh(Variable(base))
    proof.origin[fresh] = term
    return fresh


def _stage(stage: Atom, step: Step, atom: Atom, proof: Proof) -> Atom:
    """The stage with a variable for each argument, made equal to the event or consequence that reached it."""
    lifted = Function(stage.name, tuple(_value(each, "Value", proof) for each in atom.arguments))
    schema = proof.schemas[step.id]
    if proof.world.schemas.kinds.get(stage.name) is Kind.EVENT:
        for event in schema.events:
            known = {v: proof.origin[v] for v in proof.origin if v in set(schema.variables())}
            if match(event, atom, known) is not None:
                proof.equal.join(event, lifted)
                return lifted
        raise NotGeneral(f"step {step.id} does not cause the event {atom}")
    proof.produce(step.id, lifted, atom, True)
    return lifted


def _reached(problem: Problem, proof: Proof) -> dict[str, list[tuple[Step, Atom]]]:
    """The steps that reached the stages of each chain, and the atoms by which they did.

    Stages are reached at the first chance.
    """
    found: dict[str, list[tuple[Step, Atom]]] = {chain.name: [] for chain in problem.chains}
    for step in proof.plan.steps:
        change = proof.changes[step.id]
        counts = {name: len(steps) for name, steps in found.items()}
        moved, unexpected = advanced(problem.chains, counts, change.events, sorted(change.adds, key=str))
        if unexpected:
            raise NotGeneral(f"{unexpected[0]} is not the next stage of any chain")
        for name, atom in moved.items():
            found[name].append((step, atom))
    missing = next((c.name for c in problem.chains if len(found[c.name]) < len(c.stages)), None)
    if missing is not None:
        raise NotGeneral(f"the workflow of {missing} is not finished")
    return found
