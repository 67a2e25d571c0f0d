"""The features of a QIF document with their tolerances, in metres."""

from pathlib import Path

from cellwright.engine.formats.interop.qif.document import Element, read_document, wrong
from cellwright.engine.formats.interop.qif.reading import Reading
from cellwright.engine.model.measurement import Feature
from cellwright.kb.diagnostics import InvalidInput, Source, unknown_name

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


def read_features(path: Path) -> tuple[Feature, ...]:
    """The nominal features of a QIF document, in the order of the document. Raises `InvalidInput`."""
    root, file = read_document(path)
    return features_of(root, Reading(root, file))


def features_of(root: Element, reading: Reading) -> tuple[Feature, ...]:
    """The nominal features of a document that is read. Raises `InvalidInput`."""
    definitions = _by_id(root.at("Features", "FeatureDefinitions"))
    nominals = root.at("Features", "FeatureNominals")
    if nominals is None:
        raise wrong(
            Source(reading.file.path),
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
    reading: Reading,
) -> Feature:
    name, refers = nominal.attributes.get("id", ""), nominal.text_at("FeatureDefinitionId")
    if refers not in definitions:
        known = set(definitions)
        raise InvalidInput([unknown_name("feature definition", refers, known, reading.where(nominal))])
    definition = definitions[refers]
    sizes = {}
    for element in (*definition.children, *nominal.children):
        if element.tag in LENGTHS:
            sizes[element.tag] = reading.length(element)
        elif element.tag == "HalfAngle":
            sizes[element.tag] = reading.number(element) * reading.radians
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
        (sweep[0] * reading.radians, sweep[1] * reading.radians) if len(sweep) == 2 else None,
        sizes,
        tuple((x, y, z) for x, y, z in corners),
        definition.text_at("InternalExternal") == "INTERNAL",
        tolerances.get(name, {}),
        _entities(nominal),
    )


def _entities(nominal: Element) -> tuple[str, ...]:
    """The ids of the faces or edges that a feature consists of."""
    group = nominal.at("EntityInternalIds")
    return tuple(each.text.strip() for each in group.all("Id")) if group is not None else ()


def _tolerances(root: Element, reading: Reading) -> dict[str, dict[str, float]]:
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


def _width(definition: Element, reading: Reading) -> float | None:
    """The width of a tolerance zone: its value, or the difference of its limits."""
    if (value := definition.at("ToleranceValue")) is not None:
        return reading.length(value)
    upper, lower = definition.at("Tolerance", "MaxValue"), definition.at("Tolerance", "MinValue")
    if upper is None or lower is None:
        return None
    return abs(reading.length(upper) - reading.length(lower))
