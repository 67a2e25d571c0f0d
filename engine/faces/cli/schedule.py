"""`cellwright schedule`: when each step happens."""

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option
from cellwright.engine.faces.cli.exits import INTERRUPTED
from cellwright.engine.faces.cli.idle import refuse_idle
from cellwright.engine.faces.cli.options import Command, Expansions, Goals, Seed, Stats, TimeLimit, number
from cellwright.engine.faces.cli.saving import Output, form_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cellwright.engine.formats.report.timetables import Timed
    from cellwright.engine.model.outcome import GaveUp, Infeasible
    from cellwright.engine.model.schedule import Timetable
    from cellwright.engine.model.shop import Shop
    from cellwright.engine.stages.scheduling.limits import ScheduleLimits
    from cellwright.kb.model.problem import Problem


class ScheduleForm(StrEnum):
    """How a schedule is written: as a chart, as data, or as a picture."""

    TEXT = "text"
    JSON = "json"
    SVG = "svg"


Work = Annotated[
    float,
    Option(
        min=0,
        callback=number,
        help="work of the solver, about seconds of one core; the same work gives the same answer",
    ),
]
Race = Annotated[
    int, Option(min=1, help="parallel workers: an answer comes sooner, but not always the same one")
]
Instance = Annotated[str, Option(help="the instance in a file of several job shops")]


def schedule(
    target: Annotated[
        str, Argument(help="a problem, a plan in JSON, a folder of S-LAB tables, or a job-shop file")
    ],
    goals: Goals = "",
    command: Command = "",
    instance: Instance = "",
    format: Annotated[
        ScheduleForm | None,
        Option(
            "--format", help="how the schedule is written: text, unless the name of the output ends otherwise"
        ),
    ] = None,
    output: Output = None,
    stats: Stats = False,
    time_limit: TimeLimit = None,
    work: Work = 60.0,
    race: Race = 1,
    expansions: Expansions = 1_000_000,
    seed: Seed = 0,
) -> None:
    """Print a short schedule for the steps of a plan for TARGET, or for the stages of a shop."""
    kind = form_of(output, format, ScheduleForm.TEXT)
    form = Form.JSON if kind is ScheduleForm.JSON else Form.TEXT
    if kind is ScheduleForm.SVG and output is None:
        refuse_idle({"--stats": stats}, "on svg, only on text and json")
    wanted = ScheduleRequest(target, goals, command, instance)
    give(
        lambda: _schedule(wanted, kind, stats, EffortOptions(time_limit, work, race, expansions, seed)),
        form,
        output,
    )


@dataclass(frozen=True, slots=True)
class ScheduleRequest:
    """What is to be scheduled."""

    target: str
    goals: str
    command: str
    instance: str


@dataclass(frozen=True, slots=True)
class EffortOptions:
    """The limits: seconds, work of the solver, workers, expansions of the planner; and the seed."""

    seconds: float | None
    work: float
    workers: int
    expansions: int
    seed: int


def _schedule(wanted: ScheduleRequest, form: ScheduleForm, stats: bool, effort: EffortOptions) -> Answer:
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.interop.shops import shop_of
    from cellwright.engine.pipelines import objective, timetable
    from cellwright.engine.stages.planning import Limits
    from cellwright.engine.stages.scheduling.limits import ScheduleLimits

    with Interruption(effort.seconds) as interrupted:
        limits = ScheduleLimits(effort.work, effort.seed, effort.workers, interrupted)
        shop = shop_of(Path(wanted.target), wanted.instance)
        if shop is not None:
            _refuse(
                {"--goals": wanted.goals, "--command": wanted.command},
                "on a shop: all its jobs are always scheduled",
            )
            answer = _shop(shop, limits, form, stats)
        else:
            _refuse({"--instance": wanted.instance}, "here: it chooses one in a file of several job shops")
            problem, plan = timetable.subject_of(wanted.target, wanted.goals, wanted.command)
            if plan is not None:
                _refuse(
                    {"--goals": wanted.goals, "--command": wanted.command},
                    "on a plan, which has its own goals",
                )
            planning = Limits(effort.expansions, interrupted=interrupted, seed=effort.seed)
            made = (
                objective.fastest(problem, planning, limits)
                if plan is None
                else timetable.timetable(problem, plan, planning, limits)
            )
            answer = _timetable(problem, made, form, stats)
    return replace(answer, code=INTERRUPTED) if interrupted.heard else answer


def _refuse(options: "Mapping[str, str]", why: str) -> None:
    """Refuse options that would change nothing for this kind of target. Raises `InvalidInput`."""
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    if idle := [name for name, given in options.items() if given]:
        found = f"{idle[0]} has no effect {why}"
        raise InvalidInput([Diagnostic(Source(idle[0]), "K408", found, "leave it out")])


def _shop(shop: "Shop", limits: "ScheduleLimits", form: ScheduleForm, stats: bool) -> Answer:
    from cellwright.engine.formats.report.timetables import Timed
    from cellwright.engine.model.schedule import Scheduled
    from cellwright.engine.stages.scheduling import schedule

    found = schedule(shop, limits)
    if not isinstance(found, Scheduled):
        return _none(found)
    return _answer(Timed(shop, found.schedule, found.statistics), form, stats)


def _timetable(
    problem: "Problem", made: "Timetable | Infeasible | GaveUp", form: ScheduleForm, stats: bool
) -> Answer:
    from cellwright.engine.formats.report.timetables import of_plan
    from cellwright.engine.model.schedule import Timetable

    return _answer(of_plan(made, problem), form, stats) if isinstance(made, Timetable) else _none(made)


def _none(found: "Infeasible | GaveUp") -> Answer:
    from rich.text import Text

    from cellwright.engine.faces.cli.exits import exit_code
    from cellwright.engine.formats.report.json import status

    said = Text(f"No schedule: {found.reason}.")
    return Answer(status(found), {"reason": found.reason}, lambda: said, exit_code(found))


def _answer(made: "Timed", form: ScheduleForm, stats: bool) -> Answer:
    from cellwright.engine.formats.report import timetables

    raw = timetables.chart(made) if form is ScheduleForm.SVG else None
    content = timetables.content(made, stats)
    return Answer(made.status, content, lambda: timetables.text(made, stats), raw=raw)
