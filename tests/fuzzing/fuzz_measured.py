"""Readers of what was measured: range images, clouds of points, results, hidden truths, and
tools as cells describe them.
"""

import json
from functools import cache, partial
from pathlib import Path
from typing import Any

import fuzz_seeds as seeds
from fuzz_readers import Reader, Refused, _said, cell

TOOL: dict[str, Any] = {
    "eye": "laser", "width": 12, "height": 10, "view_rad": 0.2, "wavelength_m": 0.3, "noise_m": 5e-5, "at_m": 0.5,
    "beam_rad": 0.0024, "pointing_rad": 1e-4, "grazing_rad": 1.4, "dropouts": 0.0,
}  # fmt: skip
IMAGE = {
    "tool": TOOL,
    "range_m": [[0.05 + 0.001 * (row + column) for column in range(12)] for row in range(10)],
    "strength": [[0.9] * 12] * 10,
    "wrapped": False,
    "guessed": False,
    "step_m": 0.0,
}
WRAPPED = {**IMAGE, "wrapped": True}
RANGING_CELL = """cell: bench
fixtures:
  stand: {shapes: [{box: [0.1, 0.1, 0.1]}]}
tools:
  scanner:
    in: stand
    shapes: [{box: [0.1, 0.1, 0.1]}]
    features: {tip: {at: [0, 0, 0.1]}, laser: {at: [0, 0, 0.05]}}
measuring:
  scanner:
    approach: 50 mm
    tilts: [0, 5]
    patch: [20 mm, 60 mm]
    sight: {eyes: [laser], range: [0.35, 0.65], incidence: 50, back: 0.1}
    ranging: {eye: laser, pixels: [64, 48], view: 34 deg, wavelength: 0.3 m, noise: 0.05 mm, at: 0.5 m, beam: 0.0024 rad,
      pointing: 0.0001 rad, grazing: 80 deg, dropouts: 0.002}
"""
CLOUD = "x,y,z\n" + "".join(f"{0.01 * (n % 4)},{0.01 * (n // 4)},0.1\n" for n in range(16))
TRUTH = json.dumps(
    {
        "shift_mm": [12, -7, 3], "turn_deg": [0.4, 0, -2], "values": {"m1": 6350.2}, "noise": {"us_probe": 8}, "bad": {"m17": 95},
        "drift": {"us_probe": {"per_value": 2.5, "calibrated_by": "us_measure", "allowance": 30, "cause": "broken_probe"}},
    }
)  # fmt: skip


@cache
def range_images() -> list[bytes]:
    """A whole and a wrapped image as files."""
    from io import BytesIO

    made = []
    for said in (IMAGE, WRAPPED):
        out = BytesIO()
        _save(out, said)
        made.append(out.getvalue())
    return made


def _save(out: Any, said: dict[str, Any]) -> None:
    import numpy as np

    arrays = {
        name: np.array(json.dumps(each) if name == "tool" else each) for name, each in said.items()
    }
    np.savez(out, **arrays)


def range_image(path: Path) -> None:
    """An image is read, resolved and measured in."""
    from cellwright.engine.formats.interop.range_files import read_ranges

    measured_in(read_ranges(path))


def measured_in(image: Any) -> None:
    """Shapes are fitted to the whole image, if its ranges are whole or can be resolved."""
    import numpy as np

    from cellwright.engine.model.shape_fits import FitShape
    from cellwright.engine.model.vision import PixelWindow, RangeImage
    from cellwright.engine.pipelines.motion.image_dimensions import (
        DimensionRequest,
        dimensions_in_image,
    )
    from cellwright.engine.stages.vision.sensor_images import resolve_ranges

    size = (image.tool.height, image.tool.width)
    if max(size) > 64:  # larger ones are the same, and take long
        return
    image = resolve_ranges(image, np.full(size, 0.5), 0.001)
    whole = PixelWindow(0, 0, size[1], size[0])
    if isinstance(image, RangeImage):
        dimensions_in_image(
            image,
            [
                DimensionRequest(each.value, each, whole)
                for each in (FitShape.PLANE, FitShape.CIRCLE)
            ],
        )


