"""Which goals cannot be reached: a minimal set, and which pairs of them exclude each other."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from engine.pipelines.explanation.amendments import chain_text, without_chains
from engine.stages.grounding import ground
from kb.model.conditions import And, Condition, goal_parts
from kb.model.problem import Problem
from kb.model.workflow import allowed

Infeasible = Callable[[Problem], bool]


@dataclass(frozen=True, slots=True)
class Goal:
    """A conjunct of the goal, or a chain up to one of its stages. `whole` names the goal that it is a part of."""

    condition: Condition | None = None
    chain: str = ""
    stages: int = 0
    text: str = ""
    whole: str = ""

    def __str__(self) -> str:
        return self.text


def minimal_goals(problem: Problem, infeasible: Infeasible) -> list[Goal]:
    """A set of goals that has no plan while any part of it has one: a single goal, else by deletion filtering."""
    kept = [Goal(part, text=str(part), whole=str(part)) for part in goal_parts(problem.goal)]
    for chain in problem.chains:
        text = chain_text(chain.name, chain.stages)
        kept.append(Goal(None, chain.name, len(chain.stages), text, text))
    alone = next((goal for goal in kept if infeasible(only(problem, [goal]))), None)
    if alone is not None:
        return [_shortened(problem, alone, infeasible)]
    for goal in list(kept):
        rest = [each for each in kept if each is not goal]
        if rest and infeasible(only(problem, rest)):
            kept = rest
    return kept


def _shortened(problem: Problem, goal: Goal, infeasible: Infeasible) -> Goal:
    """A chain cut after the first stage that cannot be reached."""
    stages = next((each.stages for each in problem.chains if each.name == goal.chain), ())
    for length in range(1, goal.stages):
        cut = replace(goal, stages=length, text=chain_text(goal.chain, stages[:length]))
        if infeasible(only(problem, [cut])):
            return cut
    return goal


def only(problem: Problem, goals: Sequence[Goal]) -> Problem:
    """The problem with some of its goals alone. The events that the other chains ask for may occur, and need not."""
    lengths = {goal.chain: goal.stages for goal in goals if goal.chain}
    dropped = {chain.name for chain in problem.chains} - set(lengths)
    chains = (
        *(
            replace(chain, stages=chain.stages[: lengths[chain.name]])
            for chain in without_chains(problem.chains, dropped)
        ),
        *allowed((chain for chain in problem.chains if chain.name in dropped), problem.domain),
    )
    goal = And(tuple(each.condition for each in goals if each.condition is not None))
    return replace(problem, goal=goal, chains=chains)


def exclusions(problem: Problem, goals: Sequence[Goal]) -> Iterator[str]:
    """Which pairs of these goals are never true at once, by a mutex group."""
    if len(goals) < 2:
        return
    task = ground(only(problem, goals))
    names = {str(atom): 1 << number for number, atom in enumerate(task.atoms)}
    present = [(goal, names[str(goal)]) for goal in goals if str(goal) in names]
    for position, (one, bit) in enumerate(present):
        for other, other_bit in present[position + 1 :]:
            if any(group & bit and group & other_bit for group in task.mutex_groups):
                yield f"{one} and {other} are never true at once"
