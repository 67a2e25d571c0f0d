"""Reads depth images and clouds of points: NumPy arrays, 16-bit PNG, PCD and PLY.

A row of an array or a PNG is a row of the picture. Points are in the camera's frame in metres; each
is put into its pixel, the nearest one counts.
"""

import io
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.vision import DepthCamera
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import foreign_bytes

MAX_DEPTH_BYTES = 256 * 2**20
PNG_UNIT_M = 0.001  # what one count of a PNG stands for, as depth cameras write it
# a coordinate of a measured point; squares of much larger ones leave no digits for millimetres
MAX_DEPTH_M = 1e6
MIN_DEPTH_M = 1e-6  # in front of a camera
PLY_TYPES = {
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
    "uchar": "u1",
    "uint8": "u1",
    "char": "i1",
}
PLY_TYPES |= {
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "int8": "i1",
    "int16": "i2",
    "uint16": "u2",
}
PLY_TYPES |= {"int32": "i4", "uint32": "u4"}


def read_depth(path: Path, camera: DepthCamera) -> Floats:
    """Depths (height, width) in metres, 0 for nothing.

    Raises `InvalidInput` for what cannot be read, or another size.
    """
    depths = _read_by_suffix(
        path,
        {".npy": _read_array, ".png": _read_png, ".pcd": _read_pcd, ".ply": _read_ply},
        "depth image",
    )
    depth = _in_pixels(depths, camera) if depths.ndim == 2 and depths.shape[1] == 3 else depths
    if depth.shape != (camera.height, camera.width):
        size = f"{camera.width} x {camera.height}"
        shape = " x ".join(map(str, depth.shape[::-1]))
        raise _bad_depth_file(
            path,
            f"it has {shape} pixels, the camera {size}",
            "give the camera its `width` and `height`",
        )
    return np.where(np.isfinite(depth) & (depth > 0), depth, 0.0)


def read_cloud(path: Path, unit_m: float = 1.0) -> Floats:
    """Points (n, 3) in metres, those that are finite. Raises `InvalidInput` for what cannot be
    read.

    The file counts in `unit_m`; whole numbers in a `.npy` are millimetres.
    """
    readers: dict[str, Callable[[bytes], Floats]] = {".npy": partial(_read_array, unit_m=unit_m)}
    readers |= {
        ".pcd": _in_unit(unit_m, _read_pcd),
        ".ply": _in_unit(unit_m, _read_ply),
        ".csv": _in_unit(unit_m, _read_rows),
    }
    points = _read_by_suffix(path, readers, "file of points")
    if points.shape[1] != 3:
        raise _bad_depth_file(
            path, f"it has {points.shape[1]} columns", "give x, y and z of each point"
        )
    kept: Floats = points[np.isfinite(points).all(axis=1)]
    if (np.abs(kept) > MAX_DEPTH_M).any():
        hint = "say with --unit in what the file counts"
        raise _bad_depth_file(path, f"a coordinate is greater than {MAX_DEPTH_M:.0f} m", hint)
    return kept


def _in_unit(unit_m: float, read: Callable[[bytes], Floats]) -> Callable[[bytes], Floats]:
    """A reader whose lengths are in a unit."""
    return lambda data: np.asarray(read(data) * unit_m, float)


def _read_rows(data: bytes) -> Floats:
    """The columns x, y and z of a table whose first line names them."""
    lines = [line.split(",") for line in data.decode("utf-8-sig").splitlines() if line.strip()]
    names = [heading.strip().lower() for heading in lines[0]] if lines else []
    if not {"x", "y", "z"} <= set(names):
        raise ValueError("its first line does not name the columns x, y and z")
    if any(len(row) != len(names) for row in lines):
        raise ValueError("not every line has as many columns as the first one")
    columns = [names.index(axis) for axis in "xyz"]
    return np.array(
        [[float(row[column]) for column in columns] for row in lines[1:]], float
    ).reshape(-1, 3)


