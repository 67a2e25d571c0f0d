"""Generalisation of a plan to a MACROP: its goals and its workflow chains, with variables."""

from collections.abc import Sequence

from cellwright.engine.stages.lifted.cell_domain import CellDomain, State
from cellwright.engine.stages.lifted.fact_queries import FactSet
from cellwright.engine.stages.lifted.operator_schemas import NotGeneral
from cellwright.engine.stages.macros.learning.macro_extraction import GeneralisedPlan, MacroReader
from cellwright.engine.stages.macros.learning.plan_proof import PlanProof
from cellwright.engine.stages.macros.learning.proof_safety import ProofSafety
from cellwright.kb.model.conditions import BodyPart, Condition, Exists, Literal, goal_parts
from cellwright.kb.model.domain_model import Kind
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, MacroChain, Plan, Step
from cellwright.kb.model.planning_problem import (
    Chain,
    Problem,
    Reached,
    advance_chains,
    final_stages,
    initial_progress,
    stage_holds,
    those_reaching,
)
from cellwright.kb.terms import (
    TOGETHER_SIGN,
    Atom,
    Function,
    Term,
    Text,
    Variable,
    match_term,
    sort_naturally,
    term_variables,
)


def lifted_chains(problem: Problem, proof: PlanProof) -> tuple[MacroChain, ...]:
    """The chains of a problem with variables, every stage equal to the event or consequence that
    reached it.

    Chains that were finished before the first step are left out.
    """
    if any(stage.name == TOGETHER_SIGN for chain in problem.chains for stage in chain.stages):
        raise NotGeneral("a stage of the workflow has several conditions")
    reached = _reached_stages(problem, proof)
    chains = [
        chain
        for chain in problem.chains
        if any(step is not None for step, _ in reached[chain.name])
    ]
    names = {chain.name: _chain_variable(chain.name, proof) for chain in chains}
    subjects: dict[Term, Variable] = {}
    lasts = final_stages(problem.chains, problem.domain)
    macro_chains = []
    for chain in chains:
        stages = tuple(_lifted_stage(step, atom, proof) for step, atom in reached[chain.name])
        if chain.name in lasts:
            proof.need(stages[-1], True, GOAL_STEP)
        subject = None
        if chain.subject is not None:
            subject = subjects.setdefault(
                chain.subject, _fresh_variable(chain.subject, "Subject", proof)
            )
        macro_chains.append(
            MacroChain(
                names[chain.name],
                stages,
                tuple(names[name] for name in chain.after if name in names),
                subject,
            )
        )
    return tuple(macro_chains)


def _chain_variable(name: str, proof: PlanProof) -> Variable:
    return _fresh_variable(Text(name), "Chain", proof)


def _fresh_variable(term: Term, base: str, proof: PlanProof) -> Variable:
    fresh = proof.world.schemas.fresh(Variable(base))
    proof.origin[fresh] = term
    return fresh


def _lifted_stage(step: Step | None, atom: Atom, proof: PlanProof) -> Atom:
    """The stage with a variable for each argument, made equal to what reached it; None is the
    start.
    """
    lifted = Function(
        atom.name, tuple(_fresh_variable(argument, "Value", proof) for argument in atom.arguments)
    )
    if proof.world.schemas.kinds.get(atom.name) is Kind.EVENT:
        assert step is not None  # no event happens before the first step
        _join_event(step, atom, lifted, proof)
    elif step is not None and atom in proof.changes[step.id].adds:
        proof.produce(step.id, lifted, atom, True)
    elif atom in proof.states[GOAL_STEP]:
        proof.need(lifted, True, GOAL_STEP)
    else:
        raise NotGeneral(f"{atom} held before its turn came")
    return lifted


def _join_event(step: Step, atom: Atom, lifted: Atom, proof: PlanProof) -> None:
    """Make an event equal to the one that a step lets happen."""
    schema = proof.schemas[step.id]
    for event in schema.events:
        origins = {v: proof.origin[v] for v in proof.origin if v in set(schema.variables())}
        if match_term(event, atom, origins) is not None:
            proof.equal.join(event, lifted)
            return
    raise NotGeneral(f"step {step.id} does not let {atom} happen")


