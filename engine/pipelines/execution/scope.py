"""What a run is still after: the original goals without those that were given up, and the domain without what is lost."""

from dataclasses import dataclass, replace

from engine.pipelines.attainment import GivenUp
from engine.pipelines.gate import PlanGate
from engine.pipelines.revision.remaining import remaining
from engine.pipelines.simulation import WorldState
from engine.stages.validation.datalog import holds
from kb.model.conditions import TRUE, And, goal_parts
from kb.model.problem import Problem
from kb.model.workflow import finished


@dataclass(frozen=True, slots=True)
class Scope:
    """The original problem with the goals that are pursued, and what was given up of them so far, with reasons."""

    problem: Problem
    given_up: tuple[GivenUp, ...] = ()

    def rest(self, state: WorldState) -> Problem:
        """What is left of it in a state."""
        return remaining(self.problem, state.reached, state.facts)

    def narrowed(self, left: Problem, state: WorldState, given_up: tuple[GivenUp, ...]) -> "Scope":
        """The scope after a recovery: `left` is what it plans for from a state on, and how its domain is now."""
        kept = {chain.name: len(chain.stages) for chain in left.chains}
        parts = set(map(str, goal_parts(left.goal)))
        done = finished(self.problem.chains, state.reached)
        chains = tuple(
            replace(
                chain,
                stages=chain.stages[: state.reached[chain.name] + kept.get(chain.name, 0)],
                after=tuple(name for name in chain.after if name in done or name in kept),
            )
            for chain in self.problem.chains
            if chain.name in done or state.reached[chain.name] + kept.get(chain.name, 0)
        )
        wanted = tuple(part for part in goal_parts(self.problem.goal) if str(part) in parts)
        goal = And(wanted) if wanted else TRUE
        problem = replace(self.problem, domain=left.domain, chains=chains, goal=goal)
        return Scope(problem, (*self.given_up, *given_up))

    def reached(self, original: Problem, state: WorldState) -> tuple[list[str], list[str]]:
        """The goals of the original problem that are reached in a state, and the others."""
        facts = PlanGate().semantics(original).facts(state.facts)
        done, open_ = list[str](), list[str]()
        for part in goal_parts(original.goal):
            (done if holds(part, facts, {}) else open_).append(str(part))
        for chain in original.chains:
            count = state.reached.get(chain.name, 0)
            done += [f"{stage} of {chain.name}" for stage in chain.stages[:count]]
            open_ += [f"{stage} of {chain.name}" for stage in chain.stages[count:]]
        return done, open_
