"""One case from the exception to its end: ask for outcomes and update the belief until nothing is left to
ask.

A session does not know who answers. The answers come from a function: a person, a list or a simulation.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.cases import (
    Case,
    CaseStep,
    Diagnosis,
    Hypothesis,
    Observation,
    Prepared,
    Question,
)
from cellwright.engine.model.troubleshooting import Action, Advice, Standing
from cellwright.engine.stages.diagnosis.knowledge import Objective, PlanSetup, case_of, no_setup, open_case
from cellwright.engine.stages.diagnosis.multiple import explanations
from cellwright.engine.stages.diagnosis.selection import Selector
from cellwright.kb.model.faults import FaultModel
from cellwright.kb.model.plan import Step

Answerer = Callable[[Action, Advice], str | None]
"""Gives the outcome of an action; None ends the session."""
MOST_ANSWERS = 4


class Hands(Protocol):
    """Who carries out tests and repairs in a world, so that what they change there is known."""

    def prepare(self, session: "Session", action: str) -> Prepared | None:
        """What must be done before a test or repair as things stand now; None if that cannot be brought about."""

    def carried_out(self, action: str, outcome: str, prepared: Prepared) -> None:
        """A test or repair was done, after what prepared it, and had this outcome."""


QUESTION, PUT_RIGHT, A_PERSON = "question", "yes", "a person"


@dataclass
class Session:
    """An open case. `case` and `standing` change with each outcome; the stages so far are kept."""

    model: FaultModel
    exception: str
    objective: Objective = Objective.ISOLATE
    counts: Mapping[str, float] | None = None
    setup: PlanSetup = no_setup
    expansions: int | None = None
    interrupted: Interrupted = never
    hands: Hands | None = None
    stages: list[CaseStep] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)  # what cannot be prepared any more
    prepared: Prepared | None = None  # what comes before the outcome that is asked for now
    cured: str | None = None
    ended: Floats | None = None

    def __post_init__(self) -> None:
        self._take(open_case(self.model, self.exception, self.objective, self.counts, self.setup))

    def _take(self, case: Case, situation: int = 0) -> None:
        self.case = case
        self.selector = Selector(case.problem, self.expansions, self.interrupted)
        self.standing: Standing = self.selector.start(situation)

    def belief(self) -> tuple[tuple[Hypothesis, float], ...]:
        """The hypotheses that are still possible, with probabilities.

        The most probable comes first, then as declared.
        """
        weights = self.selector.weights(self.standing) if self.ended is None else self.ended
        total = float(weights.sum())
        pairs = [(h, float(w) / total) for h, w in zip(self.case.hypotheses, weights, strict=True) if w > 0.0]
        return tuple(sorted(pairs, key=lambda pair: -pair[1]))

    def advice(self) -> Advice:
        """What to do next."""
        return self.selector.advise(self.standing)

    def observe(self, action: int, outcome: int, advice: Advice) -> None:
        """Take in an outcome.

        If no hypothesis explains it, sets of causes and wrong observations become the hypotheses.
        """
        done = self.case.problem.actions[action]
        cost = float(self.selector.exact.beliefs.costs[self.standing.situation, action])
        before = tuple((str(h), p) for h, p in self.belief())
        observed = Observation(done.name, done.outcomes[outcome])
        steps: tuple[Step, ...] = ()
        if self.prepared is not None and self.hands is not None:
            steps, cost = self.prepared.steps, done.cost + self.prepared.cost
            self.hands.carried_out(done.name, observed.outcome, self.prepared)
        self.stages.append(CaseStep(before, advice, observed, cost, steps))
        if outcome in done.ends:
            self.cured = done.name
            self.ended = self.selector.weights(self.standing) * done.likelihoods[outcome]
            return
        after = self.selector.observe(self.standing, action, outcome)
        if after.possible:
            self.standing = after
        else:
            self._widen(after.situation)

    def prepare(self, action: int) -> bool:
        """Find out what must be done before an action; an action that cannot be prepared any more is left out."""
        if self.hands is None:
            return True
        name = self.case.problem.actions[action].name
        self.prepared = self.hands.prepare(self, name)
        if self.prepared is None:
            self.leave_out(name)
        return self.prepared is not None

    def leave_out(self, name: str) -> None:
        """Go on without a test or repair that cannot be done."""
        self.left_out.append(name)
        belief = self.belief()
        self._go_on(tuple(h for h, _ in belief), [p for _, p in belief], self.standing.situation)

    def _go_on(self, hypotheses: tuple[Hypothesis, ...], weights: list[float], situation: int) -> None:
        """Go on with other hypotheses or other actions; what was done or left out is not asked again."""
        done = [*(stage.observed.action for stage in self.stages), *self.left_out]
        case = case_of(self.model, self.exception, hypotheses, weights, self.objective, self.setup, done)
        self._take(case, situation if case.problem.setup else 0)

    def _widen(self, situation: int) -> None:
        """Go on with the minimal sets that explain everything, because no single cause does.

        The most probable set comes first.
        """
        observations = [stage.observed for stage in self.stages]
        priors = self.model.priors(self.exception, self.counts)
        found = explanations(self.model, priors, observations, interrupted=self.interrupted)
        self._go_on(tuple(h for h, _ in found), [weight for _, weight in found], situation)

    def reply(self, answer: str) -> None:
        """Take in a person's answer to the question of `diagnosis`. It is an observation like any other."""
        belief = self.belief()
        before = tuple((str(h), p) for h, p in belief)
        cost = float(self.model.stop)
        advice = Advice(None, None, cost, cost, True)
        self.stages.append(CaseStep(before, advice, Observation(QUESTION, answer), cost))
        if answer == PUT_RIGHT:
            self.cured = A_PERSON
        named = np.array([str(hypothesis) == answer for hypothesis in self.case.hypotheses])
        if named.any():
            self.ended = self.selector.weights(self.standing) * named

    def diagnosis(self) -> Diagnosis:
        """The state of the case."""
        belief = self.belief()
        cost = sum(stage.cost for stage in self.stages)
        isolated = len({h.causes for h, _ in belief}) == 1
        repairs = () if self.cured else self._repairs(belief)
        question = None if self.cured or repairs or self._answered(belief) else self._question(belief)
        stages = tuple(self.stages)
        finished = isolated or self.ended is not None or self.advice().action is None
        return Diagnosis(
            self.exception, stages, belief, cost, isolated, finished, self.cured, repairs, question
        )

    def _repairs(self, belief: tuple[tuple[Hypothesis, float], ...]) -> tuple[str, ...]:
        """Repairs that may help and were neither tried in vain nor left out. The most likely to cure come first, then the cheapest."""
        past = {*(stage.observed.action for stage in self.stages), *self.left_out}
        causes = [(cause, p) for h, p in belief for cause in h.causes]
        if any(self.model.causes[cause].stops for cause, _ in causes[:1]):
            return ()
        served = {
            each.name: sum(p * each.cures.get(cause, 0.0) for cause, p in causes)
            for each in self.model.repairs.values()
        }
        serving = [name for name, chance in served.items() if chance > 0.0 and name not in past]
        return tuple(
            sorted(serving, key=lambda name: (-round(served[name], 9), self.model.repairs[name].cost))
        )

    def _answered(self, belief: tuple[tuple[Hypothesis, float], ...]) -> bool:
        """Whether a person has answered already what is the matter, or whether it has been put right."""
        last = self.stages[-1].observed if self.stages else Observation("", "")
        return last.action == QUESTION and (len(belief) > 1 or last.outcome == "no")

    def _question(self, belief: tuple[tuple[Hypothesis, float], ...]) -> Question:
        if len(belief) == 1:
            said = "; ".join(self.model.causes[cause].say or cause for cause in belief[0][0].causes)
            return Question(f"{said}: has it been put right?", (PUT_RIGHT, "no"))
        likely = [str(h) for h, _ in belief[: MOST_ANSWERS - 1]]
        said = self.model.exceptions[self.exception].say or self.exception
        return Question(f"{said}: what is the matter?", (*likely, "something else"))


def run(session: Session, answer: Answerer) -> Diagnosis:
    """Ask until the case is decided, nothing is left to ask, or there is no answer."""
    for _ in steps(session, answer):
        pass
    made = session.diagnosis()
    while made.question is not None:
        said = answer(_asked(session, made.question), Advice(None, None, 0.0, 0.0, True))
        if said not in made.question.answers:
            break
        session.reply(str(said))
        made = session.diagnosis()
    return made


def _asked(session: Session, question: Question) -> Action:
    """The question as an action. Only its answers matter."""
    share = 1.0 / len(question.answers)
    rows = tuple((share,) * len(session.case.hypotheses) for _ in question.answers)
    return Action(QUESTION, float(session.model.stop), question.answers, rows)


def steps(session: Session, answer: Answerer) -> Iterator[CaseStep]:
    """Ask and observe, one stage after the other."""
    while session.cured is None:
        advice = session.advice()
        if advice.action is None:
            return
        if not session.prepare(advice.action):
            continue
        action = session.case.problem.actions[advice.action]
        said = answer(action, advice)
        if said is None:
            return
        session.observe(advice.action, action.outcomes.index(said), advice)
        yield session.stages[-1]
