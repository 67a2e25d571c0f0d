"""The verbs `measurement image`, `recognise` and `dimensions`: what range images show."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from cellwright.engine.faces.cli.options.scene_options import Image, SceneName
from cellwright.engine.faces.cli.options.shared_options import Format, Seed, Target, number_option
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import FINDINGS
from cellwright.engine.faces.cli.wrong_options import make_misfit
from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import manipulation, motion, planning
from cellwright.engine.plugins import geometry_backend
from cellwright.kb import loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.targets import CELL_FILE, find_scene

if TYPE_CHECKING:
    from cellwright.engine.kernels.arrays import Floats
    from cellwright.engine.model.vision import RangeImage
    from cellwright.engine.pipelines.motion.image_dimensions import DimensionRequest
    from cellwright.kb.model.cell_model import Ranging

ImageFile = Annotated[
    Path,
    Argument(
        metavar="IMAGE",
        help="a range image: .npz that `measurement image` has written, or a depth image: .npy, "
        "16-bit .png in mm, .pcd, .ply",
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
    Option(
        "--between", metavar="NAME,NAME", help="tell the distance and angle between two of them"
    ),
]
Tool = Annotated[
    tuple[str, str] | None,
    Option(
        "--tool",
        metavar="TARGET TOOL",
        help="what took a depth image: a cell.yaml, or a TARGET whose cell has the tool, and the "
        "TOOL, such as bulkhead slra",
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
ExpectedNoise = Annotated[
    float,
    Option(
        "--expected",
        min=0.0,
        max=1e4,
        callback=number_option,
        help="how well --about is known: standard deviation in millimetres",
    ),
]
EdgePicture = Annotated[Path | None, Option("--picture", help="write a picture there, as .png")]


def measure_dimensions(
    image: ImageFile,
    patch: Patches = None,
    between: Between = None,
    tool: Tool = None,
    about: About = "",
    expected: ExpectedNoise = 1.0,
    picture: EdgePicture = None,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Fit shapes to patches of a range image, and tell how sure their sizes and distances are."""
    asked = [_read_patch(patch_text) for patch_text in patch or []]
    names = {patch_request.name for patch_request in asked}
    if len(names) < len(asked):
        raise make_misfit("two patches have one name", param_hint="--patch")
    pairs = [_read_pair(pair_text, names) for pair_text in between or []]
    give_answer(
        lambda: _dimensions_answer(
            _image_reader(image, tool, about, expected * 1e-3), image, asked, pairs, picture
        ),
        format,
    )


def _read_patch(said: str) -> "DimensionRequest":
    from cellwright.engine.model.shape_fits import FitShape
    from cellwright.engine.model.vision import PixelWindow

    name, _, rest = said.partition("=")
    shape, _, corners = rest.partition(":")
    pixels = corners.split(",")
    if (
        not name.isidentifier()
        or shape not in {shape_kind.value for shape_kind in FitShape}
        or len(pixels) != 4
    ):
        shapes = ", ".join(shape_kind.value for shape_kind in FitShape)
        raise make_misfit(
            f"'{said[:60]}': write NAME=SHAPE:LEFT,TOP,RIGHT,BOTTOM; a shape is one of {shapes}",
            param_hint="--patch",
        )
    if not all(pixel.strip().isdecimal() and len(pixel) < 6 for pixel in pixels):
        raise make_misfit(f"'{corners[:40]}' are no four whole pixels", param_hint="--patch")
    left, top, right, bottom = (int(pixel) for pixel in pixels)
    if not (left < right and top < bottom):
        raise make_misfit(f"'{corners}' holds no pixel", param_hint="--patch")
    return motion.DimensionRequest(name, FitShape(shape), PixelWindow(left, top, right, bottom))


def _read_pair(said: str, names: set[str]) -> tuple[str, str]:
    first_name, _, second_name = said.partition(",")
    for pair_name in (first_name, second_name):
        if pair_name not in names:
            raise make_misfit(f"no --patch is named '{pair_name[:40]}'", param_hint="--between")
    return first_name, second_name


