"""Lets code deep below a command ask whether to stop and how much memory is left, without arguments
for that.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class StoppedByCaller(BaseException):
    """Whoever asked for an answer wants none any more: Ctrl-C, a request to terminate, or the end
    of the time.

    It is no `Exception`, so that none of those who catch what a foreign library raises takes it for
    that.
    """


_LEFT: ContextVar[Callable[[], float]] = ContextVar("megabytes left", default=lambda: math.inf)
_QUESTION: ContextVar[Callable[[], bool]] = ContextVar("whether to stop", default=lambda: False)


def is_stop_wanted() -> bool:
    """Whether to stop."""
    return _QUESTION.get()()


def megabytes_left() -> float:
    """How much more memory may be taken."""
    return _LEFT.get()()


@contextmanager
def asking_to_stop(
    question: Callable[[], bool], left: Callable[[], float] | None = None
) -> Iterator[None]:
    """A context in which `question` says whether to stop, and `left`, if given, how many
    megabytes of memory may still be taken.
    """
    before, room = _QUESTION.set(question), _LEFT.set(left or _LEFT.get())
    try:
        yield
    finally:
        _QUESTION.reset(before)
        _LEFT.reset(room)
