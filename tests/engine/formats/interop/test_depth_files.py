"""Depth images are read from files as they were written, and bad files are told."""

import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cellwright.engine.formats.interop.depth_files import read_cloud, read_depth
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.vision import DepthCamera
from cellwright.kb.diagnostics import InvalidInput

CAMERA = DepthCamera.viewing(8, 6, 0.6, 1.0)


def depths() -> Floats:
    """An image with one pixel missing."""
    found = 0.9 + np.arange(48).reshape(6, 8) / 1000
    found[2, 3] = 0.0
    return found


def points() -> Floats:
    """What its pixels see."""
    v, u = np.nonzero(depths())
    return CAMERA.rays(u.astype(float), v.astype(float)) * depths()[v, u][:, None]


def write_npy(path: Path) -> None:
    np.save(path, depths())


def write_png(path: Path) -> None:
    Image.fromarray(np.rint(depths() * 1000).astype(np.uint16)).save(path)


def write_pcd(path: Path) -> None:
    rows = "\n".join(" ".join(f"{x:.9f}" for x in row) for row in points())
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH "
        "47\nHEIGHT 1\n"
    )
    path.write_text(f"{head}VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points())}\nDATA ascii\n{rows}\n")


def write_ply(path: Path) -> None:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points())}\n"
    head += "property float x\nproperty float y\nproperty uchar red\nproperty float z\nend_header\n"
    body = b"".join(struct.pack("<ffBf", x, y, 7, z) for x, y, z in points())
    path.write_bytes(head.encode() + body)


WRITERS = {".npy": write_npy, ".png": write_png, ".pcd": write_pcd, ".ply": write_ply}


@pytest.mark.parametrize("kind", WRITERS)
def test_what_is_written_is_read(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"image{kind}"
    WRITERS[kind](path)
    np.testing.assert_allclose(read_depth(path, CAMERA), depths(), atol=1e-6)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_garbled_file_is_told(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"image{kind}"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(InvalidInput, match="cannot be read"):
        read_depth(path, CAMERA)


def test_another_size_or_kind_is_told(tmp_path: Path) -> None:
    path = tmp_path / "image.npy"
    np.save(path, np.ones((3, 4)))
    with pytest.raises(InvalidInput, match="4 x 3 pixels, the camera 8 x 6"):
        read_depth(path, CAMERA)
    with pytest.raises(InvalidInput, match="not a kind of depth image"):
        read_depth(tmp_path / "image.jpg", CAMERA)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "does not name the columns x, y and z"),
        ("a,b\n1,2\n", "does not name the columns x, y and z"),
        ("x,y,z\n1,2\n", "as many columns as the first one"),
        ("x,y,z\n1,2,three\n", "could not convert"),
        ("x,y,z\n1,2,1e200\n", "a coordinate is greater than"),
    ],
)
def test_a_table_without_three_columns_of_numbers_is_told(
    text: str, said: str, tmp_path: Path
) -> None:
    (tmp_path / "points.csv").write_text(text)
    with pytest.raises(InvalidInput, match=said):
        read_cloud(tmp_path / "points.csv")


def test_the_columns_of_a_table_are_found_by_their_names(tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("name,Z, y,x\na,3,2,1\n\nb,nan,0,0\n")
    assert read_cloud(tmp_path / "points.csv").tolist() == [[1.0, 2.0, 3.0]]
