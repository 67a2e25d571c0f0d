"""Makes the crew of processes or cluster that --jobs and --cluster ask for, and a progress bar."""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cellwright.engine.faces.cli.wrong_options import refuse_idle

if TYPE_CHECKING:
    from cellwright.engine.pipelines.jobs import WorkCrew


@dataclass(frozen=True, slots=True)
class WorkerOptions:
    """How units of work are carried out: by so many processes or a cluster, and the store where
    finished ones are noted.
    """

    jobs: int = 1
    cluster: str = ""
    store: str = ""


def refuse_both(jobs: int, cluster: str) -> None:
    """Refuse --jobs beside --cluster. Raises `typer.BadParameter`."""
    if cluster:
        refuse_idle({"--jobs": jobs}, "with --cluster")


def crew_asked(jobs: int, cluster: str, modules: Sequence[str] = ()) -> "WorkCrew":
    """The crew that the options --jobs and --cluster name; its processes load `modules` meanwhile.

    Raises `InvalidInput` if nobody answers at the address.
    """
    from cellwright.engine.pipelines.jobs import crew_of

    return crew_of(jobs or len(os.sched_getaffinity(0)), cluster, modules)


@contextmanager
def progress_of(what: str) -> "Iterator[Callable[[int, int], None]]":
    """A progress bar on a terminal; nothing in a pipe."""
    if not sys.stderr.isatty():
        from cellwright.engine.pipelines.jobs import show_nothing

        yield show_nothing
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from cellwright.engine.faces.cli.output.terminal_console import make_console
    from cellwright.engine.faces.cli.process.progress_line import hushing_progress

    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with (
        hushing_progress(),
        Progress(*columns, console=make_console(stderr=True), transient=True) as bar,
    ):
        shown = bar.add_task("", total=None)
        yield lambda done, of: bar.update(shown, completed=done, total=of)
