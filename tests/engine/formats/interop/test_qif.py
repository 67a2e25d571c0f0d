"""QIF documents: features in metres, points on their surfaces, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.formats.interop.qif.feature_points import inspection_of
from cellwright.engine.formats.interop.qif.nominal_features import read_features
from cellwright.engine.formats.interop.qif.point_placement import (
    INCH_M,
    curve_points,
    section_points,
    surface_points,
)
from cellwright.engine.model.part_measurements import DrawnFeature
from cellwright.kb.diagnostics import InvalidInput

HEAD = (
    '<?xml version="1.0"?><QIFDocument xmlns="http://qifstandards.org/xsd/qif3" versionQIF="3.0.0">'
)
UNITS = {
    "mm": "<LinearUnit><UnitName>mm</UnitName><UnitConversion><Factor>0.001</Factor></UnitConversion></LinearUnit>",
    "inch": "<LinearUnit><UnitName>inch</UnitName></LinearUnit>",
}
DEFINITIONS = """
<CylinderFeatureDefinition id="1"><InternalExternal>INTERNAL</InternalExternal><Diameter>20</Diameter><Length>40</Length>
</CylinderFeatureDefinition>
<PlaneFeatureDefinition id="2"/><ThreadedFeatureDefinition id="3"/>
<ConeFeatureDefinition id="4"><InternalExternal>EXTERNAL</InternalExternal><Diameter>10</Diameter>
<HalfAngle>0.5</HalfAngle><LargeEndDistance>8</LargeEndDistance><SmallEndDistance>2</SmallEndDistance></ConeFeatureDefinition>
<LineFeatureDefinition id="5"/>
<OppositeParallelPlanesFeatureDefinition id="6"><Width>5</Width><Length>30</Length></OppositeParallelPlanesFeatureDefinition>
"""
NOMINALS = """
<CylinderFeatureNominal id="11"><FeatureDefinitionId>1</FeatureDefinitionId>
<Axis><AxisPoint>1 2 3</AxisPoint><Direction>0 0 1</Direction></Axis></CylinderFeatureNominal>
<PlaneFeatureNominal id="12"><FeatureDefinitionId>2</FeatureDefinitionId><Location>0 0 5</Location><Normal>0 0 1</Normal>
<PolyLine count="4">0 0 5 100 0 5 100 100 5 0 100 5</PolyLine></PlaneFeatureNominal>
<ThreadedFeatureNominal id="13"><FeatureDefinitionId>3</FeatureDefinitionId></ThreadedFeatureNominal>
<ConeFeatureNominal id="14"><FeatureDefinitionId>4</FeatureDefinitionId>
<Axis><AxisPoint>0 0 0</AxisPoint><Direction>1 0 0</Direction></Axis></ConeFeatureNominal>
<LineFeatureNominal id="15"><FeatureDefinitionId>5</FeatureDefinitionId><Location>0 0 0</Location>
<Direction>0 1 0</Direction><Length>50</Length></LineFeatureNominal>
<OppositeParallelPlanesFeatureNominal id="16"><FeatureDefinitionId>6</FeatureDefinitionId>
<CenterPlane><Point>0 0 0</Point><Normal>0 0 1</Normal></CenterPlane><LengthVector>1 0 0</LengthVector>
</OppositeParallelPlanesFeatureNominal>
"""
TOLERANCES = """<Characteristics><CharacteristicDefinitions><DiameterCharacteristicDefinition id="21"><Tolerance>
<MaxValue>0.05</MaxValue><MinValue>-0.05</MinValue></Tolerance></DiameterCharacteristicDefinition></CharacteristicDefinitions>
<CharacteristicNominals><DiameterCharacteristicNominal id="22"><CharacteristicDefinitionId>21</CharacteristicDefinitionId>
<FeatureNominalIds n="1"><Id>11</Id></FeatureNominalIds></DiameterCharacteristicNominal></CharacteristicNominals>
</Characteristics>"""


def document(folder: Path, unit: str = "mm", nominals: str = NOMINALS, head: str = HEAD) -> Path:
    file = folder / "part.qif"
    file.write_text(
        f"{head}<FileUnits><PrimaryUnits>{UNITS[unit]}</PrimaryUnits></FileUnits><Features>"
        f"<FeatureDefinitions>{DEFINITIONS}</FeatureDefinitions><FeatureNominals>{nominals}</FeatureNominals>"
        f"</Features>{TOLERANCES}</QIFDocument>"
    )
    return file


def test_every_point_lies_on_its_feature_and_its_normal_leaves_the_material(tmp_path: Path) -> None:
    inspection = inspection_of(document(tmp_path))
    at = {
        name: [p for p in inspection.points if p.feature == name]
        for name in ("f11", "f12", "f14", "f15", "f16")
    }
    for p in at["f11"]:
        out = np.array(p.position) - (0.001, 0.002, p.position[2])
        assert np.linalg.norm(out) == pytest.approx(0.01)
        assert np.dot(out, p.normal) == pytest.approx(-0.01)
        assert 0.003 < p.position[2] < 0.043
    assert all(p.position[2] == pytest.approx(0.005) and 0 < p.position[0] < 0.1 for p in at["f12"])
    for p in at["f14"]:
        radius = 0.005 + p.position[0] * np.tan(0.5)
        assert np.hypot(p.position[1], p.position[2]) == pytest.approx(radius)
        assert np.dot(
            p.normal, (np.cos(0.5), *(np.sin(0.5) * np.array(p.position[1:]) / radius))
        ) == pytest.approx(0)
    assert all(0 < p.position[1] < 0.05 and p.position[0] == 0 for p in at["f15"])
    assert {p.kind for p in at["f16"]} == {"thickness"}
    assert all(p.position[2] == pytest.approx(0.0025) for p in at["f16"])


def test_features_without_a_scheme_are_excluded_with_a_reason(tmp_path: Path) -> None:
    inspection = inspection_of(document(tmp_path))
    assert [(each.feature, each.reason) for each in inspection.excluded] == [
        ("f13", "a thread needs a gauge")
    ]
    assert inspection.features == 6


def test_tolerances_are_the_width_of_the_zone(tmp_path: Path) -> None:
    cylinder = read_features(document(tmp_path))[0]
    assert dict(cylinder.tolerances) == {"Diameter": pytest.approx(1e-4)}
    assert section_points(cylinder) == 18  # 0.1 mm is less than 0.005 inch


def test_inches_are_inches(tmp_path: Path) -> None:
    metric, imperial = (read_features(document(tmp_path, unit))[0] for unit in ("mm", "inch"))
    assert imperial.sizes["Diameter"] == pytest.approx(25.4 * metric.sizes["Diameter"])
    assert imperial.position[2] == pytest.approx(25.4 * metric.position[2])


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ('<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><QIFDocument>', "refused"),
        (HEAD.replace("QIFDocument", "Other"), "not XML"),
        (HEAD + "<Features>", "not XML"),
    ],
)
def test_what_is_no_document_is_refused(tmp_path: Path, head: str, said: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        inspection_of(document(tmp_path, head=head))
    assert said in str(caught.value)


def test_deep_nesting_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as caught:
        inspection_of(document(tmp_path, nominals="<a>" * 100 + "</a>" * 100))
    assert caught.value.diagnostics[0].code == "K007"


@pytest.mark.parametrize(
    "nominal",
    [
        "<PlaneFeatureNominal "
        'id="1"><FeatureDefinitionId>99</FeatureDefinitionId></PlaneFeatureNominal>',
        "<LineFeatureNominal "
        'id="1"><FeatureDefinitionId>5</FeatureDefinitionId><Length>x</Length></LineFeatureNominal>',
    ],
)
def test_features_that_do_not_hold_together_are_said_with_their_line(
    tmp_path: Path, nominal: str
) -> None:
    with pytest.raises(InvalidInput) as caught:
        inspection_of(document(tmp_path, nominals=nominal))
    assert caught.value.diagnostics[0].where.line > 0


def plane(tolerance_in: float | None = None) -> DrawnFeature:
    tolerances = {} if tolerance_in is None else {"SurfaceProfile": tolerance_in * INCH_M}
    return DrawnFeature("f", "Plane", (0, 0, 0), (0, 0, 1), tolerances=tolerances)


@pytest.mark.parametrize(
    ("area", "tolerance", "count"),
    [(1, None, 3), (3, None, 4), (30, None, 5), (100, 0.005, 20), (100, 0.02, 10), (100, 0.05, 5)],
)
def test_points_on_surfaces_follow_the_rules(
    area: float, tolerance: float | None, count: int
) -> None:
    assert surface_points(area * INCH_M**2, plane(tolerance)) == count


@pytest.mark.parametrize(("length", "count"), [(0.5, 3), (3.5, 4), (4.9, 5), (80, 5)])
def test_points_on_curves_follow_the_rules(length: float, count: int) -> None:
    assert curve_points(length * INCH_M, plane()) == count


@given(st.floats(0.0001, 0.05), st.floats(0.0001, 0.05))
def test_a_narrower_tolerance_never_asks_for_fewer_points(one: float, other: float) -> None:
    narrow, wide = sorted((one, other))
    counts = [
        section_points(
            DrawnFeature(
                "f", "Cylinder", (0, 0, 0), (0, 0, 1), tolerances={"Diameter": each * INCH_M}
            )
        )
        for each in (narrow, wide)
    ]
    assert counts[0] >= counts[1]
