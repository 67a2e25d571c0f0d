"""Why there is no plan: the goals that have none, what is missing, and the smallest changes that help.

Each change is proved by a plan for the changed problem.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from engine.model.explanation import Amendment, Explanation
from engine.model.outcome import Found, Infeasible, Outcome
from engine.pipelines import planning
from engine.pipelines.explanation.relaxation import INITIAL, assumptions
from engine.stages.grounding import ground
from engine.stages.planning import Limits
from kb.diagnostics import InvalidInput
from kb.model.conditions import And, Condition, goal_parts
from kb.model.plan import GOAL, Plan, StepId
from kb.model.problem import Problem
from kb.terms import Atom, Function

MAX_CHANGES = 5  # the most changes that are shown
MAX_TRIALS = 60  # the most changes of one kind that are tried by planning
MAX_SIZE = 3  # the most facts in one change
MAX_MODELS = 400  # the most sets of assumptions of one size that are considered


def explain(problem: Problem, limits: Limits = Limits()) -> Explanation:
    """Why a problem has no plan. Raises `InvalidInput` for a problem that does not ground."""
    outcome = planning.plan(problem, limits)
    if isinstance(outcome, Found):
        return Explanation("feasible", reason=f"there is a plan of {len(outcome.plan.steps)} steps")
    if not isinstance(outcome, Infeasible):
        return Explanation("unknown", reason=outcome.reason)
    task = ground(problem)
    initial = tuple(atom for atom in task.names(task.initial) if atom.name not in ("not", "_stage"))
    inquiry = _Inquiry(problem, limits, initial, frozenset(operator.instance for operator in task.operators))
    goals = inquiry.minimal_goals()
    return Explanation(
        "infeasible",
        tuple(map(str, goals)),
        tuple(inquiry.exclusions(goals)),
        tuple(inquiry.changes(goals)),
        outcome.reason,
    )


@dataclass(frozen=True, slots=True)
class GoalPart:
    """A conjunct of the goal, or a chain up to one of its stages."""

    condition: Condition | None = None
    chain: str = ""
    stages: int = 0
    text: str = ""

    def __str__(self) -> str:
        return self.text


@dataclass
class _Inquiry:
    problem: Problem
    limits: Limits
    initial: tuple[Atom, ...]
    known: frozenset[Function]  # operator instances that can be reached without a change
    trials: int = field(default=0)

    def minimal_goals(self) -> list[GoalPart]:
        """A minimal set of goals without a plan: when any goal is removed from it, the others have a plan.

        If a single goal has no plan, it is that goal. Otherwise the set is found by deletion filtering.
        """
        kept = [GoalPart(part, text=str(part)) for part in goal_parts(self.problem.goal)]
        kept += [
            GoalPart(None, c.name, len(c.stages), _chain_text(c.name, c.stages)) for c in self.problem.chains
        ]
        alone = next((goal for goal in kept if self._infeasible(self._only([goal]))), None)
        if alone is not None:
            return [self._shortened(alone)]
        for goal in list(kept):
            rest = [each for each in kept if each is not goal]
            if rest and self._infeasible(self._only(rest)):
                kept = rest
        return kept

    def _shortened(self, goal: GoalPart) -> GoalPart:
        """A goal that is a chain, cut after the first stage that cannot be reached; any other goal as it is."""
        chain = next((each for each in self.problem.chains if each.name == goal.chain), None)
        for length in range(1, goal.stages):
            assert chain is not None
            cut = GoalPart(None, goal.chain, length, _chain_text(goal.chain, chain.stages[:length]))
            if self._infeasible(self._only([cut])):
                return cut
        return goal

    def _only(self, goals: list[GoalPart]) -> Problem:
        """The problem with only these goals."""
        lengths = {goal.chain: goal.stages for goal in goals if goal.chain}
        chains = [
            replace(
                chain,
                stages=chain.stages[: lengths[chain.name]],
                after=tuple(a for a in chain.after if a in lengths),
            )
            for chain in self.problem.chains
            if chain.name in lengths
        ]
        goal = And(tuple(each.condition for each in goals if each.condition is not None))
        return replace(self.problem, goal=goal, chains=tuple(chains))

    def _infeasible(self, problem: Problem) -> bool:
        return isinstance(_planned(problem, self.limits), Infeasible)

    def exclusions(self, goals: list[GoalPart]) -> Iterator[str]:
        """The pairs of these goals that can never be true at once, because they belong to the same mutex group."""
        if len(goals) < 2:
            return
        task = ground(self._only(goals))
        names = {str(atom): 1 << number for number, atom in enumerate(task.atoms)}
        present = [(goal, names[str(goal)]) for goal in goals if str(goal) in names]
        for position, (one, bit) in enumerate(present):
            for other, other_bit in present[position + 1 :]:
                if any(group & bit and group & other_bit for group in task.mutex_groups):
                    yield f"{one} and {other} are never true at once"

    def changes(self, goals: list[GoalPart]) -> list[Amendment]:
        """The smallest changes with which the whole problem has a plan; at most `MAX_CHANGES`."""
        single = [*self._try(self._removals()), *self._try(self._abduced(1))]
        found = single or [each for size in range(2, MAX_SIZE + 1) for each in self._try(self._abduced(size))]
        if len(goals) > 1 or not found:
            found = [*found, *self._try(self._drops(goals))]
        least = min((len(each.facts) for each in found), default=0)
        return [each for each in found if len(each.facts) <= max(least, 1)][:MAX_CHANGES]

    def _removals(self) -> Iterator[Amendment]:
        return (Amendment("remove initial", (fact,)) for fact in self.problem.initial)

    def _drops(self, goals: list[GoalPart]) -> Iterator[Amendment]:
        return (Amendment("drop goal", goal=str(goal)) for goal in goals)

    def _abduced(self, size: int) -> Iterator[Amendment]:
        """Changes that add facts. Facts that share most words with the goals come first."""
        if self.limits.interrupted():
            return
        if assumptions(self.problem, self.initial, 0, 1) and size > 1:
            return
        found = assumptions(self.problem, self.initial, size, MAX_MODELS)
        words = {str(part) for goal in goal_parts(self.problem.goal) for part in _words(str(goal))}
        words |= {
            word for chain in self.problem.chains for stage in chain.stages for word in _words(str(stage))
        }

        def strangeness(assumed: tuple[Function, ...]) -> tuple[int, int, str]:
            said = " ".join(map(str, assumed))
            return (sum(each.name == INITIAL for each in assumed), -len(words & _words(said)), said)

        for assumed in sorted(found, key=strangeness):
            kinds = {each.name for each in assumed}
            facts = tuple(fact for each in assumed if isinstance(fact := each.arguments[0], Function))
            if len(kinds) == 1:
                yield Amendment(f"add {kinds.pop()}", facts)

    def _try(self, candidates: Iterator[Amendment]) -> Iterator[Amendment]:
        """The candidates with which the problem has a plan."""
        found = 0
        self.trials = 0
        for change in candidates:
            if found >= MAX_CHANGES or self.trials >= MAX_TRIALS or self.limits.interrupted():
                return
            self.trials += 1
            outcome = _planned(changed(self.problem, change), self.limits)
            if isinstance(outcome, Found):
                found += 1
                yield replace(
                    change, proof=len(outcome.plan.steps), missing=tuple(self._chain(outcome.plan, change))
                )

    def _chain(self, plan: Plan, change: Amendment) -> Iterator[str]:
        """Why the change is needed, line by line.

        The lines lead from a goal along causal links to the first step that was out of reach before, and to the facts of
        the change that this step needs.
        """
        first = next((step.id for step in plan.steps if step.operator not in self.known), None)
        if first is None or not change.facts:
            return
        operators = {step.id: step.operator for step in plan.steps}
        consumers = {link.producer: link for link in plan.links if link.condition.name != "_stage"}
        consumers |= {link.producer: link for link in plan.links if link.consumer == GOAL}
        path: list[str] = []
        step: StepId = first
        while step in consumers and step != GOAL:
            link = consumers[step]
            path.append(f"{link.condition} needs {operators[step]}")
            step = link.consumer
        yield from reversed(path)
        need = "is out of reach because of" if change.kind == "remove initial" else "needs"
        yield f"{operators[first]} {need} {', '.join(map(str, change.facts))}"


def changed(problem: Problem, change: Amendment) -> Problem:
    """The problem after a change."""
    match change.kind:
        case "add static":
            return replace(problem, statics=(*problem.statics, *change.facts))
        case "add initial":
            return replace(problem, initial=(*problem.initial, *change.facts))
        case "remove initial":
            return replace(problem, initial=tuple(f for f in problem.initial if f not in change.facts))
        case _:
            parts = tuple(part for part in goal_parts(problem.goal) if str(part) != change.goal)
            chains = tuple(c for c in problem.chains if _chain_text(c.name, c.stages) != change.goal)
            return replace(problem, goal=And(parts), chains=chains)


def _planned(problem: Problem, limits: Limits) -> Outcome | None:
    """The answer to a variant of a problem; None if the variant contradicts itself."""
    try:
        return planning.plan(problem, limits)
    except InvalidInput:
        return None


def _chain_text(name: str, stages: tuple[Atom, ...]) -> str:
    return f"{', '.join(map(str, stages))} (workflow {name})"


def _words(text: str) -> set[str]:
    return set(re.findall(r"[a-z]\w*", text))
