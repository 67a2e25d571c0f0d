"""`cellwright place`: a part is found, taken, and put where relations say."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import GAVE_UP, INFEASIBLE
from engine.faces.cli.options import Format, Seed
from engine.faces.cli.scene_files import Image, SceneName, scene_file

if TYPE_CHECKING:
    from engine.model.vision import DepthImage
    from engine.pipelines.placing.looking import Looked
    from kb.model.scene import Scene

CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}


def place(
    part: Annotated[str, typer.Argument(metavar="PART", help="the part that is placed")],
    on: Annotated[str, typer.Argument(metavar="ON", help="the word `on`")],
    base: Annotated[str, typer.Argument(metavar="PART", help="the body that it is placed on")],
    scene: SceneName,
    image: Image = None,
    seed: Seed = 0,
    format: Format = Form.TEXT,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="a folder for pictures: the depth image with the part found"),
    ] = None,
) -> None:
    """Place a part ON another one, as the relations of a scene say: find it, grasp it, and plan all motions."""
    if on.lower() != "on":
        raise typer.BadParameter(f"write: place {part} on {base}", param_hint="ON")
    give(lambda: _placed(part, base, scene, image, seed, output), format)


def _placed(part: str, base: str, scene: str, image: Path | None, seed: int, output: Path | None) -> Answer:
    from rich.text import Text

    from engine.formats.interop.depth_files import read_depth
    from engine.formats.report import placing as report
    from engine.pipelines.placing import looking, placing
    from kb.loader.scene import load_scene

    read = load_scene(scene_file(scene))
    given = read_depth(image, looking.camera_of(read)) if image else None
    found, looked = placing.place(read, part, base, seed, given)
    status, said = report.status(found), report.text(found, part, base)
    if output is not None and looked is not None:
        output.mkdir(parents=True, exist_ok=True)
        drawn = output / "depth.png"
        drawn.write_bytes(_picture(read, part, looked))
        said = f"{said}\n{drawn}"
    return Answer(status, report.content(found), lambda: Text(said), CODES[status])


def _picture(scene: "Scene", part: str, looked: "Looked") -> bytes:
    from engine.formats.report.depth_picture import picture
    from engine.stages.geometry.shapes.solids import solid_of

    best = looked.sightings[part].best
    image: DepthImage = looked.image
    return picture(image, solid_of(scene.cell.bodies[part]), best.T_camera_part if best else None)
