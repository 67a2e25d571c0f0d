"""`cellwright measurement dimensions`: shapes in patches of a range image, and what is between them."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.exits import FINDINGS
from cellwright.engine.faces.cli.options import Format, number

if TYPE_CHECKING:
    from cellwright.engine.model.geometry import Floats
    from cellwright.engine.model.ranging import RangeImage
    from cellwright.engine.pipelines.dimensions import Asked
    from cellwright.kb.model.ranging import Ranging

ImageFile = Annotated[
    Path,
    Argument(
        metavar="IMAGE",
        help="a range image: .npz that `measurement image` has written, or a depth image: .npy, 16-bit .png in mm, .pcd, .ply",
    ),
]
Patches = Annotated[
    list[str] | None,
    Option(
        "--patch",
        metavar="NAME=SHAPE:LEFT,TOP,RIGHT,BOTTOM",
        help="a shape, and the pixels that show it; a circle is the rim of a hole in a plane there",
    ),
]
Between = Annotated[
    list[str] | None,
    Option("--between", metavar="NAME,NAME", help="tell the distance and angle between two of them"),
]
Tool = Annotated[
    tuple[str, str] | None,
    Option(
        "--tool",
        metavar="TARGET TOOL",
        help="what took a depth image: a cell.yaml, or a TARGET whose cell has the tool, and the TOOL, such as bulkhead slra",
    ),
]
About = Annotated[
    str,
    Option(
        "--about",
        metavar="MM|IMAGE",
        help="resolve wrapped ranges: how far away the surface is, or an image of what is expected",
    ),
]
Expected = Annotated[
    float,
    Option(
        "--expected",
        min=0.0,
        max=1e4,
        callback=number,
        help="how well --about is known: standard deviation in millimetres",
    ),
]
Picture = Annotated[Path | None, Option("--picture", help="write a picture there, as .png")]


def dimensions(
    image: ImageFile,
    patch: Patches = None,
    between: Between = None,
    tool: Tool = None,
    about: About = "",
    expected: Expected = 1.0,
    picture: Picture = None,
    format: Format = Form.TEXT,
) -> None:
    """Fit shapes to patches of a range image, and tell how sure their sizes and distances are."""
    asked = [_asked(each) for each in patch or []]
    names = {each.name for each in asked}
    if len(names) < len(asked):
        raise misfit("two patches have one name", param_hint="--patch")
    pairs = [_pair(each, names) for each in between or []]
    give(
        lambda: _dimensions(_image(image, tool, about, expected * 1e-3), image, asked, pairs, picture), format
    )


def _asked(said: str) -> "Asked":
    from cellwright.engine.model.fits import Shape
    from cellwright.engine.model.ranging import Window
    from cellwright.engine.pipelines.dimensions import Asked

    name, _, rest = said.partition("=")
    shape, _, corners = rest.partition(":")
    pixels = corners.split(",")
    if not name.isidentifier() or shape not in {each.value for each in Shape} or len(pixels) != 4:
        shapes = ", ".join(each.value for each in Shape)
        raise misfit(
            f"'{said[:60]}': write NAME=SHAPE:LEFT,TOP,RIGHT,BOTTOM; a shape is one of {shapes}",
            param_hint="--patch",
        )
    if not all(each.strip().isdecimal() and len(each) < 6 for each in pixels):
        raise misfit(f"'{corners[:40]}' are no four whole pixels", param_hint="--patch")
    left, top, right, bottom = (int(each) for each in pixels)
    if not (left < right and top < bottom):
        raise misfit(f"'{corners}' holds no pixel", param_hint="--patch")
    return Asked(name, Shape(shape), Window(left, top, right, bottom))


def _pair(said: str, names: set[str]) -> tuple[str, str]:
    one, _, other = said.partition(",")
    for each in (one, other):
        if each not in names:
            raise misfit(f"no --patch is named '{each[:40]}'", param_hint="--between")
    return one, other


def _image(
    path: Path, tool: tuple[str, str] | None, about: str, sigma_m: float
) -> "Callable[[], RangeImage]":
    """Reads an image, and resolves its ranges if they are wrapped."""

    def read() -> "RangeImage":
        from cellwright.engine.formats.interop.range_files import read_ranges
        from cellwright.engine.model.ranging import Vague
        from cellwright.engine.stages.vision.ranging import resolved

        image = read_ranges(path, None if tool is None else _tool(*tool))
        if not image.wrapped:
            _refuse_if(bool(about), path, "its ranges are whole already", "leave --about out")
            return image
        told, hint = "its ranges are known modulo half a wavelength", "say what is expected with --about"
        _refuse_if(not about, path, told, hint)
        found = resolved(image, _expected_m(about, image), sigma_m)
        if isinstance(found, Vague):
            _refuse_if(True, path, found.reason, "give an --about that is known better, and --expected")
        assert not isinstance(found, Vague)
        return found

    return read


def _tool(target: str, name: str) -> "Ranging":
    from cellwright.engine.pipelines.dimensions.surfaces import ranging_of
    from cellwright.kb.loader.cell import cell_of, load_cell
    from cellwright.kb.targets import CELL_FILE

    own = target.endswith(CELL_FILE) and Path(target).is_file()
    return ranging_of(load_cell(Path(target)) if own else cell_of(target), name)


def _expected_m(about: str, image: "RangeImage") -> "Floats":
    """The ranges (h, w) that are expected: those of a plane square to the axis so far away, or those of an image."""
    import numpy as np

    from cellwright.engine.formats.interop.range_files import read_ranges
    from cellwright.engine.stages.vision.ranging import of_depths

    size = (image.tool.height, image.tool.width)
    try:
        away_m = float(about) * 1e-3
    except ValueError:
        found = read_ranges(Path(about), image.tool)
        _refuse_if(
            found.wrapped, Path(about), "its ranges are wrapped, too", "give an image with whole ranges"
        )
        same = found.range_m.shape == size
        _refuse_if(not same, Path(about), "it has another size than IMAGE", "give one of the same tool")
        return found.range_m
    told, hint = f"--about {about[:40]} is no distance", "give a distance in millimetres, up to 10 km"
    _refuse_if(not 0.0 < away_m < 1e4, Path("--about"), told, hint)
    return of_depths(np.full(size, away_m), image.tool).range_m


def _refuse_if(so: bool, path: Path, told: str, hint: str) -> None:
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    if so:
        raise InvalidInput([Diagnostic(Source(str(path)), "K702", told, hint)])


def _dimensions(
    read: "Callable[[], RangeImage]",
    path: Path,
    asked: "list[Asked]",
    pairs: list[tuple[str, str]],
    picture: Path | None,
) -> Answer:
    from cellwright.engine.faces.cli.written import write
    from cellwright.engine.formats.report import ranges as report
    from cellwright.engine.model.fits import Fit
    from cellwright.engine.pipelines.dimensions import dimensions as measured
    from cellwright.engine.pipelines.dimensions import related

    image = read()
    for each in asked:
        beyond = each.window.right > image.tool.width or each.window.bottom > image.tool.height
        size = f"{image.tool.width} x {image.tool.height}"
        told = f"the patch '{each.name}' reaches beyond the picture of {size} pixels"
        _refuse_if(beyond, path, told, "give pixels inside of it")
    found = measured(image, asked)
    between = {f"{one}, {other}": related(found, one, other) for one, other in pairs}
    write(picture, lambda: report.picture(image, found.edges, {each.name: each.window for each in asked}))
    fine = all(isinstance(each, Fit) for each in found.fits.values())
    return Answer(
        "ok" if fine else "refused",
        report.dimensions_content(image, found.fits, between, found.edges),
        lambda: report.dimensions_text(image, found.fits, between, found.edges),
        0 if fine else FINDINGS,
    )
