"""Points to measure as a QIF document: valid, complete, and read back equal."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.formats.interop.inspection_files import as_qif, import_file
from cellwright.engine.formats.interop.qif.feature_points import inspection_of
from cellwright.engine.formats.interop.qif.single_points import written_points
from cellwright.engine.model.part_measurements import MeasurementPoint
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem
from tests.engine.formats.interop.test_results import SCHEMA

UM = st.integers(-2_000_000, 2_000_000)
SIZE = st.none() | st.integers(1, 50_000).map(lambda um: um * 1e-6)
NORMALS = st.sampled_from([(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8), (-0.36, 0.48, 0.8)])


@st.composite
def inspections(draw: st.DrawFn) -> list[MeasurementPoint]:
    """Points in the precision of problem files, with steps of an alignment that have no gap."""
    found, steps = [], draw(st.integers(0, 30))
    for number in range(draw(st.integers(0, 40))):
        kind = draw(st.sampled_from(["profile", "thickness", "roughness"]))
        found.append(
            MeasurementPoint(
                f"m{number}",
                f"m{number}",
                kind,
                (draw(UM) * 1e-6, draw(UM) * 1e-6, draw(UM) * 1e-6),
                draw(NORMALS),
                draw(SIZE),
                draw(SIZE),
                number + 1 if number < steps else 0,
                0.0 if kind == "profile" else draw(SIZE),
                draw(st.sampled_from(["", "us_probe", "slra"])),
            )
        )
    return found


def close(one: MeasurementPoint, other: MeasurementPoint) -> bool:
    """Whether points agree to a nanometre."""
    pairs = [
        *zip(one.position, other.position, strict=True),
        *zip(one.normal, other.normal, strict=True),
    ]
    sizes = [
        (getattr(one, size), getattr(other, size))
        for size in ("tolerance_m", "bore_m", "nominal_m")
    ]
    pairs += [(a, b) for a, b in sizes if a is not None and b is not None]
    names = (one.name, one.kind, one.step, one.tool) == (
        other.name,
        other.kind,
        other.step,
        other.tool,
    )
    return (
        names
        and all((a is None) == (b is None) for a, b in sizes)
        and all(abs(a - b) < 1e-9 for a, b in pairs)
    )


@given(points=inspections())
def test_points_are_read_back_equal(
    tmp_path_factory: pytest.TempPathFactory, points: list[MeasurementPoint]
) -> None:
    file = tmp_path_factory.mktemp("qif") / "points.qif"
    file.write_text(written_points(points), "utf-8")
    if not points:
        with pytest.raises(InvalidInput, match="no nominal features"):
            inspection_of(file)
        return
    found = inspection_of(file)
    assert not found.excluded
    assert all(close(*pair) for pair in zip(points, found.points, strict=True))


@pytest.mark.parametrize("name", ["bulkhead/twelve_points", "bulkhead/three_stations"])
def test_a_problem_that_went_through_qif_measures_the_same(tmp_path: Path, name: str) -> None:
    problem = load_problem(name)
    text, count, told = as_qif(problem)
    (tmp_path / "points.qif").write_text(text, "utf-8")
    inspection, parts, _ = import_file(tmp_path / "points.qif", "bulkhead")
    assert count == len(inspection.points) > 0
    assert not told
    assert not parts.impossible


def test_a_domain_without_measurements_is_told() -> None:
    with pytest.raises(InvalidInput, match="chooses no tools"):
        as_qif(load_problem("themse/one"))


@pytest.mark.skipif(not SCHEMA.is_file(), reason="the schemas of QIF are not there")
def test_the_document_is_valid_against_its_schema(tmp_path: Path) -> None:
    xmlschema = pytest.importorskip("xmlschema")
    point = MeasurementPoint(
        "m1", "m1", "thickness", (0.1, 0.2, 0.3), (0.0, 0.0, 1.0), 1e-5, 0.01, 1, 0.006, "us_probe"
    )
    more = MeasurementPoint(
        "m2", "m2", "roughness", (0.1, 0.2, 0.3), (0.0, 0.0, 1.0), nominal_m=1e-6
    )
    profile = MeasurementPoint(
        "m3", "m3", "profile", (0.1, 0.2, 0.3), (0.0, 0.0, 1.0), 1e-5, tool="slra"
    )
    file = tmp_path / "points.qif"
    file.write_text(written_points([point, more, profile]), "utf-8")
    told = [str(each.reason) for each in xmlschema.XMLSchema(str(SCHEMA)).iter_errors(str(file))]
    # it finds no keys in public samples, either
    assert [each for each in told if "XsdKey" not in each] == []


@given(points=inspections())
def test_ids_are_unique_and_refer_to_what_is_there(points: list[MeasurementPoint]) -> None:
    root = ElementTree.fromstring(written_points(points).encode())
    ids = [each.attrib["id"] for each in root.iter() if "id" in each.attrib]
    assert len(ids) == len({*ids})
    assert max(map(int, ids), default=0) <= int(root.attrib["idMax"])
    refers = [
        each.text
        for each in root.iter()
        if each.tag.endswith("Id") and not each.tag.endswith("QPId")
    ]
    assert {*refers} <= {*ids}
    assert all(int(each.attrib["n"]) == len(each) > 0 for each in root.iter() if "n" in each.attrib)
