"""Measurements that a page enters land in the problem file, are told to be reachable or not,
and can be undone.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellwright.engine.faces.monitor.measurement_sheets import (
    MeasuredPart,
    Sheets,
    point_verdict,
    read_point,
    written_point,
)
from cellwright.engine.stages.geometry.shapes.snapping import SnapTo
from cellwright.kb.diagnostics import InvalidInput

POINT: dict[str, Any] = {
    "name": "p1", "kind": "thickness", "at": [100.02, 200.0, 0.0], "normal": [0, 0, -2], "nominal": 20,
}  # fmt: skip


@pytest.fixture
def sheets(tmp_path: Path) -> Sheets:
    made = Sheets(tmp_path)
    assert made.change({"how": "new", "file": "job", "domain": "bulkhead"}) == "made: job.yaml"
    return made


def test_a_point_lands_in_the_file_and_can_be_changed_removed_and_undone(sheets: Sheets) -> None:
    path = sheets.path("job.yaml")
    texts = [path.read_text()]
    for how, points in (
        ("added", [POINT]),
        ("added", [{**POINT, "name": "p2", "at": [0, 0, 0]}]),
        ("replaced", [{**POINT, "tolerance": 0.5}, {**POINT, "name": "p2", "kind": "profile"}]),
        ("removed", ["p1"]),
    ):
        sheets.change({"how": how, "file": "job.yaml", "points": points})
        texts.append(path.read_text())
    assert "position(p1, 100020, 200000, 0)" in texts[1]
    assert "tolerance(p1, 500)" in texts[3]
    assert "needs(p2, profile)" in texts[3]
    assert [each.name for each in MeasuredPart(path).points] == ["p2"]
    for text in reversed(texts[:-1]):
        sheets.change({"how": "undo", "file": "job.yaml"})
        assert path.read_text() == text
    with pytest.raises(InvalidInput, match="nothing to undo"):
        sheets.change({"how": "undo", "file": "job.yaml"})


def test_the_tool_that_a_measurement_prefers_takes_it_if_it_can(sheets: Sheets) -> None:
    path = sheets.path("job.yaml")
    path.write_text(
        "problem: job\ndomain: bulkhead\nobjects:\n  us_tool: [us_probe_2]\nstatics:\n"
        "  - weight(us_probe_2, 4)\n  - accuracy(us_probe_2, 25)\n  - preference(us_probe_2, "
        "9)\ngoals: []\n"
    )
    assert MeasuredPart(path).tools == ["slra", "us_probe", "us_probe_2"]
    assert point_verdict(str(path), POINT)[1].startswith("by us_probe from")
    assert point_verdict(str(path), {**POINT, "tool": "us_probe_2"})[1].startswith("by us_probe_2")
    assert point_verdict(str(path), {**POINT, "tool": "slra"})[1].endswith(
        "not by slra, which cannot"
    )
    sheets.change({"how": "added", "file": "job.yaml", "points": [{**POINT, "tool": "us_probe_2"}]})
    assert "prefers(p1, us_probe_2)" in path.read_text()
    assert [each.tool for each in MeasuredPart(path).points] == ["us_probe_2"]
    sheets.change({"how": "replaced", "file": "job.yaml", "points": [POINT]})
    assert "prefers" not in path.read_text()


def test_a_group_that_has_a_bad_point_changes_nothing(sheets: Sheets) -> None:
    text = sheets.path("job.yaml").read_text()
    for bad in ({**POINT, "name": "Bad "
    "name"}, {**POINT, "name": "x) :- true. "
    "y(", "kind": "thickness"}, {**POINT, "normal": [0, 0, 0]}, {**POINT, "at": [1, "nan", 2]}):  # fmt: skip
        with pytest.raises(InvalidInput):
            sheets.change(
                {"how": "added", "file": "job.yaml", "points": [{**POINT, "name": "fine"}, bad]}
            )
        assert sheets.path("job.yaml").read_text() == text


def test_what_was_changed_elsewhere_is_not_undone(sheets: Sheets) -> None:
    sheets.change({"how": "added", "file": "job.yaml", "points": [POINT]})
    path = sheets.path("job.yaml")
    path.write_text(path.read_text() + "# mine\n")
    with pytest.raises(InvalidInput, match="elsewhere"):
        sheets.change({"how": "undo", "file": "job.yaml"})


@pytest.mark.parametrize(
    "name", ["../job.yaml", "/etc/passwd", "job.yaml/../job.yaml", "", "other.yaml"]
)
def test_no_file_but_those_of_the_folder_is_read_or_written(sheets: Sheets, name: str) -> None:
    for how in ("added", "removed", "undo", "import"):
        with pytest.raises(InvalidInput):
            sheets.change({"how": how, "file": name, "points": [POINT]})
    with pytest.raises(InvalidInput):
        sheets.change({"how": "new", "file": name, "domain": "bulkhead"})


def test_a_link_out_of_the_folder_is_not_followed(
    sheets: Sheets, tmp_path_factory: pytest.TempPathFactory
) -> None:
    outside = tmp_path_factory.mktemp("outside") / "secret.yaml"
    outside.write_text("problem: secret\ndomain: bulkhead\ngoals: []\n")
    (sheets.folder / "link.yaml").symlink_to(outside)
    with pytest.raises(InvalidInput):
        sheets.change({"how": "added", "file": "link.yaml", "points": [POINT]})
    assert "p1" not in outside.read_text()


def test_a_point_that_arms_share_is_told_with_the_tools_of_all_arms_that_reach_it(
    sheets: Sheets,
) -> None:
    sheets.change({"how": "new", "file": "shared", "domain": "halves"})
    path = str(sheets.path("shared.yaml"))
    west, both, east = ({**POINT, "at": [0.0, y, 0.0]} for y in (-1500.0, -100.0, 1500.0))
    assert point_verdict(path, west) == (True, "by west_probe")
    assert point_verdict(path, both) == (True, "by east_probe or west_probe")
    assert point_verdict(path, east) == (True, "by east_probe")
    reached, why = point_verdict(path, {**both, "at": [0.0, 2400.0, 0.0]})
    assert not reached
    assert "west: " in why
    assert "east: " in why


def test_a_table_is_imported_as_a_problem(sheets: Sheets) -> None:
    (sheets.folder / "points.csv").write_text(
        "name,kind,x,y,z,nx,ny,nz\na1,thickness,100,200,0,0,0,-1\n"
    )
    assert "1 points" in sheets.change(
        {"how": "import", "file": "points.csv", "domain": "bulkhead"}
    )
    assert [each.name for each in MeasuredPart(sheets.path("points.yaml")).points] == ["a1"]


def test_a_point_is_read_as_it_is_written() -> None:
    point = read_point(POINT)
    assert read_point(written_point(point)) == point


def test_a_picked_point_is_where_it_was_picked_within_a_tenth_of_a_millimetre(
    sheets: Sheets,
) -> None:
    part = MeasuredPart(sheets.path("job.yaml"))
    for x, y in ((0.1, 0.2), (-0.3, -0.75), (0.0, 1.234_567)):
        found = part.picked("web", part.in_world((x, y, 0.0)), SnapTo.FACE)
        assert found is not None
        assert found.point == pytest.approx([x, y, 0.0], abs=1e-4)
        assert found.normal == pytest.approx([0.0, 0.0, -1.0], abs=1e-9)
    assert (
        part.picked("web", np.array(part.in_world((0.1, 0.2, 0.0))).tolist(), SnapTo.HOLE) is None
    )


def test_it_is_told_whether_a_point_can_be_measured_and_why_not(sheets: Sheets) -> None:
    path = str(sheets.path("job.yaml"))
    assert point_verdict(path, POINT)[0]
    reached, why = point_verdict(path, {**POINT, "normal": [0, 0, 1]})
    assert not reached
    assert "not in this orientation" in why
    assert point_verdict(path, {**POINT, "tolerance": 0.01}) == (
        False,
        "us_probe is too coarse for the tolerance",
    )
