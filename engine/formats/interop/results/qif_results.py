"""Results of runs as QIF Results documents (ISO 23952): written, and read also from others."""

import re
import uuid
from collections.abc import Iterable
from datetime import datetime, timedelta
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from cellwright.engine.formats.interop.qif.document_writing import (
    UNIT_FACTORS,
    add_attributes,
    add_path,
    add_standard,
    document_text,
    linear_unit,
    new_document,
    plain_number,
)
from cellwright.kb.model.measured_results import COVERAGE_FACTOR, Conformity, Measured, Results
from cellwright.kb.numbers import read_finite, read_whole

LENGTH_UNITS = ("m", "cm", "mm", "um", "nm", "in")


class MeasurementDemand(NamedTuple):
    """What is measured, in which unit, and what it should be."""

    of: str
    quantity: str
    unit: str
    nominal: float | None
    lower: float | None
    upper: float | None


def demand_of(measured: Measured) -> MeasurementDemand:
    """The demand that a value answers."""
    return MeasurementDemand(
        measured.of,
        measured.quantity,
        measured.unit,
        measured.nominal,
        measured.lower,
        measured.upper,
    )


def qif_kind(demand: MeasurementDemand) -> str:
    """The beginning of the names of the QIF elements for a demand."""
    if demand.unit in LENGTH_UNITS:
        return "UserDefinedLinear"
    limited = demand.lower is not None or demand.upper is not None
    whole = demand.nominal is not None and limited and demand.unit.split() == [demand.unit]
    return "UserDefinedUnit" if whole else "UserDefinedAttribute"


STATUS_WORDS = {True: "PASS", False: "FAIL", None: "NOT_ANALYZED"}
MEASUREMENT_KINDS = {
    Conformity.CONFORMING: "PASS", Conformity.NOT_CONFORMING: "FAIL", Conformity.UNDECIDED: "INDETERMINATE",
}  # fmt: skip
# names of runs are made unique below it
RUN_NAMESPACE = uuid.UUID("6f7d9a50-6a3c-5c1e-9d3e-2f0d5a1b7c44")


def written_qif(results: Results) -> str:
    """The results as a QIF document, without history."""
    return _Document(results).text()


