"""Reads the QIF documents that `qif` writes."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from kb.model.results import Measured, Results
from kb.numbers import finite, whole

SPACE = "{http://qifstandards.org/xsd/qif3}"


def read_qif(text: str) -> Results:
    """The results of a document. Raises `ValueError` if it is another."""
    if "<!DOCTYPE" in text:
        raise ValueError("document types are refused")
    try:
        root = ElementTree.fromstring(text.encode("utf-8"))
    except ElementTree.ParseError as error:
        raise ValueError(f"not XML: {error}") from error
    found = root.find(f"{SPACE}Results/{SPACE}MeasurementResultsSet/{SPACE}MeasurementResults")
    if found is None:
        raise ValueError("not a QIF document with results")
    about = _beside(found)
    known = {each.get("id", ""): each for each in root.iter() if each.get("id")}
    measured = [each for each in found.iter() if each.tag.endswith("CharacteristicMeasurement")]
    return Results(
        about.get("run", ""), about.get("started", ""), tuple(_measured(each, known) for each in measured)
    )


def _measured(element: Element, known: dict[str, Element]) -> Measured:
    said = _beside(element)
    nominal = known[_text(known[_text(element, "CharacteristicItemId")], "CharacteristicNominalId")]
    definition = known[_text(nominal, "CharacteristicDefinitionId")]
    limits = definition.find(f"{SPACE}Tolerance")
    limits = nominal if limits is None else limits
    nominal_value, lower, upper = (
        finite(said[name]) if name in said else _number(where, tag)
        for name, where, tag in (
            ("nominal", nominal, "TargetValue"),
            ("lower", limits, "MinValue"),
            ("upper", limits, "MaxValue"),
        )
    )
    of, quantity, unit, tool, action = (
        said.get(name, "") for name in ("of", "quantity", "unit", "tool", "action")
    )
    value, at_ms = finite(_text(element, "Value")), whole(said.get("at_ms", "0"))
    return Measured(of, quantity, value, unit, nominal_value, lower, upper, tool, action, at_ms)


def _beside(element: Element) -> dict[str, str]:
    listed = element.findall(f"{SPACE}Attributes/{SPACE}AttributeStr")
    return {each.get("name", ""): each.get("value", "") for each in listed}


def _text(element: Element, tag: str) -> str:
    return (element.findtext(f"{SPACE}{tag}") or "").strip()


def _number(element: Element, tag: str) -> float | None:
    text = _text(element, tag)
    return finite(text) if text else None
