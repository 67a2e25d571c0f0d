"""The command `cellwright`: parse, call, print, exit. Heavy imports wait until a command needs them."""

import sys
from typing import Annotated

import typer

app = typer.Typer(
    name="cellwright", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)

Target = Annotated[
    str, typer.Argument(help="a problem file, a domain folder, or a bundled name such as bulkhead/one_point")
]


@app.callback()
def cellwright() -> None:
    """Plan and diagnose for robot work cells."""


@app.command()
def check(target: Target) -> None:
    """Report everything that is wrong with TARGET."""
    from kb.loader import find, load

    loaded = load(find(target))
    for warning in loaded.warnings:
        typer.echo(warning)
    typer.echo("no errors")


@app.command()
def plan(
    target: Target,
    goals: Annotated[str, typer.Option(help="goals, written as in a problem file")] = "",
    stats: Annotated[bool, typer.Option(help="print what a researcher wants")] = False,
) -> None:
    """Print a plan for TARGET."""
    from rich.console import Console

    from engine import pipeline
    from engine.cli.exits import exit_code
    from engine.report import text
    from kb.loader import find, load, load_problem, with_goals

    loaded = load(find(target))
    problem = with_goals(loaded.domain, goals, loaded.problem) if goals else load_problem(target)
    result = pipeline.plan(problem)
    console = Console()
    console.print(text.outcome(result))
    if stats:
        console.print(text.statistics(result.statistics))
    raise typer.Exit(exit_code(result))


def main() -> None:
    """Run the command line; input errors and interrupts become exit codes."""
    from kb.diagnostics import InvalidInput

    try:
        app()
    except InvalidInput as error:
        for diagnostic in error.diagnostics:
            typer.echo(diagnostic, err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
