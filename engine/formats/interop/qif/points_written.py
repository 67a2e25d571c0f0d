"""Points to measure as a QIF 3.0 document: point features with a characteristic each, as `points_read` understands them.

A wish for a tool is a measurement device of the characteristic. The width of a hole has no place in QIF: it is an attribute.
Lengths are in millimetres.
"""

import uuid
from collections.abc import Iterable, Sequence
from xml.etree.ElementTree import Element, SubElement

from cellwright.engine.formats.interop.qif.writing import (
    attributed,
    document,
    linear_unit,
    plain,
    standard,
    text_of,
    under,
)
from cellwright.engine.model.measurement import MeasurementPoint, Triple

KINDS = {
    "profile": "SurfaceProfile",
    "thickness": "Thickness",
}  # the characteristics of kinds of measurements
OWN = "UserDefinedLinear"  # the characteristic of any other kind
BORE = "bore"  # the name of an attribute
DIGITS = 6  # behind the point, of lengths in millimetres: a nanometre
PLANS = uuid.UUID("0c6f3f0e-52a4-5f0e-8f43-6b8f1f0f2d11")  # ids of documents are made unique below it
LABELS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


def written_points(points: Sequence[MeasurementPoint]) -> str:
    """The points as a QIF document."""
    return _Document(points).text()


class _Document:
    def __init__(self, points: Sequence[MeasurementPoint]) -> None:
        self.points = points
        self.last = 0
        self.root = document()
        self.definition = self._id()
        self.features = {each.name: self._id() for each in points}
        self.items = {each.name: self._id() for each in points}
        self.tools = {each: self._id() for each in sorted({point.tool for point in points if point.tool})}
        self.asked = [each for each in points if _asked(each)]

    def _id(self) -> int:
        self.last += 1
        return self.last

    def text(self) -> str:
        """The whole document. Its own id follows from what it says."""
        SubElement(self.root, "QPId").text = str(uuid.uuid5(PLANS, repr(tuple(self.points))))
        number = standard(self.root, self._id()) if self.asked else 0
        linear_unit(under(self.root, "FileUnits", "PrimaryUnits"), "mm")
        if self.points:
            self._datums()
            self._devices()
            self._features()
        if self.asked:
            self._characteristics(number)
        return text_of(self.root, self.last)

    def _datums(self) -> None:
        """The points of each step of the alignment make one datum; the datums follow their labels."""
        steps = sorted({each.step for each in self.points if each.step})
        if not steps:
            return
        listed = SubElement(self.root, "DatumDefinitions", n=str(len(steps)))
        for number, step in enumerate(steps):
            datum = SubElement(listed, "DatumDefinition", id=str(self._id()))
            SubElement(datum, "DatumLabel").text = _label(number, len(steps))
            _ids(
                datum,
                "FeatureNominalIds",
                [self.features[each.name] for each in self.points if each.step == step],
            )

    def _devices(self) -> None:
        if self.tools:
            listed = under(self.root, "MeasurementResources", "MeasurementDevices")
            listed.set("n", str(len(self.tools)))
            for name, number in self.tools.items():
                under(SubElement(listed, "MeasurementDevice", id=str(number)), "Name", text=name)

    def _features(self) -> None:
        aspects, count = SubElement(self.root, "Features"), str(len(self.points))
        listed = SubElement(aspects, "FeatureDefinitions", n="1")
        SubElement(listed, "PointFeatureDefinition", id=str(self.definition))
        listed = SubElement(aspects, "FeatureNominals", n=count)
        for point in self.points:
            self._nominal(listed, point)
        listed = SubElement(aspects, "FeatureItems", n=count)
        for point in self.points:
            item = SubElement(listed, "PointFeatureItem", id=str(self.items[point.name]))
            SubElement(item, "FeatureNominalId").text = str(self.features[point.name])
            SubElement(item, "FeatureName").text = point.name
            under(item, "DeterminationMode", "Checked", "CheckDetails", "Measured")

    def _nominal(self, listed: Element, point: MeasurementPoint) -> None:
        made = SubElement(listed, "PointFeatureNominal", id=str(self.features[point.name]))
        attributed(made, {BORE: _mm(point.bore_m)} if point.bore_m is not None else {})
        SubElement(made, "Name").text = point.name
        SubElement(made, "FeatureDefinitionId").text = str(self.definition)
        SubElement(made, "Location").text = " ".join(map(_mm, point.position))
        SubElement(made, "Normal").text = _numbers(point.normal)

    def _characteristics(self, number: int) -> None:
        aspects, count = SubElement(self.root, "Characteristics"), str(len(self.asked))
        SubElement(aspects, "FormalStandardId").text = str(number)
        definitions = SubElement(aspects, "CharacteristicDefinitions", n=count)
        nominals = SubElement(aspects, "CharacteristicNominals", n=count)
        items = SubElement(aspects, "CharacteristicItems", n=count)
        for point in self.asked:
            defined = _define(definitions, point, self._id())
            nominated = self._nominate(nominals, point, defined)
            made = SubElement(items, f"{_characteristic(point)}CharacteristicItem", id=str(self._id()))
            SubElement(made, "Name").text = f"{point.kind} of {point.name}"
            _ids(made, "FeatureItemIds", [self.items[point.name]])
            if point.tool:
                _ids(made, "MeasurementDeviceIds", [self.tools[point.tool]])
            SubElement(made, "CharacteristicNominalId").text = str(nominated)

    def _nominate(self, listed: Element, point: MeasurementPoint, definition: int) -> int:
        number = self._id()
        made = SubElement(listed, f"{_characteristic(point)}CharacteristicNominal", id=str(number))
        SubElement(made, "CharacteristicDefinitionId").text = str(definition)
        _ids(made, "FeatureNominalIds", [self.features[point.name]])
        if point.nominal_m is not None:
            SubElement(made, "TargetValue").text = _mm(point.nominal_m)
        return number


