"""Troubleshooting: causes, tests, repairs, cases and how they end; circuits as examples."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from cellwright.kb.model.plan_model import Step
from cellwright.kb.terms import Atom


@dataclass(frozen=True, slots=True)
class Action:
    """A test or a repair.

    `likelihoods[o][c]` is the probability of outcome o if c is the cause; columns sum to 1. An
    outcome in `ends` finishes the case, such as the outcome of a repair that the trouble is gone.
    `repeats` is the number of the action of which this one is an independent repetition: the same
    test once more, after that one.
    """

    name: str
    cost: float
    outcomes: tuple[str, ...]
    likelihoods: tuple[tuple[float, ...], ...]
    ends: frozenset[int] = frozenset()
    repeats: int | None = None

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

    Preparing action a in situation k costs `costs[k][a]`; the action leaves situation
    `following[k][a]`. Set-up costs are the least ones: doing another action first, only for the
    situation that it leaves, gains nothing.
    """

    costs: tuple[tuple[float, ...], ...]
    following: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class Troubleshooting:
    """A troubleshooting problem. Priors sum to 1.

    If actions are equally good, the one declared first is chosen. A conclusion that some causes
    forbid is allowed where all other causes together have the probability `certainty`.
    """

    causes: tuple[str, ...]
    priors: tuple[float, ...]
    actions: tuple[Action, ...]
    conclusions: tuple[Conclusion, ...] = ()
    setup: Setup | None = None
    certainty: float = 1.0

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
class CaseStanding:
    """The state of a case: possible causes (a bit set), outcomes of uncertain actions, the
    situation.
    """

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
    """An inner node: the index of the action, its cost here with its set-up, and the branch for
    each outcome.

    `probability` is the probability of reaching this node. Outcomes that cannot occur have no
    branch.
    """

    probability: float
    action: int
    cost: float
    branches: tuple[tuple[int, "Tree"], ...]


Tree = Conclude | Try


@dataclass(frozen=True, slots=True)
class CaseAdvice:
    """What to do next: an action, or a conclusion if `action` is None.

    `expected_cost` is the expected cost from here. `bound` is a proven lower bound of the optimum;
    it equals `expected_cost` if `optimal`. `runners_up` are other actions, best first, each with
    the expected cost (or a lower bound of it) of beginning with it.
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
    total = _weighted_cost(tree)
    return total / tree.probability if tree.probability else 0.0


def _weighted_cost(tree: Tree) -> float:
    if isinstance(tree, Conclude):
        return tree.probability * tree.loss
    return tree.probability * tree.cost + sum(_weighted_cost(branch) for _, branch in tree.branches)


@dataclass(frozen=True, slots=True)
class CaseHypothesis:
    """A possible explanation of a case: causes present together, and wrong observations (names
    of tests).
    """

    causes: tuple[str, ...]
    lies: tuple[str, ...] = ()

    def __str__(self) -> str:
        said = [*self.causes, *(f"{test} lies" for test in self.lies)]
        return " and ".join(said) or "nothing"


@dataclass(frozen=True, slots=True)
class Case:
    """An exception as a troubleshooting problem; cause i of the problem is `hypotheses[i]`.

    `certainty` is the probability with which a hypothesis counts as found.
    """

    exception: str
    hypotheses: tuple[CaseHypothesis, ...]
    problem: Troubleshooting
    certainty: float = 1.0


@dataclass(frozen=True, slots=True)
class Observation:
    """The outcome that an action showed."""

    action: str
    outcome: str


@dataclass(frozen=True, slots=True)
class PreparationSteps:
    """The steps that prepare a test or repair, in order, and how long they last together."""

    steps: tuple[Step, ...] = ()
    cost: float = 0.0


@dataclass(frozen=True, slots=True)
class CaseStep:
    """One step of a case: the belief before it, the advice, what was observed, what that cost, and
    the steps before it.

    `steps` prepared the test or repair; the cost contains them.
    """

    belief: tuple[tuple[str, float], ...]
    advice: CaseAdvice
    observed: Observation
    cost: float
    steps: tuple[Step, ...] = ()


@dataclass(frozen=True, slots=True)
class CaseDiagnosis:
    """How a case ended.

    `hypotheses` are those still possible, each with its probability, the most probable first.
    `finished` says that nothing is left to ask. `cured` names the repair that ended the case.
    `repairs` may be tried next, in order. `question` is for a person, if nothing else helps.
    `isolated` says that the most probable cause is found: where tests are not sure, others may be
    possible still.
    """

    exception: str
    stages: tuple[CaseStep, ...]
    hypotheses: tuple[tuple[CaseHypothesis, float], ...]
    cost: float
    isolated: bool
    finished: bool = True
    cured: str | None = None
    repairs: tuple[str, ...] = ()
    question: "Question | None" = None

    @property
    def counted_on(self) -> tuple[CaseHypothesis, ...]:
        """The hypotheses of which one is taken to be true: the most probable one if it is
        found, else all.
        """
        possible = tuple(hypothesis for hypothesis, _ in self.hypotheses)
        return possible[:1] if self.isolated else possible

    @property
    def question_text(self) -> str:
        """The question to a person as text, or an empty text."""
        return self.question.text if self.question else ""

    @property
    def observations(self) -> tuple[Observation, ...]:
        """All observations, in order."""
        return tuple(stage.observed for stage in self.stages)


@dataclass(frozen=True, slots=True)
class Question:
    """A question to a person, with at most four answers."""

    text: str
    answers: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Revision:
    """The changes that a diagnosis makes in the world model, each with its reason, and the lost
    resources.

    `regained` are resources that a repair has put right again: they are lost no longer. `blocked`
    are patterns of steps that are not taken any more. `assumed` is what must have held for the
    interrupted step to begin, `kept` is work like the work that the cause puts in doubt, and
    `follows` are facts that hold (True) or do not hold any more by deductive operators.
    """

    withdrawn: tuple[tuple[Atom, str], ...] = ()
    asserted: tuple[tuple[Atom, str], ...] = ()
    restored: tuple[tuple[Atom, str], ...] = ()
    lost: tuple[str, ...] = field(default=())
    blocked: tuple[tuple[Atom, str], ...] = ()
    assumed: tuple[tuple[Atom, str], ...] = ()
    kept: tuple[tuple[Atom, str], ...] = ()
    follows: tuple[tuple[Atom, bool], ...] = ()
    regained: tuple[str, ...] = ()


AND, OR, XOR = "and", "or", "xor"


@dataclass(frozen=True, slots=True)
class Gate:
    """A gate: a function of its inputs (`and`, `or`, `xor`), then inverted or not.

    With one input each function is the input.
    """

    function: str
    inverted: bool
    inputs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Circuit:
    """A circuit. A wire has the name of its gate. `gates` is ordered from inputs to outputs."""

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    gates: Mapping[str, Gate]

    def values(
        self, given: Mapping[str, bool], flipped: frozenset[str] = frozenset()
    ) -> dict[str, bool]:
        """The value of every wire for given values of the inputs.

        The outputs of the gates in `flipped` are inverted.
        """
        wire_values = dict(given)
        for name, gate in self.gates.items():
            read = [wire_values[wire] for wire in gate.inputs]
            value = (
                all(read)
                if gate.function == AND
                else any(read)
                if gate.function == OR
                else sum(read) % 2 == 1
            )
            wire_values[name] = value ^ gate.inverted ^ (name in flipped)
        return wire_values
