"""What is left of a problem when some steps of a plan are done."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

from engine.stages.macros.lifted.world import Change
from kb.model.conditions import And, Condition, Literal, goal_parts
from kb.model.domain import Kind
from kb.model.problem import Chain, Problem, superseded
from kb.terms import Atom, is_ground, match, ordered


def stages_reached(chains: Sequence[Chain], changes: Iterable[Change]) -> dict[str, int]:
    """How many stages of each chain steps have reached, each as soon as possible."""
    lengths = {chain.name: len(chain.stages) for chain in chains}
    reached = dict.fromkeys(lengths, 0)
    for change in changes:
        ready = [c for c in chains if _may_advance(c, reached, lengths)]
        events = list(change.events)
        for chain in ready:
            stage = chain.stages[reached[chain.name]]
            event = next((each for each in events if match(stage, each, {}) is not None), None)
            if event is not None:
                events.remove(event)
            if event is not None or any(match(stage, each, {}) is not None for each in change.adds):
                reached[chain.name] += 1
    return reached


def _may_advance(chain: Chain, reached: Mapping[str, int], lengths: Mapping[str, int]) -> bool:
    done = reached[chain.name]
    return done < lengths[chain.name] and (done > 0 or all(reached[n] == lengths[n] for n in chain.after))


def remaining(problem: Problem, reached: Mapping[str, int], observed: Iterable[Atom]) -> Problem:
    """The problem of what is left: chains without the stages reached, goals for what finished chains must leave behind."""
    kinds = {name: predicate.kind for name, predicate in problem.domain.predicates.items()}
    passing = superseded(problem.chains)
    finished = {c.name for c in problem.chains if reached[c.name] == len(c.stages)}
    lasting: list[Condition] = [
        Literal(chain.stages[-1])
        for chain in problem.chains
        if chain.name in finished
        and chain.name not in passing
        and kinds.get(chain.stages[-1].name) is Kind.FLUENT
        and is_ground(chain.stages[-1])
    ]
    chains = tuple(
        dataclasses.replace(
            chain,
            stages=chain.stages[reached[chain.name] :],
            after=() if reached[chain.name] else tuple(name for name in chain.after if name not in finished),
        )
        for chain in problem.chains
        if chain.name not in finished
    )
    goal = And((*goal_parts(problem.goal), *lasting)) if lasting else problem.goal
    return dataclasses.replace(problem, initial=ordered(observed), complete=True, goal=goal, chains=chains)