class _Document:
    def __init__(self, results: Results) -> None:
        self.results = results
        self.last = 0
        self.root = new_document()
        self.demands = {
            demand: self._ids() for demand in dict.fromkeys(map(demand_of, results.measured))
        }
        self.tools = {
            tool: self._id() for tool in sorted({m.tool for m in results.measured if m.tool})
        }

    def _id(self) -> int:
        self.last += 1
        return self.last

    def _ids(self) -> tuple[int, int, int]:
        return self._id(), self._id(), self._id()

    def text(self) -> str:
        """The whole document."""
        measured = self.results.measured
        name = f"{self.results.run} {self.results.started}"
        SubElement(self.root, "QPId").text = str(uuid.uuid5(RUN_NAMESPACE, name))
        if self.results.started:
            add_path(self.root, "Version", "TimeCreated", text=_last_moment(self.results, measured))
        if measured:
            number = add_standard(self.root, self._id())
            self._units()
            self._devices()
            self._characteristics(number)
        self._results()
        return document_text(self.root, self.last)

    def _units(self) -> None:
        units = dict.fromkeys(value.unit for value in self.results.measured)
        lengths = [length_unit for length_unit in units if length_unit in UNIT_FACTORS] or ["mm"]
        file = SubElement(self.root, "FileUnits")
        linear_unit(SubElement(file, "PrimaryUnits"), lengths[0])
        if lengths[1:]:
            others = SubElement(file, "OtherUnits", n=str(len(lengths) - 1))
            for length in lengths[1:]:
                linear_unit(others, length)
        own = {
            demand.unit: demand.quantity
            for demand in self.demands
            if qif_kind(demand) == "UserDefinedUnit"
        }
        if own:
            listed = SubElement(file, "UserDefinedUnits", n=str(len(own)))
            for unit, quantity in own.items():
                named = SubElement(listed, "UserDefinedUnit")
                SubElement(named, "WhatIsMeasured").text = quantity
                SubElement(named, "UnitName").text = unit

    def _devices(self) -> None:
        if self.tools:
            listed = add_path(self.root, "MeasurementResources", "MeasurementDevices")
            listed.set("n", str(len(self.tools)))
            for name, number in self.tools.items():
                add_path(SubElement(listed, "MeasurementDevice", id=str(number)), "Name", text=name)

    def _characteristics(self, standard: int) -> None:
        aspects = SubElement(self.root, "Characteristics")
        SubElement(aspects, "FormalStandardId").text = str(standard)
        count = str(len(self.demands))
        for aspect, write in (
            ("Definition", _add_definition),
            ("Nominal", _add_nominal),
            ("Item", _add_item),
        ):
            listed = SubElement(aspects, f"Characteristic{aspect}s", n=count)
            for demand, ids in self.demands.items():
                write(listed, demand, ids)

    def _results(self) -> None:
        measured = self.results.measured
        results = SubElement(self.root, "Results")
        results_element = SubElement(
            SubElement(results, "MeasurementResultsSet", n="1"),
            "MeasurementResults",
            id=str(self._id()),
        )
        add_attributes(results_element, {"run": self.results.run, "started": self.results.started})
        if measured:
            listed = add_path(
                results_element, "MeasuredCharacteristics", "CharacteristicMeasurements"
            )
            listed.set("n", str(len(measured)))
            for value in measured:
                self._measurement(listed, value)
        add_path(
            results_element,
            "InspectionStatus",
            "InspectionStatusEnum",
            text=_overall_status(measured),
        )

    def _measurement(self, listed: Element, measured: Measured) -> None:
        demand = demand_of(measured)
        kind = qif_kind(demand)
        measurement = SubElement(listed, f"{kind}CharacteristicMeasurement", id=str(self._id()))
        add_attributes(measurement, _other_fields(measured))
        add_path(measurement, "Status", "CharacteristicStatusEnum", text=_verdict_of(measured))
        SubElement(measurement, "CharacteristicItemId").text = str(self.demands[demand][2])
        if self.results.started:
            SubElement(measurement, "TimeStamp").text = _last_moment(self.results, [measured])
        if measured.tool:
            devices = SubElement(measurement, "MeasurementDeviceIds", n="1")
            SubElement(devices, "Id").text = str(self.tools[measured.tool])
        value = _add_value(measurement, "Value", kind, measured.value, measured.unit)
        if kind != "UserDefinedAttribute" and (measured.uncertainty or 0) > 0:
            value.set(
                "combinedUncertainty", plain_number((measured.uncertainty or 0) / COVERAGE_FACTOR)
            )
            value.set("meanError", "0")


def _add_definition(listed: Element, demand: MeasurementDemand, ids: tuple[int, int, int]) -> None:
    kind = qif_kind(demand)
    definition = SubElement(listed, f"{kind}CharacteristicDefinition", id=str(ids[0]))
    if kind == "UserDefinedLinear":
        _add_tolerance(definition, demand)
    if kind != "UserDefinedUnit":
        SubElement(definition, "WhatToMeasure").text = demand.quantity


def _add_tolerance(definition: Element, demand: MeasurementDemand) -> None:
    if demand.lower is None and demand.upper is None:
        SubElement(definition, "NonTolerance").text = "MEASURED"
        return
    tolerance = SubElement(definition, "Tolerance")
    _add_limits(tolerance, demand, "UserDefinedLinear")


def _add_limits(parent: Element, demand: MeasurementDemand, kind: str) -> None:
    for tag, value in (("MaxValue", demand.upper), ("MinValue", demand.lower)):
        if value is not None:
            _add_value(parent, tag, kind, value, demand.unit)
    SubElement(parent, "DefinedAsLimit").text = "true"


