"""Troubles with a controller, noted once each; what comes again is counted."""

from collections import Counter

from cellwright.engine.model.run_protocol import Trouble, TroubleKind

MAX_NOTED_TROUBLES = 20  # of one kind, before more of them are only counted
MAX_NOISE_LINES = 10_000  # lines that say nothing, from one reply to the next


class TroubleTally:
    """Which troubles were noted, and how many more there were of each kind."""

    def __init__(self) -> None:
        self._noted: dict[TroubleKind, set[tuple[str, int | None]]] = {}
        self._more: Counter[TroubleKind] = Counter()
        self._last: dict[TroubleKind, str] = {}
        self.noise = 0

    def noted(self, trouble: Trouble) -> Trouble | None:
        """The trouble, if it is to be noted; None if it is one more of those that were."""
        self.noise += 1
        seen = self._noted.setdefault(trouble.kind, set())
        key = trouble.text.partition(":")[0], trouble.number
        if key not in seen and len(seen) < MAX_NOTED_TROUBLES:
            seen.add(key)
            return trouble
        self._more[trouble.kind] += 1
        self._last[trouble.kind] = trouble.text
        return None

    def replied(self) -> None:
        """A command was answered: the controller does say something."""
        self.noise = 0

    def counts(self, now_ms: int) -> list[Trouble]:
        """How many more there were of each kind since this was asked last."""
        troubles = [
            Trouble(kind, f"{count} more like these; the last: {self._last[kind]}", now_ms)
            for kind, count in self._more.items()
        ]
        self._more.clear()
        return troubles
