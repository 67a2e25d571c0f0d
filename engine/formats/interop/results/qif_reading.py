"""Reads QIF Results: the documents that `qif` writes, and the measured characteristics of those of other programs.

From another program come the values of characteristics with one number: sizes, distances, and deviations of form, orientation,
place and profile. What was measured is the name of the characteristic, the quantity its kind.
"""

import re
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from cellwright.kb.model.results import Measured, Results
from cellwright.kb.numbers import finite, whole

SPACE = "{http://qifstandards.org/xsd/qif3}"
KIND = "CharacteristicMeasurement"
SIGNED = ("PointProfile",)  # their zone lies on both sides of the surface; a zone elsewhere begins at 0
WORDS = re.compile(r"(?<!^)(?=[A-Z])")


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
    measured = [each for each in found.iter() if each.tag.endswith(KIND)]
    if "run" in about:
        return Results(
            about["run"], about.get("started", ""), tuple(_measured(each, known) for each in measured)
        )
    lengths = root.findtext(f"{SPACE}FileUnits/{SPACE}PrimaryUnits/{SPACE}LinearUnit/{SPACE}UnitName") or "mm"
    read = (_foreign(each, known, lengths.strip()) for each in measured if _text(each, "Value"))
    return Results(_text(root, "QPId"), "", tuple(read))


def _measured(element: Element, known: dict[str, Element]) -> Measured:
    said = _beside(element)
    nominal, limits = _demanded(element, known)
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
    uncertainty, risk = (finite(said[name]) if name in said else None for name in ("uncertainty", "risk"))
    return Measured(
        of, quantity, value, unit, nominal_value, lower, upper, tool, action, at_ms, uncertainty, risk
    )


def _demanded(element: Element, known: dict[str, Element]) -> tuple[Element, Element]:
    """The nominal of what was measured, and the element that has its limits."""
    nominal = known[_text(known[_text(element, "CharacteristicItemId")], "CharacteristicNominalId")]
    definition = known[_text(nominal, "CharacteristicDefinitionId")]
    limits = definition.find(f"{SPACE}Tolerance")
    if limits is None:
        limits = definition if definition.find(f"{SPACE}ToleranceValue") is not None else nominal
    return nominal, limits


def _foreign(element: Element, known: dict[str, Element], unit: str) -> Measured:
    """A measured characteristic of another program. Raises `LookupError` where it refers to what is not there."""
    item, kind = known[_text(element, "CharacteristicItemId")], element.tag[len(SPACE) : -len(KIND)]
    nominal, limits = _demanded(element, known)
    target, zone = _number(nominal, "TargetValue"), _number(limits, "ToleranceValue")
    lower, upper = _number(limits, "MinValue"), _number(limits, "MaxValue")
    if zone is not None:
        lower, upper = (-zone / 2, zone / 2) if kind in SIGNED else (0.0, zone)
    elif target is not None and _text(limits, "DefinedAsLimit") != "true":
        lower, upper = (None if each is None else target + each for each in (lower, upper))
    name = _text(item, "Name") or _text(item, "Description") or f"characteristic {item.get('id')}"
    made, combined = element.find(f"{SPACE}Value"), None
    if made is not None and made.get("combinedUncertainty"):
        combined = 2.0 * finite(made.attrib["combinedUncertainty"])
    unit = "degree" if "Angle" in kind else unit
    value = finite(_text(element, "Value"))
    return Measured(
        name, WORDS.sub("_", kind).lower(), value, unit, target, lower, upper, uncertainty=combined
    )


def _beside(element: Element) -> dict[str, str]:
    listed = element.findall(f"{SPACE}Attributes/{SPACE}AttributeStr")
    return {each.get("name", ""): each.get("value", "") for each in listed}


def _text(element: Element, tag: str) -> str:
    return (element.findtext(f"{SPACE}{tag}") or "").strip()


def _number(element: Element, tag: str) -> float | None:
    text = _text(element, tag)
    return finite(text) if text else None
