"""Troubleshooting: causes with priors, actions that tell causes apart or put them right, and what may be concluded.

Given the cause, the outcomes of different actions are independent, and an action gives the same outcome whenever it is
repeated; so each is worth doing once. Costs and losses share one unit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

MAX_CAUSES = 62
MAX_HISTORY_BITS = 62


@dataclass(frozen=True, slots=True)
class Action:
    """A test or a repair. `likelihoods[o][c]` is the probability of outcome o if c is the cause; columns sum to 1.

    An outcome in `ends` finishes the case: of a repair, that the trouble is gone.
    """

    name: str
    cost: float
    outcomes: tuple[str, ...]
    likelihoods: tuple[tuple[float, ...], ...]
    ends: frozenset[int] = frozenset()

    @property
    def certain(self) -> bool:
        """Whether each cause fixes the outcome."""
        return all(value in (0.0, 1.0) for row in self.likelihoods for value in row)


@dataclass(frozen=True, slots=True)
class Conclusion:
    """An end of the case: what it loses if c is the cause; infinity where it may not be drawn while c is possible."""

    name: str
    losses: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Setup:
    """Situations of the cell: doing action a in situation k costs `costs[k][a]` beforehand and leaves `following[k][a]`.

    Set-up is planned well: nothing is gained by doing some other action first only for the situation that it leaves.
    """

    costs: tuple[tuple[float, ...], ...]
    following: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class Troubleshooting:
    """What is to be found out. Priors sum to 1; ties among actions go to the one declared first."""

    causes: tuple[str, ...]
    priors: tuple[float, ...]
    actions: tuple[Action, ...]
    conclusions: tuple[Conclusion, ...] = ()
    setup: Setup | None = None

    def __post_init__(self) -> None:
        if len(self.causes) > MAX_CAUSES:
            raise ValueError(f"more than {MAX_CAUSES} causes")
        if history_bits(self.actions) + situation_bits(self.setup) > MAX_HISTORY_BITS:
            raise ValueError("too many actions with uncertain outcomes")
        if not math.isclose(sum(self.priors), 1.0, abs_tol=1e-6):
            raise ValueError("priors do not sum to one")


def field_bits(action: Action) -> int:
    """Bits that remember the outcome of an uncertain action; a certain one is remembered by the causes it leaves."""
    return 0 if action.certain else len(action.outcomes).bit_length()


def history_bits(actions: Sequence[Action]) -> int:
    """Bits that remember the outcomes of all uncertain actions."""
    return sum(map(field_bits, actions))


def situation_bits(setup: Setup | None) -> int:
    """Bits that number the situations."""
    return (len(setup.costs) - 1).bit_length() if setup else 0


@dataclass(frozen=True, slots=True)
class Standing:
    """Where a case stands: the causes still possible (a bit set), outcomes of uncertain actions, the situation."""

    possible: int
    history: int = 0
    situation: int = 0


@dataclass(frozen=True, slots=True)
class Conclude:
    """A leaf: the conclusion drawn (its index), or None where an outcome ended the case."""

    probability: float
    conclusion: int | None
    loss: float = 0.0


@dataclass(frozen=True, slots=True)
class Try:
    """A branching: the action (its index), what it costs here with its set-up, and what follows each outcome.

    `probability` is that of coming here; outcomes that cannot occur have no branch.
    """

    probability: float
    action: int
    cost: float
    branches: tuple[tuple[int, "Tree"], ...]


Tree = Conclude | Try


@dataclass(frozen=True, slots=True)
class Advice:
    """What to do next: an action, or a conclusion where `action` is None; with its expected cost from here.

    `bound` is a proven lower bound of the optimum, equal to `expected_cost` where `optimal`. `runners_up` are other
    actions with (a lower bound of) the expected cost of beginning with them, best first.
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
