"""`cellwright sequence`: the cheapest order of visits."""

from collections.abc import Mapping
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.exits import GAVE_UP, INFEASIBLE, INTERRUPTED
from cellwright.engine.faces.cli.idle import refuse_idle
from cellwright.engine.faces.cli.options import Before, Lasts, Seed, TimeLimit, Windows
from cellwright.engine.faces.cli.saving import Output, form_of

if TYPE_CHECKING:
    from cellwright.engine.model.outcome import GaveUp, Infeasible
    from cellwright.engine.model.tour import Tour
    from cellwright.engine.pipelines.inspection.visits import Visits
    from cellwright.engine.stages.sequencing import Limits


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
        help="cost between measurements: straight lines, joints (the time that the arm needs), or motion (of free paths)",
    ),
]
Work = Annotated[
    int, Option("--work", min=0, help="work of the search; 0 means that it fits the number of visits")
]
Store = Annotated[str, Option("--store", help="keep the sequence of a problem in this file or database")]
Next = Annotated[bool, Option("--next", help="print only the next visit of the kept sequence")]
Done = Annotated[list[str] | None, Option("--done", help="visits that are done, separated by commas")]
Lost = Annotated[list[str] | None, Option("--lost", help="tools and resources that are lost")]
Bad = Annotated[
    list[str] | None,
    Option("--bad", help="visits to leave out because they were found bad: 'm3, m4=the surface is dirty'"),
]
Restored = Annotated[
    list[str] | None, Option("--restored", help="visits, tools and resources that can be used again")
]
Anew = Annotated[bool, Option("--anew", help="forget the kept sequence")]
Shown = Annotated[
    TourForm | None,
    Option("--format", help="how the tour is written: text, unless the name of the output ends otherwise"),
]


