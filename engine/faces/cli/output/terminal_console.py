r"""Consoles and logs on the terminal, in which no name, file or controller can command it.

Control characters, marks that turn the direction of a text, and halves of characters are shown as
`\u001b`. In JSON that is the same text.
"""

import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook
from rich.segment import Segment

from cellwright.engine.faces.cli.process.progress_line import hushing_progress
from cellwright.kb.diagnostics import escape_controls


def make_console(stderr: bool = False, **settings: Any) -> Console:
    """A console that shows what would command the terminal."""
    made = Console(stderr=stderr, **settings)
    made.push_render_hook(_Showing())
    return made


def say_on_stderr(text: str) -> None:
    """Write on standard error, where a line of progress makes room.

    If that fails, the answer is still given.
    """
    with suppress(OSError), hushing_progress():
        sys.stderr.write(escape_controls(text))
        sys.stderr.flush()


class _Showing(RenderHook):
    """Shows everything that is printed without its commands."""

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        """Each of them, without its commands."""
        return [_Shown(renderable) for renderable in renderables]


class _Shown:
    def __init__(self, inner: ConsoleRenderable) -> None:
        self.inner = inner

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        for segment in console.render(self.inner, options):
            yield (
                segment
                if segment.control
                else Segment(escape_controls(segment.text), segment.style)
            )
