"""Fault knowledge as troubleshooting problems: which tests and repairs serve which hypotheses."""

import math
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

PlanSetup = Callable[[Sequence[tuple[Atom, ...]]], Setup | None]
"""The cost of preparing the preconditions of each action: from the present state, and after
each other action.
"""


class CaseObjective(StrEnum):
    """What a case is for: to know the cause, or to end the trouble at the least cost."""

    ISOLATE = "isolate"
    REPAIR = "repair"


def no_setup(_: Sequence[tuple[Atom, ...]]) -> None:
    """No cost: preconditions need no preparation."""


def open_case(
    model: FaultModel,
    exception: str,
    objective: CaseObjective = CaseObjective.ISOLATE,
    counts: Mapping[str, float] | None = None,
    setup: PlanSetup = no_setup,
) -> Case:
    """The problem of an exception, with one hypothesis for each single cause.

    `counts` replace those of the fault base.
    """
    priors = model.priors(exception, counts)
    hypotheses = tuple(CaseHypothesis((cause,)) for cause in priors)
    return case_of(model, exception, hypotheses, tuple(priors.values()), objective, setup)


def case_of(
    model: FaultModel,
    exception: str,
    hypotheses: tuple[CaseHypothesis, ...],
    weights: Sequence[float],
    objective: CaseObjective,
    setup: PlanSetup = no_setup,
    done: Iterable[str] = (),
) -> Case:
    """The problem of telling hypotheses apart. It leaves out tests and repairs that were `done`."""
    past = set(done)
    tests = [test for test in model.tests.values() if test.name not in past]
    rows = {test.name: _outcome_rows(test, hypotheses) for test in tests}
    chosen: list[FaultTest | Repair] = [
        t for t in tests if len(set(zip(*rows[t.name], strict=True))) > 1
    ]
    if objective is CaseObjective.REPAIR:
        chosen += [
            r
            for r in model.repairs.values()
            if r.name not in past and _repair_serves(r, hypotheses)
        ]
    prepared = setup([chosen_test.preconditions for chosen_test in chosen])
    if prepared is not None and not all(map(math.isfinite, prepared.costs[0])):
        chosen = [
            candidate
            for candidate, cost in zip(chosen, prepared.costs[0], strict=True)
            if math.isfinite(cost)
        ]
        prepared = setup([chosen_test.preconditions for chosen_test in chosen])
    actions = tuple(
        _repair_action(repair, hypotheses)
        if isinstance(repair, Repair)
        else Action(repair.name, float(repair.cost), repair.outcomes, rows[repair.name])
        for repair in chosen
    )
    conclusions: tuple[Conclusion, ...] = (
        Conclusion(SAFE_STOP, (float(model.stop),) * len(hypotheses)),
    )
    if objective is CaseObjective.ISOLATE:
        conclusions = _case_conclusions(hypotheses, actions)
    total = math.fsum(weights)
    problem = Troubleshooting(
        tuple(map(str, hypotheses)),
        tuple(weight / total for weight in weights),
        actions,
        conclusions,
        prepared,
    )
    return Case(exception, hypotheses, problem)


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


def _outcome_rows(
    test: FaultTest, hypotheses: Sequence[CaseHypothesis]
) -> tuple[tuple[float, ...], ...]:
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


def _case_conclusions(
    hypotheses: Sequence[CaseHypothesis], tests: Sequence[Action]
) -> tuple[Conclusion, ...]:
    """Each hypothesis may be concluded when no other is possible.

    Those that no test surely separates may be concluded together.
    """
    count = len(hypotheses)
    together = inseparable_causes((test.likelihoods for test in tests), count)
    return tuple(
        Conclusion(
            " or ".join(str(hypotheses[index]) for index in group),
            tuple(0.0 if index in group else math.inf for index in range(count)),
        )
        for group in [*((index,) for index in range(count)), *together]
    )
