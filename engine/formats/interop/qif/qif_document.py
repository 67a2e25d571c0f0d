"""A QIF document as elements with text, and its numbers in their units; size is limited.

What only serves to show a part (views, notes, colours) is not kept.
"""

import base64
import binascii
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.part_measurements import Triple
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, read_file
from cellwright.kb.numbers import NumberError, read_decimal

MAX_QIF_DEPTH = 60
MAX_QIF_ELEMENTS = 2_000_000
PASSED_OVER = frozenset(
    {
        "Header",
        "Validation",
        "ViewSet",
        "NoteSet",
        "PartNoteSet",
        "NoteFlagSet",
        "LayerSet",
        "VisualizationSet",
    }
)


@dataclass(slots=True)
class QifElement:
    """An element: its tag without namespace, its attributes, text, and children in order."""

    tag: str
    attributes: dict[str, str]
    line: int
    text: str = ""
    children: list["QifElement"] = field(default_factory=list)

    def all(self, tag: str) -> Iterator["QifElement"]:
        """Its children of this tag."""
        return (child for child in self.children if child.tag == tag)

    def at(self, *path: str) -> "QifElement | None":
        """The first element at the end of a path of tags."""
        element: QifElement | None = self
        for tag in path:
            element = next(element.all(tag), None) if element is not None else None
        return element

    def text_at(self, *path: str) -> str:
        """The text at the end of a path, stripped; empty if there is none."""
        element = self.at(*path)
        return element.text.strip() if element is not None else ""


def read_qif_document(path: Path) -> tuple[QifElement, File]:
    """The root of a QIF document. Raises `InvalidInput`."""
    file = read_file(path)
    reader = _Reader(file)
    root = reader.read()
    if root.tag != "QIFDocument":
        raise qif_error(Source(file.path), "not a QIF document", "its root element is QIFDocument")
    return root, file


def qif_error(where: Source, message: str, hint: str = "") -> InvalidInput:
    """The error for a QIF file that cannot be read."""
    return InvalidInput([Diagnostic(where, "K804", message, hint)])


class _Reader:
    """Builds the tree. Elements below a skipped element are only counted."""

    def __init__(self, file: File) -> None:
        self._file = file
        self._parser = expat.ParserCreate("utf-8", " ")
        self._parser.buffer_text = True
        self._stack = [QifElement("", {}, 0)]
        self._skipping = 0
        self._count = 0
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.StartDoctypeDeclHandler = self._refuse
        self._parser.EntityDeclHandler = self._refuse

    def read(self) -> QifElement:
        try:
            self._parser.Parse(self._file.text.encode(), True)
        except expat.ExpatError as error:
            where = self._file.line(error.lineno, error.offset + 1)
            said = expat.ErrorString(error.code)
            raise qif_error(where, f"not XML: {said}", "close every element") from None
        return self._stack[0].children[0]

    def _here(self) -> Source:
        return self._file.line(self._parser.CurrentLineNumber, self._parser.CurrentColumnNumber + 1)

    def _refuse(self, *_: object) -> None:
        raise qif_error(self._here(), "document types and entities are refused", "remove it")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > MAX_QIF_ELEMENTS or len(self._stack) + self._skipping > MAX_QIF_DEPTH:
            raise InvalidInput(
                [Diagnostic(self._here(), "K007", "nested too deeply or too many elements")]
            )
        tag = name.rpartition(" ")[2]
        if self._skipping or tag in PASSED_OVER:
            self._skipping += 1
            return
        element = QifElement(tag, attributes, self._parser.CurrentLineNumber)
        self._stack[-1].children.append(element)
        self._stack.append(element)

    def _end(self, _name: str) -> None:
        if self._skipping:
            self._skipping -= 1
        else:
            self._stack.pop()

    def _text(self, text: str) -> None:
        if not self._skipping:
            self._stack[-1].text += text


