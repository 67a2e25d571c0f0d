"""The verb `sequence`: the cheapest order of visits, new, kept in a store, or shared by arms."""

from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import (
    Before,
    Lasts,
    Seed,
    TimeLimit,
    Windows,
)
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.output.output_files import Output, answer_form
from cellwright.engine.faces.cli.process.exit_codes import GAVE_UP, INFEASIBLE, INTERRUPTED
from cellwright.engine.faces.cli.process.search_interruption import SearchInterruption
from cellwright.engine.faces.cli.wrong_options import make_misfit, refuse_idle
from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.model.part_measurements import is_shared
from cellwright.engine.pipelines import inspection, motion, planning
from cellwright.engine.plugins import geometry_backend
from cellwright.kb import loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint

if TYPE_CHECKING:
    from cellwright.engine.model.outcome import GaveUp, Infeasible
    from cellwright.engine.model.tour_problem import Tour
    from cellwright.engine.pipelines.inspection.tool_tours import TourVisits
    from cellwright.engine.pipelines.inspection.tour_progress import SequenceNews
    from cellwright.engine.stages.sequencing import TourLimits
    from cellwright.kb.model.planning_problem import Problem


class TourForm(StrEnum):
    """How a tour is written."""

    TEXT = "text"
    JSON = "json"
    SVG = "svg"


class TravelCost(StrEnum):
    """What is counted as the cost between two measurements."""

    STRAIGHT = "straight"
    JOINTS = "joints"
    MOTION = "motion"


NEWS = ("--done", "--lost", "--bad", "--restored")
WISHES = ("--window", "--lasts", "--before")
TourOf = Annotated[
    str, Argument(metavar="TARGET", help="a TSPLIB file, or a problem with points to be measured")
]
Method = Annotated[str, Option("--method", help="auto, chain1987 or exact")]
Closed = Annotated[bool, Option("--closed", help="return to the first visit, as in TSPLIB files")]
Open = Annotated[bool, Option("--open", help="end at the last visit, as measurements do")]
Start = Annotated[str, Option("--start", help="the visit to begin with")]
End = Annotated[str, Option("--end", help="the visit to end with")]
Cost = Annotated[
    TravelCost,
    Option(
        "--cost",
        help="cost between measurements: straight lines, joints (the time that the arm needs), "
        "or motion (of free paths)",
    ),
]
Work = Annotated[
    int,
    Option("--work", min=0, help="work of the search; 0 means that it fits the number of visits"),
]
Store = Annotated[
    str, Option("--store", help="keep the sequence_visits of a problem in this file or database")
]
Next = Annotated[
    bool, Option("--next", help="print only the next visit of the kept sequence_visits")
]
Done = Annotated[
    list[str] | None, Option("--done", help="visits that are done, separated by commas")
]
Lost = Annotated[list[str] | None, Option("--lost", help="tools and resources that are lost")]
Bad = Annotated[
    list[str] | None,
    Option(
        "--bad",
        help="visits to leave out because they were found bad: 'm3, m4=the surface is dirty'",
    ),
]
Restored = Annotated[
    list[str] | None,
    Option("--restored", help="visits, tools and resources that can be used again"),
]
Anew = Annotated[bool, Option("--anew", help="forget the kept sequence_visits")]
Shown = Annotated[
    TourForm | None,
    Option(
        "--format",
        help="how the tour is written: text, unless the name of the output ends otherwise",
    ),
]


def sequence_visits(
    target: TourOf,
    method: Method = "auto",
    closed: Closed = False,
    open_: Open = False,
    start: Start = "",
    end: End = "",
    window: Windows = None,
    lasts: Lasts = None,
    before: Before = None,
    cost: Cost = TravelCost.STRAIGHT,
    time_limit: TimeLimit = None,
    work: Work = 0,
    seed: Seed = 0,
    store: Store = "",
    next_: Next = False,
    done: Done = None,
    lost: Lost = None,
    bad: Bad = None,
    restored: Restored = None,
    anew: Anew = False,
    format: Shown = None,
    output: Output = None,
) -> None:
    """Print the best order found for the visits of TARGET, with a lower bound on the cost of
    any order.
    """
    news = (done or [], lost or [], bad or [], restored or [])
    visit_demands = (window or [], lasts or [], before or [])
    store_options = {"--next": next_, "--anew": anew, **dict(zip(NEWS, news, strict=True))}
    back, kind = _returns_to_start(closed, open_), answer_form(output, format, TourForm.TEXT)
    tour_options = {
        "--closed": closed,
        "--start": start,
        "--end": end,
        "--format svg": kind is TourForm.SVG,
    }
    tour_options |= {**dict(zip(WISHES, visit_demands, strict=True)), "--method": method != "auto"}
    _refuse_misfits(tour_options, store_options, open_, cost, store)
    form, effort = (
        AnswerForm.JSON if kind is TourForm.JSON else AnswerForm.TEXT,
        (time_limit, work, seed),
    )
    if store:
        give_answer(
            lambda: continue_kept_sequence(target, store, news, effort, next_, anew), form, output
        )
    if cost is not TravelCost.STRAIGHT:
        give_answer(lambda: _of_arm(target, cost, effort), form, output)
    give_answer(
        lambda: _sequence_visits(target, method, (back, start, end), visit_demands, effort, kind),
        form,
        output,
    )


