"""How every command answers: one `Answer`, printed as text or as one JSON envelope, and an exit code.

Standard output carries the answer alone; diagnostics and progress go to standard error. Bad input, interrupts, want of
memory and bugs become exit codes here, so that no command prints a traceback.
"""

import errno
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from engine.cli.exits import BAD_INPUT, INTERNAL, INTERRUPTED, LIMIT

if TYPE_CHECKING:
    from rich.console import RenderableType

    from kb.diagnostics import Diagnostic


class Form(StrEnum):
    """How an answer is written."""

    TEXT = "text"
    JSON = "json"


@dataclass(frozen=True, slots=True)
class Answer:
    """What a command found. `text` is made only when it is printed; `raw` is printed as it stands in either form."""

    status: str
    content: Mapping[str, Any] = field(default_factory=dict)
    text: "Callable[[], RenderableType] | None" = None
    code: int = 0
    diagnostics: "tuple[Diagnostic, ...]" = ()
    raw: str | None = None


def give(make: Callable[[], Answer], form: Form) -> NoReturn:
    """Make the answer, print it and exit with its code."""
    answer = _made(make)
    try:
        _print(answer, form)
        sys.stdout.flush()
    except OSError as error:
        _abandon_output()
        if error.errno != errno.EPIPE:
            sys.stderr.write(f"cannot write the answer: {error.strerror}\n")
            raise typer.Exit(BAD_INPUT) from None
    raise typer.Exit(answer.code)


def _made(make: Callable[[], Answer]) -> Answer:
    from kb.diagnostics import Diagnostic, InvalidInput, Source

    try:
        return make()
    except InvalidInput as error:
        return Answer("bad input", code=BAD_INPUT, diagnostics=error.diagnostics)
    except KeyboardInterrupt:
        return Answer("interrupted", code=INTERRUPTED)
    except MemoryError:
        found = Diagnostic(
            Source("memory"), "K307", "out of memory", "raise --memory-limit, or make the problem smaller"
        )
        return Answer("stopped", code=LIMIT, diagnostics=(found,))
    except OSError as error:
        message, hint = (
            f"the system refuses: {error.strerror or error}",
            "name another place, or make room there",
        )
        found = Diagnostic(Source(str(error.filename or "a file")), "K403", message, hint)
        return Answer("bad input", code=BAD_INPUT, diagnostics=(found,))
    except Exception as error:
        if os.environ.get("CELLWRIGHT_TRACEBACK"):
            raise
        return Answer("internal error", {"error": f"{type(error).__name__}: {error}"}, code=INTERNAL)


def _print(answer: Answer, form: Form) -> None:
    if answer.raw is not None:
        _report(answer)
        sys.stdout.write(answer.raw)
    elif form is Form.JSON:
        from engine.report import json

        sys.stdout.write(json.envelope(answer.status, answer.content, answer.diagnostics) + "\n")
    else:
        _report(answer)
        if answer.text is not None:
            from rich.console import Console

            Console().print(answer.text())


def _report(answer: Answer) -> None:
    """Diagnostics and mishaps, on standard error."""
    if not answer.diagnostics and answer.code not in (INTERRUPTED, INTERNAL):
        return
    from rich.console import Console

    from engine.report.findings import diagnostics

    console = Console(stderr=True, soft_wrap=True)
    if answer.diagnostics:
        console.print(diagnostics(answer.diagnostics))
    if answer.code == INTERRUPTED and answer.text is None:
        console.print("interrupted")
    if answer.code == INTERNAL:
        console.print(f"internal error: {answer.content['error']}", style="red", markup=False)
        console.print("This is a bug. CELLWRIGHT_TRACEBACK=1 shows where it happened.")


def _abandon_output() -> None:
    """Nobody can read standard output any more: keep the interpreter from complaining when it closes it."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
