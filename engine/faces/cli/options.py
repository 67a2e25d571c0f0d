"""Arguments and options that several commands share."""

from math import isnan
from typing import Annotated

import typer

from engine.faces.cli import completion
from engine.faces.cli.answers import Form


def number(value: float | None) -> float | None:
    """The value of an option. NaN is refused, because it would pass every check of a range."""
    if value is not None and isnan(value):
        raise typer.BadParameter("nan is not a number")
    return value


Target = Annotated[
    str,
    typer.Argument(
        metavar="TARGET",
        help="a problem file, a domain folder, or a bundled name such as bulkhead/one_point",
        autocompletion=completion.targets,
    ),
]
Format = Annotated[Form, typer.Option("--format", help="how the answer is written")]
Goals = Annotated[str, typer.Option(help="goals, written as in a problem file")]
Command = Annotated[str, typer.Option(help="the goals as a command, in the words of the domain")]
Stats = Annotated[bool, typer.Option("--stats", help="print statistics: counts and times")]
TimeLimit = Annotated[
    float | None,
    typer.Option(min=0, callback=number, help="seconds after which the search stops with its best answer"),
]
Seed = Annotated[int, typer.Option(min=0, help="the same seed gives the same answer on any machine")]
Pddl = Annotated[bool, typer.Option("--pddl", help="the arguments are a PDDL domain and a PDDL problem")]
Ground = Annotated[bool, typer.Option("--ground", help="write PDDL without variables, as plain STRIPS")]
Strategy = Annotated[
    str,
    typer.Option(
        help="auto, backward, forward, landmarks, novelty, asp, or shortest: proved to have the fewest steps"
    ),
]
Race = Annotated[
    bool, typer.Option("--race", help="run the strategies on all processors; the first answer counts")
]
Anytime = Annotated[
    bool,
    typer.Option(
        "--anytime", help="improve the plan until the time limit or Ctrl-C, and report every better plan"
    ),
]
MemoryLimit = Annotated[
    int | None, typer.Option(min=128, help="megabytes of memory that the command may use")
]
Expansions = Annotated[int, typer.Option(min=0, help="states that the search may expand before it gives up")]
Library = Annotated[
    str,
    typer.Option(
        "--store",
        envvar="CELLWRIGHT_STORE",
        help="a library of MACROPs: a file, or postgresql://USER@HOST/DATABASE",
    ),
]
Cluster = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS",
        help="a Dask cluster that does the work, by the HOST:PORT of its scheduler; it sees the same files and store",
    ),
]
Jobs = Annotated[
    int, typer.Option(min=0, help="number of processes; 0 means as many as there are processors")
]
Windows = Annotated[
    list[str] | None,
    typer.Option("--window", help="when a visit may begin, from the start of the tour: 'm3=10..90, m4=..60'"),
]
Lasts = Annotated[list[str] | None, typer.Option("--lasts", help="how long a visit takes: 'm3=4, m4=6'")]
Before = Annotated[
    list[str] | None, typer.Option("--before", help="visits that come in this order, separated by commas")
]
