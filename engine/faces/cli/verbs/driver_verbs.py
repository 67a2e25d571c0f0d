"""The verbs `driver`: controllers in own processes, checked against the protocol or simulated."""

from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from cellwright.engine.faces.cli.options.shared_options import Format, Seed, Target
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import FINDINGS
from cellwright.engine.faces.cli.verbs.run_verbs import Factor, Faults, Options, options_of
from cellwright.engine.faces.cli.wrong_options import make_misfit
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.model.run_protocol import CommandKind, DriverCommand
from cellwright.engine.pipelines import execution, planning
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.numbers import is_count

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.pipelines.execution.controllers.conformance import CheckedPoint
    from cellwright.kb.model.planning_problem import Problem

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def driver_group() -> None:
    """Try out the controller of a cell, or serve a simulated one."""


@app.command("list")
def list_drivers(format: Format = AnswerForm.TEXT) -> None:
    """List the drivers that are installed."""
    give_answer(_list_drivers, format)


def _list_drivers() -> VerbAnswer:
    from cellwright.engine import plugins

    names = plugins.registered_names(plugins.DRIVER_GROUP)
    return VerbAnswer("ok", {"drivers": names}, lambda: rich_parts.Text("\n".join(names)))


@app.command()
def check(
    target: Target, option: Options = None, seed: Seed = 0, format: Format = AnswerForm.TEXT
) -> None:
    """Check that a controller keeps the protocol. It carries out the first steps of a plan for
    TARGET.

    Say where it is with --option command='PROGRAM ...' or --option address=HOST:PORT.
    """
    give_answer(lambda: _check_driver(target, option or [], seed), format)


def _check_driver(target: str, options: list[str], seed: int) -> VerbAnswer:
    from cellwright.engine.ports import DriverSetup

    problem = planning.problem_of(target)
    setup = DriverSetup(problem, "conformance", seed, options=options_of(options))
    checked_points = execution.check_conformance(setup, _plan_commands(problem))
    wrong = [checked_point for checked_point in checked_points if checked_point.wrong]
    content = {
        "points": [
            {"point": checked_point.point, "wrong": checked_point.wrong}
            for checked_point in checked_points
        ]
    }
    return VerbAnswer(
        "invalid" if wrong else "ok",
        content,
        lambda: _conformance_text(checked_points),
        FINDINGS if wrong else 0,
    )


def _plan_commands(problem: "Problem") -> "list[DriverCommand]":
    """The commands of a plan, in its order."""
    ready = execution.first_plan(problem)
    if not isinstance(ready, execution.ReadyPlan):
        raise InvalidInput(
            [Diagnostic(Source(problem.path), "K404", "there is no plan", "give another problem")]
        )
    activities = ready.compiled.program.activities.values()
    return [
        DriverCommand(
            number,
            CommandKind.STEP,
            a.stream,
            a.action,
            a.says,
            a.expects,
            (),
            a.lasts_ms,
            a.timeout_ms,
        )
        for number, a in enumerate(sorted(activities, key=lambda each: (each.start_ms, each.id)), 1)
    ]


def _conformance_text(found: "list[CheckedPoint]") -> "RenderableType":
    lines = [
        f"{'no ' if checked_point.wrong else 'yes'}  {checked_point.point}"
        + (f": {checked_point.wrong}" if checked_point.wrong else "")
        for checked_point in found
    ]
    wrong = sum(bool(checked_point.wrong) for checked_point in found)
    lines.append(f"{len(found) - wrong} of {len(found)} points are as the protocol says")
    return rich_parts.Text("\n".join(lines))


@app.command()
def serve(
    target: Target,
    listen: Annotated[
        str,
        Option("--listen", metavar="HOST:PORT", help="listen there; else on the standard streams"),
    ] = "",
    factor: Factor = 0.0,
    fault: Faults = None,
    option: Options = None,
    seed: Seed = 0,
) -> None:
    """Serve a simulated cell for TARGET as a controller: the reference for those who write one."""
    from cellwright.engine.ports import DriverSetup

    host, _, port = listen.rpartition(":")
    if listen and not (host and is_count(port) and int(port) < 65_536):
        raise make_misfit("--listen: write HOST:PORT, such as 127.0.0.1:7000")
    driver_options = options_of(option or []) | ({"fault": "; ".join(fault)} if fault else {})

    def make() -> VerbAnswer:
        setup = DriverSetup(planning.problem_of(target), "", seed, factor, driver_options)
        execution.serve_controller(setup, host, int(port or 0))
        return VerbAnswer("ok")

    give_answer(make, AnswerForm.TEXT)
