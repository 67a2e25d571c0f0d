"""One case from the exception to its end: ask for outcomes and update the belief until nothing is left to
ask.

A session does not know who answers. The answers come from a function: a person, a list or a simulation.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from engine.kernels.arrays import Floats
from engine.kernels.cancellation import Interrupted, never
from engine.model.cases import Case, Diagnosis, Hypothesis, Observation, Question, Stage
from engine.model.troubleshooting import Action, Advice, Standing
from engine.stages.diagnosis.knowledge import Objective, PlanSetup, case_of, no_setup, open_case
from engine.stages.diagnosis.multiple import explanations
from engine.stages.diagnosis.selection import Selector
from kb.model.faults import FaultModel

Answer = Callable[[Action, Advice], str | None]
"""Gives the outcome of an action; None ends the session."""
MOST_ANSWERS = 4
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
    stages: list[Stage] = field(default_factory=list)
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
        self.stages.append(Stage(before, advice, observed, cost))
        if outcome in done.ends:
            self.cured = done.name
            self.ended = self.selector.weights(self.standing) * done.likelihoods[outcome]
            return
        after = self.selector.observe(self.standing, action, outcome)
        if after.possible:
            self.standing = after
        else:
            self._widen(after.situation)

    def _widen(self, situation: int) -> None:
        """Go on with the minimal sets that explain everything, because no single cause does.

        The most probable set comes first.
        """
        observations = [stage.observed for stage in self.stages]
        priors = self.model.priors(self.exception, self.counts)
        found = explanations(self.model, priors, observations, interrupted=self.interrupted)
        hypotheses, weights = tuple(h for h, _ in found), [weight for _, weight in found]
        done = [each.action for each in observations]
        case = case_of(self.model, self.exception, hypotheses, weights, self.objective, self.setup, done)
        self._take(case, situation if case.problem.setup else 0)

    def reply(self, answer: str) -> None:
        """Take in a person's answer to the question of `diagnosis`. It is an observation like any other."""
        belief = self.belief()
        before = tuple((str(h), p) for h, p in belief)
        cost = float(self.model.stop)
        advice = Advice(None, None, cost, cost, True)
        self.stages.append(Stage(before, advice, Observation(QUESTION, answer), cost))
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
        """Repairs that may help. Those that are most likely to cure come first, then the cheapest."""
        causes = [(cause, p) for h, p in belief for cause in h.causes]
        if any(self.model.causes[cause].stops for cause, _ in causes[:1]):
            return ()
        served = {
            each.name: sum(p * each.cures.get(cause, 0.0) for cause, p in causes)
            for each in self.model.repairs.values()
        }
        serving = [name for name, chance in served.items() if chance > 0.0]
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


def run(session: Session, answer: Answer) -> Diagnosis:
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


def steps(session: Session, answer: Answer) -> Iterator[Stage]:
    """Ask and observe, one stage after the other."""
    while session.cured is None:
        advice = session.advice()
        if advice.action is None:
            return
        action = session.case.problem.actions[advice.action]
        said = answer(action, advice)
        if said is None:
            return
        session.observe(advice.action, action.outcomes.index(said), advice)
        yield session.stages[-1]
