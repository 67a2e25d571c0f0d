"""What all functions of the library share: targets, deadlines, and answers that show themselves.

The values of `cellwright.kb.model` and `cellwright.engine.model` know no pictures. An answer holds
such values and asks the reports to draw them, when somebody looks.
"""

import time
from abc import ABC, abstractmethod
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from io import StringIO
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar, Union

from cellwright.engine.formats import report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import planning
from cellwright.kb import stopping

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.kb.diagnostics import Diagnostic
    from cellwright.kb.model.planning_problem import Problem

WIDTH = 100  # columns of a text


class Answer(ABC):
    """An answer of Cellwright.

    `print(answer)` shows it as the command line does; notebooks show its picture, if it has one.
    """

    @property
    @abstractmethod
    def status(self) -> str:
        """One word for what came of it, as in the JSON of the command line: found, optimal,
        infeasible, ok and others.
        """

    @abstractmethod
    def data(self) -> Mapping[str, Any]:
        """What the command line writes as `data` of its JSON: texts, numbers, lists and
        mappings.
        """

    @abstractmethod
    def _renderable(self) -> "RenderableType":
        """What is printed."""

    @property
    def diagnostics(self) -> "tuple[Diagnostic, ...]":
        """Findings and warnings that come with the answer."""
        return ()

    def svg(self) -> str | None:
        """A picture of the answer as SVG; None if there is nothing to draw."""
        return None

    def json(self) -> str:
        """The answer as the command line writes it with `--format json`."""
        return report.json_envelope(self.status, self.data(), self.diagnostics)

    def __str__(self) -> str:
        from cellwright.kb.diagnostics import escape_controls

        console = rich_parts.Console(
            file=StringIO(), width=WIDTH, color_system=None, legacy_windows=False
        )
        console.print(self._renderable())
        return escape_controls(console.file.getvalue().rstrip("\n"))  # type: ignore[attr-defined]

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.status}>"

    def _repr_svg_(self) -> str | None:
        return self.svg()

    def _repr_html_(self) -> str:
        """The picture, if there is one, and the text.

        The picture stands by itself, so that nothing in it acts on the page.
        """
        drawn = self.svg()
        encoded = b64encode(drawn.encode("utf-8")).decode("ascii") if drawn else ""
        source = f"data:image/svg+xml;base64,{encoded}"
        picture = (
            f'<img alt="{escape(repr(self))}" style="max-width: 100%" src="{source}"/>'
            if drawn
            else ""
        )
        return f'<div>{picture}<pre style="line-height: 1.2">{escape(str(self))}</pre></div>'


V = TypeVar("V")


@dataclass(frozen=True, repr=False)
class Told(Answer, Generic[V]):
    """An answer with one `value` to compute with."""

    value: V
    word: str = field(repr=False)
    content: "Callable[[V], Mapping[str, Any]]" = field(repr=False, compare=False)
    shown: "Callable[[V], RenderableType]" = field(repr=False, compare=False)
    drawn: "Callable[[V], str | None] | None" = field(default=None, repr=False, compare=False)
    found: "tuple[Diagnostic, ...]" = field(default=(), repr=False)

    @property
    def status(self) -> str:
        """One word for what came of it."""
        return self.word

    @property
    def diagnostics(self) -> "tuple[Diagnostic, ...]":
        """Findings and warnings that come with the answer."""
        return self.found

    def __repr__(self) -> str:
        return f"<{type(self.value).__name__}: {self.word}>"

    def data(self) -> Mapping[str, Any]:
        """The value as data."""
        return self.content(self.value)

    def svg(self) -> str | None:
        """A picture of the value; None if there is none."""
        return self.drawn(self.value) if self.drawn else None

    def _renderable(self) -> "RenderableType":
        return self.shown(self.value)


Name: TypeAlias = Union[str, "PathLike[str]"]
Target: TypeAlias = Union[str, "PathLike[str]", "Problem"]


def load(target: Target, goals: str = "", command: str = "") -> "Problem":
    """The problem that `target` names: a file, a folder with a domain, or a bundled name such as
    "bulkhead/one_point".

    `goals`, written as in a problem file, or a `command` in the words of the domain replace its
    own. Raises `InvalidInput`.
    """
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
    from cellwright.kb.model.planning_problem import Problem

    if not isinstance(target, Problem):
        return planning.problem_of(fspath(target), goals, command)
    if goals or command:
        told, hint = "a loaded problem has its goals", "give goals and commands to `load`"
        raise InvalidInput([Diagnostic(Source(target.name), "K408", told, hint)])
    return target


def name_of(target: Target) -> str:
    """The name by which what lies beside a problem is found: its cell, fault base and contact
    model.
    """
    from cellwright.kb.model.planning_problem import Problem

    return target.path if isinstance(target, Problem) else fspath(target)


class Deadline:
    """Asked whether the time is over: by searches now and then, and by code that runs where no
    limit is passed in.
    """

    def __init__(self, seconds: float | None) -> None:
        self.seconds = seconds
        self.ends = None if seconds is None else time.monotonic() + seconds
        self.told = False

    def __call__(self) -> bool:
        self.told = self.told or self._is_over()
        return self.told

    def while_grounding(self) -> bool:
        """Whether a grounding must stop.

        After a search was stopped it may go on: the answer found so far is still to be checked.
        """
        return not self.told and self._is_over()

    def _is_over(self) -> bool:
        return self.ends is not None and time.monotonic() >= self.ends


@contextmanager
def limit_seconds(seconds: float | None) -> Iterator[Deadline]:
    """A context that stops the work in it after some seconds.

    Raises `TimeoutError` if there is no answer by then.
    """
    deadline = Deadline(seconds)
    try:
        with stopping.asking_to_stop(deadline.while_grounding):
            yield deadline
    except stopping.StoppedByCaller:
        raise TimeoutError(
            f"no answer within {seconds} s: give more seconds, or ask for less"
        ) from None
