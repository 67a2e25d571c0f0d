"""Results as a QIF 3.0 document (ISO 23952, QIF Results).

A length is a user-defined linear characteristic. Another quantity is one with a user-defined unit if it has a nominal value
and a limit, as QIF demands, else an attribute. What QIF has no place for stands in attributes of the measurement.
"""

import uuid
from collections.abc import Iterable
from datetime import datetime, timedelta
from xml.etree.ElementTree import Element, SubElement

from cellwright.engine.formats.interop.qif.writing import (
    METRES,
    attributed,
    document,
    linear_unit,
    plain,
    standard,
    text_of,
    under,
)
from cellwright.engine.formats.interop.results.demands import Demand, demand_of, kind_of
from cellwright.kb.model.conformity import COVERAGE, Conformity
from cellwright.kb.model.results import Measured, Results

STATUS = {True: "PASS", False: "FAIL", None: "NOT_ANALYZED"}
SHOWN = {
    Conformity.CONFORMING: "PASS", Conformity.NOT_CONFORMING: "FAIL", Conformity.UNDECIDED: "INDETERMINATE",
}  # fmt: skip
RUN = uuid.UUID("6f7d9a50-6a3c-5c1e-9d3e-2f0d5a1b7c44")  # names of runs are made unique below it


def written_qif(results: Results) -> str:
    """The results as a QIF document, without history."""
    return _Document(results).text()


class _Document:
    def __init__(self, results: Results) -> None:
        self.results = results
        self.last = 0
        self.root = document()
        self.demands = {each: self._ids() for each in dict.fromkeys(map(demand_of, results.measured))}
        self.tools = {each: self._id() for each in sorted({m.tool for m in results.measured if m.tool})}

    def _id(self) -> int:
        self.last += 1
        return self.last

    def _ids(self) -> tuple[int, int, int]:
        return self._id(), self._id(), self._id()

    def text(self) -> str:
        """The whole document."""
        measured = self.results.measured
        name = f"{self.results.run} {self.results.started}"
        SubElement(self.root, "QPId").text = str(uuid.uuid5(RUN, name))
        if self.results.started:
            under(self.root, "Version", "TimeCreated", text=_moment(self.results, measured))
        if measured:
            number = standard(self.root, self._id())
            self._units()
            self._devices()
            self._characteristics(number)
        self._results()
        return text_of(self.root, self.last)

    def _units(self) -> None:
        units = dict.fromkeys(each.unit for each in self.results.measured)
        lengths = [each for each in units if each in METRES] or ["mm"]
        file = SubElement(self.root, "FileUnits")
        linear_unit(SubElement(file, "PrimaryUnits"), lengths[0])
        if lengths[1:]:
            others = SubElement(file, "OtherUnits", n=str(len(lengths) - 1))
            for each in lengths[1:]:
                linear_unit(others, each)
        own = {each.unit: each.quantity for each in self.demands if kind_of(each) == "UserDefinedUnit"}
        if own:
            listed = SubElement(file, "UserDefinedUnits", n=str(len(own)))
            for unit, quantity in own.items():
                named = SubElement(listed, "UserDefinedUnit")
                SubElement(named, "WhatIsMeasured").text = quantity
                SubElement(named, "UnitName").text = unit

    def _devices(self) -> None:
        if self.tools:
            listed = under(self.root, "MeasurementResources", "MeasurementDevices")
            listed.set("n", str(len(self.tools)))
            for name, number in self.tools.items():
                under(SubElement(listed, "MeasurementDevice", id=str(number)), "Name", text=name)

    def _characteristics(self, standard: int) -> None:
        aspects = SubElement(self.root, "Characteristics")
        SubElement(aspects, "FormalStandardId").text = str(standard)
        count = str(len(self.demands))
        for aspect, write in (("Definition", _define), ("Nominal", _nominate), ("Item", _itemise)):
            listed = SubElement(aspects, f"Characteristic{aspect}s", n=count)
            for demand, ids in self.demands.items():
                write(listed, demand, ids)

    def _results(self) -> None:
        measured = self.results.measured
        results = SubElement(self.root, "Results")
        found = SubElement(
            SubElement(results, "MeasurementResultsSet", n="1"), "MeasurementResults", id=str(self._id())
        )
        attributed(found, {"run": self.results.run, "started": self.results.started})
        if measured:
            listed = under(found, "MeasuredCharacteristics", "CharacteristicMeasurements")
            listed.set("n", str(len(measured)))
            for each in measured:
                self._measurement(listed, each)
        under(found, "InspectionStatus", "InspectionStatusEnum", text=_status(measured))

    def _measurement(self, listed: Element, measured: Measured) -> None:
        demand = demand_of(measured)
        kind = kind_of(demand)
        made = SubElement(listed, f"{kind}CharacteristicMeasurement", id=str(self._id()))
        attributed(made, _beside(measured))
        under(made, "Status", "CharacteristicStatusEnum", text=_verdict(measured))
        SubElement(made, "CharacteristicItemId").text = str(self.demands[demand][2])
        if self.results.started:
            SubElement(made, "TimeStamp").text = _moment(self.results, [measured])
        if measured.tool:
            devices = SubElement(made, "MeasurementDeviceIds", n="1")
            SubElement(devices, "Id").text = str(self.tools[measured.tool])
        value = _valued(made, "Value", kind, measured.value, measured.unit)
        if kind != "UserDefinedAttribute" and (measured.uncertainty or 0) > 0:
            value.set("combinedUncertainty", plain((measured.uncertainty or 0) / COVERAGE))
            value.set("meanError", "0")