def _reached_stages(
    problem: Problem, proof: PlanProof
) -> dict[str, list[tuple[Step | None, Atom]]]:
    """For every chain the steps that reached its stages, as soon as possible, with the atoms that
    did; None is the start."""
    stages_reached: dict[str, list[tuple[Step | None, Atom]]] = {
        chain.name: [] for chain in problem.chains
    }
    facts = FactSet(sort_naturally(proof.initial))
    counts = initial_progress(problem.chains, stage_holds(facts))
    _note_reached(problem.chains, counts, None, facts, stages_reached)
    for step in proof.plan.steps:
        change = proof.changes[step.id]
        facts = change.applied(facts)
        counts, unexpected = advance_chains(
            problem.chains, counts, change.events, stage_holds(facts)
        )
        if unexpected:
            raise NotGeneral(f"{unexpected[0]} is not the next stage of any chain")
        _note_reached(problem.chains, counts, step, facts, stages_reached)
    missing = next(
        (c.name for c in problem.chains if len(stages_reached[c.name]) < len(c.stages)), None
    )
    if missing is not None:
        raise NotGeneral(f"the workflow of {missing} is not finished")
    return stages_reached


def _note_reached(
    chains: Sequence[Chain],
    counts: Reached,
    step: Step | None,
    facts: FactSet,
    stages_reached: dict[str, list[tuple[Step | None, Atom]]],
) -> None:
    """Note what reached the stages that are new, an event or a fact."""
    for chain in chains:
        own = stages_reached[chain.name]
        for stage in chain.stages[len(own) : counts[chain.name]]:
            own.append((step, next(those_reaching(stage, facts), stage)))


__all__ = ["GeneralisedPlan", "NotGeneral", "generalise_plan"]


def generalise_plan(
    problem: Problem, plan: Plan, world: CellDomain, initial: State
) -> GeneralisedPlan:
    """The MACROP of a valid plan from the state `initial`.

    Raises `NotGeneral` with the reason if there is none.

    Goals that no step had to achieve are not goals of the MACROP.
    """
    if not plan.steps:
        raise NotGeneral("a plan without steps teaches nothing")
    if problem.domain.counts_fluents:
        raise NotGeneral("rules of this domain count what can change")
    if problem.domain.quantities:
        raise NotGeneral("this domain has quantities, which no MACROP generalises")
    if any(world.schemas.named(step.operator.name).batches for step in plan.steps):
        raise NotGeneral("a step lets an event happen to all that is there")
    proof = PlanProof(world, plan, initial)
    for step in plan.steps:
        proof.justify(step)
    goals = _achieved_goals(problem, proof)
    chains = lifted_chains(problem, proof)
    safety = ProofSafety(proof)
    safety.establish()
    return MacroReader(proof, safety, goals, chains).result()


def _achieved_goals(problem: Problem, proof: PlanProof) -> tuple[Literal, ...]:
    """The goals that the plan achieves, with variables.

    A goal that is not a literal is replaced by those that prove it.
    """
    goal_literals: dict[Literal, None] = {}
    for goal in goal_parts(problem.goal):
        _rest_on(goal, proof, goal_literals)
    for need in list(proof.needs):
        if need.consumer == GOAL_STEP and need.producer == INITIAL_STEP:
            del proof.needs[need]
    return tuple(goal_literals)


def _rest_on(goal: Condition, proof: PlanProof, goal_literals: dict[Literal, None]) -> None:
    literal = _as_literal(goal)
    earlier_needs = set(proof.needs)
    for body in proof.world.schemas.disjuncts(goal, {}):
        lifted = tuple(_variablise_part(part, proof) for part in body)
        parts = proof.rest(lifted, GOAL_STEP, {})
        if parts is None:
            continue
        own = [need for need in proof.needs if need not in earlier_needs]
        if all(need.producer == INITIAL_STEP for need in own):
            return
        first = next((part for part in lifted if isinstance(part, Literal)), None)
        if literal is not None and first is not None and first.atom.name == literal.atom.name:
            goal_literals[first] = None
        else:
            goal_literals.update((part.literal, None) for part in parts)
        return
    raise NotGeneral(f"the goal {goal} does not hold at the end")


def _as_literal(goal: Condition) -> Literal | None:
    if isinstance(goal, Exists):
        return _as_literal(goal.part)
    return goal if isinstance(goal, Literal) else None


def _variablise_part(part: BodyPart, proof: PlanProof) -> BodyPart:
    """A goal's literal with a variable for each argument.

    The links of the proof bind what must be bound.
    """
    if not isinstance(part, Literal) or not proof.world.schemas.is_dynamic(part):
        return part
    return Literal(variablise_atom(part.atom, proof), part.positive)


def variablise_atom(atom: Atom, proof: PlanProof) -> Atom:
    """An atom with a fresh variable for every ground argument."""
    arguments: list[Term] = []
    for argument in atom.arguments:
        if isinstance(argument, Variable) or next(term_variables(argument), None) is not None:
            arguments.append(argument)
            continue
        fresh = proof.world.schemas.fresh(Variable("Value"))
        proof.origin[fresh] = argument
        arguments.append(fresh)
    return Function(atom.name, tuple(arguments))
