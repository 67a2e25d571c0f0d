"""Fault knowledge as troubleshooting problems: which tests and repairs serve which hypotheses."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum

from cellwright.engine.model.troubleshooting import (
    Action,
    Case,
    CaseHypothesis,
    Conclusion,
    Setup,
    Troubleshooting,
)
from cellwright.kb.model.fault_model import FaultModel, FaultTest, Repair, inseparable_causes
from cellwright.kb.terms import Atom

CURED, NOT_CURED = "cured", "not cured"
SAFE_STOP = "stop safely and ask"

Rows = tuple[tuple[float, ...], ...]
"""The probabilities of the outcomes of a test (outcomes, hypotheses)."""
PlanSetup = Callable[[Sequence[tuple[Atom, ...]]], Setup | None]
"""The cost of preparing the preconditions of each action: from the present state, and after
each other action.
"""


class CaseObjective(StrEnum):
    """What a case is for: to know the cause, or to end the trouble at the least cost."""

    ISOLATE = "isolate"
    REPAIR = "repair"


CERTAINTY = 0.95  # the probability with which a cause counts as found where tests are not sure


def suited_objective(
    model: FaultModel, exception: str, counts: Mapping[str, float] | None = None
) -> CaseObjective:
    """The objective that a case has if nobody names one.

    It is to isolate the cause if sure tests find it, or if there is nothing to tell causes apart or
    to repair. Where only unsure tests tell some causes apart, it is to repair: what an unsure
    outcome is worth depends on what follows.
    """
    hypotheses = tuple(CaseHypothesis((cause,)) for cause in model.priors(exception, counts))
    repaired = any(_repair_serves(repair, hypotheses) for repair in model.repairs.values())
    return (
        CaseObjective.REPAIR
        if repaired and _unsure(_telling(model, hypotheses), len(hypotheses))
        else CaseObjective.ISOLATE
    )


def no_setup(_: Sequence[tuple[Atom, ...]]) -> None:
    """No cost: preconditions need no preparation."""


def open_case(
    model: FaultModel,
    exception: str,
    objective: CaseObjective | None = CaseObjective.ISOLATE,
    counts: Mapping[str, float] | None = None,
    setup: PlanSetup = no_setup,
    certainty: float | None = None,
) -> Case:
    """The problem of an exception, with one hypothesis for each single cause.

    `counts` replace those of the fault base. Without an `objective` it is the one that suits the
    tests.
    """
    priors = model.priors(exception, counts)
    hypotheses = tuple(CaseHypothesis((cause,)) for cause in priors)
    aim = objective or suited_objective(model, exception, counts)
    return case_of(
        model, exception, hypotheses, tuple(priors.values()), aim, setup, certainty=certainty
    )


def case_of(
    model: FaultModel,
    exception: str,
    hypotheses: tuple[CaseHypothesis, ...],
    weights: Sequence[float],
    objective: CaseObjective,
    setup: PlanSetup = no_setup,
    done: Iterable[str] = (),
    certainty: float | None = None,
) -> Case:
    """The problem of telling hypotheses apart. It leaves out tests and repairs that were `done`.

    A test that can be repeated is left out as often as it was done. `certainty` is the probability
    with which a hypothesis counts as found; if it is None, 1 where sure tests find every
    hypothesis, else `CERTAINTY`.
    """
    past = Counter(done)
    tests = [test for test in model.tests.values() if past[test.name] < test.repeats]
    rows = {test.name: _outcome_rows(test, hypotheses) for test in tests}
    chosen: list[FaultTest | Repair] = [
        t for t in tests if len(set(zip(*rows[t.name], strict=True))) > 1
    ]
    if certainty is None:
        unsure = _unsure([rows[chosen_test.name] for chosen_test in chosen], len(hypotheses))
        certainty = CERTAINTY if unsure else 1.0
    if objective is CaseObjective.REPAIR:
        chosen += [
            r
            for r in model.repairs.values()
            if r.name not in past and _repair_serves(r, hypotheses)
        ]
    chosen = [candidate for candidate in chosen for _ in range(_times(candidate, rows, past))]
    chosen, prepared = _prepared_actions(chosen, setup)
    actions = tuple(
        _repair_action(each, hypotheses)
        if isinstance(each, Repair)
        else Action(
            each.name,
            float(each.cost),
            each.outcomes,
            rows[each.name],
            repeats=_earlier(chosen, number),
        )
        for number, each in enumerate(chosen)
    )
    conclusions: tuple[Conclusion, ...] = (
        Conclusion(SAFE_STOP, (float(model.stop),) * len(hypotheses)),
    )
    if objective is CaseObjective.ISOLATE:
        likely = (*_likely(hypotheses, actions), *conclusions)
        conclusions = _case_conclusions(hypotheses, actions) if certainty >= 1.0 else likely
    total = math.fsum(weights)
    problem = Troubleshooting(
        tuple(map(str, hypotheses)),
        tuple(weight / total for weight in weights),
        actions,
        conclusions,
        prepared,
        certainty if objective is CaseObjective.ISOLATE else 1.0,
    )
    return Case(exception, hypotheses, problem, certainty)


def _prepared_actions(
    chosen: list[FaultTest | Repair], setup: PlanSetup
) -> tuple[list[FaultTest | Repair], Setup | None]:
    """The actions that can be prepared, and the steps that prepare them."""
    prepared = setup([each.preconditions for each in chosen])
    if prepared is None or all(map(math.isfinite, prepared.costs[0])):
        return chosen, prepared
    chosen = [
        each for each, cost in zip(chosen, prepared.costs[0], strict=True) if math.isfinite(cost)
    ]
    return chosen, setup([each.preconditions for each in chosen])


def _times(action: FaultTest | Repair, rows: Mapping[str, Rows], past: Mapping[str, int]) -> int:
    """How often an action can be done from now on so that each time tells something."""
    if isinstance(action, Repair) or all(p in (0.0, 1.0) for row in rows[action.name] for p in row):
        return 1
    return action.repeats - past.get(action.name, 0)


def _earlier(chosen: Sequence[FaultTest | Repair], number: int) -> int | None:
    """The number of the action that the action with this number repeats."""
    return number - 1 if number and chosen[number - 1] is chosen[number] else None


def _telling(model: FaultModel, hypotheses: Sequence[CaseHypothesis]) -> list[Rows]:
    """The probabilities of the outcomes of those tests that tell some hypotheses apart."""
    rows = (_outcome_rows(test, hypotheses) for test in model.tests.values())
    return [each for each in rows if len(set(zip(*each, strict=True))) > 1]


def _unsure(tests: Sequence[Rows], count: int) -> bool:
    """Whether only tests that are not sure tell some hypotheses apart."""
    return any(
        len({tuple(row[index] for row in rows) for index in group}) > 1
        for group in inseparable_causes(tests, count)
        for rows in tests
    )


def outcome_likelihood(test: FaultTest, outcome: str, hypothesis: CaseHypothesis) -> float:
    """The probability of an outcome if all causes of a hypothesis are present.

    A test that lies gives each outcome with the same probability. If no cause disturbs a test, its
    outcome is the usual one. Causes disturb a test independently of each other. The other outcomes
    share the probability of a disturbance in proportion to what the causes give them (noisy-or
    without a leak: Pearl 1988).
    """
    if test.name in hypothesis.lies:
        return 1.0 / len(test.outcomes)
    if len(hypothesis.causes) == 1:
        return test.likelihood(outcome, hypothesis.causes[0])
    normal = math.prod(test.likelihood(test.otherwise, cause) for cause in hypothesis.causes)
    if outcome == test.otherwise:
        return normal
    disturbed = math.fsum(
        test.likelihood(test_outcome, cause)
        for cause in hypothesis.causes
        for test_outcome in test.outcomes
        if test_outcome != test.otherwise
    )
    if disturbed == 0.0:
        return 0.0
    shown = math.fsum(test.likelihood(outcome, cause) for cause in hypothesis.causes)
    return (1.0 - normal) * shown / disturbed


def cure_chance(repair: Repair, hypothesis: CaseHypothesis) -> float:
    """The probability that a repair ends the trouble: it must cure every cause.

    A lie alone needs no repair.
    """
    return math.prod(repair.cures.get(cause, 0.0) for cause in hypothesis.causes)


def chance_of(action: FaultTest | Repair, outcome: str, hypothesis: CaseHypothesis) -> float:
    """The probability of an outcome of a test or repair if a hypothesis is true."""
    if isinstance(action, FaultTest):
        return outcome_likelihood(action, outcome, hypothesis)
    cured = cure_chance(action, hypothesis)
    return cured if outcome == CURED else 1.0 - cured


def _outcome_rows(test: FaultTest, hypotheses: Sequence[CaseHypothesis]) -> Rows:
    """The probabilities of the outcomes of a test (outcomes, hypotheses)."""
    return tuple(
        tuple(outcome_likelihood(test, outcome, h) for h in hypotheses) for outcome in test.outcomes
    )


def _repair_action(repair: Repair, hypotheses: Sequence[CaseHypothesis]) -> Action:
    cured = tuple(cure_chance(repair, hypothesis) for hypothesis in hypotheses)
    chances = (cured, tuple(1.0 - chance for chance in cured))
    return Action(repair.name, float(repair.cost), (CURED, NOT_CURED), chances, frozenset({0}))


def _repair_serves(repair: Repair, hypotheses: Sequence[CaseHypothesis]) -> bool:
    return any(cure_chance(repair, hypothesis) > 0.0 for hypothesis in hypotheses)


def _likely(
    hypotheses: Sequence[CaseHypothesis], tests: Sequence[Action]
) -> tuple[Conclusion, ...]:
    """Each hypothesis may be concluded when it is likely enough; those that all tests answer
    alike, together.
    """
    alike: dict[tuple[tuple[float, ...], ...], list[int]] = {}
    for index in range(len(hypotheses)):
        alike.setdefault(
            tuple(tuple(row[index] for row in t.likelihoods) for t in tests), []
        ).append(index)
    return tuple(_together(hypotheses, group) for group in alike.values())


def _together(hypotheses: Sequence[CaseHypothesis], group: Sequence[int]) -> Conclusion:
    losses = tuple(0.0 if index in group else math.inf for index in range(len(hypotheses)))
    return Conclusion(" or ".join(str(hypotheses[index]) for index in group), losses)


def _case_conclusions(
    hypotheses: Sequence[CaseHypothesis], tests: Sequence[Action]
) -> tuple[Conclusion, ...]:
    """Each hypothesis may be concluded when no other is possible.

    Those that no test surely separates may be concluded together.
    """
    count = len(hypotheses)
    together = inseparable_causes((test.likelihoods for test in tests), count)
    return tuple(
        _together(hypotheses, group) for group in [*((index,) for index in range(count)), *together]
    )
