"""How every command answers: one `Answer`, printed as text or as one JSON envelope, and an exit code.

Only the answer goes to standard output; diagnostics and progress go to standard error. Bad input, interrupts, lack of
memory and bugs become exit codes here, so that no command prints a traceback.
"""

import errno
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from cellwright.engine.faces.cli.declared import is_misfit
from cellwright.engine.faces.cli.ending import abandon
from cellwright.engine.faces.cli.exits import BAD_INPUT, INTERNAL, INTERRUPTED, LIMIT
from cellwright.engine.faces.cli.memory import is_short, lift_limit
from cellwright.engine.faces.cli.slow import answered
from cellwright.engine.faces.cli.watchdog import Watch, current
from cellwright.kb.stopping import Stopped

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.kb.diagnostics import Diagnostic


UNCOMPILED = """\
The kernels of this installation are not compiled: plans may take sixteen times as long, geometry a hundred times.
Install a wheel for this system, or install again where there is a C compiler (docs/installation.md).
"""


class Form(StrEnum):
    """How an answer is written."""

    TEXT = "text"
    JSON = "json"


@dataclass(frozen=True, slots=True)
class Answer:
    """What a command found. `text` is made only when it is printed; `raw` is printed unchanged in both forms."""

    status: str
    content: Mapping[str, Any] = field(default_factory=dict)
    text: "Callable[[], RenderableType] | None" = None
    code: int = 0
    diagnostics: "tuple[Diagnostic, ...]" = ()
    raw: str | None = None


def give(make: Callable[[], Answer], form: Form, output: Path | None = None) -> NoReturn:
    """Make the answer, print it and exit with its code. With `output`, the answer goes to that file, and its text is printed."""
    if watch := current():
        watch.tell = lambda code: _print_stopped(code, form)
    with _hearing():
        answer = _answered(make)
    answered()
    with suppress(OSError):  # even if the reason cannot be printed, the exit code is right
        if form is Form.TEXT or answer.raw is not None or output:
            _report(answer)
        if uncompiled():
            sys.stderr.write(UNCOMPILED)
    with writing():
        _print(answer, form) if output is None else _print_and_save(answer, form, output)
        sys.stdout.flush()
    raise SystemExit(answer.code)


def uncompiled() -> bool:
    """Whether a module that has types to be compiled with runs as plain Python in this process."""
    files = [
        str(module.__file__)
        for name, module in list(sys.modules.items())
        if name.startswith("cellwright.engine.")
    ]
    return any(file.endswith(".py") and os.path.exists(f"{file[:-3]}.pxd") for file in files)


@contextmanager
def writing() -> Iterator[None]:
    """A context that writes to standard output. If that fails, for example on a full disk, the process exits with 2."""
    try:
        yield
    except OSError as error:
        abandon(sys.stdout)
        if error.errno != errno.EPIPE:
            with suppress(OSError):
                sys.stderr.write(f"cannot write {error.filename or 'the answer'}: {error.strerror}\n")
            raise SystemExit(BAD_INPUT) from None


def refuse(wrong: str, command: str, code: str) -> NoReturn:
    """Report a wrong command line to a program that asked for JSON."""
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    def make() -> Answer:
        hint = f"`{command} --help` shows what it takes"
        raise InvalidInput([Diagnostic(Source("command line"), code, wrong, hint)])

    give(make, Form.JSON)


def open_streams() -> None:
    """Prepare the standard streams, so that neither unusual characters nor a closed stream makes an answer fail."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - open as long as the process
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


@contextmanager
def _hearing() -> Iterator[None]:
    """A context in which Ctrl-C raises an exception, so that an answer can still be given.

    Who was impatient and pressed it twice gets the answer all the same: see `Watch.be_patient`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    watch = current()
    before = signal.signal(signal.SIGINT, watch.press if watch else signal.default_int_handler)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
            signal.signal(signal.SIGINT, before)


def _answered(make: Callable[[], Answer]) -> Answer:
    """The answer, also if it is interrupted while it is refused."""
    watch = current() or Watch()
    if (opening := sys.modules.get("cellwright.kb.store.opening")) is not None:
        opening.begin_anew()
    try:
        watch.asked = True
        answer = _made(make)
        watch.answered = True
    except Stopped:
        answer = _out_of_memory() if watch.short else _stopped(LIMIT if watch.is_time_up() else INTERRUPTED)
    except KeyboardInterrupt:
        answer = _stopped(INTERRUPTED)
    watch.answered = True
    if answer.code == INTERRUPTED:
        watch.be_patient()
    return answer


