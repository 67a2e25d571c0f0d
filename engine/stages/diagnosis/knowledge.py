"""Fault knowledge as troubleshooting problems: which tests and repairs matter for which hypotheses."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum

from cellwright.engine.model.cases import Case, Hypothesis
from cellwright.engine.model.troubleshooting import Action, Conclusion, Setup, Troubleshooting
from cellwright.kb.model.faults import FaultModel, FaultTest, Repair, inseparable
from cellwright.kb.terms import Atom

CURED, NOT_CURED = "cured", "not cured"
STOP = "stop safely and ask"

PlanSetup = Callable[[Sequence[tuple[Atom, ...]]], Setup | None]
"""The cost of preparing the preconditions of each action: from the present state, and after each other action."""


class Objective(StrEnum):
    """What a case is for: to know the cause, or to end the trouble at the least cost."""

    ISOLATE = "isolate"
    REPAIR = "repair"


def no_setup(_: Sequence[tuple[Atom, ...]]) -> None:
    """No cost: preconditions need no preparation."""


def open_case(
    model: FaultModel,
    exception: str,
    objective: Objective = Objective.ISOLATE,
    counts: Mapping[str, float] | None = None,
    setup: PlanSetup = no_setup,
) -> Case:
    """The problem of an exception, with one hypothesis for each single cause.

    `counts` replace those of the fault base.
    """
    priors = model.priors(exception, counts)
    hypotheses = tuple(Hypothesis((cause,)) for cause in priors)
    return case_of(model, exception, hypotheses, tuple(priors.values()), objective, setup)


def case_of(
    model: FaultModel,
    exception: str,
    hypotheses: tuple[Hypothesis, ...],
    weights: Sequence[float],
    objective: Objective,
    setup: PlanSetup = no_setup,
    done: Iterable[str] = (),
) -> Case:
    """The problem of telling hypotheses apart. It leaves out tests and repairs that were `done`."""
    past = set(done)
    tests = [test for test in model.tests.values() if test.name not in past]
    rows = {test.name: _rows(test, hypotheses) for test in tests}
    chosen: list[FaultTest | Repair] = [t for t in tests if len(set(zip(*rows[t.name], strict=True))) > 1]
    if objective is Objective.REPAIR:
        chosen += [r for r in model.repairs.values() if r.name not in past and _serves(r, hypotheses)]
    prepared = setup([each.preconditions for each in chosen])
    if prepared is not None and not all(map(math.isfinite, prepared.costs[0])):
        chosen = [each for each, cost in zip(chosen, prepared.costs[0], strict=True) if math.isfinite(cost)]
        prepared = setup([each.preconditions for each in chosen])
    actions = tuple(
        _repair(each, hypotheses)
        if isinstance(each, Repair)
        else Action(each.name, float(each.cost), each.outcomes, rows[each.name])
        for each in chosen
    )
    conclusions: tuple[Conclusion, ...] = (Conclusion(STOP, (float(model.stop),) * len(hypotheses)),)
    if objective is Objective.ISOLATE:
        conclusions = _conclusions(hypotheses, actions)
    total = math.fsum(weights)
    problem = Troubleshooting(
        tuple(map(str, hypotheses)),
        tuple(weight / total for weight in weights),
        actions,
        conclusions,
        prepared,
    )
    return Case(exception, hypotheses, problem)


def likelihood(test: FaultTest, outcome: str, hypothesis: Hypothesis) -> float:
    """The probability of an outcome if all causes of a hypothesis are present.

    A test that lies gives each outcome with the same probability. If no cause disturbs a test, its outcome is
    the usual one. Causes disturb a test independently of each other. The other outcomes share the probability
    of a disturbance in proportion to what the causes give them (noisy-or without a leak: Pearl 1988).
    """
    if test.name in hypothesis.lies:
        return 1.0 / len(test.outcomes)
    if len(hypothesis.causes) == 1:
        return test.likelihood(outcome, hypothesis.causes[0])
    normal = math.prod(test.likelihood(test.otherwise, cause) for cause in hypothesis.causes)
    if outcome == test.otherwise:
        return normal
    disturbed = math.fsum(
        test.likelihood(other, cause)
        for cause in hypothesis.causes
        for other in test.outcomes
        if other != test.otherwise
    )
    if disturbed == 0.0:
        return 0.0
    shown = math.fsum(test.likelihood(outcome, cause) for cause in hypothesis.causes)
    return (1.0 - normal) * shown / disturbed


def cure_chance(repair: Repair, hypothesis: Hypothesis) -> float:
    """The probability that a repair ends the trouble: it must cure every cause.

    A lie alone needs no repair.
    """
    return math.prod(repair.cures.get(cause, 0.0) for cause in hypothesis.causes)


def _rows(test: FaultTest, hypotheses: Sequence[Hypothesis]) -> tuple[tuple[float, ...], ...]:
    """The probabilities of the outcomes of a test (outcomes, hypotheses)."""
    return tuple(tuple(likelihood(test, outcome, h) for h in hypotheses) for outcome in test.outcomes)


def _repair(repair: Repair, hypotheses: Sequence[Hypothesis]) -> Action:
    cured = tuple(cure_chance(repair, hypothesis) for hypothesis in hypotheses)
    chances = (cured, tuple(1.0 - chance for chance in cured))
    return Action(repair.name, float(repair.cost), (CURED, NOT_CURED), chances, frozenset({0}))


def _serves(repair: Repair, hypotheses: Sequence[Hypothesis]) -> bool:
    return any(cure_chance(repair, hypothesis) > 0.0 for hypothesis in hypotheses)


def _conclusions(hypotheses: Sequence[Hypothesis], tests: Sequence[Action]) -> tuple[Conclusion, ...]:
    """Each hypothesis may be concluded when no other is possible.

    Those that no test surely separates may be concluded together.
    """
    count = len(hypotheses)
    together = inseparable((test.likelihoods for test in tests), count)
    return tuple(
        Conclusion(
            " or ".join(str(hypotheses[index]) for index in group),
            tuple(0.0 if index in group else math.inf for index in range(count)),
        )
        for group in [*((index,) for index in range(count)), *together]
    )
