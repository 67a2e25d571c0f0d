"""The verb `schedule`: when each step of a plan or each stage of a shop happens."""

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import (
    Command,
    Expansions,
    Goals,
    Seed,
    Stats,
    TimeLimit,
    number_option,
)
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.output.output_files import Output, answer_form
from cellwright.engine.faces.cli.process.exit_codes import INTERRUPTED, exit_code
from cellwright.engine.faces.cli.process.search_interruption import SearchInterruption
from cellwright.engine.faces.cli.wrong_options import refuse_idle
from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import planning as planning_room
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cellwright.engine.formats.report.plans.schedule_report import ScheduleAnswer
    from cellwright.engine.model.outcome import GaveUp, Infeasible
    from cellwright.engine.model.shop_scheduling import Shop, Timetable
    from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits
    from cellwright.kb.model.planning_problem import Problem


class ScheduleForm(StrEnum):
    """How a schedule is written: as a chart, as data, or as a picture."""

    TEXT = "text"
    JSON = "json"
    SVG = "svg"


Work = Annotated[
    float,
    Option(
        min=0,
        callback=number_option,
        help="work of the solver, about seconds of one core; the same work gives the same answer",
    ),
]
Race = Annotated[
    int, Option(min=1, help="parallel workers: an answer comes sooner, but not always the same one")
]
Instance = Annotated[str, Option(help="the instance in a file of several job shops")]


def schedule_target(
    target: Annotated[
        str,
        Argument(help="a problem, a plan in JSON, a folder of S-LAB tables, or a job-shop file"),
    ],
    goals: Goals = "",
    command: Command = "",
    instance: Instance = "",
    format: Annotated[
        ScheduleForm | None,
        Option(
            "--format",
            help="how the schedule_target is written: text, unless the name of the output ends "
            "otherwise",
        ),
    ] = None,
    output: Output = None,
    stats: Stats = False,
    time_limit: TimeLimit = None,
    work: Work = 60.0,
    race: Race = 1,
    expansions: Expansions = None,
    seed: Seed = 0,
) -> None:
    """Print a short schedule for the steps of a plan for TARGET, or for the stages of a shop."""
    kind = answer_form(output, format, ScheduleForm.TEXT)
    form = AnswerForm.JSON if kind is ScheduleForm.JSON else AnswerForm.TEXT
    if kind is ScheduleForm.SVG and output is None:
        refuse_idle({"--stats": stats}, "on svg, only on text and json")
    schedule_request = ScheduleRequest(target, goals, command, instance)
    give_answer(
        lambda: _schedule_target(
            schedule_request, kind, stats, EffortOptions(time_limit, work, race, expansions, seed)
        ),
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
    expansions: int | None
    seed: int


def _schedule_target(
    wanted: ScheduleRequest, form: ScheduleForm, stats: bool, effort: EffortOptions
) -> VerbAnswer:
    from cellwright.engine.stages.planning import SearchLimits, expansions_within
    from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits

    with SearchInterruption(effort.seconds) as interrupted:
        limits = ScheduleLimits(effort.work, effort.seed, effort.workers, interrupted)
        shop = interop.shop_of(Path(wanted.target), wanted.instance)
        if shop is not None:
            _refuse_idle_options(
                {"--goals": wanted.goals, "--command": wanted.command},
                "on a shop: all its jobs are always scheduled",
            )
            answer = _schedule_shop(shop, limits, form, stats)
        else:
            _refuse_idle_options(
                {"--instance": wanted.instance},
                "here: it chooses one in a file of several job shops",
            )
            problem, plan = planning_room.subject_of(wanted.target, wanted.goals, wanted.command)
            if plan is not None:
                _refuse_idle_options(
                    {"--goals": wanted.goals, "--command": wanted.command},
                    "on a plan, which has its own goals",
                )
            most = expansions_within(effort.expansions, effort.seconds)
            planning = SearchLimits(most, interrupted=interrupted, seed=effort.seed)
            timed_plan = (
                planning_room.plan_fastest(problem, planning, limits)
                if plan is None
                else planning_room.make_timetable(problem, plan, planning, limits)
            )
            answer = _schedule_plan(problem, timed_plan, form, stats)
    return replace(answer, code=INTERRUPTED) if interrupted.heard else answer


def _refuse_idle_options(options: "Mapping[str, str]", why: str) -> None:
    """Refuse options that would change nothing for this kind of target. Raises `InvalidInput`."""
    if idle := [name for name, option_value in options.items() if option_value]:
        message = f"{idle[0]} has no effect {why}"
        raise InvalidInput([Diagnostic(Source(idle[0]), "K408", message, "leave it out")])


def _schedule_shop(
    shop: "Shop", limits: "ScheduleLimits", form: ScheduleForm, stats: bool
) -> VerbAnswer:
    from cellwright.engine.model.shop_scheduling import ValidSchedule
    from cellwright.engine.stages.scheduling import schedule_shop

    shop_schedule = schedule_shop(shop, limits)
    if not isinstance(shop_schedule, ValidSchedule):
        return _no_schedule(shop_schedule)
    return _schedule_answer(
        report.ScheduleAnswer(shop, shop_schedule.schedule, shop_schedule.statistics), form, stats
    )


def _schedule_plan(
    problem: "Problem", made: "Timetable | Infeasible | GaveUp", form: ScheduleForm, stats: bool
) -> VerbAnswer:
    from cellwright.engine.model.shop_scheduling import Timetable

    return (
        _schedule_answer(report.of_plan(made, problem), form, stats)
        if isinstance(made, Timetable)
        else _no_schedule(made)
    )


def _no_schedule(found: "Infeasible | GaveUp") -> VerbAnswer:
    failure_text = rich_parts.Text(f"No schedule: {found.reason}.")
    return VerbAnswer(
        report.outcome_status(found),
        {"reason": found.reason},
        lambda: failure_text,
        exit_code(found),
    )


def _schedule_answer(made: "ScheduleAnswer", form: ScheduleForm, stats: bool) -> VerbAnswer:
    raw = report.schedule_svg(made) if form is ScheduleForm.SVG else None
    content = report.schedule_content(made, stats)
    return VerbAnswer(made.status, content, lambda: report.schedule_text(made, stats), raw=raw)
