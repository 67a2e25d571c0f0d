"""Answers of verbs: each is printed as text or as one JSON envelope, then the process exits."""

import atexit
import errno
import io
import os
import signal
import stat
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

import typer

from cellwright.engine.faces.cli.process.exit_codes import BAD_INPUT, INTERNAL, INTERRUPTED, LIMIT
from cellwright.engine.faces.cli.process.process_limits import (
    WATCH_THREAD,
    CommandWatch,
    current_watch,
    is_short,
    lift_limit,
)
from cellwright.engine.faces.cli.process.progress_line import clear_progress
from cellwright.engine.formats import report
from cellwright.kb import store
from cellwright.kb.stopping import StoppedByCaller

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.kb.diagnostics import Diagnostic


def leave_process(code: int) -> None:
    """Write the streams and end the process at once. Return only if threads still run that nobody
    gave up.

    What a limit or Ctrl-C ended may have left a solver at work: its threads are not waited for. The
    usual end would even abort the process if it came upon them.
    """
    _flush_streams()
    if not _is_busy() or _is_grounding() or code in (LIMIT, INTERRUPTED):
        _close_resources()
        _flush_streams()
        os._exit(code)


def _flush_streams() -> None:
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            abandon_stream(stream)


def abandon_stream(stream: TextIO) -> None:
    """Give up a stream that cannot be written any more.

    So closing it causes no message and no other exit code.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _is_grounding() -> bool:
    """Whether a grounding that was given up still runs: only the end of the process ends it."""
    bounded = sys.modules.get("cellwright.kb.asp.bounded_grounding")
    return bounded is not None and bool(bounded.is_left_behind())


def _is_busy() -> bool:
    """Whether threads run, or a profiler or tracer must report: then the interpreter ends as it
    does by itself.
    """
    watched = sys.getprofile() is not None or sys.gettrace() is not None
    return watched or any(thread.name != WATCH_THREAD for thread in threading.enumerate()[1:])


def _close_resources() -> None:
    """Close databases, end processes, delete temporary folders: all that must not be left as it
    is.
    """
    engines = sys.modules.get("cellwright.kb.store.database")
    with suppress(Exception):
        if engines is not None:
            engines.close_all()
        atexit._run_exitfuncs()


UNCOMPILED = """\
The kernels of this installation are not compiled. Plans may take sixteen times as long, geometry a
hundred times. Install a wheel for this system, or install again where there is a C compiler
(docs/installation.md).
"""


class AnswerForm(StrEnum):
    """How an answer is written."""

    TEXT = "text"
    JSON = "json"


@dataclass(frozen=True, slots=True)
class VerbAnswer:
    """What a command found.

    `text` is made only when it is printed; `raw` is printed unchanged in both forms.
    """

    status: str
    content: Mapping[str, Any] = field(default_factory=dict)
    text: "Callable[[], RenderableType] | None" = None
    code: int = 0
    diagnostics: "tuple[Diagnostic, ...]" = ()
    raw: str | None = None


def give_answer(
    make: Callable[[], VerbAnswer], form: AnswerForm, output: Path | None = None
) -> NoReturn:
    """Make the answer, print it and exit with its code.

    With `output`, the answer goes to that file, and its text is printed.
    """
    if watch := current_watch():
        watch.tell = lambda code: _print_stopped(code, form)
    with _hearing_interrupts():
        answer = _answer_or_interruption(make)
    clear_progress()
    with suppress(OSError):  # even if the reason cannot be printed, the exit code is right
        if form is AnswerForm.TEXT or answer.raw is not None or output:
            _report_problems(answer)
        if is_uncompiled():
            sys.stderr.write(UNCOMPILED)
    with writing_output():
        _print_answer(answer, form) if output is None else _print_and_save(answer, form, output)
        sys.stdout.flush()
    raise SystemExit(answer.code)


def is_uncompiled() -> bool:
    """Whether a module that has types to be compiled with runs as plain Python in this process."""
    files = [
        str(module.__file__)
        for name, module in list(sys.modules.items())
        if name.startswith("cellwright.engine.")
    ]
    return any(file.endswith(".py") and os.path.exists(f"{file[:-3]}.pxd") for file in files)


@contextmanager
def writing_output() -> Iterator[None]:
    """A context that writes to standard output.

    If that fails, for example on a full disk, the process exits with 2.
    """
    try:
        yield
    except OSError as error:
        is_hung_up = _is_hung_up(error)
        abandon_stream(sys.stdout)
        if error.errno != errno.EPIPE and not is_hung_up:
            with suppress(OSError):
                sys.stderr.write(
                    f"cannot write {error.filename or 'the answer'}: {error.strerror}\n"
                )
            raise SystemExit(BAD_INPUT) from None


def _is_hung_up(error: OSError) -> bool:
    """Whether the terminal is gone: then nobody reads the answer, and the exit code tells it."""
    try:
        return error.errno == errno.EIO and stat.S_ISCHR(os.fstat(1).st_mode)
    except OSError:
        return False


def refuse_command_line(wrong: str, command: str, code: str) -> NoReturn:
    """Report a wrong command line to a program that asked for JSON."""
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    def make() -> VerbAnswer:
        hint = f"`{command} --help` shows what it takes"
        raise InvalidInput([Diagnostic(Source("command line"), code, wrong, hint)])

    give_answer(make, AnswerForm.JSON)


def open_streams() -> None:
    """Prepare the standard streams, so that neither unusual characters nor a closed stream
    makes an answer fail.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - open as long as the process
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


