"""What a MACROP is looked up for: goals that are not yet true, workflow chains, and the state."""

from collections.abc import Iterable
from dataclasses import dataclass

from engine.macros.facts import Facts
from engine.macros.world import State, World, holds, with_derived
from kb.model.conditions import Condition, Exists, Literal, goal_parts
from kb.model.macro import Macrop
from kb.model.problem import Chain, Problem
from kb.terms import ANYTHING, Atom, substitute_atom


@dataclass(frozen=True, slots=True)
class Query:
    """A problem as lookup sees it. In goals `_` stands for anything."""

    world: World
    state: State
    facts: Facts
    goals: tuple[Literal, ...]
    chains: tuple[Chain, ...]


def query(problem: Problem, world: World, state: State) -> Query | None:
    """The query of a problem; None if a goal is no literal, or nothing is left to do."""
    facts = with_derived(world, state)
    goals: list[Literal] = []
    for goal in goal_parts(problem.goal):
        literal = goal_literal(goal)
        if literal is None:
            return None
        if not _is_met(literal, world, facts):
            goals.append(literal)
    if not goals and not problem.chains:
        return None
    return Query(world, state, facts, tuple(dict.fromkeys(goals)), problem.chains)


def goal_literal(goal: Condition) -> Literal | None:
    """A goal as a literal; what it merely asks to exist becomes `_`."""
    if isinstance(goal, Literal):
        return goal
    if isinstance(goal, Exists) and isinstance(goal.part, Literal) and goal.part.positive:
        return Literal(substitute_atom(goal.part.atom, {p.variable: ANYTHING for p in goal.parameters}))
    return None


def _is_met(literal: Literal, world: World, facts: Facts) -> bool:
    if not world.schemas.is_dynamic(literal):
        return holds((literal,), world, facts, {})
    return bool(facts.any_match(literal.atom)) == literal.positive


def signature(goals: Iterable[Literal], chains: Iterable[tuple[Atom, ...]]) -> str:
    """What goals must have in common to be met by one MACROP: predicates, arities, signs; stages of chains."""
    wanted = sorted(f"{'' if g.positive else 'not '}{g.atom.name}/{len(g.atom.arguments)}" for g in goals)
    worked = sorted(">".join(f"{s.name}/{len(s.arguments)}" for s in stages) for stages in chains)
    return " ".join(wanted) + (f" | {' '.join(worked)}" if worked else "")


def signature_of(macrop: Macrop) -> str:
    """The signature of a MACROP's goals."""
    return signature(macrop.goals, (chain.stages for chain in macrop.chains))


def signature_asked(asked: Query) -> str:
    """The signature of a query's goals."""
    return signature(asked.goals, (chain.stages for chain in asked.chains))
