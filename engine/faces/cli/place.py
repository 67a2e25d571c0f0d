"""`cellwright place`: a part is found, taken, and put where relations say."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import GAVE_UP, INFEASIBLE
from engine.faces.cli.options import Format, Seed
from engine.faces.cli.scene_files import Calibration, Image, SceneName, scene_of

if TYPE_CHECKING:
    from engine.formats.report.depth_picture import Hands
    from engine.model.vision import DepthImage
    from engine.pipelines.placing.answers import Placed
    from engine.pipelines.placing.looking import Looked
    from kb.model.scene import Scene

CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}


def place(
    part: Annotated[str, typer.Argument(metavar="PART", help="the part that is placed")],
    on: Annotated[str, typer.Argument(metavar="ON", help="the word `on`")],
    base: Annotated[str, typer.Argument(metavar="PART", help="the body that it is placed on")],
    scene: SceneName,
    image: Image = None,
    calibration: Calibration = None,
    again: Annotated[
        Path | None,
        typer.Option(
            "--again",
            help="a depth image taken just before the part is grasped: what has moved since is planned anew",
        ),
    ] = None,
    seed: Seed = 0,
    format: Format = Form.TEXT,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="a folder for pictures: the part found, and its grasps"),
    ] = None,
) -> None:
    """Place a part ON another one, as the relations of a scene say: find it, grasp it, and plan all motions."""
    if on.lower() != "on":
        raise typer.BadParameter(f"write: place {part} on {base}", param_hint="ON")
    give(lambda: _placed(part, base, scene_of(scene, calibration), (image, again), seed, output), format)


def _placed(
    part: str,
    base: str,
    read: "Scene",
    images: tuple[Path | None, Path | None],
    seed: int,
    output: Path | None,
) -> Answer:
    from rich.text import Text

    from engine.formats.interop.depth_files import read_depth
    from engine.formats.report import placing as report
    from engine.pipelines.placing import looking, placing
    from engine.pipelines.placing.answers import Placed

    given, later = (read_depth(each, looking.camera_of(read)) if each else None for each in images)
    found, looked = placing.place(read, part, base, seed, given)
    before = ""
    if later is not None and isinstance(found, Placed):
        since = placing.again(read, part, base, found, later)
        found, looked, before = since.answer, since.looked, report.since(since, part)
    status, said = report.status(found), before + report.text(found, part, base)
    if output is not None and looked is not None:
        output.mkdir(parents=True, exist_ok=True)
        drawn, taken = output / "depth.png", output / "grasps.png"
        drawn.write_bytes(_picture(read, part, looked))
        said = f"{said}\n{drawn}"
        if isinstance(found, Placed):
            taken.write_bytes(_picture(read, part, looked, _hands(found, looked)))
            said = f"{said}\n{taken}"
    return Answer(status, report.content(found), lambda: Text(said), CODES[status])


def _picture(scene: "Scene", part: str, looked: "Looked", hands: "Hands" = ()) -> bytes:
    from engine.formats.report.depth_picture import picture
    from engine.stages.geometry.shapes.solids import solid_of

    best = looked.sightings[part].best
    image: DepthImage = looked.image
    return picture(image, solid_of(scene.cell.bodies[part]), best.T_camera_part if best else None, hands)


def _hands(found: "Placed", looked: "Looked") -> "Hands":
    """Where the hand can take the part, and where it does."""
    from engine.kernels.rigid import inverse

    T = inverse(looked.T_world_camera) @ found.T_world_part
    first = found.carries[0]
    chosen = [(T @ first.T_part_hand, first.grasp.width_m, True)]
    return [*chosen, *((T @ pose, width, False) for pose, width in found.possible)]