def _refuse_misfits(
    given: Mapping[str, object],
    kept: Mapping[str, object],
    open_: bool,
    cost: TravelCost,
    store: str,
) -> None:
    """Refuse options of other ways to make a sequence: `kept` need --store, `given` and --cost
    do without it.
    """
    joints = cost is not TravelCost.STRAIGHT
    if store:
        why = "with --store: a kept sequence is open and counts straight lines"
        refuse_idle({**given, "--cost": joints}, why)
        return
    refuse_idle(kept, "without --store: only a kept sequence can be continued")
    if joints:
        refuse_idle({**given, "--open": open_}, f"with --cost {cost}, whose tours are closed")


def _returns_to_start(closed: bool, open_: bool) -> bool | None:
    """Whether the tour returns to its first visit; None if the options leave that to TARGET."""
    if closed and open_:
        raise make_misfit("a tour is either closed or open")
    return closed if closed or open_ else None


def _sequence_visits(
    target: str,
    method: str,
    ends: tuple[bool | None, str, str],
    wanted: tuple[list[str], list[str], list[str]],
    effort: tuple[float | None, int, int],
    form: TourForm,
) -> VerbAnswer:
    from cellwright.engine.stages.sequencing import METHODS, TourLimits

    if method not in METHODS:
        hint = nearest_hint(method, list(METHODS)) or f"one of {', '.join(METHODS)}"
        raise InvalidInput([Diagnostic(Source("--method"), "K406", f"no method '{method}'", hint)])
    if not interop.is_tsplib(target) and is_shared(problem := planning.problem_of(target)):
        tour_options = {
            "--closed": ends[0],
            "--start": ends[1],
            "--end": ends[2],
            "--method": method != "auto",
        }
        refuse_idle(
            {**tour_options, "--format svg": form is TourForm.SVG},
            "where several arms share measurements",
        )
        return shared_by_arms(problem, wanted, effort)
    with SearchInterruption(effort[0]) as interrupted:
        limits = TourLimits(effort[1], effort[2], interrupted, tell=interrupted.tell_cost)
        tour_visits, answer = _solve_visits(target, method, ends, wanted, limits)
    return _tour_answer(tour_visits, answer, form, interrupted.heard)


def _of_arm(target: str, cost: TravelCost, effort: tuple[float | None, int, int]) -> VerbAnswer:
    """Tours through measurements by what they cost the arm: by poses alone, or by the times of
    paths that touch nothing.
    """
    from cellwright.engine.stages.sequencing import TourLimits

    problem, moving = planning.problem_of(target), cost is TravelCost.MOTION
    if is_shared(problem):
        refuse_idle({f"--cost {cost}": True}, "where several arms share measurements")
    toured: Any = motion.driven_tours if moving else motion.posed_tours
    entry: Any = report.driven_entry if moving else report.posed_entry
    shown: Any = report.driven_text if moving else report.posed_text
    with SearchInterruption(effort[0]) as interrupted:
        limits = TourLimits(effort[1], effort[2], interrupted)
        tours, parts = toured(problem, loader.cell_of_problem(problem), geometry_backend(), limits)
    content = {
        "tours": [entry(tour) for tour in tours],
        "partition": report.tool_groups_entry(parts),
    }
    return VerbAnswer(
        "found", content, lambda: shown(tours, parts), INTERRUPTED if interrupted.heard else 0
    )


def _solve_visits(
    target: str,
    method: str,
    ends: tuple[bool | None, str, str],
    wanted: tuple[list[str], list[str], list[str]],
    limits: "TourLimits",
) -> "tuple[TourVisits, Tour | Infeasible | GaveUp]":
    from cellwright.engine.stages.sequencing import sequence_tour

    tour_visits = interop.visits_of_target(target, *wanted).ending(*ends)
    return tour_visits, sequence_tour(tour_visits.tours, limits, method)


