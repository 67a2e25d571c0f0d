"""Elements of the QIF 3.0 documents that we write."""

from collections.abc import Mapping
from decimal import Decimal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

QIF_NAMESPACE = "http://qifstandards.org/xsd/qif3"
UNIT_FACTORS = {
    "m": "1",
    "cm": "0.01",
    "mm": "0.001",
    "um": "0.000001",
    "nm": "0.000000001",
    "in": "0.0254",
}


def new_document() -> Element:
    """The root of a new document."""
    return Element("QIFDocument", {"xmlns": QIF_NAMESPACE, "versionQIF": "3.0.0"})


def document_text(root: Element, last: int) -> str:
    """The text of a document in which `last` is the greatest id."""
    root.set("idMax", str(last))
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, "unicode")}\n'


def add_path(parent: Element, *path: str, text: str | None = None) -> Element:
    """A new element at the end of a path of new elements."""
    for tag in path:
        parent = SubElement(parent, tag)
    parent.text = text
    return parent


def add_standard(root: Element, number: int) -> int:
    """The standard that characteristics refer to, under this id, which comes back."""
    standard_element = SubElement(
        SubElement(root, "StandardsDefinitions", n="1"), "Standard", id=str(number)
    )
    add_path(standard_element, "Organization", "StandardsOrganizationEnum", text="ISO")
    SubElement(standard_element, "Designator").text = "23952"
    return number


def linear_unit(parent: Element, name: str) -> None:
    """A unit of length, one of METRES."""
    unit = SubElement(parent, "LinearUnit")
    SubElement(unit, "SIUnitName").text = "meter"
    SubElement(unit, "UnitName").text = name
    add_path(unit, "UnitConversion", "Factor", text=UNIT_FACTORS[name])


def add_attributes(parent: Element, given: Mapping[str, str]) -> None:
    """Attributes with texts, by name; nothing if there are none."""
    if given:
        listed = SubElement(parent, "Attributes", n=str(len(given)))
        for name, value in given.items():
            SubElement(listed, "AttributeStr", name=name, value=value)


def plain_number(value: float) -> str:
    """A number without an exponent."""
    return format(Decimal(repr(value)), "f")
