"""Points of QIF features lie on the material of their faces, whatever curves and surfaces bound
it.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.interop.qif.feature_points import inspection_of
from cellwright.engine.model.part_measurements import Inspection
from tests.engine.formats.interop.qif_parts import (
    Document,
    Floats,
    Plain,
    aggregate,
    arc,
    ellipse,
    nurbs,
    plane,
    polyline,
    segment,
)

TURN = 2 * np.pi
ROOT = np.sqrt(0.5)
CIRCLE = [
    (1, 0),
    (1, 1),
    (0, 1),
    (-1, 1),
    (-1, 0),
    (-1, -1),
    (0, -1),
    (1, -1),
    (1, 0),
]  # of radius 1, as NURBS
KNOTS = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
WEIGHTS = [1, ROOT, 1, ROOT, 1, ROOT, 1, ROOT, 1]


class Sheet:
    """A plane somewhere in space on which loops are drawn."""

    def __init__(self, document: Document, scale: float = 1.0, tilted: bool = True) -> None:
        self.document = document
        self.scale = scale
        axes = (
            np.linalg.qr(np.array([[1.0, 2, 3], [-1, 0.5, 2], [0.3, -2, 1]]))[0]
            if tilted
            else np.eye(3)
        )
        self.u, self.v = axes[0] * scale, axes[1] * scale
        self.up = np.cross(axes[0], axes[1])
        self.origin = np.array([5.0, -3, 8]) if tilted else np.zeros(3)
        self.core = plane(self.origin, self.u, self.v)

    def at(self, flat: object) -> Floats:
        """Places in space."""
        return self.origin + np.asarray(flat, float) @ np.stack([self.u, self.v])

    def polygon(
        self, corners: Sequence[tuple[float, float]], form: str = "OUTER", turned: bool = False
    ) -> str:
        """A loop of segments; every second edge runs the other way if `turned`."""
        edges = []
        for number, (a, b) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
            back = turned and number % 2 == 1
            p, q = (self.at(b), self.at(a)) if back else (self.at(a), self.at(b))
            edges.append(self.document.coedge(segment(p, q), (p, q), segment(a, b), turned=back)[0])
        return self.document.loop(edges, form)

    def circle(self, centre: tuple[float, float], radius: float, form: str = "INNER") -> str:
        """A loop of two arcs."""
        edges = []
        for first in (0.0, np.pi):
            ends = [
                self.at((centre[0] + radius * np.cos(t), centre[1] + radius * np.sin(t)))
                for t in (first, first + np.pi)
            ]
            space = arc(
                self.at(centre),
                radius * self.scale,
                first,
                first + np.pi,
                self.u / self.scale,
                self.up,
            )
            flat = arc(centre, radius, first, first + np.pi, (1, 0))
            edges.append(self.document.coedge(space, (ends[0], ends[1]), flat)[0])
        return self.document.loop(edges, form)

    def whole(self, space: str, flat: str, start: tuple[float, float], form: str = "INNER") -> str:
        """A loop of one closed curve."""
        place = self.at(start)
        return self.document.loop([self.document.coedge(space, (place, place), flat)[0]], form)


RECTANGLE = [(0.0, 0.0), (100.0, 0.0), (100.0, 60.0), (0.0, 60.0)]


def ellipse_hole(sheet: Sheet) -> str:
    up, along = sheet.up, (sheet.u + sheet.v) / (sheet.scale * np.sqrt(2))
    return sheet.whole(
        ellipse(sheet.at((50, 30)), 30 * sheet.scale, 12 * sheet.scale, along, up),
        ellipse((50, 30), 30, 12, (ROOT, ROOT)),
        (50 + 30 * ROOT, 30 + 30 * ROOT),
    )


def nurbs_hole(sheet: Sheet) -> str:
    flat = np.array(CIRCLE) * 25 + (50, 30)
    return sheet.whole(
        nurbs(sheet.at(flat), KNOTS, 3, WEIGHTS), nurbs(flat, KNOTS, 3, WEIGHTS), (75, 30)
    )


def polyline_hole(sheet: Sheet) -> str:
    flat = np.array([(20, 10), (80, 10), (80, 50), (50, 20), (20, 50), (20, 10)], float)
    return sheet.whole(polyline(sheet.at(flat)), polyline(flat), (20, 10))


def aggregate_hole(sheet: Sheet) -> str:
    """A slot: two straight sides, and two half circles; one part runs the other way."""
    pieces = [
        ((30, 20), (70, 20)),
        ((70, 20), 90),
        ((30, 40), (70, 40)),
        ((30, 40), 270),
    ]
    flat, space = [], []
    for number, (start, what) in enumerate(pieces):
        if isinstance(what, tuple):
            flat.append((segment(start, what), number == 2))
            space.append((segment(sheet.at(start), sheet.at(what)), number == 2))
        else:
            x = 70 if what == 90 else 30
            first = -np.pi / 2 if what == 90 else np.pi / 2
            flat.append((arc((x, 30), 10, first, first + np.pi, (1, 0)), False))
            unit = sheet.u / sheet.scale
            space.append(
                (
                    arc(sheet.at((x, 30)), 10 * sheet.scale, first, first + np.pi, unit, sheet.up),
                    False,
                )
            )
    return sheet.whole(aggregate(space, 3), aggregate(flat, 2), (30, 20))


HOLES = {
    "arcs": lambda sheet: sheet.circle((50, 30), 26),
    "ellipse": ellipse_hole,
    "nurbs": nurbs_hole,
    "polyline": polyline_hole,
    "aggregate": aggregate_hole,
}


def on_material(file: Path, edge_m: float | None = None) -> Inspection:
    """The inspection of a document, all of whose points lie on material by the plain reading."""
    found, plain = inspection_of(file, edge_m=edge_m), Plain(file)
    for feature in {each.feature for each in found.points}:
        points = np.array([each.position for each in found.points if each.feature == feature])
        assert plain.on_feature(feature, points).all(), points
    return found


@pytest.mark.parametrize("hole", HOLES)
@pytest.mark.parametrize("flat", [True, False], ids=["parameters", "space"])
@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_points_keep_out_of_holes_bounded_by_any_curve(
    tmp_path: Path, hole: str, flat: bool, scale: float
) -> None:
    document = Document(curves2=flat, inches=scale > 1)
    sheet = Sheet(document, scale)
    face = document.face(sheet.core, [sheet.polygon(RECTANGLE, turned=True), HOLES[hole](sheet)])
    document.feature("Plane", [face], nominal="<Normal>0 0 1</Normal>")
    found = on_material(document.written(tmp_path))
    assert len(found.points) >= 3
    assert all(np.allclose(each.normal, sheet.up) for each in found.points)


def test_a_turned_face_has_its_normal_at_the_other_side(tmp_path: Path) -> None:
    document = Document()
    sheet = Sheet(document)
    document.feature(
        "Plane", [document.face(sheet.core, [sheet.polygon(RECTANGLE)], 'turned="true"')]
    )
    found = on_material(document.written(tmp_path))
    assert all(np.allclose(each.normal, -sheet.up) for each in found.points)


def test_points_spread_over_all_faces_of_a_feature_and_not_between_them(tmp_path: Path) -> None:
    document = Document()
    sheet = Sheet(document, tilted=False)
    squares = [[(x, 0.0), (x + 10, 0.0), (x + 10, 10.0), (x, 10.0)] for x in (0.0, 200.0, 400.0)]
    faces = [document.face(sheet.core, [sheet.polygon(square)]) for square in squares]
    document.feature("Plane", faces)
    found = on_material(document.written(tmp_path))
    assert {int(each.position[0] // 0.2) for each in found.points} == {0, 1, 2}


@pytest.mark.parametrize("gap", [0.0, 2.0, 4.9])
def test_points_stay_as_far_from_edges_as_asked(tmp_path: Path, gap: float) -> None:
    document = Document()
    sheet = Sheet(document, tilted=False)
    face = document.face(
        sheet.core,
        [sheet.polygon([(0, 0), (100, 0), (100, 60), (0, 60)]), sheet.circle((50, 30), 20)],
    )
    document.feature("Plane", [face])
    for each in on_material(document.written(tmp_path), gap * 1e-3).points:
        x, y = each.position[0] * 1e3, each.position[1] * 1e3
        assert min(x, y, 100 - x, 60 - y, np.hypot(x - 50, y - 30) - 20) >= gap - 1e-6


def test_where_material_is_too_narrow_the_points_lie_in_its_middle_and_it_is_said(
    tmp_path: Path,
) -> None:
    document = Document()
    sheet = Sheet(document, tilted=False)
    frame = document.face(
        sheet.core,
        [sheet.polygon(RECTANGLE), sheet.polygon([(1, 1), (99, 1), (99, 59), (1, 59)], "INNER")],
    )
    name = document.feature("Plane", [frame])
    found = on_material(document.written(tmp_path), 5e-3)
    assert [each.feature for each in found.remarks] == [name]
    assert "5 mm" in found.remarks[0].reason
    assert len(on_material(document.written(tmp_path)).points) >= 3


def test_a_face_of_many_loops_in_one_another(tmp_path: Path) -> None:
    """An island in a hole is a face of its own."""
    document = Document()
    sheet = Sheet(document)
    ring = document.face(
        sheet.core, [sheet.circle((50, 30), 29, "OUTER"), sheet.circle((50, 30), 20)]
    )
    island = document.face(
        sheet.core, [sheet.circle((50, 30), 10, "OUTER"), sheet.circle((50, 30), 5)]
    )
    document.feature("Plane", [ring, island])
    found = on_material(document.written(tmp_path))
    away = [
        np.linalg.norm(np.array(each.position) * 1e3 - sheet.at((50, 30))) for each in found.points
    ]
    assert all(5 < each < 10 or 20 < each < 29 for each in away)


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    reach=st.lists(st.floats(20, 100), min_size=3, max_size=12),
    holes=st.lists(
        st.tuples(st.floats(-60, 60), st.floats(-60, 60), st.floats(0.5, 15)), max_size=6
    ),
    flat=st.booleans(),
)
def test_points_lie_on_material_of_any_star_with_round_holes(
    tmp_path: Path, reach: list[float], holes: list[tuple[float, float, float]], flat: bool
) -> None:
    document = Document(curves2=flat)
    sheet = Sheet(document)
    angles = np.arange(len(reach)) / len(reach) * TURN
    corners = [(r * np.cos(t), r * np.sin(t)) for r, t in zip(reach, angles, strict=True)]
    apart = [
        each
        for number, each in enumerate(holes)
        if np.hypot(*each[:2]) + each[2] < min(reach) / 2.1
        and all(
            np.hypot(each[0] - o[0], each[1] - o[1]) > each[2] + o[2] + 0.5 for o in holes[:number]
        )
    ]
    loops = [sheet.polygon(corners), *(sheet.circle((x, y), r) for x, y, r in apart)]
    document.feature("Plane", [document.face(sheet.core, loops)])
    assert len(on_material(document.written(tmp_path)).points) >= 3


def cylinder(
    diameter: float = 20, length: float = 50, scale: float = 1.0, attributes: str = ""
) -> str:
    return (
        f'<Cylinder23Core scaleV="{scale}" '
        f"{attributes}><Diameter>{diameter}</Diameter><Length>{length}</Length><Axis>"
        "<AxisPoint>0 0 0</AxisPoint><Direction>0 0 1</Direction></Axis><Sweep><DirBeg>1 0 "
        "0</DirBeg>"
        f"<DomainAngle>0 {TURN:.15g}</DomainAngle></Sweep></Cylinder23Core>"
    )


def cone(bottom: float, top: float, length: float = 20) -> str:
    return (
        f"<Cone23Core><DiameterBottom>{bottom}</DiameterBottom><DiameterTop>{top}</DiameterTop><Length>{length}</Length>"
        "<Axis><AxisPoint>0 0 0</AxisPoint><Direction>0 0 1</Direction></Axis><Sweep><DirBeg>1 "
        "0 0</DirBeg>"
        f"<DomainAngle>0 {TURN:.15g}</DomainAngle></Sweep></Cone23Core>"
    )


def ring(document: Document, radius: float, height: float, up: bool = True) -> str:
    """A coedge round the axis at a height, without a curve in parameters."""
    place = (radius, 0, height)
    return document.coedge(
        arc((0, 0, height), radius, 0, TURN, (1, 0, 0), (0, 0, 1 if up else -1)), (place, place)
    )[0]


ROUND = "<InternalExternal>EXTERNAL</InternalExternal><Diameter>20</Diameter><Length>50</Length>"
AXIS = "<Axis><AxisPoint>0 0 0</AxisPoint><Direction>0 0 1</Direction></Axis>"


def seamed(document: Document, low: float, high: float, scale: float) -> str:
    """The one loop of a whole cylinder: up and down the seam, and round both ends."""
    a, b = (10, 0, low), (10, 0, high)
    seam, edge = document.coedge(
        segment(a, b), (a, b), segment((TURN, low / scale), (TURN, high / scale))
    )
    bottom = document.coedge(
        arc((0, 0, low), 10, 0, TURN, (1, 0, 0), (0, 0, 1)),
        (a, a),
        segment((0, low / scale), (TURN, low / scale)),
    )[0]
    top = document.coedge(
        arc((0, 0, high), 10, 0, TURN, (1, 0, 0), (0, 0, 1)),
        (b, b),
        segment((TURN, high / scale), (0, high / scale)),
        True,
    )[0]
    down = document.coedge("", (a, b), segment((0, high / scale), (0, low / scale)), True, edge)[0]
    return document.loop([bottom, seam, top, down])


def window(document: Document, middle: float, width: float, low: float, high: float) -> str:
    """A hole in a cylinder of radius 10 around an angle."""
    first, last = middle - width / 2, middle + width / 2

    def at(angle: float, height: float) -> tuple[float, float, float]:
        return (10 * np.cos(angle), 10 * np.sin(angle), height)

    edges = []
    for height, start, stop, up in ((low, first, last, 1), (high, last, first, -1)):
        begin = (np.cos(start), np.sin(start), 0)
        edges.append(
            (
                document.coedge(
                    arc((0, 0, height), 10, 0, width, begin, (0, 0, up)),
                    (at(start, height), at(stop, height)),
                )[0],
                document.coedge(
                    segment(at(stop, height), at(stop, low + high - height)),
                    (at(stop, height), at(stop, low + high - height)),
                )[0],
            )
        )
    return document.loop([each for pair in edges for each in pair], "INNER")


@pytest.mark.parametrize("flat", [True, False], ids=["parameters", "space"])
@pytest.mark.parametrize("middle", [0.0, 2.0, 6.2])
def test_points_on_a_cylinder_with_a_seam_keep_out_of_a_window(
    tmp_path: Path, flat: bool, middle: float
) -> None:
    document = Document(curves2=flat)
    loops = [seamed(document, 5, 45, 0.1), window(document, middle, 2.5, 8, 42)]
    document.feature("Cylinder", [document.face(cylinder(scale=0.1), loops)], ROUND, AXIS)
    found = on_material(document.written(tmp_path))
    for each in found.points:
        assert 5e-3 < each.position[2] < 45e-3
        assert np.hypot(*each.position[:2]) == pytest.approx(0.01)
        assert np.dot(each.normal[:2], each.position[:2]) == pytest.approx(0.01)


@pytest.mark.parametrize("forms", [("OUTER", "INNER"), ("OUTER", "OUTER"), ("UNKNOWN", "UNKNOWN")])
@pytest.mark.parametrize("up", [True, False])
def test_two_rings_bound_a_band_whatever_they_are_called(
    tmp_path: Path, forms: tuple[str, str], up: bool
) -> None:
    document = Document()
    loops = [
        document.loop([ring(document, 10, 20, up)], forms[0]),
        document.loop([ring(document, 10, 30, not up)], forms[1]),
    ]
    document.feature("Cylinder", [document.face(cylinder(), loops)], ROUND, AXIS)
    found = on_material(document.written(tmp_path))
    assert all(0.02 < each.position[2] < 0.03 for each in found.points)
    assert (
        len({round(float(np.arctan2(each.position[1], each.position[0]))) for each in found.points})
        > 3
    )


def test_a_cone_to_its_tip_has_one_ring(tmp_path: Path) -> None:
    document = Document()
    loop = document.loop([ring(document, 10, 0)])
    definition = "<InternalExternal>EXTERNAL</InternalExternal><HalfAngle>0.4636476</HalfAngle>"
    document.feature("Cone", [document.face(cone(20, 0), [loop])], definition, AXIS)
    found = inspection_of(document.written(tmp_path))
    assert len(found.points) >= 3
    for each in found.points:
        assert 0 < each.position[2] < 0.02
        assert np.hypot(*each.position[:2]) == pytest.approx((0.02 - each.position[2]) / 2)


def sphere(radius: float = 10) -> str:
    return (
        f"<Sphere23Core><Diameter>{2 * radius}</Diameter><Location>0 0 "
        "0</Location><LatitudeLongitudeSweep>"
        f"<DirMeridianPrime>1 0 0</DirMeridianPrime><DomainLatitude>{-np.pi / 2} "
        f"{np.pi / 2}</DomainLatitude>"
        f"<DomainLongitude>0 {TURN}</DomainLongitude><DirNorthPole>0 0 "
        "1</DirNorthPole></LatitudeLongitudeSweep>"
        "</Sphere23Core>"
    )


@pytest.mark.parametrize("north", [True, False])
def test_a_cap_of_a_sphere_lies_at_the_left_of_its_ring(tmp_path: Path, north: bool) -> None:
    document = Document()
    loop = document.loop([ring(document, 8, 6, north)])
    document.feature("Sphere", [document.face(sphere(), [loop])], "<Diameter>20</Diameter>")
    found = inspection_of(document.written(tmp_path))
    assert len(found.points) >= 3
    for each in found.points:
        assert np.linalg.norm(each.position) == pytest.approx(0.01)
        assert (each.position[2] > 0.006) == north


@pytest.mark.parametrize("loops", ["", 'hasOuter="false"'])
def test_a_whole_sphere_needs_no_loop(tmp_path: Path, loops: str) -> None:
    document = Document()
    document.feature("Sphere", [document.face(sphere(), [], loops)])
    found = inspection_of(document.written(tmp_path))
    assert all(np.linalg.norm(each.position) == pytest.approx(0.01) for each in found.points)


@pytest.mark.parametrize("flat", [True, False], ids=["parameters", "space"])
def test_an_eighth_of_a_sphere_reaches_to_its_pole(tmp_path: Path, flat: bool) -> None:
    document = Document(curves2=flat)
    x, y, z = np.eye(3) * 10
    quarter = np.pi / 2
    pieces = [
        (x, y, (0, 0, 1), ((0, 0), (quarter, 0))),
        (y, z, (1, 0, 0), ((quarter, 0), (quarter, quarter))),
        (z, x, (0, 1, 0), ((0, quarter), (0, 0))),
    ]
    edges = [
        document.coedge(arc((0, 0, 0), 10, 0, quarter, a / 10, n), (a, b), segment(*ends))[0]
        for a, b, n, ends in pieces
    ]
    document.feature("SphericalSegment", [document.face(sphere(), [document.loop(edges)])])
    found = inspection_of(document.written(tmp_path))
    assert len(found.points) >= 3
    assert all(min(each.position) > 0 for each in found.points)


@pytest.mark.parametrize("flat", [True, False], ids=["parameters", "space"])
def test_a_bend_of_a_tube_lies_between_its_two_ends(tmp_path: Path, flat: bool) -> None:
    document = Document(curves2=flat)
    core = (
        "<Torus23Core><DiameterMinor>10</DiameterMinor><DiameterMajor>60</DiameterMajor><Axis><AxisPoint>0 "
        "0 0</AxisPoint>"
        "<Direction>0 0 1</Direction></Axis><LatitudeLongitudeSweep><DirMeridianPrime>1 0 "
        "0</DirMeridianPrime>"
        f"<DomainLatitude>0 {TURN}</DomainLatitude><DomainLongitude>0 "
        f"{TURN}</DomainLongitude></LatitudeLongitudeSweep>"
        "</Torus23Core>"
    )
    loops = []
    for angle, turned in ((0.3, 1), (1.8, -1)):
        out = np.array([np.cos(angle), np.sin(angle), 0])
        start, axis = out * 35, np.cross(out, (0, 0, 1)) * -turned
        ends = (0, TURN) if turned < 0 else (TURN, 0)
        flat_core = segment((angle, ends[1]), (angle, ends[0]))
        edge = document.coedge(arc(out * 30, 5, 0, TURN, out, -axis), (start, start), flat_core)[0]
        loops.append(document.loop([edge]))
    document.feature("ToroidalSegment", [document.face(core, loops)])
    found = inspection_of(document.written(tmp_path))
    assert len(found.points) >= 3
    for each in found.points:
        assert 0.3 < np.arctan2(each.position[1], each.position[0]) < 1.8


def patch(points: Floats) -> str:
    """A NURBS surface of order 3 by 3 over nine control points; u runs first."""
    return (
        "<Nurbs23Core><OrderU>3</OrderU><OrderV>3</OrderV><KnotsU>0 0 0 1 1 1</KnotsU><KnotsV>0 "
        "0 0 1 1 1</KnotsV>"
        f"<CPs>{' '.join(map(str, points.ravel()))}</CPs></Nurbs23Core>"
    )


@pytest.mark.parametrize("flat", [True, False], ids=["parameters", "space"])
def test_points_on_a_free_form_lie_within_its_loops(tmp_path: Path, flat: bool) -> None:
    """z = x * y / 50 over a square of 100: an exact NURBS."""
    net = np.array([[x, y, x * y / 50] for y in (0, 50, 100) for x in (0, 50, 100)], float)
    document = Document(curves2=flat)

    def at(p: Floats) -> Floats:
        x, y = p.T * 100
        return np.stack([x, y, x * y / 50], axis=1)

    def around(corners: list[tuple[float, float]], form: str) -> str:
        edges = []
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
            way = np.linspace(a, b, 60)
            space = at(way)
            edges.append(document.coedge(polyline(space), (space[0], space[-1]), segment(a, b))[0])
        return document.loop(edges, form)

    outer = around([(0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 0.9)], "OUTER")
    inner = around([(0.2, 0.2), (0.2, 0.8), (0.8, 0.8), (0.8, 0.2)], "INNER")
    document.feature("OtherSurface", [document.face(patch(net), [outer, inner])])
    found = inspection_of(document.written(tmp_path))
    assert len(found.points) >= 3
    for each in found.points:
        x, y, z = np.array(each.position) * 1e3
        assert z == pytest.approx(x * y / 50, abs=1e-6)
        assert min(x, y, 100 - x, 100 - y) > 10
        assert not (20 < x < 80 and 20 < y < 80)


def test_a_motion_of_surface_and_curves_moves_the_points(tmp_path: Path) -> None:
    document = Document(curves2=True)
    matrix = document.add(
        "Transforms",
        '<Transform id="{id}"><Rotation><XDirection>0 1 0</XDirection><YDirection>-1 0 '
        "0</YDirection>"
        "<ZDirection>0 0 1</ZDirection></Rotation><Origin>7 8 9</Origin></Transform>",
    )
    sheet = Sheet(document, tilted=False)
    loop = sheet.polygon(RECTANGLE)
    motion = f"<Transform><Id>{matrix}</Id></Transform>"
    document.parts["Curve13Set"] = [
        each.replace("</Segment13>", f"{motion}</Segment13>")
        for each in document.parts["Curve13Set"]
    ]
    vertices = document.parts["PointSet"]
    document.parts["PointSet"] = [moved_point(each) for each in vertices]
    document.feature("Plane", [document.face(sheet.core, [loop], transform=motion)])
    for each in inspection_of(document.written(tmp_path)).points:
        x, y, z = np.array(each.position) * 1e3
        assert z == pytest.approx(9)
        assert 7 - 60 < x < 7
        assert 8 < y < 108


def moved_point(text: str) -> str:
    head, _, rest = text.partition("<XYZ>")
    x, y, z = (float(each) for each in rest.partition("</XYZ>")[0].split())
    return f"{head}<XYZ>{7 - y} {8 + x} {9 + z}</XYZ></Point>"


@pytest.mark.parametrize("flat", [True, False], ids=["parameters", "space"])
def test_a_body_that_is_moved_moves_its_faces(tmp_path: Path, flat: bool) -> None:
    document = Document(curves2=flat)
    matrix = document.add(
        "Transforms",
        '<Transform id="{id}"><Rotation><XDirection>0 1 0</XDirection><YDirection>-1 0 '
        "0</YDirection>"
        "<ZDirection>0 0 1</ZDirection></Rotation><Origin>0 0 50</Origin></Transform>",
    )
    sheet = Sheet(document, tilted=False)
    face = document.face(sheet.core, [sheet.polygon(RECTANGLE)])
    document.add(
        "BodySet",
        "<Body "
        f'id="{{id}}"><Transform><Id>{matrix}</Id></Transform><FaceIds><Id>{face}</Id></FaceIds></Body>',
    )
    document.feature("Plane", [face])
    found = inspection_of(document.written(tmp_path))
    assert {round(each.position[2], 9) for each in found.points} == {0.05}
    assert all(-0.06 < each.position[0] < 0 < each.position[1] < 0.1 for each in found.points)


def test_curves_that_go_beyond_their_edges_are_cut_at_the_vertices(tmp_path: Path) -> None:
    document = Document(curves2=False)
    sheet = Sheet(document, tilted=False)
    edges = []
    for a, b in zip(RECTANGLE, [*RECTANGLE[1:], RECTANGLE[0]], strict=True):
        p, q = sheet.at(a), sheet.at(b)
        edges.append(document.coedge(segment(p - 3 * (q - p), q + 2 * (q - p)), (p, q))[0])
    document.feature("Plane", [document.face(sheet.core, [document.loop(edges)])])
    found = on_material(document.written(tmp_path))
    assert all(0 < each.position[0] < 0.1 and 0 < each.position[1] < 0.06 for each in found.points)


def test_the_thickness_of_two_planes_is_measured_where_both_are(tmp_path: Path) -> None:
    document = Document()
    sheet = Sheet(document, tilted=False)
    front = document.face(plane((0, 0, 5)), [sheet.polygon([(0, 0), (60, 0), (60, 60), (0, 60)])])
    back = document.face(
        plane((0, 0, 0)), [sheet.polygon([(40, 0), (100, 0), (100, 60), (40, 60)])], 'turned="true"'
    )
    document.feature(
        "OppositeParallelPlanes",
        [front, back],
        "<Width>5</Width>",
        "<CenterPlane><Point>0 0 2.5</Point><Normal>0 0 1</Normal></CenterPlane><LengthVector>1 "
        "0 0</LengthVector>",
    )
    found = inspection_of(document.written(tmp_path))
    assert {each.kind for each in found.points} == {"thickness"}
    assert all(
        0.04 < each.position[0] < 0.06 and each.position[2] == pytest.approx(0.005)
        for each in found.points
    )


def test_points_on_an_edge_have_the_mean_normal_of_its_faces(tmp_path: Path) -> None:
    document = Document(curves2=False)
    sheet = Sheet(document, tilted=False)
    loop = sheet.polygon(RECTANGLE)
    edge = document.parts["LoopSet"][0].split("<Id>")[1].split("<")[0]
    upright = [(0, 0, 0), (0, 0, -20), (100, 0, -20), (100, 0, 0)]
    edges = [f'<CoEdge><EdgeOriented turned="true"><Id>{edge}</Id></EdgeOriented></CoEdge>']
    edges += [document.coedge(segment(a, b), (a, b))[0] for a, b in pairwise(upright)]
    document.face(sheet.core, [loop])
    document.face(plane((0, 0, 0), (1, 0, 0), (0, 0, 1)), [document.loop(edges)])
    document.feature(
        "Line",
        [edge],
        nominal="<Location>0 0 0</Location><Direction>1 0 0</Direction><Length>100</Length>",
    )
    found = inspection_of(document.written(tmp_path))
    assert [each.position[0] * 1e3 for each in found.points] == pytest.approx(
        [12.5, 37.5, 62.5, 87.5]
    )
    assert all(np.allclose(each.normal, (0, -ROOT, ROOT)) for each in found.points)


def test_a_surface_of_unknown_kind_leaves_the_feature_to_its_nominal_sizes(tmp_path: Path) -> None:
    document = Document()
    name = document.feature("OtherSurface", [document.face("<Mystery23Core></Mystery23Core>", [])])
    found = inspection_of(document.written(tmp_path))
    assert [each.feature for each in found.excluded] == [name]
    assert "OtherSurface" in found.excluded[0].reason
