"""What was measured of each feature: its value, uncertainty, verdict, and what does not count."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from cellwright.kb.model.measured_results import (
    COVERAGE_FACTOR,
    RISK_PERCENT,
    Conformity,
    Measured,
    check_conformity,
)


@dataclass(frozen=True, slots=True)
class MeasuredFeature:
    """One quantity of one thing. `value` is the mean of the `values` that count, in the frame of
    the part; None if none does.

    `uncertainty` is expanded (two standard deviations). `bad` are values that do not count, each
    with the reason. `doubt` says why it should be measured again before it counts, `why` what keeps
    it from a decision, `again` why it was measured again, each time. All numbers count `unit`s.
    """

    of: str
    quantity: str
    unit: str = ""
    nominal: float | None = None
    lower: float | None = None
    upper: float | None = None
    risk: float | None = None
    value: float | None = None
    uncertainty: float | None = None
    values: tuple[Measured, ...] = ()
    bad: tuple[tuple[Measured, str], ...] = ()
    doubt: str = ""
    why: str = ""
    again: tuple[str, ...] = ()

    @property
    def conformity(self) -> Conformity | None:
        """What the value shows; None without limits, without an uncertainty, or without a value
        that counts.
        """
        if self.value is None or self.uncertainty is None or self.doubt:
            return None
        risk = RISK_PERCENT if self.risk is None else self.risk
        return check_conformity(self.value, self.lower, self.upper, self.uncertainty, risk)

    @property
    def judged(self) -> str:
        """The verdict in a word or two."""
        if self.doubt:
            return "doubtful"
        if self.value is None:
            return "not measured"
        shown = self.conformity
        if shown is not None:
            return shown.value
        if self.lower is None and self.upper is None:
            return "not judged"
        inside = (self.lower is None or self.value >= self.lower) and (
            self.upper is None or self.value <= self.upper
        )
        return "passed" if inside else "failed"

    @property
    def sigma(self) -> float:
        """The standard deviation of the value; 0 if it is not known."""
        return (self.uncertainty or 0.0) / COVERAGE_FACTOR


@dataclass(frozen=True, slots=True)
class Spoilt:
    """Values of something by a tool that do not count, up to a time: when it was found out why."""

    of: str
    tool: str
    until_ms: int
    why: str


@dataclass(frozen=True, slots=True)
class Unmeasured:
    """A measurement that a problem has and a run has not made, and why."""

    name: str
    why: str


@dataclass(frozen=True, slots=True)
class Survey:
    """What a run has shown of a part: its features, what was not measured, and where the part lay.

    `places` are where features are, in metres in the frame of the part. `part` is the displacement
    of the part, three rows of four numbers; empty if it was not looked for. `refused` says why its
    datums fit nowhere, if they did not. `wrong` are datums that disagree.
    """

    features: tuple[MeasuredFeature, ...]
    unmeasured: tuple[Unmeasured, ...] = ()
    places: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    part: tuple[float, ...] = ()
    datums: int = 0
    wrong: tuple[str, ...] = ()
    refused: str = ""

    def counts(self) -> dict[str, int]:
        """How many features there are of each verdict, the most frequent first; those that were
        not measured are among them.
        """
        verdict_counts = Counter(feature.judged for feature in self.features)
        verdict_counts.update({"not measured": len(self.unmeasured)} if self.unmeasured else {})
        return dict(
            sorted(
                verdict_counts.items(),
                key=lambda verdict_count: (-verdict_count[1], verdict_count[0]),
            )
        )
