"""Single points to measure in QIF: what a document asks of each, and documents of points written.

A wish for a tool is a measurement device of the characteristic. The width of a hole has no place in
QIF: it is an attribute. Lengths are in millimetres.
"""

import uuid
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

from cellwright.engine.formats.interop.measurement_tables import MEASUREMENT_NAME
from cellwright.engine.formats.interop.qif.document_writing import (
    add_attributes,
    add_path,
    add_standard,
    document_text,
    linear_unit,
    new_document,
    plain_number,
)
from cellwright.engine.formats.interop.qif.qif_document import DocumentReading, QifElement
from cellwright.engine.model.part_measurements import MeasurementPoint, Triple

CHARACTERISTIC_OF_KIND = {
    "profile": "SurfaceProfile",
    "thickness": "Thickness",
}  # the characteristics of kinds of measurements
OWN_CHARACTERISTIC = "UserDefinedLinear"  # the characteristic of any other kind
BORE_ATTRIBUTE = "bore"  # the name of an attribute
LENGTH_DIGITS = 6  # behind the point, of lengths in millimetres: a nanometre
PLAN_NAMESPACE = uuid.UUID(
    "0c6f3f0e-52a4-5f0e-8f43-6b8f1f0f2d11"
)  # ids of documents are made unique below it
DATUM_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


def written_points(points: Sequence[MeasurementPoint]) -> str:
    """The points as a QIF document."""
    return _Document(points).text()


class _Document:
    def __init__(self, points: Sequence[MeasurementPoint]) -> None:
        self.points = points
        self.last = 0
        self.root = new_document()
        self.definition = self._id()
        self.features = {planned.name: self._id() for planned in points}
        self.items = {planned.name: self._id() for planned in points}
        self.tools = {
            tool: self._id() for tool in sorted({point.tool for point in points if point.tool})
        }
        self.asked = [planned for planned in points if _asks_more(planned)]

    def _id(self) -> int:
        self.last += 1
        return self.last

    def text(self) -> str:
        """The whole document. Its own id follows from what it says."""
        SubElement(self.root, "QPId").text = str(
            uuid.uuid5(PLAN_NAMESPACE, repr(tuple(self.points)))
        )
        number = add_standard(self.root, self._id()) if self.asked else 0
        linear_unit(add_path(self.root, "FileUnits", "PrimaryUnits"), "mm")
        if self.points:
            self._datums()
            self._devices()
            self._features()
        if self.asked:
            self._characteristics(number)
        return document_text(self.root, self.last)

    def _datums(self) -> None:
        """The points of each step of the alignment make one datum; the datums follow their
        labels.
        """
        steps = sorted({datum_point.step for datum_point in self.points if datum_point.step})
        if not steps:
            return
        listed = SubElement(self.root, "DatumDefinitions", n=str(len(steps)))
        for number, step in enumerate(steps):
            datum = SubElement(listed, "DatumDefinition", id=str(self._id()))
            SubElement(datum, "DatumLabel").text = _datum_label(number, len(steps))
            _add_ids(
                datum,
                "FeatureNominalIds",
                [
                    self.features[datum_point.name]
                    for datum_point in self.points
                    if datum_point.step == step
                ],
            )

    def _devices(self) -> None:
        if self.tools:
            listed = add_path(self.root, "MeasurementResources", "MeasurementDevices")
            listed.set("n", str(len(self.tools)))
            for name, number in self.tools.items():
                add_path(SubElement(listed, "MeasurementDevice", id=str(number)), "Name", text=name)

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
            add_path(item, "DeterminationMode", "Checked", "CheckDetails", "Measured")

    def _nominal(self, listed: Element, point: MeasurementPoint) -> None:
        nominal = SubElement(listed, "PointFeatureNominal", id=str(self.features[point.name]))
        add_attributes(
            nominal, {BORE_ATTRIBUTE: _text_in_mm(point.bore_m)} if point.bore_m is not None else {}
        )
        SubElement(nominal, "Name").text = point.name
        SubElement(nominal, "FeatureDefinitionId").text = str(self.definition)
        SubElement(nominal, "Location").text = " ".join(map(_text_in_mm, point.position))
        SubElement(nominal, "Normal").text = _numbers_text(point.normal)

    def _characteristics(self, number: int) -> None:
        aspects, count = SubElement(self.root, "Characteristics"), str(len(self.asked))
        SubElement(aspects, "FormalStandardId").text = str(number)
        definitions = SubElement(aspects, "CharacteristicDefinitions", n=count)
        nominals = SubElement(aspects, "CharacteristicNominals", n=count)
        items = SubElement(aspects, "CharacteristicItems", n=count)
        for point in self.asked:
            defined = _define_characteristic(definitions, point, self._id())
            nominated = self._nominate(nominals, point, defined)
            item = SubElement(
                items, f"{_characteristic_kind(point)}CharacteristicItem", id=str(self._id())
            )
            SubElement(item, "Name").text = f"{point.kind} of {point.name}"
            _add_ids(item, "FeatureItemIds", [self.items[point.name]])
            if point.tool:
                _add_ids(item, "MeasurementDeviceIds", [self.tools[point.tool]])
            SubElement(item, "CharacteristicNominalId").text = str(nominated)

    def _nominate(self, listed: Element, point: MeasurementPoint, definition: int) -> int:
        number = self._id()
        nominal = SubElement(
            listed, f"{_characteristic_kind(point)}CharacteristicNominal", id=str(number)
        )
        SubElement(nominal, "CharacteristicDefinitionId").text = str(definition)
        _add_ids(nominal, "FeatureNominalIds", [self.features[point.name]])
        if point.nominal_m is not None:
            SubElement(nominal, "TargetValue").text = _text_in_mm(point.nominal_m)
        return number


