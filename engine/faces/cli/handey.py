"""`cellwright handey`: assemblies, and portions of motions, of the scenes on which `place` works."""

from pathlib import Path
from typing import Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import FINDINGS, GAVE_UP, INFEASIBLE
from engine.faces.cli.options import Format, Seed, number
from engine.faces.cli.scene_files import Image, SceneName, scene_file

CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}
app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Assemble parts, plan portions of their motions, and follow an operator.",
)


@app.command()
def assemble(
    base: Annotated[str, typer.Argument(help="the body on which the assembly is built")],
    scene: SceneName,
    image: Image = None,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Put all parts of a scene where its relations say, in an order that the task planner finds and geometry proves."""
    give(lambda: _assembled(base, scene, image, seed), format)


def _assembled(base: str, scene: str, image: Path | None, seed: int) -> Answer:
    from rich.text import Text

    from engine.formats.interop.depth_files import read_depth
    from engine.formats.report import assembling as report
    from engine.pipelines.placing import assembling, looking
    from kb.loader import load_domain
    from kb.loader.scene import load_scene

    read = load_scene(scene_file(scene))
    given = read_depth(image, looking.camera_of(read)) if image else None
    made, _ = assembling.assemble(read, load_domain("handey"), base, seed, given)
    said = report.text(made, base)
    status = report.status(made)
    return Answer(status, report.content(made), lambda: Text(said), CODES[status])


@app.command()
def align(
    first: Annotated[str, typer.Argument(metavar="FEATURE", help="of the part, such as angle.heel")],
    kind: Annotated[str, typer.Argument(metavar="RELATION", help="such as parallel, aligned or coplanar")],
    second: Annotated[str, typer.Argument(metavar="FEATURE", help="of another body, such as base.front")],
    scene: SceneName,
    by: Annotated[
        float,
        typer.Option(
            callback=number, help="how far or how much, in millimetres or degrees, where the relation asks"
        ),
    ] = 0.0,
    image: Image = None,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Plan one portion: take a part, and bring it to where one relation holds. It stays in the hand."""
    give(lambda: _aligned(first, kind, second, by, scene, image, seed), format)


def _aligned(
    first: str, kind: str, second: str, by: float, scene: str, image: Path | None, seed: int
) -> Answer:
    from rich.text import Text

    from engine.formats.interop.depth_files import read_depth
    from engine.formats.report import portions as report
    from engine.pipelines.placing import aligning, looking
    from kb.loader.scene import load_scene, relation_of

    read = load_scene(scene_file(scene))
    said = relation_of(read.cell, first, kind, second, by)
    given = read_depth(image, looking.camera_of(read)) if image else None
    found = aligning.bring(read, said, seed, given)
    status, text = report.status(found), report.text(found, said)
    return Answer(status, report.content(found), lambda: Text(text), CODES[status])


@app.command()
def watch(
    part: Annotated[str, typer.Argument(metavar="PART", help="the part that an operator places")],
    base: Annotated[str, typer.Argument(metavar="PART", help="the body that it is placed on")],
    scene: SceneName,
    acts: Annotated[Path, typer.Option(help="what the operator does, as JSON (docs/placing.md)")],
    image: Image = None,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Follow an operator who places a part, and warn as soon as the goal has become hard or impossible."""
    give(lambda: _watched(part, base, scene, acts, image, seed), format)


def _watched(part: str, base: str, scene: str, acts: Path, image: Path | None, seed: int) -> Answer:
    from rich.text import Text

    from engine.formats.interop.acts import read_acts
    from engine.formats.interop.depth_files import read_depth
    from engine.formats.report import placing as placing_report
    from engine.formats.report import portions as report
    from engine.pipelines.placing import looking, watching
    from engine.pipelines.placing.answers import NotPlaced
    from kb.loader.scene import load_scene

    read = load_scene(scene_file(scene))
    events = read_acts(acts, read)
    given = read_depth(image, looking.camera_of(read)) if image else None
    state = watching.begin(read, part, base, seed, given)
    if isinstance(state, NotPlaced):
        why, status = placing_report.text(state, part, base), placing_report.status(state)
        return Answer(status, placing_report.content(state), lambda: Text(why), CODES[status])
    told = list(watching.watched(state, events))
    warned = any(said is not None for _, said in told)
    content, text = report.events(state, told), report.followed(state, told)
    return Answer("warned" if warned else "found", content, lambda: Text(text), FINDINGS if warned else 0)
