"""Arguments and options that several verbs share, and what a shell completes for them."""

from collections.abc import Iterator
from math import isnan
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from cellwright.engine.faces.cli.output.answer_output import AnswerForm
from cellwright.engine.faces.cli.wrong_options import make_misfit
from cellwright.kb import store

DurationsFrom = Annotated[
    str,
    Option(
        "--durations-from",
        metavar="STORE",
        help="with --robust: ranges of durations as the runs with a journal in STORE have shown",
    ),
]
TARGET_SUFFIXES = (".yaml", ".yml", ".json", ".tsp", ".pddl")


def complete_targets(incomplete: str) -> list[str]:
    """Bundled domains and problems, and files and folders, that begin like this."""
    from cellwright.kb.targets import bundled_domains

    names = [
        name
        for domain, folder in bundled_domains().items()
        for name in (domain, *_problem_names(domain, folder))
    ]
    return [*(name for name in names if name.startswith(incomplete)), *complete_files(incomplete)]


def complete_files(incomplete: str) -> list[str]:
    """Files that can be a target, and folders, that begin like this."""
    path = Path(incomplete)
    folder = path if incomplete.endswith("/") else path.parent
    try:
        folder_entries = sorted(folder.iterdir())
    except OSError:
        return []
    shown = (
        f"{folder_entry}/" if folder_entry.is_dir() else str(folder_entry)
        for folder_entry in folder_entries
        if not folder_entry.name.startswith(".")
    )
    return [
        shown_name
        for shown_name in shown
        if shown_name.startswith(incomplete) and shown_name.endswith(("/", *TARGET_SUFFIXES))
    ]


def complete_scenes(incomplete: str) -> list[str]:
    """Bundled scenes, and files, that begin like this."""
    from cellwright.kb.targets import bundled_scenes

    return [
        *(
            bundled_scene
            for bundled_scene in bundled_scenes()
            if bundled_scene.startswith(incomplete)
        ),
        *complete_files(incomplete),
    ]


def complete_devices(incomplete: str) -> list[str]:
    """Devices that begin like this; of a list with commas, the last of them."""
    from cellwright.kb.targets import bundled_devices

    before, comma, last = incomplete.rpartition(",")
    return [
        f"{before}{comma}{bundled_device}"
        for bundled_device in bundled_devices()
        if bundled_device.startswith(last)
    ]


def complete_runs(incomplete: str) -> list[str]:
    """Runs of the user's own journal that begin like this, the last ones first."""
    from cellwright.kb.diagnostics import InvalidInput

    try:
        with store.Journal(store.default_store()) as journal:
            names = [begun_run.run for begun_run in journal.begun()]
    except InvalidInput:
        return []
    return [name for name in reversed(names) if name.startswith(incomplete)]


def _problem_names(domain: str, folder: Path) -> Iterator[str]:
    for problem_file in sorted([*folder.glob("problems/*.yaml"), *folder.glob("large/*.yaml")]):
        yield f"{domain}/{problem_file.stem}"


def number_option(value: float | None) -> float | None:
    """The value of an option. NaN is refused, because it would pass every check of a range."""
    if value is not None and isnan(value):
        raise make_misfit("nan is not a number")
    return value


Target = Annotated[
    str,
    Argument(
        metavar="TARGET",
        help="a problem file, a domain folder, or a bundled name such as bulkhead/one_point",
        autocompletion=complete_targets,
    ),
]
Format = Annotated[AnswerForm, Option("--format", help="how the answer is written")]
Goals = Annotated[str, Option(help="goals, written as in a problem file")]
Command = Annotated[str, Option(help="the goals as a command, in the words of the domain")]
Stats = Annotated[bool, Option("--stats", help="print statistics: counts and times")]
TimeLimit = Annotated[
    float | None,
    Option(
        min=0,
        callback=number_option,
        help="seconds after which the search stops with its best answer",
    ),
]
Seed = Annotated[int, Option(min=0, help="the same seed gives the same answer on any machine")]
Pddl = Annotated[bool, Option("--pddl", help="the arguments are a PDDL domain and a PDDL problem")]
Ground = Annotated[bool, Option("--ground", help="write PDDL without variables, as plain STRIPS")]
Strategy = Annotated[
    str,
    Option(
        help="auto, backward, forward, landmarks, novelty, asp, or shortest: proved to have the "
        "fewest steps"
    ),
]
Race = Annotated[
    bool, Option("--race", help="run the strategies on all processors; the first answer counts")
]
Anytime = Annotated[
    bool,
    Option(
        "--anytime",
        help="improve the plan until the time limit or Ctrl-C, and report every better plan",
    ),
]
MemoryLimit = Annotated[
    int | None, Option(min=128, help="megabytes of memory that the command may use")
]
Expansions = Annotated[
    int | None,
    Option(
        min=0,
        help="states that the search may expand before it gives up; 1000000 without a time limit",
    ),
]
Library = Annotated[
    str,
    Option(
        "--store",
        envvar="CELLWRIGHT_STORE",
        help="a library of MACROPs: a file, or postgresql://USER@HOST/DB",
    ),
]
Cluster = Annotated[
    str,
    Option(
        metavar="ADDRESS",
        help="a Dask cluster that does the work, by the HOST:PORT of its scheduler; it sees the "
        "same files and store",
    ),
]
Jobs = Annotated[
    int, Option(min=0, help="number of processes; 0 means as many as there are processors")
]
Windows = Annotated[
    list[str] | None,
    Option(
        "--window", help="when a visit may begin, from the start of the tour: 'm3=10..90, m4=..60'"
    ),
]
Lasts = Annotated[list[str] | None, Option("--lasts", help="how long a visit takes: 'm3=4, m4=6'")]
Before = Annotated[
    list[str] | None, Option("--before", help="visits that come in this order, separated by commas")
]