def _asks_more(point: MeasurementPoint) -> bool:
    """Whether more is asked of a point than its profile."""
    return point.kind != "profile" or bool(
        point.tolerance_m is not None or point.tool or point.nominal_m
    )


def _characteristic_kind(point: MeasurementPoint) -> str:
    """The kind of a point's characteristic; in QIF a profile has a tolerance."""
    untold = point.kind == "profile" and point.tolerance_m is None
    return (
        OWN_CHARACTERISTIC if untold else CHARACTERISTIC_OF_KIND.get(point.kind, OWN_CHARACTERISTIC)
    )


def _define_characteristic(listed: Element, point: MeasurementPoint, number: int) -> int:
    kind, tolerance = _characteristic_kind(point), point.tolerance_m
    definition = SubElement(listed, f"{kind}CharacteristicDefinition", id=str(number))
    if kind == CHARACTERISTIC_OF_KIND["profile"]:
        SubElement(definition, "ToleranceValue").text = _text_in_mm(tolerance or 0.0)
    elif tolerance is None:
        SubElement(definition, "NonTolerance").text = "MEASURED"
    else:
        zone = SubElement(definition, "Tolerance")
        SubElement(zone, "MaxValue").text = _text_in_mm(tolerance / 2)
        SubElement(zone, "MinValue").text = _text_in_mm(-tolerance / 2)
        SubElement(zone, "DefinedAsLimit").text = "false"
    if kind == OWN_CHARACTERISTIC:
        SubElement(definition, "WhatToMeasure").text = point.kind
    return number


def _add_ids(parent: Element, tag: str, numbers: Iterable[int]) -> None:
    listed = SubElement(parent, tag)
    for number in numbers:
        SubElement(listed, "Id").text = str(number)
    listed.set("n", str(len(listed)))


def _datum_label(number: int, of: int) -> str:
    """A label of a datum; labels are in order as texts, too."""
    return DATUM_LETTERS[number] if of <= len(DATUM_LETTERS) else f"A{number:04d}"


def _text_in_mm(metres: float) -> str:
    return plain_number(round(1e3 * metres, LENGTH_DIGITS) + 0.0)


def _numbers_text(v: Triple) -> str:
    return " ".join(plain_number(round(component, 9) + 0.0) for component in v)


