"""The verb `place`: a part is found, grasped and put where relations say, with pictures of it."""

import sys
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from cellwright.engine.faces.cli.options.scene_options import (
    Calibration,
    Image,
    SceneName,
    needs_mujoco,
    read_scene,
)
from cellwright.engine.faces.cli.options.shared_options import Format, Seed
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import GAVE_UP, INFEASIBLE, STOPPED
from cellwright.engine.faces.cli.verbs.motion_verbs import MotionStrategy, Strategy
from cellwright.engine.faces.cli.wrong_options import make_misfit
from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import manipulation

if TYPE_CHECKING:
    from cellwright.engine.formats.report.cells.placing_pictures import Hands
    from cellwright.engine.pipelines.manipulation.place_answers import PlaceAnswer, Placed
    from cellwright.engine.pipelines.manipulation.scene_camera import SceneView
    from cellwright.engine.pipelines.manipulation.workspace import MotionManner, PlaceTask
    from cellwright.kb.model.part_scene import Scene

PLACE_EXIT_CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}


On = Annotated[str, Argument(metavar="ON", help="the word `on`")]

Again = Annotated[
    Path | None,
    Option(
        "--again",
        help="a depth image taken just before the part is grasped: what has moved since is "
        "planned anew",
    ),
]


class GraspApproach(StrEnum):
    """The ways in which a hand comes to a grasp, named here so that help needs no array library."""

    STRAIGHT = "straight"
    COMPLETE = "complete"
    POTENTIAL = "potential"


def place_part_on_base(
    part: Annotated[str, Argument(metavar="PART", help="the part that is placed")],
    on: On,
    base: Annotated[str, Argument(metavar="PART", help="the body that it is placed on")],
    scene: SceneName,
    image: Image = None,
    calibration: Calibration = None,
    again: Again = None,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
    approach: Annotated[
        GraspApproach,
        Option(
            metavar="WAY",
            help="complete: straight, else the best way in the grasp plane; straight; potential: "
            "Handey's field of forces",
        ),
    ] = GraspApproach.COMPLETE,
    strategy: Strategy = MotionStrategy.CONNECT,
    execute: Annotated[bool, Option("--execute", help="carry it out in MuJoCo")] = False,
    approve: Annotated[
        bool,
        Option("--approve", help="with --execute: show the plan and ask before anything moves"),
    ] = False,
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            help="a folder for a picture of each stage, and a preview of the motion",
        ),
    ] = None,
) -> None:
    """Place a part ON another one, as the relations of a scene say: find it, grasp it, and plan
    all motions.
    """
    if on.lower() != "on":
        raise make_misfit(f"write: place {part} on {base}", param_hint="ON")
    names, images, moves = (part, base), (image, again), (execute, approve)
    manner = approach.value, strategy.value
    _refuse_misfits(images, moves)
    give_answer(
        lambda: _place_part(
            names, read_scene(scene, calibration), images, seed, manner, moves, output
        ),
        format,
    )


def _refuse_misfits(images: tuple[Path | None, Path | None], moves: tuple[bool, bool]) -> None:
    """Refuse options that do not go together: images of files, and what is carried out and
    asked for.
    """
    execute, approve = moves
    if approve and not execute:
        raise make_misfit("--approve asks before something moves: add --execute")
    if execute and any(images):
        raise make_misfit(
            "--execute makes its images from the scene: leave out --image and --again"
        )


def _place_part(
    names: tuple[str, str],
    read: "Scene",
    images: tuple[Path | None, Path | None],
    seed: int,
    said_manner: tuple[str, str],
    moves: tuple[bool, bool],
    output: Path | None,
) -> VerbAnswer:
    from cellwright.engine.model.motion_values import Strategy

    part, base = names
    if moves[0]:
        needs_mujoco("--execute")
    manner = manipulation.MotionManner(
        manipulation.HandApproachKind(said_manner[0]), Strategy(said_manner[1])
    )
    depth_image, later = (
        interop.read_depth(image, manipulation.camera_of(read)) if image else None
        for image in images
    )
    placing_answer, looked = manipulation.place_part(read, part, base, seed, depth_image, manner)
    before = ""
    if later is not None and isinstance(placing_answer, manipulation.Placed):
        since = manipulation.look_again(read, part, base, placing_answer, later)
        placing_answer, looked, before = (
            since.answer,
            since.looked,
            report.second_look_text(since, part),
        )
    status, answer_text = (
        report.placing_status(placing_answer),
        before + report.placing_text(placing_answer, part, base),
    )
    if output is not None and looked is not None:
        files = draw_placing(read, part, placing_answer, looked, manner, output)
        answer_text = "\n".join([answer_text, *map(str, files)])
    if moves[0] and isinstance(placing_answer, manipulation.Placed):
        return _execute_placing(read, part, placing_answer, moves[1], answer_text)
    return VerbAnswer(
        status,
        report.placing_content(placing_answer),
        lambda: rich_parts.Text(answer_text),
        PLACE_EXIT_CODES[status],
    )


