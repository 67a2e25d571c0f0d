"""Whether a MACROP lookup pays for goals of a kind, and whether its plans are good, from what a
library has seen so far.

A kind is the signature of the goals. A lookup pays if its plan answers, or might have answered. It
fails if the planner has to be asked after all, and answers soon: small problems are planned in
milliseconds. Work is counted, not timed, so that the same input gives the same plan.
"""

from dataclasses import dataclass, field

from cellwright.kb.store import Library
from cellwright.kb.store.lookup_counts import LOOKUP, still_pays

QUALITY = "(reuse) "


@dataclass
class LookupTrials:
    """The lookups for goals of a domain, by kind."""

    library: Library
    domain: str
    _counts: dict[str, tuple[int, int]] = field(default_factory=dict)

    def pays(self, kind: str) -> bool:
        """Whether goals of a kind are still looked up, and their plans learned."""
        return still_pays(*self._known(LOOKUP + kind))

    def is_trusted(self, kind: str, cost: int) -> bool:
        """Whether reused plans of this cost have always been about as good as those of the
        planner.
        """
        successes, failures = self._known(f"{QUALITY}{cost} {kind}")
        return successes > 0 and not failures

    def note_lookup(self, kind: str, pays: bool) -> None:
        """Count a lookup. Those that pay need not be counted as long as they are more than those
        that fail.
        """
        successes, failures = self._known(LOOKUP + kind)
        if not pays or failures >= max(successes, 1):
            self._note(LOOKUP + kind, pays)

    def note_quality(self, kind: str, cost: int, good: bool) -> None:
        """Count a reused plan of a cost that was compared with the planner's: whether it was about
        as good.
        """
        self._note(f"{QUALITY}{cost} {kind}", good)

    def _note(self, key: str, success: bool) -> None:
        successes, failures = self._known(key)
        self._counts[key] = (successes + 1, failures) if success else (successes, failures + 1)
        self.library.note_trial(self.domain, key, success)

    def _known(self, key: str) -> tuple[int, int]:
        if key not in self._counts:
            self._counts[key] = self.library.trials(self.domain, key)
        return self._counts[key]
