"""`cellwright motion`: paths of an arm in a cell."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import GAVE_UP, INFEASIBLE
from engine.faces.cli.options import Seed, Target, number, refuse_idle

app = typer.Typer(add_completion=False, no_args_is_help=True)
CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}
NAMED = 'home, a place of the cell, joint values "0, 90, 0, 0, 45, 0", or "point X, Y, Z" in metres'


class Way(StrEnum):
    """The strategies of `engine.model.motion`, named here so that help needs no array library."""

    CONNECT = "connect"
    VISIBILITY = "visibility"
    REDUCED = "reduced"


class MotionForm(StrEnum):
    """The forms in which a motion is shown."""

    TEXT = "text"
    JSON = "json"
    SVG = "svg"


@app.callback()
def motion() -> None:
    """Plan motions of an arm."""


@app.command("plan")
def plan_motion(
    target: Target,
    start: Annotated[str, typer.Option("--from", help=f"where it starts: {NAMED}")],
    goal: Annotated[str, typer.Option("--to", help="where it goes: the same")],
    margin: Annotated[
        float, typer.Option(min=0, max=10, callback=number, help="metres that everything must stay clear")
    ] = 0.0,
    bridges: Annotated[
        int, typer.Option(min=0, max=100_000, help="short cuts that are tried: more work, a shorter path")
    ] = 60,
    strategy: Annotated[
        Way,
        typer.Option(help="connect: two trees; visibility: the hand first; reduced: three joints at a time"),
    ] = Way.CONNECT,
    seed: Seed = 0,
    format: Annotated[MotionForm, typer.Option("--format", help="how it is shown")] = MotionForm.TEXT,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="the SVG file to write")] = None,
) -> None:
    """Plan a motion in the cell of TARGET that touches nothing, and prove it."""
    if format is not MotionForm.SVG:
        refuse_idle({"--output": output}, "without a picture: give --format svg")
    form = Form.JSON if format is MotionForm.JSON else Form.TEXT
    give(lambda: _planned(target, (start, goal), (margin, seed, bridges, strategy), format, output), form)


def _planned(
    target: str,
    ends: tuple[str, str],
    settings: tuple[float, int, int, Way],
    form: MotionForm,
    output: Path | None,
) -> Answer:
    import numpy as np
    from rich.text import Text

    from engine.formats.report import motion as report
    from engine.formats.report import motion_svg
    from engine.model.motion import Strategy
    from engine.pipelines.motion import moving as pipeline

    margin, seed, bridges, strategy = settings
    found = pipeline.move(target, *ends, margin, seed, bridges, Strategy(strategy.value))
    path, timed = found.path(), found.trajectory()
    times = timed.corners_s
    status = report.status(found.answer)
    content = report.content(found.answer, found.joints, path, times)
    said = report.text(found.answer, found.joints, path, times)
    if form is MotionForm.SVG and len(path):
        moments = np.linspace(0.0, times[-1], motion_svg.MOMENTS)
        values, speeds, _ = timed.at(moments)
        drawn = motion_svg.picture(found.joints, moments, values, speeds)
        if output is None:
            return Answer(status, raw=drawn)
        output.write_text(drawn, encoding="utf-8")
        said = f"{said}\n{output}"
    return Answer(status, {"arm": found.arm, **content}, lambda: Text(said), CODES[status])
