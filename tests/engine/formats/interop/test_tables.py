"""Tables of measurements: what is read, and what is wrong in which line."""

from pathlib import Path

import pytest

from cellwright.engine.formats.interop.inspection_files import import_file, inspection_remarks
from cellwright.engine.formats.interop.measurement_tables import read_table
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.inspection.tool_tours import NO_TOOL
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.plan_objective import plan_for_objective
from cellwright.kb.diagnostics import Diagnostic, InvalidInput

HEAD = "name,x,y,z,nx,ny,nz,kind,tolerance,bore,feature,remark\n"


def table(folder: Path, text: str) -> Path:
    file = folder / "points.csv"
    file.write_text(text)
    return file


def wrong(folder: Path, text: str, unit: str = "mm") -> tuple[Diagnostic, ...]:
    with pytest.raises(InvalidInput) as caught:
        read_table(table(folder, text), unit)
    return caught.value.diagnostics


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_columns_are_divided_by_what_the_first_line_has(tmp_path: Path, mark: str) -> None:
    text = (HEAD + "a,1,2,3,0,0,2,thickness,0.5,,f,a note\n").replace(",", mark)
    (point,) = read_table(table(tmp_path, text)).points
    assert point.position == pytest.approx((0.001, 0.002, 0.003))
    assert (point.normal, point.kind, point.feature) == ((0, 0, 1), "thickness", "f")
    assert (point.tolerance_m, point.bore_m) == (pytest.approx(0.0005), None)


@pytest.mark.parametrize(
    ("unit", "metres"), [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("in", 0.0254)]
)
def test_units(tmp_path: Path, unit: str, metres: float) -> None:
    (point,) = read_table(table(tmp_path, HEAD + "a,1,2,3,0,0,1,,1,,,\n"), unit).points
    assert point.position == pytest.approx((metres, 2 * metres, 3 * metres))
    assert point.tolerance_m == pytest.approx(metres)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("b,,2,3,0,0,1", "no number in the column 'x'"),
        ("b,1,2,3", "no number in the column 'nx'"),
        ("b,one,2,3,0,0,1", "'one' is not a number"),
        ("b,1,2,3,0,0,1,,-1", "less than 0"),
        ("b,9e9,2,3,0,0,1", "more than 2147 m"),
        ("not,1,2,3,0,0,1", "'not' is not a name"),
        ("b,1,2,3,0,0,1,Very thick", "is not a kind"),
        ("a,1,2,3,0,0,1", "used twice: first in line 2"),
        ("b,1,2,3,0,0,1,,,,f,note,1,5", "cells in 12 columns"),
    ],
)
def test_what_is_wrong_is_said_with_its_line_and_empty_lines_count(
    tmp_path: Path, row: str, said: str
) -> None:
    (found,) = wrong(tmp_path, f"{HEAD}a,1,2,3,0,0,1\n\n{row}\n")
    assert said in found.message
    assert found.where.line == 4
    assert found.hint


def test_all_missing_columns_are_told_at_once_and_misspelt_ones(tmp_path: Path) -> None:
    found = wrong(tmp_path, "name,x,y,nx,ny,tolerence\n")
    assert found[0].message == "no column 'z', 'nz'"
    assert ("unknown column 'tolerence'", "did you mean 'tolerance'?") in [
        (each.message, each.hint) for each in found
    ]


def test_a_table_without_rows_is_refused(tmp_path: Path) -> None:
    assert "no rows" in wrong(tmp_path, HEAD)[0].message


def test_a_kind_that_the_domain_does_not_know_is_told_and_the_problem_plans(tmp_path: Path) -> None:
    rows = "a,1,2,0,0,0,-1,thickness,0.5,,,\nb,9,2,0,0,0,-1,profile,0.5,,,\nc,3,3,0,0,0,-1,roughness,0.5,,,\n"
    path = table(tmp_path, HEAD + rows)
    inspection, parts, text = import_file(path, "bulkhead", table=True)
    assert parts.impossible == {"c": NO_TOOL}
    assert [each.message for each in inspection_remarks(inspection, path)] == [
        "the domain knows no measurement of the kind 'roughness'"
    ]
    written = tmp_path / "points.yaml"
    written.write_text(text)
    assert isinstance(plan_for_objective(problem_of(str(written))).outcome, Found)


