"""When steps may start: what each waits for, as the executive and forecasts of runs read it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction


@dataclass(frozen=True, slots=True)
class StartRule:
    """A step starts no sooner than all this allows; times are in one unit.

    `floor` counts from the beginning of all. `starts` and `ends` give how long after the start or
    the end of other steps. `waits`: not before that step has ended, or so long after its start.
    """

    floor: int = 0
    starts: Mapping[int, int] = field(default_factory=dict)
    ends: Mapping[int, int] = field(default_factory=dict)
    waits: Mapping[int, int] = field(default_factory=dict)

    def scaled(self, factor: Fraction, begin: int = 0) -> "StartRule":
        """The same in another unit, of which each old one has so many, when all begins later."""

        def times(lags: Mapping[int, int]) -> dict[int, int]:
            return {step: int(lag * factor) for step, lag in lags.items()}

        return StartRule(
            begin + int(self.floor * factor),
            times(self.starts),
            times(self.ends),
            times(self.waits),
        )


StartRules = Mapping[int, StartRule]  # for each step, in an order in which they can be worked out
NO_RULES: StartRules = {}
