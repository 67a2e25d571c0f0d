"""`cellwright place`: a part is found, taken, and put where relations say."""

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.exits import GAVE_UP, INFEASIBLE, STOPPED
from cellwright.engine.faces.cli.motion import Strategy, Way
from cellwright.engine.faces.cli.options import Format, Seed
from cellwright.engine.faces.cli.scene_files import Calibration, Image, SceneName, scene_of

if TYPE_CHECKING:
    from cellwright.engine.pipelines.placing.answers import Placed
    from cellwright.kb.model.scene import Scene

CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}


On = Annotated[str, Argument(metavar="ON", help="the word `on`")]

Again = Annotated[
    Path | None,
    Option(
        "--again",
        help="a depth image taken just before the part is grasped: what has moved since is planned anew",
    ),
]


class Approach(StrEnum):
    """The ways in which a hand comes to a grasp, named here so that help needs no array library."""

    STRAIGHT = "straight"
    COMPLETE = "complete"
    POTENTIAL = "potential"


def place(
    part: Annotated[str, Argument(metavar="PART", help="the part that is placed")],
    on: On,
    base: Annotated[str, Argument(metavar="PART", help="the body that it is placed on")],
    scene: SceneName,
    image: Image = None,
    calibration: Calibration = None,
    again: Again = None,
    seed: Seed = 0,
    format: Format = Form.TEXT,
    approach: Annotated[
        Approach,
        Option(
            metavar="WAY",
            help="complete: straight, else the best way in the grasp plane; straight; potential: Handey's field of forces",
        ),
    ] = Approach.COMPLETE,
    strategy: Strategy = Way.CONNECT,
    execute: Annotated[bool, Option("--execute", help="carry it out in MuJoCo")] = False,
    approve: Annotated[
        bool, Option("--approve", help="with --execute: show the plan and ask before anything moves")
    ] = False,
    output: Annotated[
        Path | None,
        Option("--output", "-o", help="a folder for a picture of each stage, and a preview of the motion"),
    ] = None,
) -> None:
    """Place a part ON another one, as the relations of a scene say: find it, grasp it, and plan all motions."""
    if on.lower() != "on":
        raise misfit(f"write: place {part} on {base}", param_hint="ON")
    names, images, moves = (part, base), (image, again), (execute, approve)
    manner = approach.value, strategy.value
    _refuse_misfits(images, moves)
    give(lambda: _placed(names, scene_of(scene, calibration), images, seed, manner, moves, output), format)


def _refuse_misfits(images: tuple[Path | None, Path | None], moves: tuple[bool, bool]) -> None:
    """Refuse options that do not go together: images of files, and what is carried out and asked for."""
    execute, approve = moves
    if approve and not execute:
        raise misfit("--approve asks before something moves: add --execute")
    if execute and any(images):
        raise misfit("--execute makes its images from the scene: leave out --image and --again")


def _placed(
    names: tuple[str, str],
    read: "Scene",
    images: tuple[Path | None, Path | None],
    seed: int,
    said_manner: tuple[str, str],
    moves: tuple[bool, bool],
    output: Path | None,
) -> Answer:
    from rich.text import Text

    from cellwright.engine.faces.cli.execution_options import needs_mujoco
    from cellwright.engine.faces.cli.place_pictures import draw
    from cellwright.engine.formats.interop.depth_files import read_depth
    from cellwright.engine.formats.report import placing as report
    from cellwright.engine.model.motion import Strategy
    from cellwright.engine.pipelines.placing import looking, placing
    from cellwright.engine.pipelines.placing.answers import Placed
    from cellwright.engine.pipelines.placing.task import Coming, Manner

    part, base = names
    if moves[0]:
        needs_mujoco("--execute")
    manner = Manner(Coming(said_manner[0]), Strategy(said_manner[1]))
    given, later = (read_depth(each, looking.camera_of(read)) if each else None for each in images)
    found, looked = placing.place(read, part, base, seed, given, manner)
    before = ""
    if later is not None and isinstance(found, Placed):
        since = placing.again(read, part, base, found, later)
        found, looked, before = since.answer, since.looked, report.since(since, part)
    status, said = report.status(found), before + report.text(found, part, base)
    if output is not None and looked is not None:
        files = draw(read, part, found, looked, manner, output)
        said = "\n".join([said, *map(str, files)])
    if moves[0] and isinstance(found, Placed):
        return _executed(read, part, found, moves[1], said)
    return Answer(status, report.content(found), lambda: Text(said), CODES[status])


def _executed(read: "Scene", part: str, found: "Placed", approve: bool, said: str) -> Answer:
    """What comes of a plan in physics, if whoever is asked approves it."""
    from rich.text import Text

    from cellwright.engine.formats.report import placing as report
    from cellwright.engine.formats.report import workshop

    planned = report.content(found)
    if approve and not _approved(said):
        return Answer("stopped", planned, lambda: Text("nothing was moved"), STOPPED)
    from cellwright.engine.pipelines.workshop.running import carried

    done = carried(read, part, found)
    text = workshop.carried_text(done, part)
    content = {**planned, "execution": workshop.carried_content(done)}
    told = text if approve else f"{said}\n{text}"
    return Answer(done.status, content, lambda: Text(told), 0 if done.status == "reached" else STOPPED)


def _approved(said: str) -> bool:
    """Show what is planned, and ask the person at the terminal."""
    sys.stderr.write(f"{said}\ncarry this out? [y/n] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")
