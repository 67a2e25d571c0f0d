"""The parts of URDF elements with numbers and shapes: origins, vectors, collision geometry."""

import math
from dataclasses import dataclass
from pathlib import Path

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.files import is_file
from cellwright.kb.loader.reader import Findings
from cellwright.kb.loader.xml import Element
from cellwright.kb.model.cell import Inertia
from cellwright.kb.model.shapes import (
    LARGEST,
    MESHES,
    Box,
    Cylinder,
    Mesh,
    PlacedShape,
    Pose,
    Shape,
    Sphere,
    Vector,
)
from cellwright.kb.numbers import NumberError, decimal

FARTHEST = 1e300  # more is no number for us; LARGEST is what a cell may have
LEAST = 1e-9  # a scale nearer to zero leaves nothing
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@dataclass(frozen=True, slots=True)
class ElementReader:
    """Reads elements and reports their errors. Meshes are looked up in `folders`."""

    findings: Findings
    folders: list[Path]

    def note(self, element: Element, message: str, hint: str) -> None:
        """Report an error in an element."""
        self.findings.add(element.where, "K703", message, hint)

    def broken(self, element: Element, message: str, hint: str) -> InvalidInput:
        """The exception for an error after which reading cannot continue."""
        self.note(element, message, hint)
        return InvalidInput(self.findings.diagnostics)

    def shapes(self, link: Element) -> tuple[PlacedShape, ...]:
        """The collision shapes of a link."""
        shapes = []
        for collision in link.all("collision"):
            geometry = collision.first("geometry")
            if geometry is None or len(geometry.children) != 1:
                self.note(collision, "a collision element without one geometry", "add <geometry>")
                continue
            shape = self._shape(geometry.children[0])
            if shape is not None:
                shapes.append(PlacedShape(shape, self.origin(collision)))
        return tuple(shapes)

    def _shape(self, element: Element) -> Shape | None:
        match element.tag:
            case "box":
                size = self.vector(element, "size", "0 0 0")
                return Box(size) if self._extent(element, *size) else None
            case "sphere":
                (radius,) = self.numbers(element, "radius", 1, "0")
                return Sphere(radius) if self._extent(element, radius) else None
            case "cylinder":
                (radius,), (length,) = (self.numbers(element, key, 1, "0") for key in ("radius", "length"))
                return Cylinder(radius, length) if self._extent(element, radius, length) else None
            case "mesh":
                return self._mesh(element)
            case _:
                self.note(element, f"<{element.tag}> is not a shape", "box, sphere, cylinder or mesh")
                return None

    def _extent(self, element: Element, *sizes: float) -> bool:
        if min(sizes) > 0:
            return self._finite(element, *sizes)
        self.findings.add(
            element.where, "K702", f"a <{element.tag}> without a positive size", "give its size"
        )
        return False

    def _mesh(self, element: Element) -> Mesh | None:
        name = element.get("filename")
        if name.startswith("package://") and ".." in Path(name).parts:
            hint = "name the folder with its packages under `packages`"
            self.findings.add(element.where, "K706", f"'{name[:80]}' leaves its package", hint)
            return None
        path = self._found(name)
        if path is None:
            hint = "name the folder with its packages under `packages`"
            self.findings.add(element.where, "K706", f"there is no mesh '{name[:80]}'", hint)
            return None
        if path.suffix.lower() not in MESHES:
            hint = f"convert it to one of: {', '.join(MESHES)}"
            self.note(element, f"'{path.suffix}' is not a supported mesh format", hint)
            return None
        scale = self.vector(element, "scale", "1 1 1")
        if min(map(abs, scale)) < LEAST:
            hint = "write 1, or 0.001 for millimetres"
            self.findings.add(element.where, "K702", "a scale of 0 leaves no volume", hint)
            return None
        return Mesh(str(path), scale, element.where)

    def _found(self, name: str) -> Path | None:
        """The file that a name leads to. A `package://` path is looked for within the folders of packages alone."""
        inside = name.removeprefix("package://").removeprefix("file://")
        if name.startswith("package://"):
            inside = inside.lstrip("/")
        candidates = (folder / part for folder in self.folders for part in (inside, inside.partition("/")[2]))
        return next((path for path in candidates if is_file(path) and self._is_inside(path)), None)

    def _is_inside(self, path: Path) -> bool:
        return any(path.resolve().is_relative_to(folder.resolve()) for folder in self.folders)

    def inertia(self, link: Element) -> Inertia | None:
        """The mass and the moments of a link; None if it has none."""
        element = link.first("inertial")
        if element is None:
            return None
        mass, moments = element.first("mass"), element.first("inertia")
        (weight,) = self.numbers(mass, "value", 1) if mass is not None else [0.0]
        values = (
            [self.numbers(moments, key, 1, "0")[0] for key in MOMENTS] if moments is not None else [0.0] * 6
        )
        if weight < 0:
            self.note(element, f"link '{link.get('name')}' has a mass below zero", "give its mass in kg")
        xx, xy, xz, yy, yz, zz = values
        return Inertia(weight, self.origin(element), (xx, xy, xz, yy, yz, zz))

    def origin(self, element: Element) -> Pose:
        """The pose in its `<origin>`."""
        origin = element.first("origin")
        if origin is None:
            return Pose()
        return Pose(self.vector(origin, "xyz", "0 0 0"), self.vector(origin, "rpy", "0 0 0"))

    def vector(self, element: Element, key: str, default: str) -> Vector:
        """Three numbers of an attribute."""
        x, y, z = self.numbers(element, key, 3, default)
        return (x, y, z) if self._finite(element, x, y, z) else (0.0, 0.0, 0.0)

    def _finite(self, element: Element, *values: float) -> bool:
        """Whether numbers are not larger than those of any cell; reported if they are."""
        if max(map(abs, values)) <= LARGEST:
            return True
        hint = "URDF has metres and radians"
        self.findings.add(element.where, "K113", f"a <{element.tag}> larger than {LARGEST:g}", hint)
        return False

    def numbers(self, element: Element, key: str, count: int, default: str = "") -> list[float]:
        """`count` finite numbers in an attribute. Another number of values is reported, and the result is zeros."""
        text = element.get(key, default)
        try:
            values = [decimal(part, FARTHEST) for part in text.split()]
        except NumberError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            self.note(
                element, f'{key}="{text[:40]}" is not {count} finite numbers', "separate them by blanks"
            )
            return [0.0] * count
        return values
