"""Range images in files: our own `.npz` with ranges, strengths and the tool; depth images of others, read for a tool."""

import io
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from engine.formats.interop.depth_files import MAX_BYTES, read_depth
from engine.model.geometry import Floats
from engine.model.ranging import RangeImage, picture_of
from engine.stages.vision.ranging import of_depths
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.files import read_bytes
from kb.json_text import parsed
from kb.model.ranging import Ranging

OWN = ".npz"
LARGEST = 1e6  # m


def write_ranges(path: Path, image: RangeImage) -> None:
    """Write an image; the ending is `.npz`. Raises `InvalidInput` for a file that cannot be written."""
    import json

    if path.suffix.lower() != OWN:
        raise _refused(path, f"'{path.suffix}' is no form of range images", f"write a {OWN} file")
    made = io.BytesIO()
    told = json.dumps(asdict(image.tool))
    np.savez_compressed(
        made, range_m=image.range_m, strength=image.strength, wrapped=image.wrapped, tool=np.array(told)
    )
    try:
        path.write_bytes(made.getvalue())
    except OSError as error:
        raise _refused(path, f"it cannot be written: {error.strerror}", "is its folder there?") from None


def read_ranges(path: Path, tool: Ranging | None = None) -> RangeImage:
    """The image in a file: `.npz` as written by `write_ranges`, or a depth image for a tool. Raises `InvalidInput`."""
    if path.suffix.lower() == OWN:
        return _own(path)
    if tool is None:
        hint = f"give a {OWN} file that `measurement image` has written"
        raise _refused(path, "a depth image does not tell which tool took it", hint)
    return of_depths(read_depth(path, picture_of(tool)), tool)


def _own(path: Path) -> RangeImage:
    data = read_bytes(path, str(path), MAX_BYTES)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as found:
            tool = _tool(parsed(str(found["tool"])))
            ranges, strength = (_checked(found[name], tool) for name in ("range_m", "strength"))
            wrapped = bool(found["wrapped"])
    except Exception as error:  # what a garbled file makes the readers raise is not laid down
        said = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise _refused(path, f"it cannot be read: {said}", "write it with `measurement image`") from None
    known = (ranges > 0) & (strength > 0)
    return RangeImage(tool, np.where(known, ranges, 0.0), np.where(known, strength, 0.0), wrapped)


def _tool(said: Any) -> Ranging:
    tool = Ranging(**said)
    sizes = (tool.view_rad, tool.wavelength_m, tool.noise_m, tool.at_m, tool.beam_rad)
    whole = all(isinstance(each, int) and 4 <= each <= 2048 for each in (tool.width, tool.height))
    if not whole or not all(0 < each < LARGEST for each in sizes) or not tool.view_rad < np.pi:
        raise ValueError("the tool makes no sense")
    return tool


def _checked(values: Any, tool: Ranging) -> Floats:
    found = np.asarray(values, dtype=float)
    if found.shape != (tool.height, tool.width):
        raise ValueError("the picture has another size than the tool's")
    return np.where(np.isfinite(found) & (np.abs(found) < LARGEST), found, 0.0)


def _refused(path: Path, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path)), "K702", message, hint)])
