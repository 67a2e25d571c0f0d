"""`cellwright driver`: controllers in processes of their own, tried out and simulated."""

from typing import TYPE_CHECKING, Annotated

import typer

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Option, misfit
from cellwright.engine.faces.cli.options import Format, Seed, Target
from cellwright.engine.faces.cli.run import Factor, Faults, Options, options_of
from cellwright.kb.numbers import is_count

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.model.execution import Command
    from cellwright.engine.pipelines.controllers.conformance import Checked
    from cellwright.kb.model.problem import Problem

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def driver() -> None:
    """Try out the controller of a cell, or serve a simulated one."""


@app.command("list")
def list_(format: Format = Form.TEXT) -> None:
    """List the drivers that are installed."""
    give(_list, format)


def _list() -> Answer:
    from rich.text import Text

    from cellwright.engine import plugins

    names = plugins.known(plugins.DRIVERS)
    return Answer("ok", {"drivers": names}, lambda: Text("\n".join(names)))


@app.command()
def check(target: Target, option: Options = None, seed: Seed = 0, format: Format = Form.TEXT) -> None:
    """Check that a controller keeps the protocol. It carries out the first steps of a plan for TARGET.

    Say where it is with --option command='PROGRAM ...' or --option address=HOST:PORT.
    """
    give(lambda: _check(target, option or [], seed), format)


def _check(target: str, options: list[str], seed: int) -> Answer:
    from cellwright.engine.faces.cli.exits import FINDINGS
    from cellwright.engine.pipelines import planning
    from cellwright.engine.pipelines.controllers import conformance
    from cellwright.engine.ports import DriverSetup

    problem = planning.problem_of(target)
    setup = DriverSetup(problem, "conformance", seed, options=options_of(options))
    found = conformance.checked(setup, _commands(problem))
    wrong = [each for each in found if each.wrong]
    content = {"points": [{"point": each.point, "wrong": each.wrong} for each in found]}
    return Answer("invalid" if wrong else "ok", content, lambda: _shown(found), FINDINGS if wrong else 0)


def _commands(problem: "Problem") -> "list[Command]":
    """The commands of a plan, in its order."""
    from cellwright.engine.model.execution import Command, CommandKind
    from cellwright.engine.pipelines.execution.planned import Ready, first
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    ready = first(problem)
    if not isinstance(ready, Ready):
        raise InvalidInput(
            [Diagnostic(Source(problem.path), "K404", "there is no plan", "give another problem")]
        )
    activities = ready.compiled.program.activities.values()
    return [
        Command(number, CommandKind.STEP, a.stream, a.action, a.says, a.expects, (), a.lasts_ms, a.timeout_ms)
        for number, a in enumerate(sorted(activities, key=lambda each: (each.start_ms, each.id)), 1)
    ]


def _shown(found: "list[Checked]") -> "RenderableType":
    from rich.text import Text

    lines = [
        f"{'no ' if each.wrong else 'yes'}  {each.point}" + (f": {each.wrong}" if each.wrong else "")
        for each in found
    ]
    wrong = sum(bool(each.wrong) for each in found)
    lines.append(f"{len(found) - wrong} of {len(found)} points are as the protocol says")
    return Text("\n".join(lines))


@app.command()
def serve(
    target: Target,
    listen: Annotated[
        str, Option("--listen", metavar="HOST:PORT", help="listen there; else on the standard streams")
    ] = "",
    factor: Factor = 0.0,
    fault: Faults = None,
    option: Options = None,
    seed: Seed = 0,
) -> None:
    """Serve a simulated cell for TARGET as a controller: the reference for those who write one."""
    from cellwright.engine.pipelines import planning
    from cellwright.engine.pipelines.controllers import serving
    from cellwright.engine.ports import DriverSetup

    host, _, port = listen.rpartition(":")
    if listen and not (host and is_count(port) and int(port) < 65_536):
        raise misfit("--listen: write HOST:PORT, such as 127.0.0.1:7000")
    given = options_of(option or []) | ({"fault": "; ".join(fault)} if fault else {})

    def make() -> Answer:
        setup = DriverSetup(planning.problem_of(target), "", seed, factor, given)
        serving.serve(setup, host, int(port or 0))
        return Answer("ok")

    give(make, Form.TEXT)