def _read_by_suffix(
    path: Path, readers: Mapping[str, Callable[[bytes], Floats]], what: str
) -> Floats:
    """What the reader for a file's ending makes of it."""
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise _bad_depth_file(
            path, f"'{path.suffix}' is not a kind of {what}", f"one of: {', '.join(readers)}"
        )
    data = foreign_bytes(path, "K702", "it", MAX_DEPTH_BYTES)
    try:
        return reader(data)
    except Exception as error:  # what a garbled file makes the readers raise is not laid down
        said = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        hint = f"is the file whole, and of the kind that '{path.suffix}' says?"
        raise _bad_depth_file(path, f"it cannot be read: {said}", hint) from None


def _bad_depth_file(path: Path, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path)), "K702", message, hint)])


def _read_array(data: bytes, unit_m: float = 1.0) -> Floats:
    array = np.load(io.BytesIO(data), allow_pickle=False)
    if array.ndim != 2 or array.dtype.kind not in "fiu":
        raise ValueError("not an array of two dimensions with numbers")
    scale = unit_m if array.dtype.kind == "f" else PNG_UNIT_M
    return np.asarray(array, dtype=float) * scale


def _read_png(data: bytes) -> Floats:
    from PIL import Image

    with Image.open(io.BytesIO(data), formats=["PNG"]) as image:
        if not image.mode.startswith("I"):
            raise ValueError(f"a PNG of mode {image.mode}, not of 16 bits in one channel")
        return np.asarray(image, dtype=float) * PNG_UNIT_M


def _read_pcd(data: bytes) -> Floats:
    """The points of a PCD file, as text or plain binary."""
    header: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in header:
        end = data.index(b"\n", at)
        key, *values = data[at:end].decode("ascii").split()
        header[key] = values
        at = end + 1
    names, count = header["FIELDS"], int(header["POINTS"][0])
    kinds = {"F": "f", "I": "i", "U": "u"}
    columns = [
        (n, kinds[t] + s) for n, t, s in zip(names, header["TYPE"], header["SIZE"], strict=True)
    ]
    if any(count_text != "1" for count_text in header.get("COUNT", [])):
        raise ValueError("fields of several numbers")
    return _points_of_rows(data[at:], columns, count, header["DATA"][0] == "ascii", "<")


def _read_ply(data: bytes) -> Floats:
    """The vertices of a PLY file."""
    end = data.index(b"end_header") + len(b"end_header")
    lines = data[:end].decode("ascii").splitlines()
    at = data.index(b"\n", end) + 1
    form = next(line.split()[1] for line in lines if line.startswith("format"))
    columns, count, reading = [], 0, False
    for line in map(str.split, lines):
        if line[0] == "element":
            if count == 0 and line[1] != "vertex":
                raise ValueError("its vertices do not come first")
            reading = line[1] == "vertex"
            count = int(line[2]) if reading else count
        elif line[0] == "property" and reading:
            columns.append((line[2], PLY_TYPES[line[1]]))
    return _points_of_rows(
        data[at:], columns, count, form == "ascii", ">" if "big" in form else "<"
    )


def _points_of_rows(
    data: bytes, columns: list[tuple[str, str]], count: int, written: bool, order: str
) -> Floats:
    """The x, y and z (n, 3) of rows of named columns."""
    if written:
        rows = [line.split() for line in data.decode("ascii").splitlines()[:count]]
        table = np.array(rows, dtype=float).reshape(count, len(columns))
        names = [name for name, _ in columns]
        return table[:, [names.index(axis) for axis in "xyz"]]
    kind = np.dtype([(name, order + form) for name, form in columns])
    if len(data) < count * kind.itemsize:
        raise ValueError(f"it ends before its {count} points")
    records = np.frombuffer(data, kind, count)
    return np.stack([records[axis].astype(float) for axis in "xyz"], axis=1)


def _in_pixels(points: Floats, camera: DepthCamera) -> Floats:
    """The depths (height, width) of the nearest points (n, 3)."""
    measured = (np.abs(points) < MAX_DEPTH_M).all(axis=1) & (points[:, 2] > MIN_DEPTH_M)
    near = points[measured]
    u, v = (np.rint(coordinates) for coordinates in camera.pixels(near))
    inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    rows, columns = (pixels[inside].astype(np.int64) for pixels in (v, u))
    depth = np.full((camera.height, camera.width), np.inf)
    np.minimum.at(depth, (rows, columns), near[inside, 2])
    return np.where(np.isfinite(depth), depth, 0.0)
