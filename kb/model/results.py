"""Results of a run: what was measured, and what happened to each object. They can be read back next month.

Times in `_ms` are milliseconds since the run began.
"""

from dataclasses import dataclass

from cellwright.kb.model.conformity import RISK, Conformity, conformity


@dataclass(frozen=True, slots=True)
class Measured:
    """One value that was measured: the `quantity` `of` something, by `tool`, with the step `action`.

    `nominal` is what it should be. It passes if it is at least `lower` and at most `upper`, which count `unit`s like the
    value. None: nobody said. `uncertainty` is the expanded one of the value, two standard deviations; `risk` is how many percent
    of the decisions may be wrong.
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
        """What the value shows by ISO 14253-1; None if it has no limits, or if nobody said how uncertain it is."""
        if self.uncertainty is None:
            return None
        risk = RISK if self.risk is None else self.risk
        return conformity(self.value, self.lower, self.upper, self.uncertainty, risk)


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
    """What a run gave. `started` is when it began, as ISO 8601 with a time zone; empty if that is not known."""

    run: str
    started: str = ""
    measured: tuple[Measured, ...] = ()
    history: tuple[Treated, ...] = ()