def _image_reader(
    path: Path, tool: tuple[str, str] | None, about: str, sigma_m: float
) -> "Callable[[], RangeImage]":
    """Reads an image, and resolves its ranges if they are wrapped."""

    def read() -> "RangeImage":
        from cellwright.engine.model.vision import Vague
        from cellwright.engine.stages.vision.sensor_images import resolve_ranges

        image = interop.read_ranges(path, None if tool is None else _ranging_tool(*tool))
        if not image.wrapped:
            _refuse_if(bool(about), path, "its ranges are whole already", "leave --about out")
            return image
        message, hint = (
            "its ranges are known modulo half a wavelength",
            "say what is expected with --about",
        )
        _refuse_if(not about, path, message, hint)
        resolved_image = resolve_ranges(image, _expected_m(about, image), sigma_m)
        if isinstance(resolved_image, Vague):
            _refuse_if(
                True,
                path,
                resolved_image.reason,
                "give an --about that is known better, and --expected",
            )
        assert not isinstance(resolved_image, Vague)
        return resolved_image

    return read


def _ranging_tool(target: str, name: str) -> "Ranging":
    own = target.endswith(CELL_FILE) and Path(target).is_file()
    return motion.ranging_of(
        loader.load_cell(Path(target)) if own else loader.cell_of(target), name
    )


def _expected_m(about: str, image: "RangeImage") -> "Floats":
    """The ranges (h, w) that are expected: those of a plane square to the axis so far away, or
    those of an image.
    """
    import numpy as np

    from cellwright.engine.stages.vision.sensor_images import of_depths

    size = (image.tool.height, image.tool.width)
    try:
        away_m = float(about) * 1e-3
    except ValueError:
        expected_ranges = interop.read_ranges(Path(about), image.tool)
        _refuse_if(
            expected_ranges.wrapped,
            Path(about),
            "its ranges are wrapped, too",
            "give an image with whole ranges",
        )
        same = expected_ranges.range_m.shape == size
        _refuse_if(
            not same, Path(about), "it has another size than IMAGE", "give one of the same tool"
        )
        return expected_ranges.range_m
    message, hint = (
        f"--about {about[:40]} is no distance",
        "give a distance in millimetres, up to 10 km",
    )
    _refuse_if(not 0.0 < away_m < 1e4, Path("--about"), message, hint)
    return of_depths(np.full(size, away_m), image.tool).range_m


def _refuse_if(so: bool, path: Path, told: str, hint: str) -> None:
    if so:
        raise InvalidInput([Diagnostic(Source(str(path)), "K702", told, hint)])


def _dimensions_answer(
    read: "Callable[[], RangeImage]",
    path: Path,
    asked: "list[DimensionRequest]",
    pairs: list[tuple[str, str]],
    picture: Path | None,
) -> VerbAnswer:
    from cellwright.engine.faces.cli.output.output_files import write_picture
    from cellwright.engine.model.shape_fits import Fit

    image = read()
    for patch_request in asked:
        beyond = (
            patch_request.window.right > image.tool.width
            or patch_request.window.bottom > image.tool.height
        )
        size = f"{image.tool.width} x {image.tool.height}"
        message = f"the patch '{patch_request.name}' reaches beyond the picture of {size} pixels"
        _refuse_if(beyond, path, message, "give pixels inside of it")
    measured_patches = motion.dimensions_in_image(image, asked)
    between = {
        f"{first_name}, {second_name}": motion.relate_shapes(
            measured_patches, first_name, second_name
        )
        for first_name, second_name in pairs
    }
    write_picture(
        picture,
        lambda: report.range_image_png(
            image,
            measured_patches.edges,
            {patch_request.name: patch_request.window for patch_request in asked},
        ),
    )
    fine = all(isinstance(fit, Fit) for fit in measured_patches.fits.values())
    return VerbAnswer(
        "ok" if fine else "refused",
        report.dimensions_content(image, measured_patches.fits, between, measured_patches.edges),
        lambda: report.dimensions_text(
            image, measured_patches.fits, between, measured_patches.edges
        ),
        0 if fine else FINDINGS,
    )


