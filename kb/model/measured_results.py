"""Results of a run: measured values, whether they conform, and what objects underwent.

The true value is taken as normally distributed about the measured one (GUM, JCGM 106). With one
limit far from the other the rule is a guard band: at a risk of 5 % the value has to keep 1.645
standard deviations inside the limit. Where the zone is so narrow that both limits count, both do.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

COVERAGE_FACTOR = 2.0  # standard deviations of an expanded uncertainty
MAX_DEVIATIONS = 40.0  # standard deviations beyond which nothing is
RISK_PERCENT = 5.0  # percent, where a domain states an uncertainty and no risk (ISO 14253-1:2017)


class Conformity(StrEnum):
    """What a value shows."""

    CONFORMING = "conforming"
    NOT_CONFORMING = "not conforming"
    UNDECIDED = "undecided"


def share_within(value: float, lower: float | None, upper: float | None, sigma: float) -> float:
    """How probable it is that the true value lies between the limits, for a measured value with
    a standard deviation above 0.
    """
    above = 1.0 if upper is None else _share_below(upper - value, sigma)
    under = 0.0 if lower is None else _share_below(lower - value, sigma)
    return max(0.0, above - under)


def check_conformity(
    value: float,
    lower: float | None,
    upper: float | None,
    uncertainty: float,
    risk: float = RISK_PERCENT,
) -> Conformity | None:
    """What a value with its expanded uncertainty (two standard deviations) shows; None if it has no
    limits.

    At most `risk` percent of the values that just show something show it wrongly. Without
    uncertainty every value decides.
    """
    if lower is None and upper is None:
        return None
    sigma = uncertainty / COVERAGE_FACTOR
    if sigma <= 0:
        inside = (lower is None or value >= lower) and (upper is None or value <= upper)
        return Conformity.CONFORMING if inside else Conformity.NOT_CONFORMING
    within = share_within(value, lower, upper, sigma)
    if within >= 1.0 - risk / 100.0:
        return Conformity.CONFORMING
    return Conformity.NOT_CONFORMING if within <= risk / 100.0 else Conformity.UNDECIDED


def _share_below(off: float, sigma: float) -> float:
    """The share of a normal distribution below a distance from its mean."""
    if abs(off) > MAX_DEVIATIONS * sigma:
        return float(off > 0)
    return 0.5 * math.erfc(-off / sigma / math.sqrt(2.0))


@dataclass(frozen=True, slots=True)
class Measured:
    """One value that was measured: the `quantity` `of` something, by `tool`, with the step
    `action`.

    `nominal` is what it should be. It passes if it is at least `lower` and at most `upper`, which
    count `unit`s like the value. None: nobody said. `uncertainty` is the expanded one of the value,
    two standard deviations; `risk` is how many percent of the decisions may be wrong.
    """

    of: str
    quantity: str
    value: float
    unit: str
    nominal: float | None = None
    lower: float | None = None
    upper: float | None = None
    tool: str = ""
    action: str = ""
    at_ms: int = 0
    uncertainty: float | None = None
    risk: float | None = None

    @property
    def passed(self) -> bool | None:
        """Whether the value lies between its limits; None if it has none."""
        if self.lower is None and self.upper is None:
            return None
        above = self.lower is None or self.value >= self.lower
        return above and (self.upper is None or self.value <= self.upper)

    @property
    def conformity(self) -> Conformity | None:
        """What the value shows by ISO 14253-1; None if it has no limits, or if nobody said how
        uncertain it is.
        """
        if self.uncertainty is None:
            return None
        risk = RISK_PERCENT if self.risk is None else self.risk
        return check_conformity(self.value, self.lower, self.upper, self.uncertainty, risk)


@dataclass(frozen=True, slots=True)
class Treated:
    """A step that was done to an object, from when to when, and what it changed for it."""

    object: str
    action: str
    started_ms: int
    ended_ms: int
    changes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Results:
    """What a run gave. `started` is when it began, as ISO 8601 with a time zone; empty if that
    is not known.
    """

    run: str
    started: str = ""
    measured: tuple[Measured, ...] = ()
    history: tuple[Treated, ...] = ()
