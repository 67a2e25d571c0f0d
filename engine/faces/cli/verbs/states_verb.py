"""The verb `states`: contact states of a cell as a net of places and transitions."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import GAVE_UP, INFEASIBLE
from cellwright.engine.faces.cli.wrong_options import make_misfit, refuse_idle
from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts

if TYPE_CHECKING:
    from cellwright.engine.model.task_space import ContactNet


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
More = Annotated[
    list[str] | None, Argument(metavar="[PART]...", help="more parts, after --reduced PART")
]
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
        "--goal",
        metavar="CONTACT",
        help="find the shortest sequence of operators to this contact; repeat it",
    ),
]
Brings = Annotated[
    str,
    Option("--brings", metavar="PART", help="say what an object, or a class, brings to the net"),
]


def show_contact_states(
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
    """Generate the contact states of DOMAIN from its contact model, and the net of the steps
    between them.
    """
    form = AnswerForm.JSON if format is NetForm.JSON else AnswerForm.TEXT
    if more and not reduced:
        raise make_misfit(f"'{more[0]}' is one argument too many; parts of a cell follow --reduced")
    reduced = [*(reduced or ()), *(more or ())]
    if output is not None:
        refuse_idle(
            {"--full": full, "--reduced": reduced, "--contacts": contacts, "--brings": brings},
            _WITH_OUTPUT,
        )
        give_answer(lambda: _write_domain_files(target, output), form)
    if goal:
        refuse_idle(
            {"--full": full, "--contacts": contacts, "--brings": brings},
            "with --goal, which prints a sequence",
        )
        give_answer(lambda: _firing_sequence(target, tuple(reduced), goal), form)
    give_answer(
        lambda: _states_answer(target, full, tuple(reduced), contacts, brings, format), form
    )


def _firing_sequence(target: str, parts: tuple[str, ...], goals: list[str]) -> VerbAnswer:
    from cellwright.engine.pipelines import contact_states

    model, warnings = contact_states.contact_model_of(target)
    firing_search, _ = contact_states.contact_sequence(
        model, goals, contact_states.NetRequest(parts)
    )
    if firing_search.firings is None:
        refusal_text = (
            "no contact state that can be reached has it"
            if firing_search.exhausted
            else "the search was stopped"
        )
        status, code = (
            ("infeasible", INFEASIBLE) if firing_search.exhausted else ("gave up", GAVE_UP)
        )
        return VerbAnswer(
            status, {"sequence": None}, lambda: rich_parts.Text(refusal_text), code, warnings
        )
    steps = [str(firing) for firing in firing_search.firings]
    text = (
        "\n".join(f"{n:3} {firing_text}" for n, firing_text in enumerate(steps, 1))
        or "it holds already"
    )
    return VerbAnswer("found", {"sequence": steps}, lambda: rich_parts.Text(text), 0, warnings)


def _write_domain_files(target: str, output: Path) -> VerbAnswer:
    from cellwright.engine.pipelines import contact_states

    files = [str(written_file) for written_file in contact_states.write_domain(target, output)]
    return VerbAnswer("ok", {"files": files}, lambda: rich_parts.Text("\n".join(files)))


def _states_answer(
    target: str, full: bool, parts: tuple[str, ...], contacts: bool, brings: str, form: NetForm
) -> VerbAnswer:
    from cellwright.engine.pipelines import contact_states

    model, warnings = contact_states.contact_model_of(target)
    contact_net = contact_states.build_net(model, contact_states.NetRequest(parts, full))
    raw = (
        report.place_templates(contact_net)
        if contacts and form is NetForm.TEXT
        else _draw_net(contact_net, form, full)
    )
    content = report.net_content(contact_net)
    if brings:
        part = contact_states.compare_net_without(model, contact_net, brings)
        content["brings"] = report.brings_entry(part)
        more = report.brought_text(part)
        return VerbAnswer(
            "ok",
            content,
            lambda: rich_parts.Group(report.net_text(contact_net), rich_parts.Text(more)),
            0,
            warnings,
            raw,
        )
    status, code = ("ok", 0) if contact_net.complete else ("gave up", GAVE_UP)
    return VerbAnswer(status, content, lambda: report.net_text(contact_net), code, warnings, raw)


def _draw_net(found: "ContactNet", form: NetForm, full: bool) -> str | None:
    """The net in a form that is no table; None for tables and JSON."""
    match form:
        case NetForm.DOT:
            return report.net_dot(found)
        case NetForm.SVG:
            return report.draw_net(found)
        case NetForm.PNML:
            return interop.write_contact_net(found, coloured=not full)
        case _:
            return None
