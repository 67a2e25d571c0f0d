"""A minimal set of goals that cannot be reached, and pairs of goals that exclude each other."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.pipelines.explanation.amendments import chain_text, without_chains
from cellwright.engine.stages.grounding import ground
from cellwright.kb.model.conditions import And, Condition, goal_parts
from cellwright.kb.model.planning_problem import Problem, event_chains

Infeasible = Callable[[Problem], bool | None]  # None if it is not decided


@dataclass(frozen=True, slots=True)
class GoalOrStage:
    """A conjunct of the goal, or a chain up to one of its stages.

    `whole` names the goal that it is a part of.
    """

    condition: Condition | None = None
    chain: str = ""
    stages: int = 0
    text: str = ""
    whole: str = ""

    def __str__(self) -> str:
        return self.text


def minimal_goals(problem: Problem, infeasible: Infeasible) -> list[GoalOrStage]:
    """A set of goals that has no plan while any part of it has one: a single goal if there is
    one, else the last such goals.
    """
    goals = [
        GoalOrStage(part, text=str(part), whole=str(part)) for part in goal_parts(problem.goal)
    ]
    for chain in problem.chains:
        text = chain_text(chain.name, chain.stages)
        goals.append(GoalOrStage(None, chain.name, len(chain.stages), text, text))
    parts = _GoalParts(problem, infeasible)
    conflict = parts.conflict([], goals)
    alone = next((goal for goal in goals if parts.fails([goal])), None)
    return conflict if alone is None else [_shorten_chain(problem, alone, infeasible)]


class _GoalParts:
    """Which parts of the goals have no plan. A part of what has a plan has one."""

    def __init__(self, problem: Problem, infeasible: Infeasible) -> None:
        self._problem, self._infeasible = problem, infeasible
        self._failing: dict[frozenset[GoalOrStage], bool] = {}
        self._planned: list[frozenset[GoalOrStage]] = []

    def fails(self, goals: Sequence[GoalOrStage]) -> bool:
        """Whether there is proof that some goals have no plan."""
        part = frozenset(goals)
        if not part or any(part <= planned_part for planned_part in self._planned):
            return False
        if part not in self._failing:
            answer = self._infeasible(with_goals_only(self._problem, goals))
            self._failing[part] = bool(answer)
            self._planned += [part] if answer is False else []
        return self._failing[part]

    def conflict(
        self, base: Sequence[GoalOrStage], goals: Sequence[GoalOrStage], more: bool = False
    ) -> list[GoalOrStage]:
        """The goals without which those of the base would have a plan, and none more: by halves
        (Junker 2004). All together have none.

        `more` says that the base has grown, so that it may have no plan by itself.
        """
        if more and self.fails(base):
            return []
        if len(goals) < 2:
            return list(goals)
        first, last = goals[: len(goals) // 2], goals[len(goals) // 2 :]
        first_part = self.conflict([*base, *last], first, True)
        return [*first_part, *self.conflict([*base, *first_part], last, bool(first_part))]


def _shorten_chain(problem: Problem, goal: GoalOrStage, infeasible: Infeasible) -> GoalOrStage:
    """A chain cut after the first stage that cannot be reached."""
    stages = next((chain.stages for chain in problem.chains if chain.name == goal.chain), ())
    for length in range(1, goal.stages):
        cut = replace(goal, stages=length, text=chain_text(goal.chain, stages[:length]))
        if infeasible(with_goals_only(problem, [cut])):
            return cut
    return goal


def with_goals_only(problem: Problem, goals: Sequence[GoalOrStage]) -> Problem:
    """The problem with some of its goals alone.

    The events that the other chains ask for may occur, and need not.
    """
    lengths = {goal.chain: goal.stages for goal in goals if goal.chain}
    dropped = {chain.name for chain in problem.chains} - set(lengths)
    chains = (
        *(
            replace(chain, stages=chain.stages[: lengths[chain.name]])
            for chain in without_chains(problem.chains, dropped)
        ),
        *event_chains((chain for chain in problem.chains if chain.name in dropped), problem.domain),
    )
    goal = And(tuple(goal.condition for goal in goals if goal.condition is not None))
    return replace(problem, goal=goal, chains=chains)


def exclusive_goals(problem: Problem, goals: Sequence[GoalOrStage]) -> Iterator[str]:
    """Which pairs of these goals are never true at once, by a mutex group."""
    if len(goals) < 2:
        return
    task = ground(with_goals_only(problem, goals))
    names = {str(atom): 1 << number for number, atom in enumerate(task.atoms)}
    present = [(goal, names[str(goal)]) for goal in goals if str(goal) in names]
    for position, (first_goal, bit) in enumerate(present):
        for second_goal, other_bit in present[position + 1 :]:
            if any(group & bit and group & other_bit for group in task.mutex_groups):
                yield f"{first_goal} and {second_goal} are never true at once"
