"""What every verb answers: values to compute with, that know how to show themselves in a terminal, in JSON and in a notebook.

The values of `cellwright.kb.model` and `cellwright.engine.model` know no pictures. An answer holds such values and asks the reports to draw them,
when somebody looks.
"""

from abc import ABC, abstractmethod
from base64 import b64encode
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.kb.diagnostics import Diagnostic

WIDTH = 100  # columns of a text


class Answer(ABC):
    """An answer of Cellwright. `print(answer)` shows it as the command line does; notebooks show its picture, if it has one."""

    @property
    @abstractmethod
    def status(self) -> str:
        """One word for what came of it, as in the JSON of the command line: found, optimal, infeasible, ok and others."""

    @abstractmethod
    def data(self) -> Mapping[str, Any]:
        """What the command line writes as `data` of its JSON: texts, numbers, lists and mappings."""

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
        from cellwright.engine.formats.report import json

        return json.envelope(self.status, self.data(), self.diagnostics)

    def __str__(self) -> str:
        from io import StringIO

        from rich.console import Console

        from cellwright.kb.diagnostics import escaped

        console = Console(file=StringIO(), width=WIDTH, color_system=None, legacy_windows=False)
        console.print(self._renderable())
        return escaped(console.file.getvalue().rstrip("\n"))  # type: ignore[attr-defined]

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.status}>"

    def _repr_svg_(self) -> str | None:
        return self.svg()

    def _repr_html_(self) -> str:
        """The picture, if there is one, and the text. The picture stands by itself, so that nothing in it acts on the page."""
        drawn = self.svg()
        encoded = b64encode(drawn.encode("utf-8")).decode("ascii") if drawn else ""
        source = f"data:image/svg+xml;base64,{encoded}"
        picture = f'<img alt="{escape(repr(self))}" style="max-width: 100%" src="{source}"/>' if drawn else ""
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
