"""Several faults at once, and wrong observations: the minimal sets that explain what no single cause
explains.

Minimal diagnoses, most probable first (Reiter 1987; de Kleer & Williams 1987). clingo finds the sets; exact
probabilities decide their order.
"""

import math
from collections.abc import Mapping, Sequence

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.cases import Hypothesis, Observation
from cellwright.engine.stages.diagnosis.knowledge import cure_chance, likelihood
from cellwright.kb.asp.optimum import best_models
from cellwright.kb.model.faults import FaultModel, FaultTest, Repair
from cellwright.kb.terms import Function

MOST = 12
_SCALE = 1000  # the factor of the negative logarithms that clingo adds up

_RULES = """
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


def explanations(
    model: FaultModel,
    priors: Mapping[str, float],
    observations: Sequence[Observation],
    most: int = MOST,
    interrupted: Interrupted = never,
) -> list[tuple[Hypothesis, float]]:
    """The minimal sets of causes and wrong observations that explain what was seen.

    If `interrupted`, there are fewer, but always the most probable one. Each has its probability; these sum to 1. The most probable set comes first.
    """
    seen = [each for each in observations if each.action in model.tests]
    failed = [model.repairs[each.action] for each in observations if each.action in model.repairs]
    program = "\n".join([_RULES, *_facts(model, priors, seen), *_failures(failed, priors)])
    found = [_hypothesis(atoms) for _, atoms in best_models(program, "chosen", most, (), interrupted)]
    weights = [
        _weight(model, priors, seen, each) * math.prod(1.0 - cure_chance(repair, each) for repair in failed)
        for each in found
    ]
    total = math.fsum(weights)
    ranked = [(h, w / total) for h, w in zip(found, weights, strict=True) if w > 0.0]
    return sorted(ranked, key=lambda each: -each[1])


def _facts(model: FaultModel, priors: Mapping[str, float], seen: Sequence[Observation]) -> list[str]:
    facts = [f"cause({cause}). cause_weight({cause}, {_cost(prior)})." for cause, prior in priors.items()]
    for each in seen:
        test = model.tests[each.action]
        facts.append(f"observed({test.name}, {each.outcome}). usual({test.name}, {test.otherwise}).")
        facts.append(f"lie_weight({test.name}, {_cost(model.lies)}).")
        for cause in priors:
            if test.likelihood(each.outcome, cause) > 0.0:
                facts.append(f"may({cause}, {test.name}, {each.outcome}).")
            if test.likelihood(test.otherwise, cause) == 0.0:
                facts.append(f"never({cause}, {test.name}).")
    return facts


def _failures(failed: Sequence[Repair], priors: Mapping[str, float]) -> list[str]:
    """Facts for repairs that did not help: each leaves some cause that it does not surely cure."""
    facts = [f"failed({repair.name})." for repair in failed]
    return facts + [
        f"survives({cause}, {repair.name})."
        for repair in failed
        for cause in priors
        if repair.cures.get(cause, 0.0) < 1.0
    ]


def _cost(probability: float) -> int:
    return max(1, round(-_SCALE * math.log(max(probability, 1e-12))))


def _hypothesis(atoms: Sequence[Function]) -> Hypothesis:
    named = [(atom.name, str(atom.arguments[0])) for atom in atoms]
    causes = tuple(sorted(name for kind, name in named if kind == "there"))
    return Hypothesis(causes, tuple(sorted(name for kind, name in named if kind == "false")))


def _weight(
    model: FaultModel, priors: Mapping[str, float], seen: Sequence[Observation], hypothesis: Hypothesis
) -> float:
    """The probability of a hypothesis together with what was seen, up to a factor."""
    weight = math.prod(priors[cause] for cause in hypothesis.causes) * model.lies ** len(hypothesis.lies)
    for each in seen:
        test: FaultTest = model.tests[each.action]
        weight *= likelihood(test, each.outcome, hypothesis)
    return weight