Name = Annotated[str, Argument(help="the name of the measurement")]
ExpectedUncertainty = Annotated[
    float,
    Option(
        "--expected",
        min=0.0,
        max=1e4,
        callback=number_option,
        help="how well the place of the part is known: standard deviation in millimetres",
    ),
]
Displaced = Annotated[
    tuple[float, float, float] | None,
    Option(
        "--displaced",
        help="where everything really is, beside where it is expected: x y z in millimetres",
    ),
]
Given = Annotated[
    Path | None,
    Option(
        "--from",
        help="the make_range_image that the tool took: .npz, or a depth make_range_image: .npy, "
        "16-bit .png in mm, .pcd, .ply; else it is made",
    ),
]
Output = Annotated[
    Path | None, Option("--output", "-o", help="write the make_range_image there, as .npz")
]
Wrapped = Annotated[
    bool,
    Option("--wrapped", help="write it as the tool answers: ranges modulo half the wavelength"),
]
ImagePicture = Annotated[Path | None, Option("--picture", help="write a picture there, as .png")]
Parts = Annotated[
    list[str] | None,
    Option("--part", help="a part to look for; all parts of the scene if none is given"),
]


def make_range_image(
    target: Target,
    name: Name,
    expected: ExpectedUncertainty = 1.0,
    displaced: Displaced = None,
    given: Given = None,
    seed: Seed = 0,
    output: Output = None,
    wrapped: Wrapped = False,
    picture: ImagePicture = None,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Make the range image that the measurement NAME of TARGET is taken from, or read it, and
    measure its patch in it.
    """
    if given is not None and displaced is not None:
        raise make_misfit("an image that is read shows where things are", param_hint="--displaced")
    if wrapped and output is None:
        raise make_misfit("say with -o where to write it", param_hint="--wrapped")
    off = (
        None
        if displaced is None
        else (displaced[0] * 1e-3, displaced[1] * 1e-3, displaced[2] * 1e-3)
    )
    give_answer(
        lambda: _image_answer(
            target, name, expected * 1e-3, off, given, seed, output, wrapped, picture
        ),
        format,
    )


def recognise_parts(
    scene: SceneName,
    part: Parts = None,
    image: Image = None,
    seed: Seed = 0,
    picture: ImagePicture = None,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Tell which parts of a scene are seen, by the angles, distances and edges of their faces,
    and where they are; and what is none of them.
    """
    give_answer(lambda: _recognition_answer(scene, part or [], image, seed, picture), format)


def _image_answer(
    target: str,
    name: str,
    sigma_m: float,
    off: tuple[float, float, float] | None,
    given: Path | None,
    seed: int,
    output: Path | None,
    wrapped: bool,
    picture: Path | None,
) -> VerbAnswer:
    import numpy as np

    from cellwright.engine.faces.cli.output.output_files import write_picture
    from cellwright.engine.model.vision import Vague
    from cellwright.engine.pipelines.motion.measured_surface import measured_surface

    problem = planning.problem_of(target)
    true = None if off is None else np.array(off)
    seeing = motion.ImageRequest(
        sigma_m,
        seed,
        true,
        None if given is None else lambda tool: interop.read_ranges(given, tool),
    )
    surface = measured_surface(
        problem, loader.cell_of_problem(problem), geometry_backend(), name, seeing
    )
    if isinstance(surface, Vague):
        refusal_reason = surface.reason
        return VerbAnswer(
            "refused", {"reason": refusal_reason}, lambda: rich_parts.Text(refusal_reason), FINDINGS
        )
    if output is not None:
        interop.write_ranges(output, surface.answered if wrapped else surface.image)
    write_picture(
        picture,
        lambda: report.range_image_png(surface.image, surface.edges, {name: surface.window}),
    )
    return VerbAnswer(
        "found" if surface.sure else "refused",
        report.surface_content(surface),
        lambda: report.surface_text(surface),
        0 if surface.sure else FINDINGS,
    )


def _recognition_answer(
    scene: str, parts: list[str], path: Path | None, seed: int, picture: Path | None
) -> VerbAnswer:
    from cellwright.engine.faces.cli.output.output_files import write_picture

    read = loader.load_scene(find_scene(scene))
    depth_image = interop.read_depth(path, manipulation.camera_of(read)) if path else None
    seen = manipulation.recognised_in(read, parts, seed, depth_image)
    recognition = seen.answer
    drawn = [
        (seen.models[named_part.best.part].solid, named_part.best.T_eye_part)
        for named_part in recognition.named
    ]
    notes = [
        (unexplained_region.window, "no part") for unexplained_region in recognition.unexplained
    ]
    write_picture(picture, lambda: report.depth_png(seen.image, drawn, notes=notes))
    return VerbAnswer(
        "found" if recognition.named else "refused",
        report.recognition_content(recognition),
        lambda: report.recognition_text(recognition),
        0 if recognition.named else FINDINGS,
    )
