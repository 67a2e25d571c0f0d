"""Numbers in a QIF document: their units, and where they stand."""

import base64
import binascii

import numpy as np

from cellwright.engine.formats.interop.qif.document import Element, wrong
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.measurement import Triple
from cellwright.kb.diagnostics import Source
from cellwright.kb.files import File
from cellwright.kb.numbers import NumberError, decimal

UNITS_M = {
    "mm": 1e-3,
    "millimetre": 1e-3,
    "millimeter": 1e-3,
    "cm": 1e-2,
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "inch": 0.0254,
    "in": 0.0254,
    "foot": 0.3048,
    "ft": 0.3048,
}
ANGLES_RAD = {"radian": 1.0, "rad": 1.0, "degree": float(np.pi / 180), "deg": float(np.pi / 180)}
DOUBLE, SINGLE = 8, 4
LARGEST = 1e12


class Reading:
    """What is needed to read any part of a document: its file, its units, and its elements by their ids."""

    def __init__(self, root: Element, file: File, unit_m: float = 1e-3) -> None:
        """`unit_m` is the unit of length if the document names none."""
        self.file = file
        primary = root.at("FileUnits", "PrimaryUnits")
        self.metres = self._primary(primary, "LinearUnit", UNITS_M, unit_m)
        self.radians = self._primary(primary, "AngularUnit", ANGLES_RAD, 1.0)
        self._units = self._named(root.at("FileUnits"))

    def _primary(self, primary: Element | None, tag: str, known: dict[str, float], otherwise: float) -> float:
        unit = primary.at(tag) if primary is not None else None
        return self._unit(unit, known) if unit is not None else otherwise

    def _unit(self, unit: Element, known: dict[str, float]) -> float:
        """What one of a unit is in metres or radians."""
        if (factor := unit.at("UnitConversion", "Factor")) is not None:
            value = self.number(factor)
            if value <= 0:
                raise wrong(self.where(factor), "the factor of a unit must be more than 0")
            return value
        name = unit.text_at("UnitName")
        if name.lower() not in known:
            raise wrong(self.where(unit), f"unknown unit '{name}'", f"one of {', '.join(known)}")
        return known[name.lower()]

    def _named(self, units: Element | None) -> dict[str, float]:
        """All units of length that the document defines, in metres, by name."""
        if units is None:
            return {}
        groups = [group for group in (units.at("PrimaryUnits"), units.at("OtherUnits")) if group is not None]
        found = [unit for group in groups for unit in group.all("LinearUnit")]
        return {
            unit.text_at("UnitName"): self._unit(unit, UNITS_M) for unit in found if unit.at("UnitConversion")
        }

    def number(self, element: Element | None) -> float:
        """The only number in an element. Raises `InvalidInput`."""
        values = self.numbers(element)
        if element is None or len(values) != 1:
            raise wrong(self.where(element), "one number is needed here")
        return values[0]

    def length(self, element: Element | None) -> float:
        """The only length in an element, in metres; its `linearUnit` counts more than the unit of the file."""
        unit = element.attributes.get("linearUnit", "") if element is not None else ""
        metres = self._units.get(unit) or UNITS_M.get(unit.lower()) or self.metres
        return self.number(element) * metres

    def numbers(self, element: Element | None) -> list[float]:
        """The numbers in an element, none without one. Raises `InvalidInput`."""
        try:
            return [decimal(each, LARGEST) for each in element.text.split()] if element is not None else []
        except NumberError as error:
            raise wrong(self.where(element), f"a number here {error}") from None

    def vectors(self, parent: Element, tag: str, width: int) -> Floats:
        """The points (n, width) in a child of this tag, as text or in binary (`...Binary`). Raises `InvalidInput`."""
        if (binary := parent.at(f"{tag}Binary")) is not None:
            values = self._decoded(binary, width)
        else:
            values = np.array(self.numbers(parent.at(tag)), float)
        if len(values) == 0 or len(values) % width:
            raise wrong(self.where(parent.at(tag) or parent), f"{tag} needs groups of {width} numbers")
        return values.reshape(-1, width)

    def _decoded(self, element: Element, width: int) -> Floats:
        size = element.attributes.get("sizeElement", str(DOUBLE * width))
        kind = "<f4" if size == str(SINGLE * width) else "<f8"
        try:
            values = np.frombuffer(base64.b64decode(element.text), kind).astype(float)
        except (binascii.Error, ValueError):
            raise wrong(self.where(element), "this is not an array of numbers in base64") from None
        if not np.isfinite(values).all():
            raise wrong(self.where(element), "a number is not finite")
        return values

    def vector(self, parent: Element, *path: str, width: int = 3) -> Floats:
        """The vector (width,) at the end of a path. Raises `InvalidInput`."""
        element = parent.at(*path)
        values = self.numbers(element)
        if len(values) != width:
            raise wrong(self.where(element or parent), f"{path[-1]} needs {width} numbers")
        return np.array(values)

    def span(self, parent: Element, name: str) -> tuple[float, float]:
        """The range that an attribute or a child of this name gives; from 0 to 1 without one."""
        child = parent.at(name)
        text = parent.attributes.get(name, child.text if child is not None else "0 1")
        values = self.numbers(Element(name, {}, parent.line, text))
        if len(values) != 2:
            raise wrong(self.where(parent), f"{name} needs 2 numbers")
        return values[0], values[1]

    def where(self, element: Element | None) -> Source:
        """The place of an element in the file."""
        return self.file.line(element.line, 1) if element is not None else Source(self.file.path)

    def triple(
        self, element: Element, paths: tuple[tuple[str, ...], ...], scale: float = 1.0
    ) -> Triple | None:
        """Three numbers at the end of the first path that has them, times `scale`."""
        for path in paths:
            if (found := element.at(*path)) is not None:
                values = self.numbers(found)
                if len(values) == 3:
                    return (values[0] * scale, values[1] * scale, values[2] * scale)
        return None


def is_true(element: Element, attribute: str, otherwise: bool = False) -> bool:
    """Whether an attribute says `true` or `1`."""
    return element.attributes.get(attribute, str(otherwise)).strip().lower() in ("true", "1")
