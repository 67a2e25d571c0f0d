"""One case from exception to end: tests update the belief; several faults at once are found.

Minimal diagnoses, most probable first (Reiter 1987; de Kleer & Williams 1987). clingo finds the
sets; exact probabilities decide their order.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.troubleshooting import (
    Action,
    Case,
    CaseAdvice,
    CaseDiagnosis,
    CaseHypothesis,
    CaseStanding,
    CaseStep,
    Observation,
    PreparationSteps,
    Question,
)
from cellwright.engine.stages.diagnosis.action_selection import ActionSelector
from cellwright.engine.stages.diagnosis.fault_problems import (
    CURED,
    CaseObjective,
    PlanSetup,
    case_of,
    chance_of,
    cure_chance,
    no_setup,
    open_case,
    outcome_likelihood,
    suited_objective,
)
from cellwright.kb.asp.model_search import best_models
from cellwright.kb.model.fault_model import FaultModel, FaultTest, Repair
from cellwright.kb.model.plan_model import Step
from cellwright.kb.terms import Function

MAX_EXPLANATIONS = 12
# the probability of what is said never to be: it counts only if nothing else explains what was seen
LEAST = 1e-12
_LOG_SCALE = 1000  # the factor of the negative logarithms that clingo adds up

_EXPLANATION_RULES = """
{ active(C) : cause(C) }.
{ lies(T) : observed(T, _) }.
chosen(there(C)) :- active(C).
chosen(false(T)) :- lies(T).
:- not active(C) : cause(C).
explained(T) :- lies(T).
explained(T) :- observed(T, O), usual(T, O), active(_), not disturbed(T).
explained(T) :- observed(T, O), not usual(T, O), active(C), may(C, T, O).
disturbed(T) :- active(C), never(C, T).
:- observed(T, _), not explained(T).
outlasts(R) :- failed(R), active(C), survives(C, R).
:- failed(R), not outlasts(R).
#minimize { W, C : active(C), cause_weight(C, W); W, T, lie : lies(T), lie_weight(T, W) }.
"""


def explain_observations(
    model: FaultModel,
    priors: Mapping[str, float],
    observations: Sequence[Observation],
    most: int = MAX_EXPLANATIONS,
    interrupted: Interrupted = never,
) -> list[tuple[CaseHypothesis, float]]:
    """The minimal sets of causes and wrong observations that explain what was seen.

    If `interrupted`, there are fewer, but always the most probable one. Each has its probability;
    these sum to 1. The most probable set comes first.
    """
    seen = [observation for observation in observations if observation.action in model.tests]
    failed = [
        model.repairs[observation.action]
        for observation in observations
        if observation.action in model.repairs
    ]
    program = "\n".join(
        [
            _EXPLANATION_RULES,
            *_observation_facts(model, priors, seen),
            *_failure_facts(failed, priors),
        ]
    )
    hypotheses = [
        _hypothesis_of(atoms) for _, atoms in best_models(program, "chosen", most, (), interrupted)
    ]
    weights = [
        _joint_probability(model, priors, seen, hypothesis)
        * math.prod(1.0 - cure_chance(repair, hypothesis) for repair in failed)
        for hypothesis in hypotheses
    ]
    total = math.fsum(weights)
    ranked = [(h, w / total) for h, w in zip(hypotheses, weights, strict=True) if w > 0.0]
    return sorted(ranked, key=lambda weighted: -weighted[1])


def _observation_facts(
    model: FaultModel, priors: Mapping[str, float], seen: Sequence[Observation]
) -> list[str]:
    facts = [
        f"cause({cause}). cause_weight({cause}, {_log_cost(prior)})."
        for cause, prior in priors.items()
    ]
    for observation in seen:
        test = model.tests[observation.action]
        facts.append(
            f"observed({test.name}, {observation.outcome}). usual({test.name}, {test.otherwise})."
        )
        facts.append(f"lie_weight({test.name}, {_log_cost(model.lies)}).")
        for cause in priors:
            if test.likelihood(observation.outcome, cause) > 0.0:
                facts.append(f"may({cause}, {test.name}, {observation.outcome}).")
            if test.likelihood(test.otherwise, cause) == 0.0:
                facts.append(f"never({cause}, {test.name}).")
    return facts


def _failure_facts(failed: Sequence[Repair], priors: Mapping[str, float]) -> list[str]:
    """Facts for repairs that did not help: each leaves some cause that it does not surely cure."""
    facts = [f"failed({repair.name})." for repair in failed]
    return facts + [
        f"survives({cause}, {repair.name})."
        for repair in failed
        for cause in priors
        if repair.cures.get(cause, 0.0) < 1.0
    ]


def _log_cost(probability: float) -> int:
    return max(1, round(-_LOG_SCALE * math.log(max(probability, LEAST))))


def _hypothesis_of(atoms: Sequence[Function]) -> CaseHypothesis:
    named = [(atom.name, str(atom.arguments[0])) for atom in atoms]
    causes = tuple(sorted(name for kind, name in named if kind == "there"))
    return CaseHypothesis(causes, tuple(sorted(name for kind, name in named if kind == "false")))


def _joint_probability(
    model: FaultModel,
    priors: Mapping[str, float],
    seen: Sequence[Observation],
    hypothesis: CaseHypothesis,
) -> float:
    """The probability of a hypothesis together with what was seen, up to a factor."""
    weight = math.prod(priors[cause] for cause in hypothesis.causes) * max(
        model.lies, LEAST
    ) ** len(hypothesis.lies)
    for observation in seen:
        test: FaultTest = model.tests[observation.action]
        weight *= outcome_likelihood(test, observation.outcome, hypothesis)
    return weight


Answerer = Callable[[Action, CaseAdvice], str | None]
"""Gives the outcome of an action; None ends the session."""
MOST_ANSWERS = 4


class CaseExecutor(Protocol):
    """Who carries out tests and repairs in a world, so that what they change there is known."""

    def prepare(self, session: "CaseSession", action: str) -> PreparationSteps | None:
        """What must be done before a test or repair as things stand now; None if that cannot be
        brought about.
        """

    def carried_out(self, action: str, outcome: str, prepared: PreparationSteps) -> None:
        """A test or repair was done, after what prepared it, and had this outcome."""


NOT_ASKED = CaseAdvice(None, None, 0.0, 0.0, True)
"""No advice: an outcome was given without being asked for."""
ROUNDING = 1e-9  # of probabilities
QUESTION, PUT_RIGHT, A_PERSON = "question", "yes", "a person"


@dataclass
class CaseSession:
    """An open case. `case` and `standing` change with each outcome; the stages so far are kept."""

    model: FaultModel
    exception: str
    objective: CaseObjective | None = CaseObjective.ISOLATE  # None: the one that suits the tests
    counts: Mapping[str, float] | None = None
    setup: PlanSetup = no_setup
    expansions: int | None = None
    interrupted: Interrupted = never
    hands: CaseExecutor | None = None
    certainty: float | None = None  # with which a cause counts as found; None: what suits the tests
    stages: list[CaseStep] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)  # what cannot be prepared any more
    prepared: PreparationSteps | None = None  # what comes before the outcome that is asked for now
    cured: str | None = None
    ended: Floats | None = None

    def __post_init__(self) -> None:
        self.aim = self.objective or suited_objective(self.model, self.exception, self.counts)
        model, exception, counts = self.model, self.exception, self.counts
        self._take(open_case(model, exception, self.aim, counts, self.setup, self.certainty))
        self.asked = self.case.certainty

    def _take(self, case: Case, situation: int = 0) -> None:
        self.case = case
        self.selector = ActionSelector(case.problem, self.expansions, self.interrupted)
        self.standing: CaseStanding = self.selector.start(situation)

    def belief(self) -> tuple[tuple[CaseHypothesis, float], ...]:
        """The hypotheses that are still possible, with probabilities.

        The most probable comes first, then as declared.
        """
        weights = self.selector.weights(self.standing) if self.ended is None else self.ended
        total = float(weights.sum())
        pairs = [
            (h, float(w) / total)
            for h, w in zip(self.case.hypotheses, weights, strict=True)
            if w > 0.0
        ]
        return tuple(sorted(pairs, key=lambda pair: -pair[1]))

    def advice(self) -> CaseAdvice:
        """What to do next."""
        return self.selector.advise(self.standing)

    def observe(self, action: int, outcome: int, advice: CaseAdvice) -> None:
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

    def take_in(self, seen: Observation) -> None:
        """Take in an outcome that was seen, whether it was asked for or not.

        What the same test has shown already is known, unless its repetitions are independent.
        """
        name, outcome = seen.action, seen.outcome
        actions = self.case.problem.actions
        self.prepared = (
            None if self.hands is None else self.hands.prepare(self, name) or PreparationSteps()
        )
        after = self.selector.available(self.standing)
        number = next((n for n in after if actions[n].name == name), None)
        if number is not None:
            self.observe(number, actions[number].outcomes.index(outcome), NOT_ASKED)
        elif not self._is_known(name):
            self._condition(seen)

    def _is_known(self, name: str) -> bool:
        """Whether doing a test or repair once more shows what it has shown."""
        times = sum(stage.observed.action == name for stage in self.stages)
        return times >= (self.model.tests[name].repeats if name in self.model.tests else 1)

    def _condition(self, seen: Observation) -> None:
        """Take in the outcome of a test or repair that is no action of the case."""
        done = self.model.tests.get(seen.action) or self.model.repairs[seen.action]
        belief = self.belief()
        cost = float(done.cost)
        steps: tuple[Step, ...] = ()
        if self.prepared is not None and self.hands is not None:
            steps, cost = self.prepared.steps, cost + self.prepared.cost
            self.hands.carried_out(seen.action, seen.outcome, self.prepared)
        before = tuple((str(h), p) for h, p in belief)
        self.stages.append(CaseStep(before, NOT_ASKED, seen, cost, steps))
        left = [(h, p * chance_of(done, seen.outcome, h)) for h, p in belief]
        left = [(h, p) for h, p in left if p > 0.0]
        situation = self.standing.situation
        if not left:
            self._widen(situation)
            return
        self._go_on(tuple(h for h, _ in left), [p for _, p in left], situation)
        if isinstance(done, Repair) and seen.outcome == CURED:
            self.cured, self.ended = done.name, self.selector.weights(self.standing)

    def prepare(self, action: int) -> bool:
        """Find out what must be done before an action; an action that cannot be prepared any
        more is left out.
        """
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

    def _go_on(
        self, hypotheses: tuple[CaseHypothesis, ...], weights: list[float], situation: int
    ) -> None:
        """Go on with other hypotheses or other actions; what was done or left out is not asked
        again.
        """
        done = [*(stage.observed.action for stage in self.stages), *self.left_out]
        model, asked = self.model, self.asked
        case = case_of(
            model, self.exception, hypotheses, weights, self.aim, self.setup, done, asked
        )
        self._take(case, situation if case.problem.setup else 0)

    def _widen(self, situation: int) -> None:
        """Go on with the minimal sets that explain everything, because no single cause does.

        The most probable set comes first.
        """
        observations = [stage.observed for stage in self.stages]
        priors = self.model.priors(self.exception, self.counts)
        wider = explain_observations(self.model, priors, observations, interrupted=self.interrupted)
        self._go_on(tuple(h for h, _ in wider), [weight for _, weight in wider], situation)

    def reply(self, answer: str) -> None:
        """Take in a person's answer to the question of `diagnosis`.

        It is an observation like any other.
        """
        belief = self.belief()
        before = tuple((str(h), p) for h, p in belief)
        cost = float(self.model.stop)
        advice = CaseAdvice(None, None, cost, cost, True)
        self.stages.append(CaseStep(before, advice, Observation(QUESTION, answer), cost))
        if answer == PUT_RIGHT:
            self.cured = A_PERSON
        named = np.array([str(hypothesis) == answer for hypothesis in self.case.hypotheses])
        if named.any():
            self.ended = self.selector.weights(self.standing) * named

    def diagnosis(self) -> CaseDiagnosis:
        """The state of the case."""
        belief = self.belief()
        cost = sum(stage.cost for stage in self.stages)
        likely = self.asked < 1.0 and belief[0][1] >= self.asked - ROUNDING
        isolated = likely or len({h.causes for h, _ in belief}) == 1
        repairs = () if self.cured else self._repairs(belief)
        question = (
            None if self.cured or repairs or self._answered(belief) else self._question(belief)
        )
        stages = tuple(self.stages)
        finished = isolated or self.ended is not None or self.advice().action is None
        return CaseDiagnosis(
            self.exception, stages, belief, cost, isolated, finished, self.cured, repairs, question
        )

    def _repairs(self, belief: tuple[tuple[CaseHypothesis, float], ...]) -> tuple[str, ...]:
        """Repairs that may help and were neither tried in vain nor left out.

        The most likely to cure come first, then the cheapest.
        """
        past = {*(stage.observed.action for stage in self.stages), *self.left_out}
        causes = [(cause, p) for h, p in belief for cause in h.causes]
        if any(self.model.causes[cause].stops for cause, _ in causes[:1]):
            return ()
        served = {
            repair.name: sum(p * repair.cures.get(cause, 0.0) for cause, p in causes)
            for repair in self.model.repairs.values()
        }
        serving = [name for name, chance in served.items() if chance > 0.0 and name not in past]
        return tuple(
            sorted(
                serving, key=lambda name: (-round(served[name], 9), self.model.repairs[name].cost)
            )
        )

    def _answered(self, belief: tuple[tuple[CaseHypothesis, float], ...]) -> bool:
        """Whether a person has answered already what is the matter, or whether it has been put
        right.
        """
        last = self.stages[-1].observed if self.stages else Observation("", "")
        return last.action == QUESTION and (len(belief) > 1 or last.outcome == "no")

    def _question(self, belief: tuple[tuple[CaseHypothesis, float], ...]) -> Question:
        if len(belief) == 1:
            said = "; ".join(self.model.causes[cause].say or cause for cause in belief[0][0].causes)
            return Question(f"{said}: has it been put right?", (PUT_RIGHT, "no"))
        likely = [str(h) for h, _ in belief[: MOST_ANSWERS - 1]]
        said = self.model.exceptions[self.exception].say or self.exception
        return Question(f"{said}: what is the matter?", (*likely, "something else"))


def run_session(
    session: CaseSession, answer: Answerer, given: Iterable[Observation] = ()
) -> CaseDiagnosis:
    """Ask until the case is decided, nothing is left to ask, or there is no answer.

    What is `given` was seen before anything is asked.
    """
    for seen in given:
        session.take_in(seen)
    for _ in case_steps(session, answer):
        pass
    diagnosis = session.diagnosis()
    while diagnosis.question is not None:
        said = answer(
            _question_action(session, diagnosis.question), CaseAdvice(None, None, 0.0, 0.0, True)
        )
        if said not in diagnosis.question.answers:
            break
        session.reply(str(said))
        diagnosis = session.diagnosis()
    return diagnosis


def _question_action(session: CaseSession, question: Question) -> Action:
    """The question as an action. Only its answers matter."""
    share = 1.0 / len(question.answers)
    rows = tuple((share,) * len(session.case.hypotheses) for _ in question.answers)
    return Action(QUESTION, float(session.model.stop), question.answers, rows)


def case_steps(session: CaseSession, answer: Answerer) -> Iterator[CaseStep]:
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
