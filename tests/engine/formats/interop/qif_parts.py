"""QIF documents of small parts, written face by face, and a plain reading of them: which points lie
on material.

The plain reading shares nothing with the importer. It looks at the edges in space alone: a ray
along the surface that leaves the material crosses an odd number of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

Floats = NDArray[np.float64]
STEPS = 2001


def _text(values: object) -> str:
    return " ".join(f"{each:.15g}" for each in np.ravel(np.asarray(values, float)))


@dataclass
class Document:
    """A QIF document under construction. `curves2` says whether loops have curves in parameters."""

    curves2: bool = True
    inches: bool = False
    parts: dict[str, list[str]] = field(default_factory=dict)
    count: int = 0

    def add(self, group: str, text: str) -> str:
        """Put an element into a group; `{id}` in it becomes the id that comes back."""
        self.count += 1
        self.parts.setdefault(group, []).append(text.replace("{id}", str(self.count)))
        return str(self.count)

    def vertex(self, place: Floats) -> str:
        """The id of a vertex."""
        point = self.add("PointSet", f'<Point id="{{id}}"><XYZ>{_text(place)}</XYZ></Point>')
        return self.add(
            "VertexSet", f'<Vertex id="{{id}}"><Point><Id>{point}</Id></Point></Vertex>'
        )

    def coedge(
        self, core: str, ends: tuple[Any, Any], flat: str = "", turned: bool = False, edge: str = ""
    ) -> tuple[str, str]:
        """The text of a coedge, and the id of its edge.

        `core` is a curve in space, `flat` one in parameters.
        """
        if not edge:
            kind = core[1:].split("Core")[0]
            curve = self.add("Curve13Set", f'<{kind} id="{{id}}">{core}</{kind}>')
            first, last = (self.vertex(np.asarray(each, float)) for each in ends)
            edge = self.add(
                "EdgeSet",
                "<Edge "
                f'id="{{id}}"><Curve><Id>{curve}</Id></Curve><VertexBeg><Id>{first}</Id></VertexBeg>'
                f"<VertexEnd><Id>{last}</Id></VertexEnd></Edge>",
            )
        text = f'<EdgeOriented turned="{str(turned).lower()}"><Id>{edge}</Id></EdgeOriented>'
        if flat and self.curves2:
            kind = flat[1:].split("Core")[0]
            two = self.add("Curve12Set", f'<{kind} id="{{id}}">{flat}</{kind}>')
            text += f"<Curve12><Id>{two}</Id></Curve12>"
        return f"<CoEdge>{text}</CoEdge>", edge

    def loop(self, coedges: Sequence[str], form: str = "OUTER") -> str:
        """The id of a loop."""
        return self.add(
            "LoopSet",
            f'<Loop form="{form}" id="{{id}}"><CoEdges>{"".join(coedges)}</CoEdges></Loop>',
        )

    def face(
        self, surface: str, loops: Sequence[str], attributes: str = "", transform: str = ""
    ) -> str:
        """The id of a face on a surface, given as the text of its core."""
        kind = surface[1:].split("Core")[0]
        of = self.add("SurfaceSet", f'<{kind} id="{{id}}">{surface}{transform}</{kind}>')
        ids = "".join(f"<Id>{each}</Id>" for each in loops)
        return self.add(
            "FaceSet",
            f'<Face id="{{id}}" '
            f"{attributes}><Surface><Id>{of}</Id></Surface><LoopIds>{ids}</LoopIds></Face>",
        )

    def feature(
        self, kind: str, faces: Sequence[str], definition: str = "", nominal: str = ""
    ) -> str:
        """The name of a feature of some faces."""
        of = self.add(
            "FeatureDefinitions",
            f'<{kind}FeatureDefinition id="{{id}}">{definition}</{kind}FeatureDefinition>',
        )
        ids = "".join(f"<Id>{each}</Id>" for each in faces)
        name = self.add(
            "FeatureNominals",
            f'<{kind}FeatureNominal id="{{id}}"><FeatureDefinitionId>{of}</FeatureDefinitionId>'
            f"<EntityInternalIds>{ids}</EntityInternalIds>{nominal}</{kind}FeatureNominal>",
        )
        return f"f{name}"

    def written(self, folder: Path) -> Path:
        """The file with all of it."""
        unit = ("inch", "0.0254") if self.inches else ("mm", "0.001")

        def sets(names: Sequence[str]) -> str:
            return "".join(
                f"<{name}>{''.join(self.parts.get(name, ()))}</{name}>" for name in names
            )

        file = folder / "part.qif"
        file.write_text(
            '<?xml version="1.0"?><QIFDocument xmlns="http://qifstandards.org/xsd/qif3" '
            'versionQIF="3.0.0">'
            f"<FileUnits><PrimaryUnits><LinearUnit><UnitName>{unit[0]}</UnitName><UnitConversion><Factor>{unit[1]}</Factor>"
            f"</UnitConversion></LinearUnit></PrimaryUnits></FileUnits>{sets(['DatumDefinitions', 'DatumReferenceFrames'])}"
            f"{sets(['Transforms'])}<Product><GeometrySet>{sets(['PointSet', 'Curve12Set', 'Curve13Set', 'SurfaceSet'])}"
            f"</GeometrySet><TopologySet>{sets(['VertexSet', 'EdgeSet', 'LoopSet', 'FaceSet', 'ShellSet', 'BodySet'])}"
            f"</TopologySet></Product><Features>{sets(['FeatureDefinitions', 'FeatureNominals'])}</Features></QIFDocument>"
        )
        return file


def segment(a: object, b: object) -> str:
    """A segment, in space or in parameters."""
    width = len(np.ravel(np.asarray(a)))
    return (
        f'<Segment1{width}Core domain="0 1"><StartPoint>{_text(a)}</StartPoint>'
        f"<EndPoint>{_text(b)}</EndPoint></Segment1{width}Core>"
    )


def arc(
    centre: object, radius: float, first: float, last: float, begin: object, normal: object = ()
) -> str:
    """An arc of a circle from one angle to another, counted from `begin`."""
    width = 3 if np.size(normal) else 2
    up = f"<Normal>{_text(normal)}</Normal>" if width == 3 else ""
    return (
        f'<ArcCircular1{width}Core domain="{_text([first, last])}"><Radius>{radius}</Radius>'
        f"<Center>{_text(centre)}</Center><DirBeg>{_text(begin)}</DirBeg>{up}</ArcCircular1{width}Core>"
    )


def ellipse(centre: object, a: float, b: float, begin: object, normal: object = ()) -> str:
    """A whole ellipse with two half axes."""
    width = 3 if np.size(normal) else 2
    up = f"<Normal>{_text(normal)}</Normal>" if width == 3 else ""
    return (
        f'<ArcConic1{width}Core domain="{_text([0, 2 * np.pi])}" '
        f'form="ELLIPSE"><A>{a}</A><B>{b}</B>'
        f"<Center>{_text(centre)}</Center><DirBeg>{_text(begin)}</DirBeg>{up}</ArcConic1{width}Core>"
    )


def polyline(points: object) -> str:
    """A polyline through points."""
    width = np.shape(points)[1]
    return (
        f'<Polyline1{width}Core domain="0 '
        f'1"><Points>{_text(points)}</Points></Polyline1{width}Core>'
    )


def nurbs(points: object, knots: object, order: int, weights: object = ()) -> str:
    """A NURBS curve."""
    width = np.shape(points)[1]
    heavy = f"<Weights>{_text(weights)}</Weights>" if np.size(weights) else ""
    ends = np.ravel(np.asarray(knots, float))[[order - 1, -order]]
    return (
        f"<Nurbs1{width}Core "
        f'domain="{_text(ends)}"><Order>{order}</Order><Knots>{_text(knots)}</Knots>'
        f"<CPs>{_text(points)}</CPs>{heavy}</Nurbs1{width}Core>"
    )


def aggregate(pieces: Sequence[tuple[str, bool]], width: int) -> str:
    """Curves one behind the other, each as it is or turned."""
    inner = "".join(
        f'<SubCurve turned="{str(turned).lower()}">{piece}</SubCurve>' for piece, turned in pieces
    )
    return (
        f'<Aggregate1{width}Core domain="0 '
        f'{len(pieces)}"><SubCurves>{inner}</SubCurves></Aggregate1{width}Core>'
    )


def plane(origin: object = (0, 0, 0), u: object = (1, 0, 0), v: object = (0, 1, 0)) -> str:
    """A plane."""
    return (
        f'<Plane23Core domainU="-1000 1000" domainV="-1000 1000"><Origin>{_text(origin)}</Origin>'
        f"<DirU>{_text(u)}</DirU><DirV>{_text(v)}</DirV></Plane23Core>"
    )


class Plain:
    """A plain reading of a document."""

    def __init__(self, file: Path) -> None:
        self.root = ElementTree.parse(file).getroot()
        for each in self.root.iter():
            each.tag = each.tag.rpartition("}")[2]
        self.found = {each.attrib["id"]: each for each in self.root.iter() if "id" in each.attrib}
        factor = self.root.find("FileUnits/PrimaryUnits/LinearUnit/UnitConversion/Factor")
        self.metres = float(factor.text or "") if factor is not None else 1e-3

    def faces(self, feature: str) -> list[Any]:
        """The faces of a feature."""
        ids = self.found[feature.removeprefix("f")].findall("EntityInternalIds/Id")
        return [
            self.found[str(each.text)] for each in ids if self.found[str(each.text)].tag == "Face"
        ]

    def surface(self, face: Any) -> Any:
        """The numbers of the surface of a face."""
        return self._to(face, "Surface")[0]

    def _to(self, element: Any, tag: str) -> Any:
        return self.found[element.find(f"{tag}/Id").text.strip()]

    def edges(self, face: Any) -> list[Floats]:
        """Points along each edge of a face, as often as its loops pass it."""
        loops = [self.found[each.text.strip()] for each in face.findall("LoopIds/Id")]
        return [
            self.edge(self.found[each.text.strip()])
            for loop in loops
            for each in loop.findall("CoEdges/CoEdge/EdgeOriented/Id")
        ]

    def edge(self, edge: Any) -> Floats:
        """Points along an edge from its first vertex to its last."""
        points = curve(self._to(edge, "Curve")[0])
        ends = [
            numbers(self._to(self._to(edge, tag), "Point"), "XYZ")
            for tag in ("VertexBeg", "VertexEnd")
        ]
        if np.linalg.norm(ends[0] - ends[1]) < 1e-9:
            return points
        if len(points) == 2:
            return np.stack([ends[0], (ends[0] + ends[1]) / 2, ends[1]])
        first, last = (int(np.argmin(np.linalg.norm(points - each, axis=1))) for each in ends)
        inner = (
            points[first + 1 : last]
            if first < last
            else np.concatenate([points[first + 1 : -1], points[:last]])
        )
        return np.concatenate([ends[:1], inner, ends[1:]])

    def on_plane(self, face: Any, points: Floats) -> NDArray[np.bool_]:
        """Whether points (metres) lie on the material of a plane face."""
        core = self.surface(face)
        origin, u, v = (numbers(core, name) for name in ("Origin", "DirU", "DirV"))
        z = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        x = np.array([0.8312, 0.4711, -0.2953])
        x = x - (x @ z) * z
        axes = np.stack([x / np.linalg.norm(x), np.cross(z, x / np.linalg.norm(x)), z], axis=1)
        sides = [(edge - origin) @ axes[:, :2] for edge in self.edges(face)]
        a, b = (
            np.concatenate([each[:-1] for each in sides]),
            np.concatenate([each[1:] for each in sides]),
        )
        return np.array([_odd(a, b, (p / self.metres - origin) @ axes) for p in points], bool)

    def on_round(self, face: Any, points: Floats) -> NDArray[np.bool_]:
        """Whether points (metres) lie on the material of a cylinder or a cone: they lie on its
        surface, and a ray that runs along its straight lines, away from its tip, crosses an odd
        number of edges."""
        core = self.surface(face)
        origin, z = numbers(core, "Axis/AxisPoint"), numbers(core, "Axis/Direction")
        same = core.findtext("Diameter", "0")
        radii = [float(core.findtext(f"Diameter{name}", same)) / 2 for name in ("Bottom", "Top")]
        away = -1 if radii[0] > radii[1] else 1
        x = np.array([0.8312, 0.4711, -0.2953])
        x = x - (x @ z) * z
        x, y = x / np.linalg.norm(x), np.cross(z, x / np.linalg.norm(x))
        a, b = [np.zeros((0, 2))], [np.zeros((0, 2))]
        for edge in self.edges(face):
            angle = np.unwrap(np.arctan2((edge - origin) @ y, (edge - origin) @ x))
            flat = np.stack([angle, (edge - origin) @ z * away], axis=1)
            if len(edge) > 3 or min(abs(np.diff(angle))) > 1e-6:  # others run along the rays
                a.append(flat[:-1])
                b.append(flat[1:])
        start, stop = np.concatenate(a), np.concatenate(b)
        found = []
        for p in points / self.metres - origin:
            at = np.arctan2(p @ y, p @ x) + 1.7e-5
            crossed = sum(
                _above(start, stop, at + 2 * np.pi * turn, p @ z * away) for turn in range(-2, 3)
            )
            slope = (radii[1] - radii[0]) / float(core.findtext("Length", "1"))
            away_from_axis = np.hypot(p @ x, p @ y) - radii[0] - slope * (p @ z)
            found.append(crossed % 2 == 1 and abs(away_from_axis) < 1e-6)
        return np.array(found)

    def on_feature(self, feature: str, points: Floats) -> NDArray[np.bool_]:
        """Whether points (metres) lie on the material of a feature of planes, or of cylinders
        and cones.
        """
        found = np.zeros(len(points), bool)
        for face in self.faces(feature):
            kind = self.surface(face).tag
            if kind == "Plane23Core":
                found |= self.on_plane(face, points)
            elif kind in ("Cylinder23Core", "Cone23Core"):
                found |= self.on_round(face, points)
        return found


def _odd(a: Floats, b: Floats, p: Floats) -> bool:
    if abs(p[2]) > 1e-6:
        return False
    crossed = (a[:, 1] > p[1]) != (b[:, 1] > p[1])
    a, b = a[crossed], b[crossed]
    at = a[:, 0] + (p[1] - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    return bool((at > p[0]).sum() % 2)


def _above(a: Floats, b: Floats, angle: float, height: float) -> int:
    crossed = (a[:, 0] > angle) != (b[:, 0] > angle)
    a, b = a[crossed], b[crossed]
    at = a[:, 1] + (angle - a[:, 0]) * (b[:, 1] - a[:, 1]) / (b[:, 0] - a[:, 0])
    return int((at > height).sum())


def numbers(element: Any, path: str) -> Floats:
    """The numbers at a path."""
    return np.array([float(each) for each in element.findtext(path, "").split()])


def curve(core: Any) -> Floats:
    """Points along a curve in space."""
    kind = core.tag.removesuffix("13Core")
    if kind == "Segment":
        return np.stack([numbers(core, "StartPoint"), numbers(core, "EndPoint")])
    if kind == "Polyline":
        return numbers(core, "Points").reshape(-1, 3)
    if kind == "Aggregate":
        pieces = core.find("SubCurves")
        return np.concatenate(
            [curve(each[0])[:: -1 if each.get("turned") == "true" else 1] for each in pieces]
        )
    if kind == "Nurbs":
        points, knots = numbers(core, "CPs").reshape(-1, 3), numbers(core, "Knots")
        weights = (
            numbers(core, "Weights") if core.find("Weights") is not None else np.ones(len(points))
        )
        degree = int(core.findtext("Order")) - 1
        spline = BSpline(knots, np.column_stack([points * weights[:, None], weights]), degree)
        found = spline(np.linspace(knots[degree], knots[-degree - 1], STEPS))
        return np.asarray(found[:, :3] / found[:, 3:])
    t = np.linspace(*(float(each) for each in core.get("domain").split()), STEPS)[:, None]
    x, z = numbers(core, "DirBeg"), numbers(core, "Normal")
    a, b = (float(core.findtext(name, core.findtext("Radius", "0"))) for name in "AB")
    return np.asarray(numbers(core, "Center") + a * np.cos(t) * x + b * np.sin(t) * np.cross(z, x))
