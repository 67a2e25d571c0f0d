"""`cellwright measurement image` and `recognise`: the range image of a measurement, and which parts an image shows."""

from pathlib import Path
from typing import Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.exits import FINDINGS
from cellwright.engine.faces.cli.options import Format, Seed, Target, number
from cellwright.engine.faces.cli.scene_files import Image, SceneName

Name = Annotated[str, Argument(help="the name of the measurement")]
Expected = Annotated[
    float,
    Option(
        "--expected",
        min=0.0,
        max=1e4,
        callback=number,
        help="how well the place of the part is known: standard deviation in millimetres",
    ),
]
Displaced = Annotated[
    tuple[float, float, float] | None,
    Option(
        "--displaced", help="where everything really is, beside where it is expected: x y z in millimetres"
    ),
]
Given = Annotated[
    Path | None,
    Option(
        "--from",
        help="the image that the tool took: .npz, or a depth image: .npy, 16-bit .png in mm, .pcd, .ply; else it is made",
    ),
]
Output = Annotated[Path | None, Option("--output", "-o", help="write the image there, as .npz")]
Wrapped = Annotated[
    bool,
    Option("--wrapped", help="write it as the tool answers: ranges modulo half the wavelength"),
]
Picture = Annotated[Path | None, Option("--picture", help="write a picture there, as .png")]
Parts = Annotated[
    list[str] | None,
    Option("--part", help="a part to look for; all parts of the scene if none is given"),
]


def image(
    target: Target,
    name: Name,
    expected: Expected = 1.0,
    displaced: Displaced = None,
    given: Given = None,
    seed: Seed = 0,
    output: Output = None,
    wrapped: Wrapped = False,
    picture: Picture = None,
    format: Format = Form.TEXT,
) -> None:
    """Make the range image that the measurement NAME of TARGET is taken from, or read it, and measure its patch in it."""
    if given is not None and displaced is not None:
        raise misfit("an image that is read shows where things are", param_hint="--displaced")
    if wrapped and output is None:
        raise misfit("say with -o where to write it", param_hint="--wrapped")
    off = None if displaced is None else (displaced[0] * 1e-3, displaced[1] * 1e-3, displaced[2] * 1e-3)
    give(lambda: _image(target, name, expected * 1e-3, off, given, seed, output, wrapped, picture), format)


def recognise(
    scene: SceneName,
    part: Parts = None,
    image: Image = None,
    seed: Seed = 0,
    picture: Picture = None,
    format: Format = Form.TEXT,
) -> None:
    """Tell which parts of a scene are seen, by the angles, distances and edges of their faces, and where they are; and what is none of them."""
    give(lambda: _recognise(scene, part or [], image, seed, picture), format)


def _image(
    target: str,
    name: str,
    sigma_m: float,
    off: tuple[float, float, float] | None,
    given: Path | None,
    seed: int,
    output: Path | None,
    wrapped: bool,
    picture: Path | None,
) -> Answer:
    import numpy as np
    from rich.text import Text

    from cellwright.engine.faces.cli.written import write
    from cellwright.engine.formats.interop.range_files import read_ranges, write_ranges
    from cellwright.engine.formats.report import ranges as report
    from cellwright.engine.model.ranging import Vague
    from cellwright.engine.pipelines import planning
    from cellwright.engine.pipelines.dimensions.surfaces import Seeing, measured_surface
    from cellwright.engine.plugins import geometry_backend
    from cellwright.kb.loader.cell import cell_of

    problem = planning.problem_of(target)
    true = None if off is None else np.array(off)
    seeing = Seeing(sigma_m, seed, true, None if given is None else lambda tool: read_ranges(given, tool))
    found = measured_surface(problem, cell_of(target), geometry_backend(), name, seeing)
    if isinstance(found, Vague):
        told = found.reason
        return Answer("refused", {"reason": told}, lambda: Text(told), FINDINGS)
    if output is not None:
        write_ranges(output, found.answered if wrapped else found.image)
    write(picture, lambda: report.picture(found.image, found.edges, {name: found.window}))
    return Answer(
        "found" if found.sure else "refused",
        report.surface_content(found),
        lambda: report.surface_text(found),
        0 if found.sure else FINDINGS,
    )


def _recognise(scene: str, parts: list[str], path: Path | None, seed: int, picture: Path | None) -> Answer:
    from cellwright.engine.faces.cli.written import write
    from cellwright.engine.formats.interop.depth_files import read_depth
    from cellwright.engine.formats.report import depth_picture
    from cellwright.engine.formats.report import recognition as report
    from cellwright.engine.pipelines.placing import looking
    from cellwright.engine.pipelines.placing.recognising import recognised_in
    from cellwright.kb.loader.scene import load_scene
    from cellwright.kb.targets import find_scene

    read = load_scene(find_scene(scene))
    given = read_depth(path, looking.camera_of(read)) if path else None
    seen = recognised_in(read, parts, seed, given)
    found = seen.answer
    drawn = [(seen.models[each.best.part].solid, each.best.T_eye_part) for each in found.named]
    notes = [(each.window, "no part") for each in found.unexplained]
    write(picture, lambda: depth_picture.picture(seen.image, drawn, notes=notes))
    return Answer(
        "found" if found.named else "refused",
        report.content(found),
        lambda: report.text(found),
        0 if found.named else FINDINGS,
    )
