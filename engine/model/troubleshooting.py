"""Troubleshooting: causes with priors, actions that separate causes or repair them, and possible conclusions.

Given the cause, the outcomes of different actions are independent. An action gives the same outcome whenever
it is repeated, so each action is worth doing only once. Costs and losses share one unit.
"""

import math
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Action:
    """A test or a repair.

    `likelihoods[o][c]` is the probability of outcome o if c is the cause; columns sum to 1. An outcome in
    `ends` finishes the case, such as the outcome of a repair that the trouble is gone.
    """

    name: str
    cost: float
    outcomes: tuple[str, ...]
    likelihoods: tuple[tuple[float, ...], ...]
    ends: frozenset[int] = frozenset()

    @property
    def certain(self) -> bool:
        """Whether the cause determines the outcome, for every cause."""
        return all(value in (0.0, 1.0) for row in self.likelihoods for value in row)


@dataclass(frozen=True, slots=True)
class Conclusion:
    """An end of the case.

    `losses[c]` is the loss if c is the cause; infinity forbids this conclusion while c is possible.
    """

    name: str
    losses: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Setup:
    """Situations of the cell.

    Preparing action a in situation k costs `costs[k][a]`; the action leaves situation `following[k][a]`.
    Set-up costs are the least ones: doing another action first, only for the situation that it leaves, gains
    nothing.
    """

    costs: tuple[tuple[float, ...], ...]
    following: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class Troubleshooting:
    """A troubleshooting problem. Priors sum to 1.

    If actions are equally good, the one declared first is chosen.
    """

    causes: tuple[str, ...]
    priors: tuple[float, ...]
    actions: tuple[Action, ...]
    conclusions: tuple[Conclusion, ...] = ()
    setup: Setup | None = None

    def __post_init__(self) -> None:
        if not math.isclose(sum(self.priors), 1.0, abs_tol=1e-6):
            raise ValueError("priors do not sum to one")


def field_bits(action: Action) -> int:
    """The bits that store the outcome of one uncertain action.

    The outcome of a certain action needs none: the causes left show it.
    """
    return 0 if action.certain else len(action.outcomes).bit_length()


def situation_bits(setup: Setup | None) -> int:
    """The bits that store the situation."""
    return (len(setup.costs) - 1).bit_length() if setup else 0


@dataclass(frozen=True, slots=True)
class Standing:
    """The state of a case: possible causes (a bit set), outcomes of uncertain actions, the situation."""

    possible: int
    history: int = 0
    situation: int = 0


@dataclass(frozen=True, slots=True)
class Conclude:
    """A leaf: the index of the conclusion drawn, or None if an outcome ended the case."""

    probability: float
    conclusion: int | None
    loss: float = 0.0


@dataclass(frozen=True, slots=True)
class Try:
    """An inner node: the index of the action, its cost here with its set-up, and the branch for each outcome.

    `probability` is the probability of reaching this node. Outcomes that cannot occur have no branch.
    """

    probability: float
    action: int
    cost: float
    branches: tuple[tuple[int, "Tree"], ...]


Tree = Conclude | Try


@dataclass(frozen=True, slots=True)
class Advice:
    """What to do next: an action, or a conclusion if `action` is None.

    `expected_cost` is the expected cost from here. `bound` is a proven lower bound of the optimum; it equals
    `expected_cost` if `optimal`. `runners_up` are other actions, best first, each with the expected cost (or
    a lower bound of it) of beginning with it.
    """

    action: int | None
    conclusion: int | None
    expected_cost: float
    bound: float
    optimal: bool
    runners_up: tuple[tuple[int, float], ...] = field(default=())
    expansions: int = 0


def expected_cost(tree: Tree) -> float:
    """The expected cost of a tree from its root, set-up and losses included."""
    total = _weighted(tree)
    return total / tree.probability if tree.probability else 0.0


def _weighted(tree: Tree) -> float:
    if isinstance(tree, Conclude):
        return tree.probability * tree.loss
    return tree.probability * tree.cost + sum(_weighted(branch) for _, branch in tree.branches)