def image_content(path: Path) -> None:
    """An image whose arrays are what a text in JSON says, so that mutations get past the
    checksums of the file.
    """
    from cellwright.kb.json_text import parse_json

    try:
        said = parse_json(path.read_bytes().decode("utf-8", "replace"))
    except ValueError:
        raise Refused from None
    file = path.with_suffix(".npz")
    try:
        _save(file, said)
    except Exception:  # what NumPy cannot write is no file
        raise Refused from None
    range_image(file)


def depth_as_ranges(path: Path) -> None:
    """A depth image of a tool is read and measured in."""
    from cellwright.engine.formats.interop.range_files import read_ranges
    from cellwright.kb.model.cell_model import Ranging

    measured_in(read_ranges(path, Ranging(**{**TOOL, "width": 8, "height": 6})))


def cloud(path: Path) -> None:
    """A shape is fitted to a cloud."""
    import numpy as np

    from cellwright.engine.formats.interop.depth_files import read_cloud
    from cellwright.engine.model.shape_fits import Cloud, FitShape
    from cellwright.engine.stages.fitting.shape_fit import fit_measured_shape

    points = read_cloud(path)
    if len(points) < 200:
        fit_measured_shape(FitShape.PLANE, Cloud(points, np.full(len(points), 5e-5)))


def truth(path: Path) -> None:
    """The hidden truth of a simulated part."""
    from cellwright.engine.pipelines.simulators.true_part import read_truth

    read_truth(str(path), _job(), 1)


def alignment(path: Path) -> None:
    """Results as datums of a part, and where they say that it lies."""
    from cellwright.engine.formats.interop.measured_alignment import datums_of, read_results
    from cellwright.engine.stages.fitting.datum_alignment import align_by_datums

    align_by_datums(datums_of(_job(), read_results(path), 5e-5))


@cache
def profiles(form: str) -> list[bytes]:
    """Profiles of points of a problem."""
    from cellwright.engine.formats.interop.results import ResultForm, write_results
    from cellwright.kb.model.measured_results import Measured, Results

    found = tuple(
        Measured(f"m{n}", "profile", 10.0 * n, "um", 0.0, tool="slra") for n in range(1, 13)
    )
    return [write_results(Results("monday", "", found), ResultForm(form)).encode()]


@cache
def _job() -> Any:
    from cellwright.engine.pipelines.planning.checked_plan import problem_of

    return problem_of("bulkhead/twelve_points")


MEASURED = [
    Reader("range image", "bytes", range_images, range_image, "a.npz"),
    Reader("range image "
    "content", "json", _said(json.dumps(IMAGE), json.dumps(WRAPPED)), image_content, "a.json"),
    Reader("ranges NPY", "bytes", lambda: [seeds.npy()], depth_as_ranges, "a.npy"),
    Reader("ranges PNG", "bytes", lambda: [seeds.png()], depth_as_ranges, "a.png"),
    Reader("ranges PCD", "text", _said(seeds.PCD), depth_as_ranges, "a.pcd"),
    Reader("ranges PLY", "bytes", lambda: [seeds.ply()], depth_as_ranges, "a.ply"),
    Reader("cloud CSV", "text", _said(CLOUD), cloud, "points.csv"),
    Reader("cloud PCD", "text", _said(seeds.PCD), cloud, "points.pcd"),
    Reader("ranging tool", "yaml", _said(RANGING_CELL), cell, "cell.yaml"),
    Reader("truth", "json", _said(TRUTH), truth, "truth.json"),
    *(
        Reader(f"alignment {form}", "text", partial(profiles, form), alignment, f"results.{form}")
        for form in ("csv", "json", "qif")
    ),
]  # fmt: skip
