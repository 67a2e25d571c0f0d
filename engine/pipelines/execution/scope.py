"""What a run is still after: the original goals without those that were given up, and the domain without what is lost."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

from cellwright.engine.model.cases import Revision
from cellwright.engine.pipelines.attainment import GivenUp
from cellwright.engine.pipelines.barring import barred
from cellwright.engine.pipelines.each import for_each
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.revision.remaining import remaining
from cellwright.engine.pipelines.simulation import WorldState
from cellwright.engine.stages.validation.datalog import holds
from cellwright.kb.model.conditions import TRUE, And, Condition, goal_parts
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.workflow import finished
from cellwright.kb.terms import Atom


@dataclass(frozen=True, slots=True)
class Scope:
    """The original problem with the goals that are pursued, and what was given up of them so far, with reasons.

    `lost` are resources that cannot be used any more, `blocked` are patterns of steps that are not taken any more.
    """

    problem: Problem
    given_up: tuple[GivenUp, ...] = ()
    lost: tuple[str, ...] = ()
    blocked: tuple[Atom, ...] = ()

    def rest(self, state: WorldState) -> Problem:
        """What is left of it in a state; of a chain that is new nothing is reached."""
        reached = {chain.name: 0 for chain in self.problem.chains} | dict(state.reached)
        return remaining(self.problem, reached, state.facts)

    def changed(self, found: Revision) -> "Scope":
        """The scope without what a case has found to be lost, or to fail."""
        lost = tuple(dict.fromkeys((*self.lost, *found.lost)))
        blocked = tuple(dict.fromkeys((*self.blocked, *(pattern for pattern, _ in found.blocked))))
        if (lost, blocked) == (self.lost, self.blocked):
            return self
        more = [each for each in blocked if each not in self.blocked]
        problem = barred(self.problem, [each for each in lost if each not in self.lost], more)
        return Scope(problem, self.given_up, lost, blocked)

    def narrowed(self, left: Problem, state: WorldState, given_up: tuple[GivenUp, ...]) -> "Scope":
        """The scope after a recovery: `left` is what it plans for from a state on."""
        lengths = {chain.name: state.reached[chain.name] + len(chain.stages) for chain in left.chains}
        done = finished(self.problem.chains, state.reached)
        lengths |= {chain.name: len(chain.stages) for chain in self.problem.chains if chain.name in done}
        lengths |= {
            chain.name: state.reached[chain.name]
            for chain in self.problem.chains
            if chain.name not in lengths and state.reached[chain.name]
        }
        return replace(
            self.cut(lengths, frozenset(map(str, goal_parts(left.goal)))),
            given_up=(*self.given_up, *given_up),
        )

    def cut(self, lengths: Mapping[str, int], goals: Collection[str]) -> "Scope":
        """The scope with chains of so many stages, and with those of its goals that are named."""
        chains = tuple(
            replace(
                chain,
                stages=chain.stages[: lengths[chain.name]],
                after=tuple(name for name in chain.after if name in lengths),
            )
            for chain in self.problem.chains
            if lengths.get(chain.name)
        )
        wanted = tuple(part for whole in goal_parts(self.problem.goal) for part in self._wanted(whole, goals))
        goal = And(wanted) if wanted else TRUE
        return replace(self, problem=replace(self.problem, chains=chains, goal=goal))

    def _wanted(self, whole: Condition, goals: Collection[str]) -> Iterator[Condition]:
        """A goal if it is named; else what of it is: of a goal about all objects, some may be left."""
        if str(whole) in goals:
            yield whole
        else:
            parts = goal_parts(for_each(replace(self.problem, goal=whole)).goal)
            yield from (part for part in parts if str(part) in goals)

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
