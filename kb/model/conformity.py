"""Whether a measured value shows that what was measured lies within its limits: the decision rule of ISO 14253-1.

The true value is taken as normally distributed about the measured one (GUM, JCGM 106). With one limit far from the other the rule
is a guard band: at a risk of 5 % the value has to keep 1.645 standard deviations inside the limit. Where the zone is so
narrow that both limits count, both do.
"""

import math
from enum import StrEnum

COVERAGE = 2.0  # standard deviations of an expanded uncertainty
FAR = 40.0  # standard deviations beyond which nothing is
RISK = 5.0  # percent, where a domain states an uncertainty and no risk (ISO 14253-1:2017)


class Conformity(StrEnum):
    """What a value shows."""

    CONFORMING = "conforming"
    NOT_CONFORMING = "not conforming"
    UNDECIDED = "undecided"


def share_within(value: float, lower: float | None, upper: float | None, sigma: float) -> float:
    """How probable it is that the true value lies between the limits, for a measured value with a standard deviation above 0."""
    above = 1.0 if upper is None else _below(upper - value, sigma)
    under = 0.0 if lower is None else _below(lower - value, sigma)
    return max(0.0, above - under)


def conformity(
    value: float, lower: float | None, upper: float | None, uncertainty: float, risk: float = RISK
) -> Conformity | None:
    """What a value with its expanded uncertainty (two standard deviations) shows; None if it has no limits.

    At most `risk` percent of the values that just show something show it wrongly. Without uncertainty every value decides.
    """
    if lower is None and upper is None:
        return None
    sigma = uncertainty / COVERAGE
    if sigma <= 0:
        inside = (lower is None or value >= lower) and (upper is None or value <= upper)
        return Conformity.CONFORMING if inside else Conformity.NOT_CONFORMING
    within = share_within(value, lower, upper, sigma)
    if within >= 1.0 - risk / 100.0:
        return Conformity.CONFORMING
    return Conformity.NOT_CONFORMING if within <= risk / 100.0 else Conformity.UNDECIDED


def _below(off: float, sigma: float) -> float:
    """The share of a normal distribution below a distance from its mean."""
    if abs(off) > FAR * sigma:
        return float(off > 0)
    return 0.5 * math.erfc(-off / sigma / math.sqrt(2.0))
