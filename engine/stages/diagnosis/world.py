"""A small simulated world with a hidden cause.

It answers tests and repairs with the fault base's probabilities.
"""

import random
from collections.abc import Mapping
from dataclasses import dataclass, field

from cellwright.engine.model.cases import Hypothesis
from cellwright.engine.model.troubleshooting import Action
from cellwright.engine.stages.diagnosis.knowledge import CURED, NOT_CURED, cure_chance, likelihood
from cellwright.kb.model.faults import FaultModel


@dataclass
class HiddenWorld:
    """Answers by the name of a test or repair.

    The same question gets the same answer; `chance` decides uncertain ones.
    """

    model: FaultModel
    hidden: Hypothesis
    chance: random.Random = field(default_factory=lambda: random.Random(0))
    answered: dict[str, str] = field(default_factory=dict)

    def answer(self, name: str) -> str:
        """The outcome of a test or repair."""
        if name not in self.answered:
            distribution = self._distribution(name)
            self.answered[name] = self.chance.choices(list(distribution), list(distribution.values()))[0]
        return self.answered[name]

    def respond(self, action: Action) -> str:
        """The outcome of an action of a case. The question of a safe stop gets the true answer."""
        if action.name in self.model.tests or action.name in self.model.repairs:
            return self.answer(action.name)
        return str(self.hidden) if str(self.hidden) in action.outcomes else action.outcomes[-1]

    def _distribution(self, name: str) -> Mapping[str, float]:
        if name in self.model.repairs:
            cured = cure_chance(self.model.repairs[name], self.hidden)
            return {CURED: cured, NOT_CURED: 1.0 - cured}
        test = self.model.tests[name]
        return {outcome: likelihood(test, outcome, self.hidden) for outcome in test.outcomes}


def draw_cause(
    model: FaultModel, exception: str, chance: random.Random, counts: Mapping[str, float] | None = None
) -> Hypothesis:
    """A hidden cause of an exception, drawn with its probability."""
    priors = model.priors(exception, counts)
    return Hypothesis((chance.choices(list(priors), list(priors.values()))[0],))
