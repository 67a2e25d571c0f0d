"""Arguments and options that several commands share."""

from math import isnan
from typing import Annotated

from cellwright.engine.faces.cli import completion
from cellwright.engine.faces.cli.answers import Form
from cellwright.engine.faces.cli.declared import Argument, Option, misfit


def number(value: float | None) -> float | None:
    """The value of an option. NaN is refused, because it would pass every check of a range."""
    if value is not None and isnan(value):
        raise misfit("nan is not a number")
    return value


Target = Annotated[
    str,
    Argument(
        metavar="TARGET",
        help="a problem file, a domain folder, or a bundled name such as bulkhead/one_point",
        autocompletion=completion.targets,
    ),
]
Format = Annotated[Form, Option("--format", help="how the answer is written")]
Goals = Annotated[str, Option(help="goals, written as in a problem file")]
Command = Annotated[str, Option(help="the goals as a command, in the words of the domain")]
Stats = Annotated[bool, Option("--stats", help="print statistics: counts and times")]
TimeLimit = Annotated[
    float | None,
    Option(min=0, callback=number, help="seconds after which the search stops with its best answer"),
]
Seed = Annotated[int, Option(min=0, help="the same seed gives the same answer on any machine")]
Pddl = Annotated[bool, Option("--pddl", help="the arguments are a PDDL domain and a PDDL problem")]
Ground = Annotated[bool, Option("--ground", help="write PDDL without variables, as plain STRIPS")]
Strategy = Annotated[
    str,
    Option(
        help="auto, backward, forward, landmarks, novelty, asp, or shortest: proved to have the fewest steps"
    ),
]
Race = Annotated[bool, Option("--race", help="run the strategies on all processors; the first answer counts")]
Anytime = Annotated[
    bool,
    Option("--anytime", help="improve the plan until the time limit or Ctrl-C, and report every better plan"),
]
MemoryLimit = Annotated[int | None, Option(min=128, help="megabytes of memory that the command may use")]
Expansions = Annotated[int, Option(min=0, help="states that the search may expand before it gives up")]
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
        help="a Dask cluster that does the work, by the HOST:PORT of its scheduler; it sees the same files and store",
    ),
]
Jobs = Annotated[int, Option(min=0, help="number of processes; 0 means as many as there are processors")]
Windows = Annotated[
    list[str] | None,
    Option("--window", help="when a visit may begin, from the start of the tour: 'm3=10..90, m4=..60'"),
]
Lasts = Annotated[list[str] | None, Option("--lasts", help="how long a visit takes: 'm3=4, m4=6'")]
Before = Annotated[
    list[str] | None, Option("--before", help="visits that come in this order, separated by commas")
]