QIF_UNITS_M = {
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
MAX_QIF_NUMBER = 1e12


class DocumentReading:
    """What is needed to read any part of a document: its file, its units, and its elements by
    their ids.
    """

    def __init__(self, root: QifElement, file: File, unit_m: float = 1e-3) -> None:
        """`unit_m` is the unit of length if the document names none."""
        self.file = file
        primary = root.at("FileUnits", "PrimaryUnits")
        self.metres = self._primary(primary, "LinearUnit", QIF_UNITS_M, unit_m)
        self.radians = self._primary(primary, "AngularUnit", ANGLES_RAD, 1.0)
        self._units = self._named(root.at("FileUnits"))

    def _primary(
        self, primary: QifElement | None, tag: str, known: dict[str, float], otherwise: float
    ) -> float:
        unit = primary.at(tag) if primary is not None else None
        return self._unit(unit, known) if unit is not None else otherwise

    def _unit(self, unit: QifElement, known: dict[str, float]) -> float:
        """What one of a unit is in metres or radians."""
        if (factor := unit.at("UnitConversion", "Factor")) is not None:
            value = self.number(factor)
            if value <= 0:
                raise qif_error(self.where(factor), "the factor of a unit must be more than 0")
            return value
        name = unit.text_at("UnitName")
        if name.lower() not in known:
            raise qif_error(
                self.where(unit), f"unknown unit '{name}'", f"one of {', '.join(known)}"
            )
        return known[name.lower()]

    def _named(self, units: QifElement | None) -> dict[str, float]:
        """All units of length that the document defines, in metres, by name."""
        if units is None:
            return {}
        groups = [
            group
            for group in (units.at("PrimaryUnits"), units.at("OtherUnits"))
            if group is not None
        ]
        units_named = [unit for group in groups for unit in group.all("LinearUnit")]
        return {
            unit.text_at("UnitName"): self._unit(unit, QIF_UNITS_M)
            for unit in units_named
            if unit.at("UnitConversion")
        }

    def number(self, element: QifElement | None) -> float:
        """The only number in an element. Raises `InvalidInput`."""
        values = self.numbers(element)
        if element is None or len(values) != 1:
            raise qif_error(self.where(element), "one number is needed here")
        return values[0]

    def length(self, element: QifElement | None) -> float:
        """The only length in an element, in metres; its `linearUnit` counts more than the unit
        of the file.
        """
        unit = element.attributes.get("linearUnit", "") if element is not None else ""
        metres = self._units.get(unit) or QIF_UNITS_M.get(unit.lower()) or self.metres
        return self.number(element) * metres

    def numbers(self, element: QifElement | None) -> list[float]:
        """The numbers in an element, none without one. Raises `InvalidInput`."""
        try:
            return (
                [read_decimal(word, MAX_QIF_NUMBER) for word in element.text.split()]
                if element is not None
                else []
            )
        except NumberError as error:
            raise qif_error(self.where(element), f"a number here {error}") from None

    def vectors(self, parent: QifElement, tag: str, width: int) -> Floats:
        """The points (n, width) in a child of this tag, as text or in binary (`...Binary`).

        Raises `InvalidInput`.
        """
        if (binary := parent.at(f"{tag}Binary")) is not None:
            values = self._decoded(binary, width)
        else:
            values = np.array(self.numbers(parent.at(tag)), float)
        if len(values) == 0 or len(values) % width:
            raise qif_error(
                self.where(parent.at(tag) or parent), f"{tag} needs groups of {width} numbers"
            )
        return values.reshape(-1, width)

    def _decoded(self, element: QifElement, width: int) -> Floats:
        size = element.attributes.get("sizeElement", str(DOUBLE * width))
        kind = "<f4" if size == str(SINGLE * width) else "<f8"
        try:
            values = np.frombuffer(base64.b64decode(element.text), kind).astype(float)
        except (binascii.Error, ValueError):
            raise qif_error(
                self.where(element), "this is not an array of numbers in base64"
            ) from None
        if not np.isfinite(values).all():
            raise qif_error(self.where(element), "a number is not finite")
        return values

    def vector(self, parent: QifElement, *path: str, width: int = 3) -> Floats:
        """The vector (width,) at the end of a path. Raises `InvalidInput`."""
        element = parent.at(*path)
        values = self.numbers(element)
        if len(values) != width:
            raise qif_error(self.where(element or parent), f"{path[-1]} needs {width} numbers")
        return np.array(values)

    def span(self, parent: QifElement, name: str) -> tuple[float, float]:
        """The range that an attribute or a child of this name gives; from 0 to 1 without one."""
        child = parent.at(name)
        text = parent.attributes.get(name, child.text if child is not None else "0 1")
        values = self.numbers(QifElement(name, {}, parent.line, text))
        if len(values) != 2:
            raise qif_error(self.where(parent), f"{name} needs 2 numbers")
        return values[0], values[1]

    def where(self, element: QifElement | None) -> Source:
        """The place of an element in the file."""
        return self.file.line(element.line, 1) if element is not None else Source(self.file.path)

    def triple(
        self, element: QifElement, paths: tuple[tuple[str, ...], ...], scale: float = 1.0
    ) -> Triple | None:
        """Three numbers at the end of the first path that has them, times `scale`."""
        for path in paths:
            if (triple_element := element.at(*path)) is not None:
                values = self.numbers(triple_element)
                if len(values) == 3:
                    return (values[0] * scale, values[1] * scale, values[2] * scale)
        return None


def is_true(element: QifElement, attribute: str, otherwise: bool = False) -> bool:
    """Whether an attribute says `true` or `1`."""
    return element.attributes.get(attribute, str(otherwise)).strip().lower() in ("true", "1")