def _add_nominal(listed: Element, demand: MeasurementDemand, ids: tuple[int, int, int]) -> None:
    kind = qif_kind(demand)
    nominal = SubElement(listed, f"{kind}CharacteristicNominal", id=str(ids[1]))
    SubElement(nominal, "CharacteristicDefinitionId").text = str(ids[0])
    if demand.nominal is not None and kind != "UserDefinedAttribute":
        _add_value(nominal, "TargetValue", kind, demand.nominal, demand.unit)
    if kind == "UserDefinedUnit":
        _add_limits(nominal, demand, kind)


def _add_item(listed: Element, demand: MeasurementDemand, ids: tuple[int, int, int]) -> None:
    item = SubElement(listed, f"{qif_kind(demand)}CharacteristicItem", id=str(ids[2]))
    SubElement(item, "Name").text = f"{demand.quantity} of {demand.of}"
    SubElement(item, "CharacteristicNominalId").text = str(ids[1])


def _add_value(parent: Element, tag: str, kind: str, value: float, unit: str) -> Element:
    value_element = SubElement(parent, tag)
    value_element.text = plain_number(value)
    if kind != "UserDefinedAttribute":
        value_element.set("linearUnit" if kind == "UserDefinedLinear" else "unitName", unit)
    return value_element


def _verdict_of(measured: Measured) -> str:
    """What a value shows, in the words of QIF: with its uncertainty, if that is known."""
    shown = measured.conformity
    return STATUS_WORDS[measured.passed] if shown is None else MEASUREMENT_KINDS[shown]


def _other_fields(measured: Measured) -> dict[str, str]:
    """What QIF has no place for, by name."""
    said = {name: getattr(measured, name) for name in ("of", "quantity", "tool", "action", "unit")}
    fields = {**said, "at_ms": str(measured.at_ms)}
    if qif_kind(demand_of(measured)) == "UserDefinedAttribute":
        fields |= _number_texts(measured, ("nominal", "lower", "upper"))
    return fields | _number_texts(measured, ("uncertainty", "risk"))


def _number_texts(measured: Measured, names: Iterable[str]) -> dict[str, str]:
    numbers = ((name, getattr(measured, name)) for name in names)
    return {name: repr(value) for name, value in numbers if value is not None}


def _last_moment(results: Results, measured: Iterable[Measured]) -> str:
    """When the last of the values was measured."""
    last = max((value.at_ms for value in measured), default=0)
    return (datetime.fromisoformat(results.started) + timedelta(milliseconds=last)).isoformat()


def _overall_status(measured: Iterable[Measured]) -> str:
    verdicts = {_verdict_of(value) for value in measured}
    if not verdicts:
        return "NOT_MEASURED"
    return "FAIL" if "FAIL" in verdicts else "PASS" if verdicts == {"PASS"} else "UNKNOWN"


QIF_SPACE = "{http://qifstandards.org/xsd/qif3}"
MEASUREMENT_SUFFIX = "CharacteristicMeasurement"
# their zone lies on both sides of the surface; a zone elsewhere begins at 0
SIGNED_KINDS = ("PointProfile",)
WORD_START = re.compile(r"(?<!^)(?=[A-Z])")


def read_qif(text: str) -> Results:
    """The results of a document. Raises `ValueError` if it is another."""
    if "<!DOCTYPE" in text:
        raise ValueError("document types are refused")
    try:
        root = ElementTree.fromstring(text.encode("utf-8"))
    except ElementTree.ParseError as error:
        raise ValueError(f"not XML: {error}") from error
    results_element = root.find(
        f"{QIF_SPACE}Results/{QIF_SPACE}MeasurementResultsSet/{QIF_SPACE}MeasurementResults"
    )
    if results_element is None:
        raise ValueError("not a QIF document with results")
    about = _attributes_of(results_element)
    known = {element.get("id", ""): element for element in root.iter() if element.get("id")}
    measured = [
        element for element in results_element.iter() if element.tag.endswith(MEASUREMENT_SUFFIX)
    ]
    if "run" in about:
        return Results(
            about["run"],
            about.get("started", ""),
            tuple(_read_measured(element, known) for element in measured),
        )
    lengths = (
        root.findtext(
            f"{QIF_SPACE}FileUnits/{QIF_SPACE}PrimaryUnits/{QIF_SPACE}LinearUnit/{QIF_SPACE}UnitName"
        )
        or "mm"
    )
    read = (
        _read_foreign(element, known, lengths.strip())
        for element in measured
        if _child_text(element, "Value")
    )
    return Results(_child_text(root, "QPId"), "", tuple(read))


