"""The features of a QIF document with their tolerances, in metres."""

from pathlib import Path

from engine.formats.interop.qif.document import Element, read_document, wrong
from engine.model.measurement import Feature, Triple
from kb.diagnostics import InvalidInput, Source, unknown_name
from kb.files import File

UNITS_M = {
    "mm": 1e-3,
    "millimetre": 1e-3,
    "millimeter": 1e-3,
    "m": 1.0,
    "meter": 1.0,
    "inch": 0.0254,
    "in": 0.0254,
}
LENGTHS = (
    "Diameter",
    "Length",
    "Width",
    "Depth",
    "Radius",
    "LargeEndDistance",
    "SmallEndDistance",
    "MinorDiameter",
    "MajorDiameter",
)
WHERE = (("Location",), ("Axis", "AxisPoint"), ("CenterPlane", "Point"), ("Point",))
ALONG = (("Normal",), ("Axis", "Direction"), ("AxisVector",), ("CenterPlane", "Normal"), ("Direction",))
ACROSS = (("Sweep", "DirBeg"), ("LatitudeLongitudeSweep", "DirMeridianPrime"), ("LengthVector",))
SWEEP = (("Sweep", "DomainAngle"), ("LatitudeLongitudeSweep", "DomainLongitude"))


class _Reading:
    """What is needed to read any part of a document: its file and its unit of length."""

    def __init__(self, root: Element, file: File) -> None:
        self.file = file
        self.metres = _unit(root, file)

    def number(self, element: Element | None) -> float:
        values = self.numbers(element)
        if element is None or len(values) != 1:
            raise wrong(self.where(element), "one number is needed here")
        return values[0]

    def numbers(self, element: Element | None) -> list[float]:
        try:
            found = [float(each) for each in element.text.split()] if element is not None else []
        except ValueError:
            raise wrong(self.where(element), "this is not a number") from None
        if any(abs(each) > 1e12 or each != each for each in found):
            raise wrong(self.where(element), "the number is too large")
        return found

    def where(self, element: Element | None) -> Source:
        return self.file.line(element.line, 1) if element is not None else Source(self.file.path)

    def triple(
        self, element: Element, paths: tuple[tuple[str, ...], ...], scale: float = 1.0
    ) -> Triple | None:
        for path in paths:
            if (found := element.at(*path)) is not None:
                values = self.numbers(found)
                if len(values) == 3:
                    return (values[0] * scale, values[1] * scale, values[2] * scale)
        return None


def _unit(root: Element, file: File) -> float:
    """The unit of length in metres; a millimetre if the document names none."""
    unit = root.at("FileUnits", "PrimaryUnits", "LinearUnit")
    if unit is None:
        return 1e-3
    if factor := unit.text_at("UnitConversion", "Factor"):
        try:
            return float(factor)
        except ValueError:
            raise wrong(file.line(unit.line, 1), f"'{factor}' is not a number") from None
    name = unit.text_at("UnitName")
    if name not in UNITS_M:
        raise wrong(file.line(unit.line, 1), f"unknown unit '{name}'", f"one of {', '.join(UNITS_M)}")
    return UNITS_M[name]


def read_features(path: Path) -> tuple[Feature, ...]:
    """The nominal features of a QIF document, in the order of the document. Raises `InvalidInput`."""
    root, file = read_document(path)
    reading = _Reading(root, file)
    definitions = _by_id(root.at("Features", "FeatureDefinitions"))
    nominals = root.at("Features", "FeatureNominals")
    if nominals is None:
        raise wrong(
            Source(file.path),
            "there are no nominal features",
            "the file must give the position of its features",
        )
    tolerances = _tolerances(root, reading)
    return tuple(_feature(each, definitions, tolerances, reading) for each in nominals.children)


def _by_id(parent: Element | None) -> dict[str, Element]:
    return (
        {each.attributes["id"]: each for each in parent.children if "id" in each.attributes} if parent else {}
    )


def _feature(
    nominal: Element,
    definitions: dict[str, Element],
    tolerances: dict[str, dict[str, float]],
    reading: _Reading,
) -> Feature:
    name, refers = nominal.attributes.get("id", ""), nominal.text_at("FeatureDefinitionId")
    if refers not in definitions:
        known = set(definitions)
        raise InvalidInput([unknown_name("feature definition", refers, known, reading.where(nominal))])
    definition = definitions[refers]
    sizes = {}
    for element in (*definition.children, *nominal.children):
        if element.tag in LENGTHS:
            sizes[element.tag] = reading.number(element) * reading.metres
        elif element.tag == "HalfAngle":
            sizes[element.tag] = reading.number(element)
    outline = reading.numbers(nominal.at("PolyLine"))
    corners = (
        tuple(reading.metres * each for each in outline[i : i + 3]) for i in range(0, len(outline) - 2, 3)
    )
    sweep = next((reading.numbers(found) for path in SWEEP if (found := nominal.at(*path))), [])
    return Feature(
        f"f{name}",
        nominal.tag.removesuffix("FeatureNominal"),
        reading.triple(nominal, WHERE, reading.metres) or (0.0, 0.0, 0.0),
        reading.triple(nominal, ALONG) or (0.0, 0.0, 0.0),
        reading.triple(nominal, ACROSS),
        (sweep[0], sweep[1]) if len(sweep) == 2 else None,
        sizes,
        tuple((x, y, z) for x, y, z in corners),
        definition.text_at("InternalExternal") == "INTERNAL",
        tolerances.get(name, {}),
    )


def _tolerances(root: Element, reading: _Reading) -> dict[str, dict[str, float]]:
    """For each feature the narrowest tolerance of each kind of characteristic, in metres."""
    definitions = _by_id(root.at("Characteristics", "CharacteristicDefinitions"))
    nominals = root.at("Characteristics", "CharacteristicNominals")
    found: dict[str, dict[str, float]] = {}
    for nominal in nominals.children if nominals else []:
        definition = definitions.get(nominal.text_at("CharacteristicDefinitionId"))
        width = _width(definition, reading) if definition is not None else None
        kind = nominal.tag.removesuffix("CharacteristicNominal")
        features = nominal.at("FeatureNominalIds")
        if width is None or features is None or kind.startswith("Angle"):
            continue
        for feature in features.all("Id"):
            known = found.setdefault(feature.text.strip(), {})
            known[kind] = min(width, known.get(kind, width))
    return found


def _width(definition: Element, reading: _Reading) -> float | None:
    """The width of a tolerance zone: its value, or the difference of its limits."""
    if (value := definition.at("ToleranceValue")) is not None:
        return reading.number(value) * reading.metres
    upper, lower = definition.at("Tolerance", "MaxValue"), definition.at("Tolerance", "MinValue")
    if upper is None or lower is None:
        return None
    return abs(reading.number(upper) - reading.number(lower)) * reading.metres
