"""Generalises a plan to a MACROP.

First comes a proof that the plan works, then the conditions that keep its instances safe. The MACROP is read
off the proof, with readable names.
"""

from cellwright.engine.stages.macros.learning.proof import Proof
from cellwright.engine.stages.macros.learning.reading import Generalised, Reading
from cellwright.engine.stages.macros.learning.safety import Safety
from cellwright.engine.stages.macros.learning.stages import lifted_chains
from cellwright.engine.stages.macros.lifted.schema import NotGeneral
from cellwright.engine.stages.macros.lifted.world import CellDomain, State
from cellwright.kb.model.conditions import BodyPart, Condition, Exists, Literal, goal_parts
from cellwright.kb.model.plan import GOAL, START, Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Term, Variable, variables

__all__ = ["Generalised", "NotGeneral", "generalise"]


def generalise(problem: Problem, plan: Plan, world: CellDomain, initial: State) -> Generalised:
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
    proof = Proof(world, plan, initial)
    for step in plan.steps:
        proof.justify(step)
    goals = _goals(problem, proof)
    chains = lifted_chains(problem, proof)
    safety = Safety(proof)
    safety.establish()
    return Reading(proof, safety, goals, chains).result()


def _goals(problem: Problem, proof: Proof) -> tuple[Literal, ...]:
    """The goals that the plan achieves, with variables.

    A goal that is not a literal is replaced by those that prove it.
    """
    found: dict[Literal, None] = {}
    for goal in goal_parts(problem.goal):
        _rest_on(goal, proof, found)
    for need in list(proof.needs):
        if need.consumer == GOAL and need.producer == START:
            del proof.needs[need]
    return tuple(found)


def _rest_on(goal: Condition, proof: Proof, found: dict[Literal, None]) -> None:
    literal = _as_literal(goal)
    known = set(proof.needs)
    for body in proof.world.schemas.disjuncts(goal, {}):
        lifted = tuple(_variablised(part, proof) for part in body)
        parts = proof.rest(lifted, GOAL, {})
        if parts is None:
            continue
        own = [need for need in proof.needs if need not in known]
        if all(need.producer == START for need in own):
            return
        first = next((part for part in lifted if isinstance(part, Literal)), None)
        if literal is not None and first is not None and first.atom.name == literal.atom.name:
            found[first] = None
        else:
            found.update((part.literal, None) for part in parts)
        return
    raise NotGeneral(f"the goal {goal} does not hold at the end")


def _as_literal(goal: Condition) -> Literal | None:
    if isinstance(goal, Exists):
        return _as_literal(goal.part)
    return goal if isinstance(goal, Literal) else None


def _variablised(part: BodyPart, proof: Proof) -> BodyPart:
    """A goal's literal with a variable for each argument. The links of the proof bind what must be bound."""
    if not isinstance(part, Literal) or not proof.world.schemas.is_dynamic(part):
        return part
    return Literal(variablised(part.atom, proof), part.positive)


def variablised(atom: Atom, proof: Proof) -> Atom:
    """An atom with a fresh variable for every ground argument."""
    arguments: list[Term] = []
    for argument in atom.arguments:
        if isinstance(argument, Variable) or next(variables(argument), None) is not None:
            arguments.append(argument)
            continue
        fresh = proof.world.schemas.fresh(Variable("Value"))
        proof.origin[fresh] = argument
        arguments.append(fresh)
    return Function(atom.name, tuple(arguments))