def _tour_answer(
    found: "TourVisits",
    answer: "Tour | Infeasible | GaveUp",
    form: TourForm,
    heard: bool,
) -> VerbAnswer:
    from cellwright.engine.model.tour_problem import Tour

    if not isinstance(answer, Tour):
        code = (
            INTERRUPTED
            if heard
            else INFEASIBLE
            if report.outcome_status(answer) == "infeasible"
            else GAVE_UP
        )
        reason = answer.reason
        return VerbAnswer(
            report.outcome_status(answer),
            {"reason": reason},
            lambda: rich_parts.Text(f"No tour: {reason}."),
            code,
        )
    return VerbAnswer(
        "optimal" if answer.proved else "found",
        report.visits_tour_content(answer, found),
        lambda: report.visits_tour_text(answer, found),
        INTERRUPTED if heard else 0,
        diagnostics=found.warnings,
        raw=report.draw_tour(answer, found.tours) if form is TourForm.SVG else None,
    )


def continue_kept_sequence(
    target: str,
    store: str,
    said: tuple[list[str], list[str], list[str], list[str]],
    effort: tuple[float | None, int, int],
    next_alone: bool,
    anew: bool,
) -> VerbAnswer:
    """The visits that are left. `said` holds the texts of --done, --lost, --bad and --restored."""
    from cellwright.engine.stages.sequencing import TourLimits

    with SearchInterruption(effort[0]) as interrupted:
        limits = TourLimits(effort[1], effort[2], interrupted)
        sequence_progress = planning.carry_on(
            store, planning.problem_of(target), _sequence_news(*said), limits, anew
        )
    return VerbAnswer(
        "found" if sequence_progress.plan.rest else "done",
        report.next_entry(sequence_progress)
        if next_alone
        else report.sequence_entry(sequence_progress),
        lambda: (
            report.next_text(sequence_progress)
            if next_alone
            else report.sequence_text(sequence_progress)
        ),
        INTERRUPTED if interrupted.heard else 0,
    )


def _sequence_news(
    done: list[str], lost: list[str], bad: list[str], restored: list[str]
) -> "SequenceNews":
    parted = [bad_text.partition("=") for bad_text in bad]
    reasons = {
        name: why.strip() or inspection.FOUND_BAD
        for names, _, why in parted
        for name in _split_names([names])
    }
    return inspection.SequenceNews(
        _split_names(done), _split_names(lost), reasons, _split_names(restored)
    )


def _split_names(texts: Iterable[str]) -> tuple[str, ...]:
    return tuple(name.strip() for text in texts for name in text.split(",") if name.strip())


def shared_by_arms(
    problem: "Problem",
    wanted: tuple[list[str], list[str], list[str]],
    effort: tuple[float | None, int, int],
) -> VerbAnswer:
    """Which arm makes which measurements, in which order. Raises `InvalidInput`."""
    from cellwright.engine.stages.sequencing import TourLimits

    demands, placed = inspection.of_options(*wanted), inspection.with_places(problem)
    with SearchInterruption(effort[0]) as interrupted:
        arm_shares = planning.shares_of(
            placed, demands, TourLimits(effort[1], effort[2], interrupted)
        )
    assert arm_shares is not None
    if not isinstance(arm_shares, planning.SharedMeasurements):
        reason, code = (
            arm_shares.reason,
            INFEASIBLE if report.outcome_status(arm_shares) == "infeasible" else GAVE_UP,
        )
        return VerbAnswer(
            report.outcome_status(arm_shares),
            {"reason": reason},
            lambda: rich_parts.Text(f"No shares: {reason}."),
            code,
        )
    inspection.require_known_visits(demands, set(arm_shares.arms))
    content = {
        **report.shares_entry(arm_shares),
        "partition": report.tool_groups_entry(arm_shares.partition),
    }
    late = (
        [rich_parts.Text(f"Not all windows can be kept: {arm_shares.unkept}.")]
        if arm_shares.unkept
        else []
    )
    return VerbAnswer(
        "optimal" if arm_shares.shares.makespan <= arm_shares.shares.lower_bound else "found",
        content,
        lambda: rich_parts.Group(
            report.tool_groups_text(arm_shares.partition),
            report.shares_text(arm_shares),
            *late,
        ),
        INTERRUPTED if interrupted.heard else 0,
    )
