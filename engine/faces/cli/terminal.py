"""The terminal and its logs: what names, files and controllers say cannot command it.

Control characters, marks that turn the direction of a text, and halves of characters are shown as `\\u001b`. In JSON that is
the same text.
"""

import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook
from rich.segment import Segment

from cellwright.engine.faces.cli.slow import hushed
from cellwright.kb.diagnostics import escaped


def console(stderr: bool = False, **settings: Any) -> Console:
    """A console that shows what would command the terminal."""
    made = Console(stderr=stderr, **settings)
    made.push_render_hook(_Showing())
    return made


def say(text: str) -> None:
    """Write on standard error, where a line of progress makes room. If that fails, the answer is still given."""
    with suppress(OSError), hushed():
        sys.stderr.write(escaped(text))
        sys.stderr.flush()


class _Showing(RenderHook):
    """Shows everything that is printed without its commands."""

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        """Each of them, without its commands."""
        return [_Shown(each) for each in renderables]


class _Shown:
    def __init__(self, inner: ConsoleRenderable) -> None:
        self.inner = inner

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        for each in console.render(self.inner, options):
            yield each if each.control else Segment(escaped(each.text), each.style)
