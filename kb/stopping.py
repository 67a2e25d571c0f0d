"""Whether what runs now shall stop: asked by those who cannot be given the question as an argument."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class Stopped(BaseException):
    """Whoever asked for an answer wants none any more: Ctrl-C, a request to terminate, or the end of the time.

    It is no `Exception`, so that none of those who catch what a foreign library raises takes it for that.
    """


_QUESTION: ContextVar[Callable[[], bool]] = ContextVar("whether to stop", default=lambda: False)


def wanted() -> bool:
    """Whether to stop."""
    return _QUESTION.get()()


@contextmanager
def asking(question: Callable[[], bool]) -> Iterator[None]:
    """A context in which `question` says whether to stop."""
    before = _QUESTION.set(question)
    try:
        yield
    finally:
        _QUESTION.reset(before)