def _read_measured(element: Element, known: dict[str, Element]) -> Measured:
    said = _attributes_of(element)
    nominal, limits = _demand_elements(element, known)
    nominal_value, lower, upper = (
        read_finite(said[name]) if name in said else _child_number(where, tag)
        for name, where, tag in (
            ("nominal", nominal, "TargetValue"),
            ("lower", limits, "MinValue"),
            ("upper", limits, "MaxValue"),
        )
    )
    of, quantity, unit, tool, action = (
        said.get(name, "") for name in ("of", "quantity", "unit", "tool", "action")
    )
    value, at_ms = read_finite(_child_text(element, "Value")), read_whole(said.get("at_ms", "0"))
    uncertainty, risk = (
        read_finite(said[name]) if name in said else None for name in ("uncertainty", "risk")
    )
    return Measured(
        of,
        quantity,
        value,
        unit,
        nominal_value,
        lower,
        upper,
        tool,
        action,
        at_ms,
        uncertainty,
        risk,
    )


def _demand_elements(element: Element, known: dict[str, Element]) -> tuple[Element, Element]:
    """The nominal of what was measured, and the element that has its limits."""
    nominal = known[
        _child_text(known[_child_text(element, "CharacteristicItemId")], "CharacteristicNominalId")
    ]
    definition = known[_child_text(nominal, "CharacteristicDefinitionId")]
    limits = definition.find(f"{QIF_SPACE}Tolerance")
    if limits is None:
        limits = (
            definition if definition.find(f"{QIF_SPACE}ToleranceValue") is not None else nominal
        )
    return nominal, limits


def _read_foreign(element: Element, known: dict[str, Element], unit: str) -> Measured:
    """A measured characteristic of another program.

    Raises `LookupError` where it refers to what is not there.
    """
    item, kind = (
        known[_child_text(element, "CharacteristicItemId")],
        element.tag[len(QIF_SPACE) : -len(MEASUREMENT_SUFFIX)],
    )
    nominal, limits = _demand_elements(element, known)
    target, zone = _child_number(nominal, "TargetValue"), _child_number(limits, "ToleranceValue")
    lower, upper = _child_number(limits, "MinValue"), _child_number(limits, "MaxValue")
    if zone is not None:
        lower, upper = (-zone / 2, zone / 2) if kind in SIGNED_KINDS else (0.0, zone)
    elif target is not None and _child_text(limits, "DefinedAsLimit") != "true":
        lower, upper = (None if bound is None else target + bound for bound in (lower, upper))
    name = (
        _child_text(item, "Name")
        or _child_text(item, "Description")
        or f"characteristic {item.get('id')}"
    )
    value_element, combined = element.find(f"{QIF_SPACE}Value"), None
    if value_element is not None and value_element.get("combinedUncertainty"):
        combined = 2.0 * read_finite(value_element.attrib["combinedUncertainty"])
    unit = "degree" if "Angle" in kind else unit
    value = read_finite(_child_text(element, "Value"))
    return Measured(
        name,
        WORD_START.sub("_", kind).lower(),
        value,
        unit,
        target,
        lower,
        upper,
        uncertainty=combined,
    )


def _attributes_of(element: Element) -> dict[str, str]:
    listed = element.findall(f"{QIF_SPACE}Attributes/{QIF_SPACE}AttributeStr")
    return {attribute.get("name", ""): attribute.get("value", "") for attribute in listed}


def _child_text(element: Element, tag: str) -> str:
    return (element.findtext(f"{QIF_SPACE}{tag}") or "").strip()


def _child_number(element: Element, tag: str) -> float | None:
    text = _child_text(element, tag)
    return read_finite(text) if text else None