def test_columns_may_carry_their_unit_and_points_need_no_names(tmp_path: Path) -> None:
    table = tmp_path / "points.csv"
    table.write_text(
        "x_m,y_cm,z,nx,ny,nz,tolerance_in\n0.5,2,300,1,0,0,0.1\n\n0.25,4,100,0,1,0,\n", "utf-8"
    )
    first, second = read_table(table, "mm").points
    assert (first.name, second.name) == ("p1", "p2")
    assert first.position == pytest.approx((0.5, 0.02, 0.3))
    assert second.position == pytest.approx((0.25, 0.04, 0.1))
    assert (first.tolerance_m, second.tolerance_m) == (pytest.approx(0.00254), None)


def test_a_column_with_two_units_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "points.csv"
    table.write_text("x_m,x_mm,y,z,nx,ny,nz\n0.5,500,2,3,1,0,0\n", "utf-8")
    with pytest.raises(InvalidInput, match="the column 'x' is there twice"):
        read_table(table)


@pytest.mark.parametrize(
    ("cell", "said"), [("", "no number in the column 'Z_m'"), ("3o", "the column 'Z_m' needs")]
)
def test_a_column_is_called_as_the_table_calls_it(tmp_path: Path, cell: str, said: str) -> None:
    table = tmp_path / "points.csv"
    table.write_text(f"x_m,y,Z_m,nx,ny,nz\n0.5,2,{cell},1,0,0\n", "utf-8")
    with pytest.raises(InvalidInput) as refused:
        read_table(table)
    (found,) = refused.value.diagnostics
    assert said in f"{found.message} {found.hint}"


@pytest.mark.parametrize(
    ("columns", "cells", "width", "nominal"),
    [
        ("+tol,-tol", "0.05,0.02", 70, 15),
        ("Upper Tol,lower_tol", "0.05,-0.02", 70, 15),
        ("upper_tol,lower_tol", "0.05,0.02", 30, 35),
        ("tol_plus,tol_minus,nominal", "0.05,-0.05,2", 100, 2000),
        ("upper_tol_in,lower_tol_mm", "1,0", 25_400, 12_700),
        ("+/-tol", "0.05", 100, None),
    ],
)
def test_the_ends_of_a_tolerance_are_read(
    tmp_path: Path, columns: str, cells: str, width: int, nominal: int | None
) -> None:
    (tmp_path / "t.csv").write_text(f"x,y,z,nx,ny,nz,{columns}\n1,2,3,0,0,1,{cells}\n")
    (point,) = read_table(tmp_path / "t.csv").points
    assert point.tolerance_m is not None
    assert round(point.tolerance_m * 1e6) == width
    assert (None if point.nominal_m is None else round(point.nominal_m * 1e6)) == nominal


@pytest.mark.parametrize(
    ("columns", "cells", "said"),
    [
        ("+tol", "0.05", "one end of the tolerance without the other"),
        ("upper_tol,lower_tol", "0.05,", "one end of the tolerance without the other"),
        ("upper_tol,lower_tol,tolerance", "1,0,1", "width of the tolerance zone and its ends"),
        ("upper_tol,lower_tol", "-0.05,0.02", "above the upper one"),
        ("upper_tol,lower_tol,kind", "0.05,-0.02,thickness", "needs a nominal value"),
        ("tol", "0.05", "column .tol."),
        ("iso_tol_class", "7", "looks like a tolerance"),
    ],
)
def test_tolerances_that_are_not_read_are_told(
    tmp_path: Path, columns: str, cells: str, said: str
) -> None:
    (tmp_path / "t.csv").write_text(f"x,y,z,nx,ny,nz,{columns}\n1,2,3,0,0,1,{cells}\n")
    with pytest.raises(InvalidInput, match=said):
        read_table(tmp_path / "t.csv")
