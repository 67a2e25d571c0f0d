"""The command `cellwright`: parse, call, print, exit. Heavy imports wait until a command needs them."""

import gc

import typer

from engine.cli.cell import app as cell
from engine.cli.check import check, schema
from engine.cli.diagnose import diagnose
from engine.cli.explain import explain
from engine.cli.export import export
from engine.cli.golden import golden_plans
from engine.cli.import_ import app as import_
from engine.cli.init import init
from engine.cli.macros import app as macros
from engine.cli.measurement import app as measurement
from engine.cli.plan import plan, validate
from engine.cli.prepare import prepare
from engine.cli.revise import revise
from engine.cli.schedule import schedule
from engine.cli.sequence import sequence

app = typer.Typer(
    name="cellwright", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


@app.callback()
def cellwright() -> None:
    """Plan and diagnose for robot work cells."""


for command in (check, diagnose, explain, export, init, plan, prepare, revise, schedule, schema, validate):
    app.command()(command)
app.command()(sequence)
app.command("test")(golden_plans)
app.add_typer(macros, name="macros")
app.add_typer(import_, name="import")
app.add_typer(measurement, name="measurement")
app.add_typer(cell, name="cell")


def main() -> None:
    """Run the command line."""
    gc.set_threshold(100_000)  # hardly anything here is part of a cycle
    app()
