"""`cellwright measurement image`, `dimensions` and `recognise`: range images, what is measured in them, and which part they show."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import FINDINGS
from engine.faces.cli.options import Format, Seed, Target, number
from engine.faces.cli.scene_files import Image, SceneName

if TYPE_CHECKING:
    from engine.pipelines.dimensions import Asked

Name = Annotated[str, typer.Argument(help="the name of the measurement")]
Expected = Annotated[
    float,
    typer.Option(
        "--expected",
        min=0.0,
        max=1e4,
        callback=number,
        help="how well the place of the part is known: standard deviation in millimetres",
    ),
]
Displaced = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        "--displaced", help="where everything really is, beside where it is expected: x y z in millimetres"
    ),
]
Output = Annotated[Path | None, typer.Option("--output", "-o", help="write the image there, as .npz")]
Picture = Annotated[Path | None, typer.Option("--picture", help="write a picture there, as .png")]
ImageFile = Annotated[
    Path, typer.Argument(metavar="IMAGE", help="a range image that `measurement image` has written, .npz")
]
Patches = Annotated[
    list[str] | None,
    typer.Option(
        "--patch",
        metavar="NAME=SHAPE:LEFT,TOP,RIGHT,BOTTOM",
        help="a shape, and the pixels that show it; a circle is the rim of a hole in a plane there",
    ),
]
Between = Annotated[
    list[str] | None,
    typer.Option("--between", metavar="NAME,NAME", help="tell the distance and angle between two of them"),
]
Parts = Annotated[
    list[str] | None,
    typer.Option("--part", help="a part that it may be; all parts of the scene if none is given"),
]


def image(
    target: Target,
    name: Name,
    expected: Expected = 1.0,
    displaced: Displaced = None,
    seed: Seed = 0,
    output: Output = None,
    picture: Picture = None,
    format: Format = Form.TEXT,
) -> None:
    """Make the range image that the measurement NAME of TARGET is taken from, and measure its patch in it."""
    off = None if displaced is None else (displaced[0] * 1e-3, displaced[1] * 1e-3, displaced[2] * 1e-3)
    give(lambda: _image(target, name, expected * 1e-3, off, seed, output, picture), format)


def dimensions(
    image: ImageFile,
    patch: Patches = None,
    between: Between = None,
    picture: Picture = None,
    format: Format = Form.TEXT,
) -> None:
    """Fit shapes to patches of a range image, and tell how sure their sizes and distances are."""
    asked = [_asked(each) for each in patch or []]
    names = {each.name for each in asked}
    if len(names) < len(asked):
        raise typer.BadParameter("two patches have one name", param_hint="--patch")
    pairs = [_pair(each, names) for each in between or []]
    give(lambda: _dimensions(image, asked, pairs, picture), format)


def recognise(
    scene: SceneName,
    part: Parts = None,
    image: Image = None,
    seed: Seed = 0,
    picture: Picture = None,
    format: Format = Form.TEXT,
) -> None:
    """Tell which part of a scene is seen, by the angles, distances and areas of its faces, and where it is."""
    give(lambda: _recognise(scene, part or [], image, seed, picture), format)


def _asked(said: str) -> "Asked":
    from engine.model.fits import Shape
    from engine.model.ranging import Window
    from engine.pipelines.dimensions import Asked

    name, _, rest = said.partition("=")
    shape, _, corners = rest.partition(":")
    pixels = corners.split(",")
    if not name.isidentifier() or shape not in {each.value for each in Shape} or len(pixels) != 4:
        shapes = ", ".join(each.value for each in Shape)
        raise typer.BadParameter(
            f"'{said[:60]}': write NAME=SHAPE:LEFT,TOP,RIGHT,BOTTOM; a shape is one of {shapes}",
            param_hint="--patch",
        )
    if not all(each.strip().isdecimal() and len(each) < 6 for each in pixels):
        raise typer.BadParameter(f"'{corners[:40]}' are no four whole pixels", param_hint="--patch")
    left, top, right, bottom = (int(each) for each in pixels)
    if not (left < right and top < bottom):
        raise typer.BadParameter(f"'{corners}' holds no pixel", param_hint="--patch")
    return Asked(name, Shape(shape), Window(left, top, right, bottom))


def _pair(said: str, names: set[str]) -> tuple[str, str]:
    one, _, other = said.partition(",")
    for each in (one, other):
        if each not in names:
            raise typer.BadParameter(f"no --patch is named '{each[:40]}'", param_hint="--between")
    return one, other


def _image(
    target: str,
    name: str,
    sigma_m: float,
    off: tuple[float, float, float] | None,
    seed: int,
    output: Path | None,
    picture: Path | None,
) -> Answer:
    import numpy as np
    from rich.text import Text

    from engine.formats.interop.range_files import write_ranges
    from engine.formats.report import ranges as report
    from engine.model.ranging import Vague
    from engine.pipelines import planning
    from engine.pipelines.dimensions.surfaces import measured_surface
    from engine.plugins import geometry_backend
    from kb.loader.cell import cell_of

    problem = planning.problem_of(target)
    true = None if off is None else np.array(off)
    found = measured_surface(problem, cell_of(target), geometry_backend(), name, sigma_m, seed, true)
    if isinstance(found, Vague):
        told = found.reason
        return Answer("refused", {"reason": told}, lambda: Text(told), FINDINGS)
    if output is not None:
        write_ranges(output, found.image)
    _write(picture, lambda: report.picture(found.image, found.edges, {name: found.window}))
    return Answer(
        "found" if found.sure else "refused",
        report.surface_content(found),
        lambda: report.surface_text(found),
        0 if found.sure else FINDINGS,
    )


def _dimensions(
    path: Path, asked: "list[Asked]", pairs: list[tuple[str, str]], picture: Path | None
) -> Answer:
    from engine.formats.interop.range_files import read_ranges
    from engine.formats.report import ranges as report
    from engine.model.fits import Fit
    from engine.pipelines.dimensions import dimensions as measured
    from engine.pipelines.dimensions import related
    from kb.diagnostics import Diagnostic, InvalidInput, Source

    image = read_ranges(path)
    for each in asked:
        if each.window.right > image.tool.width or each.window.bottom > image.tool.height:
            size = f"{image.tool.width} x {image.tool.height}"
            told = f"the patch '{each.name}' reaches beyond the picture of {size} pixels"
            raise InvalidInput([Diagnostic(Source(str(path)), "K702", told, "give pixels inside of it")])
    if image.wrapped:
        told = "its ranges are known modulo half a wavelength"
        raise InvalidInput([Diagnostic(Source(str(path)), "K702", told, "resolve them before")])
    found = measured(image, asked)
    between = {f"{one}, {other}": related(found, one, other) for one, other in pairs}
    _write(picture, lambda: report.picture(image, found.edges, {each.name: each.window for each in asked}))
    fine = all(isinstance(each, Fit) for each in found.fits.values())
    return Answer(
        "ok" if fine else "refused",
        report.dimensions_content(found.fits, between, found.edges),
        lambda: report.dimensions_text(found.fits, between, found.edges),
        0 if fine else FINDINGS,
    )


def _recognise(scene: str, parts: list[str], path: Path | None, seed: int, picture: Path | None) -> Answer:
    from engine.formats.interop.depth_files import read_depth
    from engine.formats.report import depth_picture
    from engine.formats.report import ranges as report
    from engine.model.ranging import Recognised
    from engine.pipelines.placing import looking
    from engine.pipelines.placing.recognising import recognised_in
    from kb.loader.scene import load_scene
    from kb.targets import find_scene

    read = load_scene(find_scene(scene))
    given = read_depth(path, looking.camera_of(read)) if path else None
    seen = recognised_in(read, parts, seed, given)
    found = seen.answer
    best = found.best if isinstance(found, Recognised) else None
    solid = seen.models[best.part].solid if best else None
    _write(picture, lambda: depth_picture.picture(seen.image, solid, best.T_eye_part if best else None))
    return Answer(
        "found" if best else "refused",
        report.recognised_content(found),
        lambda: report.recognised_text(found),
        0 if best else FINDINGS,
    )


def _write(path: Path | None, made: Callable[[], bytes]) -> None:
    from kb.diagnostics import Diagnostic, InvalidInput, Source

    if path is None:
        return
    try:
        path.write_bytes(made())
    except OSError as error:
        told = f"it cannot be written: {error.strerror}"
        raise InvalidInput([Diagnostic(Source(str(path)), "K702", told, "is its folder there?")]) from None