def _made(make: Callable[[], Answer]) -> Answer:
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    try:
        return make()
    except InvalidInput as error:
        code = LIMIT if any(each.code == "K307" for each in error.diagnostics) else BAD_INPUT
        return Answer("bad input", code=code, diagnostics=error.diagnostics)
    except OSError as error:
        message, hint = (
            f"the operating system reports: {error.strerror or error}",
            "name another place, or make room on the disk",
        )
        found = Diagnostic(Source(str(error.filename or "a file")), "K415", message, hint)
        return Answer("bad input", code=BAD_INPUT, diagnostics=(found,))
    except Exception as error:
        if is_misfit(error):  # an option that does not fit what the target holds
            raise
        return _failed(error)


def _failed(error: Exception) -> Answer:
    """The answer of a command that has ended with an error that is none of the user's: memory, a request to end, damage, a bug."""
    watch = current()
    if is_short(error) or (watch and watch.short):
        return _out_of_memory()
    if os.environ.get("CELLWRIGHT_TRACEBACK"):
        raise error
    if watch and watch.is_ending():
        return _stopped(LIMIT if watch.is_time_up() else INTERRUPTED)
    if found_damage := _damage():
        return Answer("bad input", code=BAD_INPUT, diagnostics=found_damage)
    return Answer("internal error", {"error": f"{type(error).__name__}: {error}"}, code=INTERNAL)


def _out_of_memory() -> Answer:
    """The answer of a command whose memory has run out. It may take more, to say so."""
    from cellwright.kb.diagnostics import Diagnostic, Source

    lift_limit()
    found = Diagnostic(
        Source("memory"), "K419", "out of memory", "raise --memory-limit, or make the problem smaller"
    )
    return Answer("stopped", code=LIMIT, diagnostics=(found,))


def _damage() -> "tuple[Diagnostic, ...]":
    """What is wrong in the libraries that were opened: damage there explains what no reader could foresee."""
    if "cellwright.kb.store.opening" not in sys.modules:
        return ()
    from cellwright.kb.store.checking import damage
    from cellwright.kb.store.opening import opened_so_far

    return damage(opened_so_far())


def _stopped(code: int) -> Answer:
    """The answer of a command that was ended before it had one: by its time limit or by Ctrl-C."""
    from cellwright.kb.diagnostics import Diagnostic, Source

    if code == INTERRUPTED:
        return Answer("interrupted", code=INTERRUPTED)
    found = Diagnostic(
        Source("--time-limit"), "K420", "the time was over before there was an answer", "give more seconds"
    )
    return Answer("stopped", code=code, diagnostics=(found,))


def _print_stopped(code: int, form: Form) -> None:
    answered()
    watch = current()
    answer = _out_of_memory() if watch and watch.short else _stopped(code)
    if form is Form.TEXT:
        _report(answer)
    _print(answer, form)
    sys.stdout.flush()
    sys.stderr.flush()


def _print(answer: Answer, form: Form) -> None:
    document = _document(answer, form)
    if document is not None:
        _write(document)
    elif answer.text is not None:
        from cellwright.engine.faces.cli.terminal import console

        console().print(answer.text())


def _document(answer: Answer, form: Form) -> str | None:
    """The answer as data or as a picture; None if it is text."""
    if answer.raw is not None or form is Form.TEXT:
        return answer.raw
    from cellwright.engine.formats.report import json

    return json.envelope(answer.status, answer.content, answer.diagnostics) + "\n"


def _print_and_save(answer: Answer, form: Form, output: Path) -> None:
    """Print the text, then write the file, so that a full disk does not take the answer with it. A failure is not written."""
    from cellwright.engine.faces.cli.saving import save
    from cellwright.engine.faces.cli.terminal import console
    from cellwright.kb.diagnostics import escaped

    _print(replace(answer, raw=None), Form.TEXT)
    document = _document(answer, form) if answer.text and answer.code in (0, INTERRUPTED) else None
    if document is not None:
        try:
            save(output, escaped(document))
        except OSError as error:
            sys.stderr.write(f"cannot write {output}: {error.strerror}\n")
            raise SystemExit(BAD_INPUT) from None
        console(soft_wrap=True).print(f"\nWritten to {output}.", markup=False, highlight=False)


def _write(text: str) -> None:
    """Write data as UTF-8, whatever the encoding of the terminal is."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(encoding="utf-8", errors="replace")
    from cellwright.kb.diagnostics import escaped

    sys.stdout.write(escaped(text))


def _report(answer: Answer) -> None:
    """Print diagnostics and failures on standard error."""
    if not answer.diagnostics and answer.code not in (INTERRUPTED, INTERNAL):
        return
    from cellwright.engine.faces.cli import terminal
    from cellwright.engine.formats.report.findings import diagnostics

    console = terminal.console(stderr=True, soft_wrap=True)
    if answer.diagnostics:
        console.print(diagnostics(answer.diagnostics))
    if answer.code == INTERRUPTED and answer.text is None:
        console.print("interrupted")
    if answer.code == INTERNAL:
        console.print(f"internal error: {answer.content['error']}", style="red", markup=False)
        console.print("This is a bug. CELLWRIGHT_TRACEBACK=1 shows where it happened.")
