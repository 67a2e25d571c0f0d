"""A case: an exception that happened, its possible causes, what was observed, and how it ended."""

from dataclasses import dataclass, field

from cellwright.engine.model.troubleshooting import Advice, Troubleshooting
from cellwright.kb.model.plan import Step
from cellwright.kb.terms import Atom


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A possible explanation of a case: causes present together, and wrong observations (names of tests)."""

    causes: tuple[str, ...]
    lies: tuple[str, ...] = ()

    def __str__(self) -> str:
        said = [*self.causes, *(f"{test} lies" for test in self.lies)]
        return " and ".join(said) or "nothing"


@dataclass(frozen=True, slots=True)
class Case:
    """An exception as a troubleshooting problem; cause i of the problem is `hypotheses[i]`."""

    exception: str
    hypotheses: tuple[Hypothesis, ...]
    problem: Troubleshooting


@dataclass(frozen=True, slots=True)
class Observation:
    """The outcome that an action showed."""

    action: str
    outcome: str


@dataclass(frozen=True, slots=True)
class Prepared:
    """The steps that prepare a test or repair, in order, and how long they last together."""

    steps: tuple[Step, ...] = ()
    cost: float = 0.0


@dataclass(frozen=True, slots=True)
class CaseStep:
    """One step of a case: the belief before it, the advice, what was observed, what that cost, and the steps before it.

    `steps` prepared the test or repair; the cost contains them.
    """

    belief: tuple[tuple[str, float], ...]
    advice: Advice
    observed: Observation
    cost: float
    steps: tuple[Step, ...] = ()


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """How a case ended.

    `hypotheses` are those still possible, each with its probability, the most probable first. `finished` says
    that nothing is left to ask. `cured` names the repair that ended the case. `repairs` may be tried next, in
    order. `question` is for a person, if nothing else helps.
    """

    exception: str
    stages: tuple[CaseStep, ...]
    hypotheses: tuple[tuple[Hypothesis, float], ...]
    cost: float
    isolated: bool
    finished: bool = True
    cured: str | None = None
    repairs: tuple[str, ...] = ()
    question: "Question | None" = None

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
    """The changes that a diagnosis makes in the world model, each with its reason, and the lost resources.

    `blocked` are patterns of steps that are not taken any more. `assumed` is what must have held for the interrupted step
    to begin, `kept` is work like the work that the cause puts in doubt, and `follows` are facts that hold (True) or do not
    hold any more by deductive operators.
    """

    withdrawn: tuple[tuple[Atom, str], ...] = ()
    asserted: tuple[tuple[Atom, str], ...] = ()
    restored: tuple[tuple[Atom, str], ...] = ()
    lost: tuple[str, ...] = field(default=())
    blocked: tuple[tuple[Atom, str], ...] = ()
    assumed: tuple[tuple[Atom, str], ...] = ()
    kept: tuple[tuple[Atom, str], ...] = ()
    follows: tuple[tuple[Atom, bool], ...] = ()