def _define(listed: Element, demand: Demand, ids: tuple[int, int, int]) -> None:
    kind = kind_of(demand)
    made = SubElement(listed, f"{kind}CharacteristicDefinition", id=str(ids[0]))
    if kind == "UserDefinedLinear":
        _tolerance(made, demand)
    if kind != "UserDefinedUnit":
        SubElement(made, "WhatToMeasure").text = demand.quantity


def _tolerance(made: Element, demand: Demand) -> None:
    if demand.lower is None and demand.upper is None:
        SubElement(made, "NonTolerance").text = "MEASURED"
        return
    tolerance = SubElement(made, "Tolerance")
    _limits(tolerance, demand, "UserDefinedLinear")


def _limits(parent: Element, demand: Demand, kind: str) -> None:
    for tag, value in (("MaxValue", demand.upper), ("MinValue", demand.lower)):
        if value is not None:
            _valued(parent, tag, kind, value, demand.unit)
    SubElement(parent, "DefinedAsLimit").text = "true"


def _nominate(listed: Element, demand: Demand, ids: tuple[int, int, int]) -> None:
    kind = kind_of(demand)
    made = SubElement(listed, f"{kind}CharacteristicNominal", id=str(ids[1]))
    SubElement(made, "CharacteristicDefinitionId").text = str(ids[0])
    if demand.nominal is not None and kind != "UserDefinedAttribute":
        _valued(made, "TargetValue", kind, demand.nominal, demand.unit)
    if kind == "UserDefinedUnit":
        _limits(made, demand, kind)


def _itemise(listed: Element, demand: Demand, ids: tuple[int, int, int]) -> None:
    made = SubElement(listed, f"{kind_of(demand)}CharacteristicItem", id=str(ids[2]))
    SubElement(made, "Name").text = f"{demand.quantity} of {demand.of}"
    SubElement(made, "CharacteristicNominalId").text = str(ids[1])


def _valued(parent: Element, tag: str, kind: str, value: float, unit: str) -> Element:
    made = SubElement(parent, tag)
    made.text = plain(value)
    if kind != "UserDefinedAttribute":
        made.set("linearUnit" if kind == "UserDefinedLinear" else "unitName", unit)
    return made


def _verdict(measured: Measured) -> str:
    """What a value shows, in the words of QIF: with its uncertainty, if that is known."""
    shown = measured.conformity
    return STATUS[measured.passed] if shown is None else SHOWN[shown]


def _beside(measured: Measured) -> dict[str, str]:
    """What QIF has no place for, by name."""
    said = {name: getattr(measured, name) for name in ("of", "quantity", "tool", "action", "unit")}
    found = {**said, "at_ms": str(measured.at_ms)}
    if kind_of(demand_of(measured)) == "UserDefinedAttribute":
        found |= _numbers(measured, ("nominal", "lower", "upper"))
    return found | _numbers(measured, ("uncertainty", "risk"))


def _numbers(measured: Measured, names: Iterable[str]) -> dict[str, str]:
    numbers = ((name, getattr(measured, name)) for name in names)
    return {name: repr(value) for name, value in numbers if value is not None}


def _moment(results: Results, measured: Iterable[Measured]) -> str:
    """When the last of the values was measured."""
    last = max((each.at_ms for each in measured), default=0)
    return (datetime.fromisoformat(results.started) + timedelta(milliseconds=last)).isoformat()


def _status(measured: Iterable[Measured]) -> str:
    verdicts = {_verdict(each) for each in measured}
    if not verdicts:
        return "NOT_MEASURED"
    return "FAIL" if "FAIL" in verdicts else "PASS" if verdicts == {"PASS"} else "UNKNOWN"
