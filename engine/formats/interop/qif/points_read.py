"""What a QIF document says of single points beside where they are: their names, what is measured there, by which device."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.formats.interop.qif.document import Element
from cellwright.engine.formats.interop.qif.points_written import BORE, KINDS
from cellwright.engine.formats.interop.qif.reading import Reading
from cellwright.engine.formats.interop.tables import NAME

CHARACTERISTICS = {name: kind for kind, name in KINDS.items()}


@dataclass(frozen=True, slots=True)
class Asked:
    """What is asked of a point; None and empty: the document does not say. `kind` is as in `MeasurementPoint`."""

    name: str = ""
    kind: str = ""
    nominal_m: float | None = None
    bore_m: float | None = None
    tool: str = ""


def points_asked(root: Element, reading: Reading) -> dict[str, Asked]:
    """What is asked of each point feature, by the feature's id. Raises `InvalidInput`.

    A name is taken over if it can name an object and no other point has it, the name of a device if it can name one.
    """
    nominals = [
        each for each in _listed(root, "Features", "FeatureNominals") if each.tag == "PointFeatureNominal"
    ]
    names = Counter(each.text_at("Name") or f"f{each.attributes.get('id', '')}_1" for each in nominals)
    definitions = {
        each.attributes.get("id", ""): each
        for each in _listed(root, "Characteristics", "CharacteristicDefinitions")
    }
    tools = _tools(root)
    demands = {
        feature: (each, definitions.get(each.text_at("CharacteristicDefinitionId")))
        for each in _listed(root, "Characteristics", "CharacteristicNominals")
        for feature in _ids(each.at("FeatureNominalIds"))
    }
    found = {}
    for each in nominals:
        name, number = each.text_at("Name"), each.attributes.get("id", "")
        own = name if names[name] == 1 and _can_name(name) else ""
        demand, definition = demands.get(number, (None, None))
        kind, nominal_m = _demanded(demand, definition, reading)
        tool = tools.get(demand.attributes.get("id", ""), "") if demand is not None else ""
        found[number] = Asked(own, kind, nominal_m, _bore(each, reading), tool)
    return found


def _listed(root: Element, *path: str) -> list[Element]:
    group = root.at(*path)
    return group.children if group is not None else []


def _ids(group: Element | None) -> list[str]:
    return [each.text.strip() for each in group.all("Id")] if group is not None else []


def _can_name(text: str) -> bool:
    return NAME.fullmatch(text) is not None and text != "not"


def _tools(root: Element) -> dict[str, str]:
    """The name of the first device of each characteristic, by the id of its nominal."""
    devices = {
        each.attributes.get("id", ""): each.text_at("Name")
        for each in _listed(root, "MeasurementResources", "MeasurementDevices")
    }
    return dict(_wishes(root, devices))


def _wishes(root: Element, devices: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for item in _listed(root, "Characteristics", "CharacteristicItems"):
        for device in _ids(item.at("MeasurementDeviceIds"))[:1]:
            if _can_name(devices.get(device, "")):
                yield item.text_at("CharacteristicNominalId"), devices[device]


def _demanded(
    demand: Element | None, definition: Element | None, reading: Reading
) -> tuple[str, float | None]:
    """The kind of a measurement and its nominal value in metres."""
    if demand is None or definition is None:
        return "", None
    name = demand.tag.removesuffix("CharacteristicNominal")
    own = definition.text_at("WhatToMeasure")
    target = demand.at("TargetValue")
    kind = CHARACTERISTICS.get(name, own if _can_name(own) else "")
    return kind, reading.length(target) if kind and target is not None else None


def _bore(nominal: Element, reading: Reading) -> float | None:
    """The width of the hole that a point lies in, in metres."""
    for each in _listed(nominal, "Attributes"):
        if each.attributes.get("name") == BORE:
            return reading.length(Element(each.tag, {}, each.line, each.attributes.get("value", "")))
    return None
