"""Queries for MACROPs: goals that are not yet true, workflow chains, and the situation."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from cellwright.engine.stages.lifted.cell_domain import (
    CellDomain,
    Situation,
    body_holds,
    with_derived,
)
from cellwright.engine.stages.lifted.fact_queries import FactSet
from cellwright.kb.model.conditions import Condition, Exists, Literal, goal_parts
from cellwright.kb.model.plan_model import Macrop
from cellwright.kb.model.planning_problem import (
    Chain,
    Problem,
    final_stages,
    finished_chains,
    initial_progress,
    stage_holds,
)
from cellwright.kb.terms import ANYTHING, TOGETHER_SIGN, Atom, substitute_atom

MOST_KEPT = 3


@dataclass(frozen=True, slots=True)
class MacroQuery:
    """A problem as lookup sees it. In goals `_` stands for anything.

    The goals in `kept` hold already, and must hold again at the end. In `memory`, matching stores
    results that it needs for several MACROPs.
    """

    situation: Situation
    goals: tuple[Literal, ...]
    chains: tuple[Chain, ...]
    kept: tuple[Literal, ...] = ()
    memory: dict[str, Any] = field(default_factory=dict, init=False, compare=False, repr=False)

    @property
    def served(self) -> bool:
        """Whether nothing is left to do."""
        return not self.goals and not self.chains

    @property
    def world(self) -> CellDomain:
        """The world of the situation."""
        return self.situation.world

    @property
    def facts(self) -> FactSet:
        """The fluents that are true."""
        return self.situation.facts


def make_query(problem: Problem, situation: Situation) -> MacroQuery | None:
    """The query of a problem; None if a goal is no literal, or a stage has several. Chains that
    are finished at the start are kept so.
    """
    if any(stage.name == TOGETHER_SIGN for chain in problem.chains for stage in chain.stages):
        return None
    goals: dict[bool, dict[Literal, None]] = {False: {}, True: {}}
    for goal in goal_parts(problem.goal):
        literal = goal_literal(goal)
        if literal is None:
            return None
        goals[is_met(literal, situation)][literal] = None
    done = finished_chains(
        problem.chains, initial_progress(problem.chains, stage_holds(situation.facts))
    )
    lasts = final_stages(problem.chains, problem.domain)
    goals[True] |= {
        Literal(stage): None for name, own in lasts.items() if name in done for stage in own
    }
    chains = tuple(
        chain.wait_only_for(set(chain.after).difference(done))
        for chain in problem.chains
        if chain.name not in done
    )
    return MacroQuery(situation, tuple(goals[False]), chains, tuple(goals[True]))


def query_variants(asked: MacroQuery) -> Iterator[MacroQuery]:
    """The query itself, then variants in which some goals that hold already must be achieved again.

    A plan may have to end such a goal for a while. If there are at most `MOST_KEPT` of them, all
    choices are tried; otherwise only none and all.
    """
    yield asked
    if len(asked.kept) > MOST_KEPT:
        yield replace(asked, goals=asked.goals + asked.kept)
        return
    for size in range(1, len(asked.kept) + 1):
        for chosen in itertools.combinations(asked.kept, size):
            yield replace(asked, goals=asked.goals + chosen)


def goal_literal(goal: Condition) -> Literal | None:
    """A goal as a literal, in which existential variables become `_`; None if it is something
    else.
    """
    if isinstance(goal, Literal):
        return goal
    if isinstance(goal, Exists) and isinstance(goal.part, Literal) and goal.part.positive:
        return Literal(
            substitute_atom(goal.part.atom, {p.variable: ANYTHING for p in goal.parameters})
        )
    return None


def is_met(literal: Literal, situation: Situation) -> bool:
    """Whether a goal holds. Derived predicates are evaluated."""
    world, facts = situation.world, situation.facts
    if not world.schemas.is_dynamic(literal):
        return body_holds((literal,), world, facts, {})
    if world.schemas.is_derived(literal.atom):
        facts = with_derived(world, facts)
    return facts.any_match(literal.atom) == literal.positive


def goal_signature(goals: Iterable[Literal], chains: Iterable[tuple[Atom, ...]]) -> str:
    """The signature of goals: their predicates, arities and signs, and the stages of the chains.

    Only goals with the signature of a MACROP can be solved by it.
    """
    goal_texts = sorted(
        f"{'' if g.positive else 'not '}{g.atom.name}/{len(g.atom.arguments)}" for g in goals
    )
    worked = sorted(">".join(f"{s.name}/{len(s.arguments)}" for s in stages) for stages in chains)
    return " ".join(goal_texts) + (f" | {' '.join(worked)}" if worked else "")


def signature_of(macrop: Macrop) -> str:
    """The signature of a MACROP's goals."""
    return goal_signature(macrop.goals, (chain.stages for chain in macrop.chains))


def signature_asked(asked: MacroQuery) -> str:
    """The signature of a query's goals."""
    return goal_signature(asked.goals, (chain.stages for chain in asked.chains))
