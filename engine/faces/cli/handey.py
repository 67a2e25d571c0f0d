"""`cellwright handey`: assemblies, and portions of motions, of the scenes on which `place` works."""

from pathlib import Path
from typing import Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import GAVE_UP, INFEASIBLE
from engine.faces.cli.options import Format, Seed
from engine.faces.cli.scene_files import Image, SceneName, scene_file

CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}
app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Assemble parts, and align features, as a scene says."
)


@app.callback()
def handey() -> None:
    """Assemble parts as the relations of a scene say."""


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