def _execute_placing(
    read: "Scene", part: str, found: "Placed", approve: bool, said: str
) -> VerbAnswer:
    """What comes of a plan in physics, if whoever is asked approves it."""
    planned = report.placing_content(found)
    if approve and not _ask_approval(said):
        return VerbAnswer("stopped", planned, lambda: rich_parts.Text("nothing was moved"), STOPPED)
    done = manipulation.execute_carries(read, part, found)
    text = report.carried_text(done, part)
    content = {**planned, "execution": report.carried_content(done)}
    execution_text = text if approve else f"{said}\n{text}"
    return VerbAnswer(
        done.status,
        content,
        lambda: rich_parts.Text(execution_text),
        0 if done.status == "reached" else STOPPED,
    )


def _ask_approval(said: str) -> bool:
    """Show what is planned, and ask the person at the terminal."""
    sys.stderr.write(f"{said}\ncarry this out? [y/n] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


HAND_BLOCK_NAMES = {
    2: ("finger", "finger", "cross-piece", "sensor"),
    3: ("finger", "finger", "finger", "palm", "sensor"),
}


def draw_placing(
    scene: "Scene",
    part: str,
    found: "PlaceAnswer",
    looked: "SceneView",
    manner: "MotionManner",
    folder: Path,
) -> Iterator[Path]:
    """Write the pictures of an answer into a folder, and tell their files."""
    folder.mkdir(parents=True, exist_ok=True)
    yield _write_picture(folder / "depth.png", _depth_picture(scene, part, looked, edges=True))
    if not isinstance(found, manipulation.Placed):
        return
    yield _write_picture(
        folder / "grasps.png", _depth_picture(scene, part, looked, _hand_poses(found, looked))
    )
    task = _placing_task(scene, part, found, looked, manner)
    yield _write_picture(folder / "plane.svg", _grasp_plane(scene, task, found).encode())
    yield _write_picture(folder / "placements.svg", _placement_graph(task, found).encode())
    yield _write_picture(folder / "preview.gltf", _placing_film(scene, part, found).encode())


def _write_picture(file: Path, content: bytes) -> Path:
    file.write_bytes(content)
    return file


def _depth_picture(
    scene: "Scene", part: str, looked: "SceneView", hands: "Hands" = (), edges: bool = False
) -> bytes:
    from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of

    best = looked.sightings[part].best
    shown = manipulation.seen_edges(looked) if edges else ()
    parts = [(solid_of(scene.cell.bodies[part]), best.T_camera_part)] if best else []
    return report.depth_png(looked.image, parts, hands, shown)


def _hand_poses(found: "Placed", looked: "SceneView") -> "Hands":
    """Where the hand can take the part, and where it does."""
    from cellwright.engine.kernels.rigid import inverse

    T = inverse(looked.T_world_camera) @ found.T_world_part
    first = found.carries[0]
    chosen = [(T @ first.T_part_hand, first.grasp.width_m, True)]
    return [*chosen, *((T @ pose, width, False) for pose, width in found.possible)]


def _placing_task(
    scene: "Scene", part: str, found: "Placed", looked: "SceneView", manner: "MotionManner"
) -> "PlaceTask":
    from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld

    site = manipulation.AssemblySite.of(
        scene, GeometricWorld.of(scene.cell), looked, {part: found.T_world_part}, manner
    )
    return site.task(part, (found.T_world_part, found.T_world_goal))


def _grasp_plane(scene: "Scene", task: "PlaceTask", found: "Placed") -> str:
    plane = manipulation.plane_of(task, found.carries[0])
    return report.grasp_plane_svg(
        plane,
        manipulation.way_in(task.world, scene, found.carries[0]),
        HAND_BLOCK_NAMES[scene.hand.fingers],
    )


def _placement_graph(task: "PlaceTask", found: "Placed") -> str:
    return report.placements_svg(manipulation.regrasp_graph(task, found), task.part)


def _placing_film(scene: "Scene", part: str, found: "Placed") -> str:
    return report.film_gltf(list(manipulation.film_shots(scene, part, found)))
