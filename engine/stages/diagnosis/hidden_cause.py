"""A simulated world with a hidden cause, and the cost of a decision tree followed in it.

It answers tests and repairs with the fault base's probabilities.
"""

import random
from collections.abc import Mapping
from dataclasses import dataclass, field

from cellwright.engine.model.troubleshooting import (
    Action,
    CaseHypothesis,
    Conclude,
    Tree,
    Troubleshooting,
    Try,
)
from cellwright.engine.stages.diagnosis.fault_problems import (
    CURED,
    NOT_CURED,
    cure_chance,
    outcome_likelihood,
)
from cellwright.kb.model.fault_model import FaultModel


@dataclass
class HiddenWorld:
    """Answers by the name of a test or repair.

    The same question gets the same answer, but for repetitions that are independent; `chance`
    decides uncertain ones.
    """

    model: FaultModel
    hidden: CaseHypothesis
    chance: random.Random = field(default_factory=lambda: random.Random(0))
    answered: dict[str, str] = field(default_factory=dict)
    times: dict[str, int] = field(default_factory=dict)

    def answer(self, name: str) -> str:
        """The outcome of a test or repair."""
        test = self.model.tests.get(name)
        self.times[name] = self.times.get(name, 0) + 1
        if name not in self.answered or (test is not None and self.times[name] <= test.repeats):
            distribution = self._distribution(name)
            self.answered[name] = self.chance.choices(
                list(distribution), list(distribution.values())
            )[0]
        return self.answered[name]

    def respond(self, action: Action) -> str:
        """The outcome of an action of a case. The question of a safe stop gets the true answer."""
        if action.name in self.model.tests or action.name in self.model.repairs:
            return self.answer(action.name)
        return str(self.hidden) if str(self.hidden) in action.outcomes else action.outcomes[-1]

    def _distribution(self, name: str) -> Mapping[str, float]:
        if name in self.model.repairs:
            cured = cure_chance(self.model.repairs[name], self.hidden)
            return {CURED: cured, NOT_CURED: 1.0 - cured}
        test = self.model.tests[name]
        return {
            outcome: outcome_likelihood(test, outcome, self.hidden) for outcome in test.outcomes
        }


def draw_cause(
    model: FaultModel,
    exception: str,
    chance: random.Random,
    counts: Mapping[str, float] | None = None,
) -> CaseHypothesis:
    """A hidden cause of an exception, drawn with its probability."""
    priors = model.priors(exception, counts)
    return CaseHypothesis((chance.choices(list(priors), list(priors.values()))[0],))


def simulated_cost(problem: Troubleshooting, tree: Tree, chance: random.Random) -> float:
    """The cost of one simulated case: a cause is drawn from the priors, and outcomes from their
    likelihoods.
    """
    cause = chance.choices(range(len(problem.causes)), problem.priors)[0]
    return cost_of_case(problem, tree, cause, chance)


def cost_of_case(problem: Troubleshooting, tree: Tree, cause: int, chance: random.Random) -> float:
    """The cost of following a tree if `cause` is the cause."""
    cost = 0.0
    while isinstance(tree, Try):
        cost += tree.cost
        rows = problem.actions[tree.action].likelihoods
        outcome = chance.choices(range(len(rows)), [row[cause] for row in rows])[0]
        tree = dict(tree.branches)[outcome]
    return cost + (
        problem.conclusions[tree.conclusion].losses[cause] if tree.conclusion is not None else 0.0
    )


def cost_under(problem: Troubleshooting, tree: Tree) -> float:
    """The expected cost of following a tree under the priors, set-up and losses of `problem`.

    The tree may have been made for other beliefs.
    """
    return _tree_cost(problem, tree, problem.priors, 0)


def _tree_cost(
    problem: Troubleshooting, tree: Tree, weights: tuple[float, ...], situation: int
) -> float:
    if isinstance(tree, Conclude):
        if tree.conclusion is None:
            return 0.0
        losses = problem.conclusions[tree.conclusion].losses
        return sum(
            weight * loss for weight, loss in zip(weights, losses, strict=True) if weight > 0.0
        )
    action, setup = problem.actions[tree.action], problem.setup
    extra = setup.costs[situation][tree.action] if setup else 0.0
    after = setup.following[situation][tree.action] if setup else 0
    total = (action.cost + extra) * sum(weights)
    for outcome, branch in tree.branches:
        row = action.likelihoods[outcome]
        total += _tree_cost(
            problem, branch, tuple(w * p for w, p in zip(weights, row, strict=True)), after
        )
    return total
