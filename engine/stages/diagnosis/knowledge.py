"""Fault knowledge as troubleshooting problems: which tests and repairs matter for which hypotheses."""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum

from engine.model.cases import Case, Hypothesis
from engine.model.troubleshooting import Action, Conclusion, Setup, Troubleshooting
from kb.model.faults import FaultModel, FaultTest, Repair
from kb.terms import Atom

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
    chosen: list[FaultTest | Repair] = [t for t in tests if _tells(t, hypotheses)]
    if objective is Objective.REPAIR:
        chosen += [r for r in model.repairs.values() if r.name not in past and _serves(r, hypotheses)]
    prepared = setup([each.preconditions for each in chosen])
    if prepared is not None and not all(map(math.isfinite, prepared.costs[0])):
        chosen = [each for each, cost in zip(chosen, prepared.costs[0], strict=True) if math.isfinite(cost)]
        prepared = setup([each.preconditions for each in chosen])
    actions = tuple(_action(each, hypotheses) for each in chosen)
    conclusions: tuple[Conclusion, ...] = (Conclusion(STOP, (float(model.stop),) * len(hypotheses)),)
    if objective is Objective.ISOLATE:
        conclusions = _conclusions(hypotheses, [each for each in chosen if isinstance(each, FaultTest)])
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


def _action(each: FaultTest | Repair, hypotheses: Sequence[Hypothesis]) -> Action:
    if isinstance(each, Repair):
        cured = tuple(cure_chance(each, hypothesis) for hypothesis in hypotheses)
        chances = (cured, tuple(1.0 - chance for chance in cured))
        return Action(each.name, float(each.cost), (CURED, NOT_CURED), chances, frozenset({0}))
    rows = tuple(tuple(likelihood(each, outcome, h) for h in hypotheses) for outcome in each.outcomes)
    return Action(each.name, float(each.cost), each.outcomes, rows)


def _tells(test: FaultTest, hypotheses: Sequence[Hypothesis]) -> bool:
    return len({tuple(likelihood(test, outcome, h) for outcome in test.outcomes) for h in hypotheses}) > 1


def _serves(repair: Repair, hypotheses: Sequence[Hypothesis]) -> bool:
    return any(cure_chance(repair, hypothesis) > 0.0 for hypothesis in hypotheses)


def _conclusions(hypotheses: Sequence[Hypothesis], tests: Sequence[FaultTest]) -> tuple[Conclusion, ...]:
    """Each hypothesis may be concluded when no other is possible.

    Those that no test surely separates may be concluded together.
    """
    groups: list[set[int]] = [{index} for index in range(len(hypotheses))]
    for one, other in itertools.combinations(range(len(hypotheses)), 2):
        if not any(_surely_apart(test, hypotheses[one], hypotheses[other]) for test in tests):
            joined = [group for group in groups if one in group or other in group]
            groups = [group for group in groups if group not in joined] + [set[int]().union(*joined)]
    alone = [{index} for index in range(len(hypotheses))]
    return tuple(
        Conclusion(
            " or ".join(str(hypotheses[index]) for index in sorted(group)),
            tuple(0.0 if index in group else math.inf for index in range(len(hypotheses))),
        )
        for group in [*alone, *(group for group in groups if len(group) > 1)]
    )


def _surely_apart(test: FaultTest, one: Hypothesis, other: Hypothesis) -> bool:
    """Whether each outcome of a test rules out at least one of two hypotheses."""
    return all(likelihood(test, o, one) == 0.0 or likelihood(test, o, other) == 0.0 for o in test.outcomes)
