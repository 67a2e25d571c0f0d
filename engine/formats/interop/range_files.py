"""Range images in files: our own `.npz`, and depth images of other programs read for a ranging
tool.
"""

import io
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from cellwright.engine.formats.interop.depth_files import MAX_DEPTH_BYTES, PNG_UNIT_M, read_depth
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.vision import RangeImage, picture_of
from cellwright.engine.stages.vision.sensor_images import of_depths
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_bytes
from cellwright.kb.json_text import parse_json
from cellwright.kb.model.cell_model import Ranging

OWN_SUFFIX = ".npz"
LEAST, LARGEST = 1e-6, 1e6  # of a range in m, and of a strength: beyond, there is no answer
TOOL_BOUNDS = {  # what each size of a tool is more than, and at most; as in a cell
    "view_rad": (0.0, 2.6),
    "wavelength_m": (0.0, 1e3),
    "noise_m": (0.0, 1.0),
    "at_m": (0.0, 1e3),
    "beam_rad": (0.0, 0.1),
    "pointing_rad": (-1e-12, 0.1),
    "grazing_rad": (0.0, 1.5707),
    "dropouts": (-1e-12, 0.9),
}
COUNT_TOLERANCE = 1e-6  # of a count: what differs by less from a whole number is one


def write_ranges(path: Path, image: RangeImage) -> None:
    """Write an image; the ending is `.npz`.

    Raises `InvalidInput` for a file that cannot be written.
    """
    if path.suffix.lower() != OWN_SUFFIX:
        raise _bad_range_file(
            path, f"'{path.suffix}' is no form of range images", f"write a {OWN_SUFFIX} file"
        )
    buffer = io.BytesIO()
    told = json.dumps(asdict(image.tool))
    np.savez_compressed(
        buffer,
        range_m=image.range_m,
        strength=image.strength,
        wrapped=image.wrapped,
        guessed=image.guessed,
        step_m=image.step_m,
        tool=np.array(told),
    )
    try:
        path.write_bytes(buffer.getvalue())
    except OSError as error:
        raise _bad_range_file(
            path, f"it cannot be written: {error.strerror}", "is its folder there?"
        ) from None


def read_ranges(path: Path, tool: Ranging | None = None) -> RangeImage:
    """The image in a file: `.npz` as written by `write_ranges`, or a depth image for a tool. Raises
    `InvalidInput`.

    Depths that are all whole millimetres were rounded to these.
    """
    if path.suffix.lower() == OWN_SUFFIX:
        return _read_own_file(path)
    if tool is None:
        hint = (
            f"say it with --tool, or give a {OWN_SUFFIX} file that `measurement image` has written"
        )
        raise _bad_range_file(path, "a depth image does not tell which tool took it", hint)
    depth = read_depth(path, picture_of(tool))
    depth = np.where((depth > LEAST) & (depth < LARGEST), depth, 0.0)
    counts = depth / PNG_UNIT_M
    whole = bool((np.abs(counts - np.rint(counts)) < COUNT_TOLERANCE).all())
    return of_depths(depth, tool, PNG_UNIT_M if whole else 0.0)


def _read_own_file(path: Path) -> RangeImage:
    data = read_bytes(path, str(path), MAX_DEPTH_BYTES)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            tool = _read_tool(parse_json(str(arrays["tool"])))
            ranges, strength = (
                _check_values(arrays[name], tool) for name in ("range_m", "strength")
            )
            wrapped = bool(arrays["wrapped"])
            guessed = "guessed" in arrays and bool(arrays["guessed"])
            step_m = float(arrays["step_m"]) if "step_m" in arrays else 0.0
            if not 0.0 <= step_m < LARGEST:
                raise ValueError("its depths are rounded to no length")
    except Exception as error:  # what a garbled file makes the readers raise is not laid down
        said = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise _bad_range_file(
            path, f"it cannot be read: {said}", "write it with `measurement image`"
        ) from None
    known = (ranges > LEAST) & (strength > LEAST)
    ranges, strength = (np.where(known, values, 0.0) for values in (ranges, strength))
    return RangeImage(tool, ranges, strength, wrapped, guessed, step_m)


def _read_tool(said: Any) -> Ranging:
    tool = Ranging(**said)
    whole = all(isinstance(size, int) and 4 <= size <= 2048 for size in (tool.width, tool.height))
    if not whole or not all(
        low < getattr(tool, key) <= high for key, (low, high) in TOOL_BOUNDS.items()
    ):
        raise ValueError("the tool makes no sense")
    return tool


def _check_values(values: Any, tool: Ranging) -> Floats:
    array = np.asarray(values, dtype=float)
    if array.shape != (tool.height, tool.width):
        raise ValueError("the picture has another size than the tool's")
    return np.where(np.isfinite(array) & (np.abs(array) < LARGEST), array, 0.0)


def _bad_range_file(path: Path, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path)), "K702", message, hint)])