def sequence(
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
    """Print the best order found for the visits of TARGET, with a lower bound on the cost of any order."""
    news = (done or [], lost or [], bad or [], restored or [])
    wanted = (window or [], lasts or [], before or [])
    kept = {"--next": next_, "--anew": anew, **dict(zip(NEWS, news, strict=True))}
    back, kind = _returns(closed, open_), form_of(output, format, TourForm.TEXT)
    given = {"--closed": closed, "--start": start, "--end": end, "--format svg": kind is TourForm.SVG}
    given |= {**dict(zip(WISHES, wanted, strict=True)), "--method": method != "auto"}
    _refuse_misfits(given, kept, open_, cost, store)
    form, effort = Form.JSON if kind is TourForm.JSON else Form.TEXT, (time_limit, work, seed)
    if store:
        from cellwright.engine.faces.cli.kept_sequence import carried_on

        give(lambda: carried_on(target, store, news, effort, next_, anew), form, output)
    if cost is not TravelCost.STRAIGHT:
        give(lambda: _of_arm(target, cost, effort), form, output)
    give(lambda: _sequence(target, method, (back, start, end), wanted, effort, kind), form, output)


def _refuse_misfits(
    given: Mapping[str, object], kept: Mapping[str, object], open_: bool, cost: TravelCost, store: str
) -> None:
    """Refuse options of other ways to make a sequence: `kept` need --store, `given` and --cost do without it."""
    joints = cost is not TravelCost.STRAIGHT
    if store:
        why = "with --store: a kept sequence is open and counts straight lines"
        refuse_idle({**given, "--cost": joints}, why)
        return
    refuse_idle(kept, "without --store: only a kept sequence can be continued")
    if joints:
        refuse_idle({**given, "--open": open_}, f"with --cost {cost}, whose tours are closed")


def _returns(closed: bool, open_: bool) -> bool | None:
    """Whether the tour returns to its first visit; None if the options leave that to TARGET."""
    if closed and open_:
        raise misfit("a tour is either closed or open")
    return closed if closed or open_ else None


def _sequence(
    target: str,
    method: str,
    ends: tuple[bool | None, str, str],
    wanted: tuple[list[str], list[str], list[str]],
    effort: tuple[float | None, int, int],
    form: TourForm,
) -> Answer:
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.interop.visits import is_tsplib
    from cellwright.engine.model.measurements import is_shared
    from cellwright.engine.pipelines.planning import problem_of
    from cellwright.engine.stages.sequencing import METHODS, Limits
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest

    if method not in METHODS:
        hint = nearest(method, list(METHODS)) or f"one of {', '.join(METHODS)}"
        raise InvalidInput([Diagnostic(Source("--method"), "K406", f"no method '{method}'", hint)])
    if not is_tsplib(target) and is_shared(problem := problem_of(target)):
        from cellwright.engine.faces.cli.shared_sequence import shared_by_arms

        given = {"--closed": ends[0], "--start": ends[1], "--end": ends[2], "--method": method != "auto"}
        refuse_idle({**given, "--format svg": form is TourForm.SVG}, "where several arms share measurements")
        return shared_by_arms(problem, wanted, effort)
    with Interruption(effort[0]) as interrupted:
        limits = Limits(effort[1], effort[2], interrupted, tell=interrupted.tell_cost)
        found, answer = _solve(target, method, ends, wanted, limits)
    return _answer(found, answer, form, interrupted.heard)


def _of_arm(target: str, cost: TravelCost, effort: tuple[float | None, int, int]) -> Answer:
    """Tours through measurements by what they cost the arm: by poses alone, or by the times of paths that touch nothing."""
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.report import inspection
    from cellwright.engine.model.measurements import is_shared
    from cellwright.engine.pipelines.inspection.poses import posed_tours
    from cellwright.engine.pipelines.motion.driven import driven_tours
    from cellwright.engine.pipelines.planning import problem_of
    from cellwright.engine.plugins import geometry_backend
    from cellwright.engine.stages.sequencing import Limits
    from cellwright.kb.loader.cell import cell_of

    problem, moving = problem_of(target), cost is TravelCost.MOTION
    if is_shared(problem):
        refuse_idle({f"--cost {cost}": True}, "where several arms share measurements")
    toured: Any = driven_tours if moving else posed_tours
    entry: Any = inspection.driven_entry if moving else inspection.posed_entry
    shown: Any = inspection.driven if moving else inspection.posed
    with Interruption(effort[0]) as interrupted:
        limits = Limits(effort[1], effort[2], interrupted)
        tours, parts = toured(problem, cell_of(target), geometry_backend(), limits)
    content = {"tours": [entry(each) for each in tours], "partition": inspection.entry(parts)}
    return Answer("found", content, lambda: shown(tours, parts), INTERRUPTED if interrupted.heard else 0)


def _solve(
    target: str,
    method: str,
    ends: tuple[bool | None, str, str],
    wanted: tuple[list[str], list[str], list[str]],
    limits: "Limits",
) -> "tuple[Visits, Tour | Infeasible | GaveUp]":
    from cellwright.engine.formats.interop.visits import visits_of
    from cellwright.engine.stages.sequencing import sequence

    found = visits_of(target, *wanted).ending(*ends)
    return found, sequence(found.tours, limits, method)


def _answer(
    found: "Visits",
    answer: "Tour | Infeasible | GaveUp",
    form: TourForm,
    heard: bool,
) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.report import json, tour_svg, toured
    from cellwright.engine.model.tour import Tour

    if not isinstance(answer, Tour):
        code = INTERRUPTED if heard else INFEASIBLE if json.status(answer) == "infeasible" else GAVE_UP
        reason = answer.reason
        return Answer(json.status(answer), {"reason": reason}, lambda: Text(f"No tour: {reason}."), code)
    return Answer(
        "optimal" if answer.proved else "found",
        toured.content(answer, found),
        lambda: toured.text(answer, found),
        INTERRUPTED if heard else 0,
        raw=tour_svg.picture(answer, found.tours) if form is TourForm.SVG else None,
    )
