"""A workflow with variables: which step reached which stage, and what that makes equal."""

from engine.stages.macros.learning.proof import Proof
from engine.stages.macros.lifted.schema import NotGeneral
from engine.stages.macros.lifted.world import Change
from kb.model.domain import Kind
from kb.model.macro import MacroChain
from kb.model.plan import GOAL, Step
from kb.model.problem import Chain, Problem, superseded
from kb.terms import Atom, Function, Term, Text, Variable, is_ground, match


def lifted_chains(problem: Problem, proof: Proof) -> tuple[MacroChain, ...]:
    """The chains of a problem with variables, every stage equal to the event or consequence that reached it."""
    names = {chain.name: _named(chain.name, proof) for chain in problem.chains}
    subjects: dict[Term, Variable] = {}
    passing = superseded(problem.chains)
    reached = _reached(problem, proof)
    made = []
    for chain in problem.chains:
        pairs = zip(chain.stages, reached[chain.name], strict=True)
        stages = tuple(_stage(stage, step, atom, proof) for stage, (step, atom) in pairs)
        last = chain.stages[-1]
        fluent = proof.world.schemas.kinds.get(last.name) is Kind.FLUENT
        if fluent and is_ground(last) and chain.name not in passing:
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
    """The stage with a variable for each argument, made equal to what reached it."""
    lifted = Function(stage.name, tuple(_value(each, "Value", proof) for each in atom.arguments))
    schema = proof.schemas[step.id]
    if proof.world.schemas.kinds.get(stage.name) is Kind.EVENT:
        for event in schema.events:
            known = {v: proof.origin[v] for v in proof.origin if v in set(schema.variables())}
            if match(event, atom, known) is not None:
                proof.equal.join(event, lifted)
                return lifted
        raise NotGeneral(f"step {step.id} does not let {atom} happen")
    proof.produce(step.id, lifted, atom, True)
    return lifted


def _reached(problem: Problem, proof: Proof) -> dict[str, list[tuple[Step, Atom]]]:
    """For every chain the steps that reached its stages, as soon as possible, with the atoms that did."""
    found: dict[str, list[tuple[Step, Atom]]] = {chain.name: [] for chain in problem.chains}
    for step in proof.plan.steps:
        change = proof.changes[step.id]
        events = list(change.events)
        ready = [chain for chain in problem.chains if _may_advance(chain, found, problem)]
        for chain in ready:
            atom = _reaching(chain.stages[len(found[chain.name])], change, events)
            if atom is not None:
                found[chain.name].append((step, atom))
                if atom in events:
                    events.remove(atom)
        if events:
            raise NotGeneral(f"{events[0]} is not the next stage of any chain")
    missing = next((c.name for c in problem.chains if len(found[c.name]) < len(c.stages)), None)
    if missing is not None:
        raise NotGeneral(f"the workflow of {missing} is not finished")
    return found


def _may_advance(chain: Chain, found: dict[str, list[tuple[Step, Atom]]], problem: Problem) -> bool:
    done = len(found[chain.name])
    if done == len(chain.stages):
        return False
    lengths = {each.name: len(each.stages) for each in problem.chains}
    return done > 0 or all(len(found[name]) == lengths[name] for name in chain.after)


def _reaching(stage: Atom, change: Change, events: list[Atom]) -> Atom | None:
    candidates = [*events, *sorted(change.adds, key=str)]
    return next((atom for atom in candidates if match(stage, atom, {}) is not None), None)