CHARACTERISTIC_KINDS = {name: kind for kind, name in CHARACTERISTIC_OF_KIND.items()}


@dataclass(frozen=True, slots=True)
class AskedPoint:
    """What is asked of a point; None and empty: the document does not say. `kind` is as in
    `MeasurementPoint`.
    """

    name: str = ""
    kind: str = ""
    nominal_m: float | None = None
    bore_m: float | None = None
    tool: str = ""


def points_asked(root: QifElement, reading: DocumentReading) -> dict[str, AskedPoint]:
    """What is asked of each point feature, by the feature's id. Raises `InvalidInput`.

    A name is taken over if it can name an object and no other point has it, the name of a device if
    it can name one.
    """
    nominals = [
        feature_element
        for feature_element in _elements_at(root, "Features", "FeatureNominals")
        if feature_element.tag == "PointFeatureNominal"
    ]
    names = Counter(
        nominal.text_at("Name") or f"f{nominal.attributes.get('id', '')}_1" for nominal in nominals
    )
    definitions = {
        definition_element.attributes.get("id", ""): definition_element
        for definition_element in _elements_at(root, "Characteristics", "CharacteristicDefinitions")
    }
    tools = _devices_by_nominal(root)
    demands = {
        feature: (
            characteristic,
            definitions.get(characteristic.text_at("CharacteristicDefinitionId")),
        )
        for characteristic in _elements_at(root, "Characteristics", "CharacteristicNominals")
        for feature in _ids_in_group(characteristic.at("FeatureNominalIds"))
    }
    asked = {}
    for nominal_entry in nominals:
        name, number = nominal_entry.text_at("Name"), nominal_entry.attributes.get("id", "")
        own = name if names[name] == 1 and _can_name(name) else ""
        demand, definition = demands.get(number, (None, None))
        kind, nominal_m = _demand_of(demand, definition, reading)
        tool = tools.get(demand.attributes.get("id", ""), "") if demand is not None else ""
        asked[number] = AskedPoint(own, kind, nominal_m, _bore_width(nominal_entry, reading), tool)
    return asked


def _elements_at(root: QifElement, *path: str) -> list[QifElement]:
    group = root.at(*path)
    return group.children if group is not None else []


def _ids_in_group(group: QifElement | None) -> list[str]:
    return [id_element.text.strip() for id_element in group.all("Id")] if group is not None else []


def _can_name(text: str) -> bool:
    return MEASUREMENT_NAME.fullmatch(text) is not None and text != "not"


def _devices_by_nominal(root: QifElement) -> dict[str, str]:
    """The name of the first device of each characteristic, by the id of its nominal."""
    devices = {
        device.attributes.get("id", ""): device.text_at("Name")
        for device in _elements_at(root, "MeasurementResources", "MeasurementDevices")
    }
    return dict(_device_wishes(root, devices))


def _device_wishes(root: QifElement, devices: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for item in _elements_at(root, "Characteristics", "CharacteristicItems"):
        for device in _ids_in_group(item.at("MeasurementDeviceIds"))[:1]:
            if _can_name(devices.get(device, "")):
                yield item.text_at("CharacteristicNominalId"), devices[device]


def _demand_of(
    demand: QifElement | None, definition: QifElement | None, reading: DocumentReading
) -> tuple[str, float | None]:
    """The kind of a measurement and its nominal value in metres."""
    if demand is None or definition is None:
        return "", None
    name = demand.tag.removesuffix("CharacteristicNominal")
    own = definition.text_at("WhatToMeasure")
    target = demand.at("TargetValue")
    kind = CHARACTERISTIC_KINDS.get(name, own if _can_name(own) else "")
    return kind, reading.length(target) if kind and target is not None else None


def _bore_width(nominal: QifElement, reading: DocumentReading) -> float | None:
    """The width of the hole that a point lies in, in metres."""
    for attribute in _elements_at(nominal, "Attributes"):
        if attribute.attributes.get("name") == BORE_ATTRIBUTE:
            return reading.length(
                QifElement(attribute.tag, {}, attribute.line, attribute.attributes.get("value", ""))
            )
    return None
