"""`cellwright place`: a part is found, taken, and put where relations say."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import GAVE_UP, INFEASIBLE
from engine.faces.cli.options import Format, Seed

if TYPE_CHECKING:
    from engine.model.vision import DepthImage
    from engine.pipelines.placing.looking import Looked
    from kb.model.scene import Scene

CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}
SCENE_FILE = "scene.yaml"


def place(
    part: Annotated[str, typer.Argument(metavar="PART", help="the part that is placed")],
    on: Annotated[str, typer.Argument(metavar="ON", help="the word `on`")],
    base: Annotated[str, typer.Argument(metavar="PART", help="the body that it is placed on")],
    scene: Annotated[
        str, typer.Option("--scene", help="a scene file, or the name of a bundled one, such as handey")
    ],
    image: Annotated[
        Path | None,
        typer.Option(
            "--image",
            help="the depth image: .npy, 16-bit .png in mm, .pcd or .ply; else it is made from the scene",
        ),
    ] = None,
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

    read = load_scene(_file(scene))
    given = read_depth(image, looking.camera_of(read)) if image else None
    found, looked = placing.place(read, part, base, seed, given)
    status, said = report.status(found), report.text(found, part, base)
    if output is not None and looked is not None:
        output.mkdir(parents=True, exist_ok=True)
        drawn = output / "depth.png"
        drawn.write_bytes(_picture(read, part, looked))
        said = f"{said}\n{drawn}"
    return Answer(status, report.content(found), lambda: Text(said), CODES[status])


def _file(scene: str) -> Path:
    """The file that is meant. Raises `InvalidInput`."""
    from kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
    from kb.files import is_file
    from kb.targets import BUNDLED

    bundled = {path.parent.name: path for path in sorted(BUNDLED.glob(f"*/{SCENE_FILE}"))}
    if is_file(Path(scene)):
        return Path(scene)
    if scene in bundled:
        return bundled[scene]
    hint = nearest(scene, list(bundled)) or f"bundled: {', '.join(bundled)}"
    raise InvalidInput([Diagnostic(Source(scene), "K401", "no file and no bundled scene of this name", hint)])


def _picture(scene: "Scene", part: str, looked: "Looked") -> bytes:
    from engine.formats.report.depth_picture import picture
    from engine.stages.geometry.shapes.solids import solid_of

    best = looked.sighting.best
    image: DepthImage = looked.image
    return picture(image, solid_of(scene.cell.bodies[part]), best.T_camera_part if best else None)