@contextmanager
def _hearing_interrupts() -> Iterator[None]:
    """A context in which Ctrl-C raises an exception, so that an answer can still be given.

    Who was impatient and pressed it twice gets the answer all the same: see `Watch.be_patient`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    watch = current_watch()
    before = signal.signal(signal.SIGINT, watch.press if watch else signal.default_int_handler)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
            signal.signal(signal.SIGINT, before)


def _answer_or_interruption(make: Callable[[], VerbAnswer]) -> VerbAnswer:
    """The answer, also if it is interrupted while it is refused."""
    watch = current_watch() or CommandWatch()
    if (opening := sys.modules.get("cellwright.kb.store.database")) is not None:
        opening.begin_anew()
    try:
        watch.asked = True
        answer = _make_answer(make)
        watch.answered = True
    except StoppedByCaller:
        answer = (
            _out_of_memory()
            if watch.short
            else _stopped_answer(LIMIT if watch.is_time_up() else INTERRUPTED)
        )
    except KeyboardInterrupt:
        answer = _stopped_answer(INTERRUPTED)
    watch.answered = True
    if answer.code == INTERRUPTED:
        watch.be_patient()
    return answer


def _make_answer(make: Callable[[], VerbAnswer]) -> VerbAnswer:
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    try:
        return make()
    except InvalidInput as error:
        code = (
            LIMIT
            if any(diagnostic.code == "K307" for diagnostic in error.diagnostics)
            else BAD_INPUT
        )
        return VerbAnswer("bad input", code=code, diagnostics=error.diagnostics)
    except OSError as error:
        message, hint = (
            f"the operating system reports: {error.strerror or error}",
            "name another place, or make room on the disk",
        )
        file_diagnostic = Diagnostic(Source(str(error.filename or "a file")), "K415", message, hint)
        return VerbAnswer("bad input", code=BAD_INPUT, diagnostics=(file_diagnostic,))
    except typer.BadParameter:  # an option that does not fit what the target holds
        raise
    except Exception as error:
        return _failure_answer(error)


def _failure_answer(error: Exception) -> VerbAnswer:
    """The answer of a command that has ended with an error that is none of the user's: memory,
    a request to end, damage, a bug.
    """
    watch = current_watch()
    if is_short(error) or (watch and watch.short):
        return _out_of_memory()
    if os.environ.get("CELLWRIGHT_TRACEBACK"):
        raise error
    if watch and watch.is_ending():
        return _stopped_answer(LIMIT if watch.is_time_up() else INTERRUPTED)
    if found_damage := _library_damage():
        return VerbAnswer("bad input", code=BAD_INPUT, diagnostics=found_damage)
    return VerbAnswer(
        "internal error", {"error": f"{type(error).__name__}: {error}"}, code=INTERNAL
    )


def _out_of_memory() -> VerbAnswer:
    """The answer of a command whose memory has run out. It may take more, to say so."""
    from cellwright.kb.diagnostics import Diagnostic, Source

    lift_limit()
    memory_diagnostic = Diagnostic(
        Source("memory"),
        "K419",
        "out of memory",
        "raise --memory-limit, or make the problem smaller",
    )
    return VerbAnswer("stopped", code=LIMIT, diagnostics=(memory_diagnostic,))


def _library_damage() -> "tuple[Diagnostic, ...]":
    """What is wrong in the libraries that were opened: damage there explains what no reader
    could foresee.
    """
    if "cellwright.kb.store.database" not in sys.modules:
        return ()
    return store.store_damage(store.opened_so_far())


def _stopped_answer(code: int) -> VerbAnswer:
    """The answer of a command that was ended before it had one: by its time limit or by Ctrl-C."""
    from cellwright.kb.diagnostics import Diagnostic, Source

    if code == INTERRUPTED:
        return VerbAnswer("interrupted", code=INTERRUPTED)
    stop_diagnostic = Diagnostic(
        Source("--time-limit"),
        "K420",
        "the time was over before there was an answer",
        "give more seconds",
    )
    return VerbAnswer("stopped", code=code, diagnostics=(stop_diagnostic,))


def _print_stopped(code: int, form: AnswerForm) -> None:
    clear_progress()
    watch = current_watch()
    answer = _out_of_memory() if watch and watch.short else _stopped_answer(code)
    if form is AnswerForm.TEXT:
        _report_problems(answer)
    _print_answer(answer, form)
    sys.stdout.flush()
    sys.stderr.flush()


def _print_answer(answer: VerbAnswer, form: AnswerForm) -> None:
    document = _answer_document(answer, form)
    if document is not None:
        _write_utf8(document)
    elif answer.text is not None:
        from cellwright.engine.faces.cli.output.terminal_console import make_console

        make_console().print(answer.text())


def _answer_document(answer: VerbAnswer, form: AnswerForm) -> str | None:
    """The answer as data or as a picture; None if it is text."""
    if answer.raw is not None or form is AnswerForm.TEXT:
        return answer.raw
    return report.json_envelope(answer.status, answer.content, answer.diagnostics) + "\n"


def _print_and_save(answer: VerbAnswer, form: AnswerForm, output: Path) -> None:
    """Print the text, then write the file, so that a full disk does not take the answer with it.

    A failure is not written.
    """
    from cellwright.engine.faces.cli.output.output_files import save_text
    from cellwright.engine.faces.cli.output.terminal_console import make_console
    from cellwright.kb.diagnostics import escape_controls

    _print_answer(replace(answer, raw=None), AnswerForm.TEXT)
    document = (
        _answer_document(answer, form) if answer.text and answer.code in (0, INTERRUPTED) else None
    )
    if document is not None:
        try:
            save_text(output, escape_controls(document))
        except OSError as error:
            sys.stderr.write(f"cannot write {output}: {error.strerror}\n")
            raise SystemExit(BAD_INPUT) from None
        make_console(soft_wrap=True).print(f"\nWritten to {output}.", markup=False, highlight=False)


def _write_utf8(text: str) -> None:
    """Write data as UTF-8, whatever the encoding of the terminal is."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(encoding="utf-8", errors="replace")
    from cellwright.kb.diagnostics import escape_controls

    sys.stdout.write(escape_controls(text))


def _report_problems(answer: VerbAnswer) -> None:
    """Print diagnostics and failures on standard error."""
    if not answer.diagnostics and answer.code not in (INTERRUPTED, INTERNAL):
        return
    from cellwright.engine.faces.cli.output import terminal_console

    console = terminal_console.make_console(stderr=True, soft_wrap=True)
    if answer.diagnostics:
        console.print(report.diagnostics_text(answer.diagnostics))
    if answer.code == INTERRUPTED and answer.text is None:
        console.print("interrupted")
    if answer.code == INTERNAL:
        console.print(f"internal error: {answer.content['error']}", style="red", markup=False)
        console.print("This is a bug. CELLWRIGHT_TRACEBACK=1 shows where it happened.")
