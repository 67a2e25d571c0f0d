"""A case: an exception that happened, what may be behind it, what was observed, and how it ended."""

from dataclasses import dataclass, field

from engine.model.troubleshooting import Advice, Troubleshooting
from kb.terms import Atom


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """What may be the matter: causes that are there together, and observations (names of tests) that are wrong."""

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
    """What an action showed."""

    action: str
    outcome: str


@dataclass(frozen=True, slots=True)
class Stage:
    """One step of a case: the belief before it, the advice, and what was observed at which cost."""

    belief: tuple[tuple[str, float], ...]
    advice: Advice
    observed: Observation
    cost: float


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """How a case ended. `hypotheses` are those still possible with their probabilities, most probable first.

    `finished` says that nothing is left to ask; `cured` names the repair that ended it; `repairs` may be tried next, in order; `question` is put to a person where
    nothing helps.
    """

    exception: str
    stages: tuple[Stage, ...]
    hypotheses: tuple[tuple[Hypothesis, float], ...]
    cost: float
    isolated: bool
    finished: bool = True
    cured: str | None = None
    repairs: tuple[str, ...] = ()
    question: "Question | None" = None

    @property
    def question_text(self) -> str:
        """What a person is asked, or nothing."""
        return self.question.text if self.question else ""

    @property
    def observations(self) -> tuple[Observation, ...]:
        """Everything observed, in order."""
        return tuple(stage.observed for stage in self.stages)


@dataclass(frozen=True, slots=True)
class Question:
    """What a person is asked: at most four answers."""

    text: str
    answers: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Revision:
    """What a diagnosis changes in the world model, each with its reason, and what is lost."""

    withdrawn: tuple[tuple[Atom, str], ...] = ()
    asserted: tuple[tuple[Atom, str], ...] = ()
    restored: tuple[tuple[Atom, str], ...] = ()
    lost: tuple[str, ...] = field(default=())