def _asked(point: MeasurementPoint) -> bool:
    """Whether more is asked of a point than its profile."""
    return point.kind != "profile" or bool(point.tolerance_m is not None or point.tool or point.nominal_m)


def _characteristic(point: MeasurementPoint) -> str:
    """The kind of a point's characteristic; in QIF a profile has a tolerance."""
    untold = point.kind == "profile" and point.tolerance_m is None
    return OWN if untold else KINDS.get(point.kind, OWN)


def _define(listed: Element, point: MeasurementPoint, number: int) -> int:
    kind, tolerance = _characteristic(point), point.tolerance_m
    made = SubElement(listed, f"{kind}CharacteristicDefinition", id=str(number))
    if kind == KINDS["profile"]:
        SubElement(made, "ToleranceValue").text = _mm(tolerance or 0.0)
    elif tolerance is None:
        SubElement(made, "NonTolerance").text = "MEASURED"
    else:
        zone = SubElement(made, "Tolerance")
        SubElement(zone, "MaxValue").text = _mm(tolerance / 2)
        SubElement(zone, "MinValue").text = _mm(-tolerance / 2)
        SubElement(zone, "DefinedAsLimit").text = "false"
    if kind == OWN:
        SubElement(made, "WhatToMeasure").text = point.kind
    return number


def _ids(parent: Element, tag: str, numbers: Iterable[int]) -> None:
    listed = SubElement(parent, tag)
    for number in numbers:
        SubElement(listed, "Id").text = str(number)
    listed.set("n", str(len(listed)))


def _label(number: int, of: int) -> str:
    """A label of a datum; labels are in order as texts, too."""
    return LABELS[number] if of <= len(LABELS) else f"A{number:04d}"


def _mm(metres: float) -> str:
    return plain(round(1e3 * metres, DIGITS) + 0.0)


def _numbers(v: Triple) -> str:
    return " ".join(plain(round(each, 9) + 0.0) for each in v)
