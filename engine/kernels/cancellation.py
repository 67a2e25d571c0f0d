# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False
"""How a search is stopped early: by Ctrl-C, a request to terminate, or a time limit.

Whoever starts a search gives it an `Interrupted`: a function that says whether to stop. Loops of
Python call it. Compiled loops ask a `Poll`, which counts their work and calls the function a
thousand times per second at most. Python handles signals only while Python code runs, so that
Ctrl-C is heard in a compiled loop exactly when the function is called.
"""

from collections.abc import Callable

Interrupted = Callable[[], bool]
"""Says whether to stop with the best answer so far. A search calls it now and then."""

EVERY = 1 << 20  # units of work, about one nanosecond each, between two questions


def never() -> bool:
    """Never interrupt."""
    return False


class Poll:
    """Counts the work of compiled loops and asks now and then whether to stop.

    Once `stopped`, it stays so. What the function raised is kept, since not every loop passes on an
    exception: `check` raises it.
    """

    def __init__(self, interrupted: Interrupted = never, every: int = EVERY) -> None:
        """Asks `interrupted` after each `every` units of work."""
        self.interrupted, self.every, self.left = interrupted, every, 0
        self.stopped = False
        self.error: BaseException | None = None

    def due(self, work: int) -> bool:
        """Count some work, and say whether to stop."""
        self.left -= work
        if self.left <= 0 and not self.stopped:
            self.left = self.every
            self._ask()
        return self.stopped

    def check(self) -> bool:
        """Ask now. Raises what the function raised, here or in a loop."""
        if not self.stopped:
            self._ask()
        if self.error is not None:
            raise self.error
        return self.stopped

    def _ask(self) -> None:
        try:
            self.stopped = bool(self.interrupted())
        except BaseException as error:
            self.error, self.stopped = error, True
