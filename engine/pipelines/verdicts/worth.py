"""What one more measurement of an undecided feature is worth: how probable it is that it decides (preposterior analysis).

The mean of the values with one more is normally distributed about the mean of those that are there (Raiffa & Schlaifer 1961). Over
its distribution the share is counted at which the decision rule decides.
"""

import math
from statistics import NormalDist

from cellwright.engine.model.verdicts import Feature
from cellwright.kb.model.conformity import COVERAGE, RISK, Conformity, conformity

DRAWS = 99  # equally probable means


def chance_of_decision(feature: Feature, uncertainty: float, common: float = 0.0) -> float:
    """How probable it is that one more value, with an expanded uncertainty of its own, decides.

    `common` is the part of the feature's expanded uncertainty that all its values share, such as that of where the part lies.
    """
    if feature.value is None or not feature.uncertainty or uncertainty <= 0:
        return 0.0
    sigma2 = max(0.0, feature.uncertainty**2 - common**2) / COVERAGE**2
    one2, shared2 = (uncertainty / COVERAGE) ** 2, (common / COVERAGE) ** 2
    if not sigma2:
        return 0.0
    after2 = 1.0 / (1.0 / sigma2 + 1.0 / one2)
    moves, then = math.sqrt(sigma2 - after2), COVERAGE * math.sqrt(after2 + shared2)
    risk = RISK if feature.risk is None else feature.risk
    decided = 0
    for number in range(DRAWS):
        mean = feature.value + moves * NormalDist().inv_cdf((number + 0.5) / DRAWS)
        shown = conformity(mean, feature.lower, feature.upper, then, risk)
        decided += shown is not None and shown is not Conformity.UNDECIDED
    return decided / DRAWS
