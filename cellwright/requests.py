"""What is asked: targets of all kinds, and how long it may take."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike, fspath
from typing import TYPE_CHECKING, TypeAlias, Union

from cellwright.kb import stopping

if TYPE_CHECKING:
    from cellwright.kb.model.problem import Problem

Name: TypeAlias = Union[str, "PathLike[str]"]
Target: TypeAlias = Union[str, "PathLike[str]", "Problem"]


def load(target: Target, goals: str = "", command: str = "") -> "Problem":
    """The problem that `target` names: a file, a folder with a domain, or a bundled name such as "bulkhead/one_point".

    `goals`, written as in a problem file, or a `command` in the words of the domain replace its own. Raises `InvalidInput`.
    """
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
    from cellwright.kb.model.problem import Problem

    if not isinstance(target, Problem):
        from cellwright.engine.pipelines.planning import problem_of

        return problem_of(fspath(target), goals, command)
    if goals or command:
        told, hint = "a loaded problem has its goals", "give goals and commands to `load`"
        raise InvalidInput([Diagnostic(Source(target.name), "K408", told, hint)])
    return target


def name_of(target: Target) -> str:
    """The name by which what lies beside a problem is found: its cell, fault base and contact model."""
    from cellwright.kb.model.problem import Problem

    return target.path if isinstance(target, Problem) else fspath(target)


class Deadline:
    """Asked whether the time is over: by searches now and then, and by code that runs where no limit is passed in."""

    def __init__(self, seconds: float | None) -> None:
        self.ends = None if seconds is None else time.monotonic() + seconds
        self.told = False

    def __call__(self) -> bool:
        self.told = self.told or self._is_over()
        return self.told

    def while_grounding(self) -> bool:
        """Whether a grounding must stop. After a search was stopped it may go on: the answer found so far is still to be checked."""
        return not self.told and self._is_over()

    def _is_over(self) -> bool:
        return self.ends is not None and time.monotonic() >= self.ends


@contextmanager
def limited(seconds: float | None) -> Iterator[Deadline]:
    """A context that stops the work in it after some seconds. Raises `TimeoutError` if there is no answer by then."""
    deadline = Deadline(seconds)
    try:
        with stopping.asking(deadline.while_grounding):
            yield deadline
    except stopping.Stopped:
        raise TimeoutError(f"no answer within {seconds} s: give more seconds, or ask for less") from None
