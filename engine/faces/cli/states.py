"""`cellwright states`: the contact states of a cell as a net of places and transitions."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.idle import refuse_idle

if TYPE_CHECKING:
    from cellwright.engine.model.task_space import Net


class NetForm(StrEnum):
    """How a net is written."""

    TEXT = "text"
    JSON = "json"
    DOT = "dot"
    SVG = "svg"
    PNML = "pnml"


Domain = Annotated[
    str, Argument(metavar="DOMAIN", help="a domain with a contacts.yaml, or one of its problems")
]
Full = Annotated[
    bool, Option("--full", help="tell all objects and anchor points apart, not only their classes")
]
Reduced = Annotated[
    list[str] | None,
    Option("--reduced", metavar="PART", help="only these objects or classes, one or several"),
]
More = Annotated[list[str] | None, Argument(metavar="[PART]...", help="more parts, after --reduced PART")]
Templates = Annotated[
    bool, Option("--contacts", help="print each place with its contacts in the normal form")
]
Output = Annotated[
    Path | None,
    Option(
        "--output",
        "-o",
        metavar="FOLDER",
        help="write the planning domain that is generated, with its problems",
    ),
]
_WITH_OUTPUT = "with --output, which writes the planning domain of the whole cell"
Goals = Annotated[
    list[str] | None,
    Option(
        "--goal", metavar="CONTACT", help="find the shortest sequence of operators to this contact; repeat it"
    ),
]
Brings = Annotated[
    str, Option("--brings", metavar="PART", help="say what an object, or a class, brings to the net")
]


def states(
    target: Domain,
    more: More = None,
    full: Full = False,
    reduced: Reduced = None,
    contacts: Templates = False,
    brings: Brings = "",
    goal: Goals = None,
    output: Output = None,
    format: Annotated[NetForm, Option("--format", help="how the net is written")] = NetForm.TEXT,
) -> None:
    """Generate the contact states of DOMAIN from its contact model, and the net of the steps between them."""
    form = Form.JSON if format is NetForm.JSON else Form.TEXT
    if more and not reduced:
        raise misfit(f"'{more[0]}' is one argument too many; parts of a cell follow --reduced")
    reduced = [*(reduced or ()), *(more or ())]
    if output is not None:
        refuse_idle(
            {"--full": full, "--reduced": reduced, "--contacts": contacts, "--brings": brings}, _WITH_OUTPUT
        )
        give(lambda: _written(target, output), form)
    if goal:
        refuse_idle(
            {"--full": full, "--contacts": contacts, "--brings": brings},
            "with --goal, which prints a sequence",
        )
        give(lambda: _sequence(target, tuple(reduced), goal), form)
    give(lambda: _states(target, full, tuple(reduced), contacts, brings, format), form)


def _sequence(target: str, parts: tuple[str, ...], goals: list[str]) -> Answer:
    from rich.text import Text

    from cellwright.engine.faces.cli.exits import GAVE_UP, INFEASIBLE
    from cellwright.engine.pipelines import task_space

    model, warnings = task_space.model_of(target)
    found, _ = task_space.sequence(model, goals, task_space.Wanted(parts))
    if found.firings is None:
        said = "no contact state that can be reached has it" if found.exhausted else "the search was stopped"
        status, code = ("infeasible", INFEASIBLE) if found.exhausted else ("gave up", GAVE_UP)
        return Answer(status, {"sequence": None}, lambda: Text(said), code, warnings)
    steps = [str(each) for each in found.firings]
    text = "\n".join(f"{n:3} {each}" for n, each in enumerate(steps, 1)) or "it holds already"
    return Answer("found", {"sequence": steps}, lambda: Text(text), 0, warnings)


def _written(target: str, output: Path) -> Answer:
    from rich.text import Text

    from cellwright.engine.pipelines import task_space

    files = [str(each) for each in task_space.write_domain(target, output)]
    return Answer("ok", {"files": files}, lambda: Text("\n".join(files)))


def _states(
    target: str, full: bool, parts: tuple[str, ...], contacts: bool, brings: str, form: NetForm
) -> Answer:
    from rich.console import Group
    from rich.text import Text

    from cellwright.engine.faces.cli.exits import GAVE_UP
    from cellwright.engine.formats.report import states as report
    from cellwright.engine.pipelines import task_space

    model, warnings = task_space.model_of(target)
    found = task_space.net(model, task_space.Wanted(parts, full))
    raw = report.template(found) if contacts and form is NetForm.TEXT else _drawn(found, form, full)
    content = report.content(found)
    if brings:
        part = task_space.brought(model, found, brings)
        content["brings"] = report.brings_entry(part)
        more = report.brings(part)
        return Answer("ok", content, lambda: Group(report.text(found), Text(more)), 0, warnings, raw)
    status, code = ("ok", 0) if found.complete else ("gave up", GAVE_UP)
    return Answer(status, content, lambda: report.text(found), code, warnings, raw)


def _drawn(found: "Net", form: NetForm, full: bool) -> str | None:
    """The net in a form that is no table; None for tables and JSON."""
    match form:
        case NetForm.DOT:
            from cellwright.engine.formats.report import states_dot

            return states_dot.net(found)
        case NetForm.SVG:
            from cellwright.engine.formats.report import states_svg

            return states_svg.net(found)
        case NetForm.PNML:
            from cellwright.engine.formats.interop.pnml import written

            return written(found, coloured=not full)
        case _:
            return None
