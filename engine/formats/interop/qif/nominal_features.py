"""The features of a QIF document: sizes, tolerances in metres, and the datums that align a part."""

from collections.abc import Iterator
from pathlib import Path

from cellwright.engine.formats.interop.qif.qif_document import (
    DocumentReading,
    QifElement,
    qif_error,
    read_qif_document,
)
from cellwright.engine.model.part_measurements import DrawnFeature
from cellwright.kb.diagnostics import InvalidInput, Source, unknown_name

PRECEDENCE_STEPS = {
    "PRIMARY": 1,
    "SECONDARY": 2,
    "TERTIARY": 3,
    "QUATERNARY": 4,
    "QUINARY": 5,
    "SENARY": 6,
}
LATER_STEP = 7  # precedence of another name


def alignment_steps(root: QifElement) -> dict[str, int]:
    """The step (1 first) in which each feature that is a datum is measured, by the ids of features.

    A datum of several frames has its earliest step. In a document without frames, the datums follow
    their labels.
    """
    features = {name: tuple(feature_ids) for name, feature_ids in _datum_features(root)}
    steps: dict[str, int] = {}
    for datum, step in list(_in_frames(root)) or _by_label(root):
        for feature in features.get(datum, ()):
            steps[feature] = min(step, steps.get(feature, step))
    used = {step: number for number, step in enumerate(sorted(set(steps.values())), 1)}
    return {feature: used[step] for feature, step in steps.items()}


def _children_of(root: QifElement, group: str) -> list[QifElement]:
    group_element = root.at(group)
    return group_element.children if group_element is not None else []


def _datum_features(root: QifElement) -> Iterator[tuple[str, list[str]]]:
    """Each datum with the features that make it, itself or through its targets."""
    targets = {
        target.attributes.get("id", ""): target.text_at("FeatureNominalId")
        for target in _children_of(root, "DatumTargetDefinitions")
    }
    for datum in _children_of(root, "DatumDefinitions"):
        own = _ids_in(datum.at("FeatureNominalIds"))
        through = [
            targets[target_id]
            for target_id in _ids_in(datum.at("DatumTargetIds"))
            if targets.get(target_id)
        ]
        yield datum.attributes.get("id", ""), [*own, *through]


def _ids_in(group: QifElement | None) -> list[str]:
    return [id_element.text.strip() for id_element in group.all("Id")] if group is not None else []


def _in_frames(root: QifElement) -> Iterator[tuple[str, int]]:
    """The datums of all frames with their steps."""
    for frame in _children_of(root, "DatumReferenceFrames"):
        datums = frame.at("Datums")
        for datum in datums.children if datums is not None else ():
            step = PRECEDENCE_STEPS.get(datum.text_at("Precedence", "PrecedenceEnum"), LATER_STEP)
            yield from (
                (definition_id.text.strip(), step)
                for definition_id in _elements_below(datum, "DatumDefinitionId")
            )


def _elements_below(element: QifElement, tag: str) -> Iterator[QifElement]:
    for child in element.children:
        if child.tag == tag:
            yield child
        else:
            yield from _elements_below(child, tag)


def _by_label(root: QifElement) -> list[tuple[str, int]]:
    labelled = sorted(
        (datum.text_at("DatumLabel"), datum.attributes.get("id", ""))
        for datum in _children_of(root, "DatumDefinitions")
    )
    return [(name, step) for step, (_, name) in enumerate(labelled, 1)]


LENGTH_PATHS = (
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
PLACE_PATHS = (("Location",), ("Axis", "AxisPoint"), ("CenterPlane", "Point"), ("Point",))
DIRECTION_PATHS = (
    ("Normal",),
    ("Axis", "Direction"),
    ("AxisVector",),
    ("CenterPlane", "Normal"),
    ("Direction",),
)
ACROSS_PATHS = (
    ("Sweep", "DirBeg"),
    ("LatitudeLongitudeSweep", "DirMeridianPrime"),
    ("LengthVector",),
)
SWEEP_PATHS = (("Sweep", "DomainAngle"), ("LatitudeLongitudeSweep", "DomainLongitude"))


def read_features(path: Path) -> tuple[DrawnFeature, ...]:
    """The nominal features of a QIF document, in the order of the document.

    Raises `InvalidInput`.
    """
    root, file = read_qif_document(path)
    return nominal_features(root, DocumentReading(root, file))


def nominal_features(root: QifElement, reading: DocumentReading) -> tuple[DrawnFeature, ...]:
    """The nominal features of a document that is read. Raises `InvalidInput`."""
    definitions = _by_id(root.at("Features", "FeatureDefinitions"))
    nominals = root.at("Features", "FeatureNominals")
    if nominals is None:
        raise qif_error(
            Source(reading.file.path),
            "there are no nominal features",
            "the file must give the position of its features",
        )
    tolerances = _feature_tolerances(root, reading)
    return tuple(
        _read_feature(nominal, definitions, tolerances, reading) for nominal in nominals.children
    )


def _by_id(parent: QifElement | None) -> dict[str, QifElement]:
    return (
        {child.attributes["id"]: child for child in parent.children if "id" in child.attributes}
        if parent
        else {}
    )


def _read_feature(
    nominal: QifElement,
    definitions: dict[str, QifElement],
    tolerances: dict[str, dict[str, float]],
    reading: DocumentReading,
) -> DrawnFeature:
    name, refers = nominal.attributes.get("id", ""), nominal.text_at("FeatureDefinitionId")
    if refers not in definitions:
        known = set(definitions)
        raise InvalidInput(
            [unknown_name("feature definition", refers, known, reading.where(nominal))]
        )
    definition = definitions[refers]
    sizes = {}
    for element in (*definition.children, *nominal.children):
        if element.tag in LENGTH_PATHS:
            sizes[element.tag] = reading.length(element)
        elif element.tag == "HalfAngle":
            sizes[element.tag] = reading.number(element) * reading.radians
    outline = reading.numbers(nominal.at("PolyLine"))
    corners = (
        tuple(reading.metres * outline_value for outline_value in outline[i : i + 3])
        for i in range(0, len(outline) - 2, 3)
    )
    sweep = next(
        (
            reading.numbers(sweep_element)
            for path in SWEEP_PATHS
            if (sweep_element := nominal.at(*path))
        ),
        [],
    )
    return DrawnFeature(
        f"f{name}",
        nominal.tag.removesuffix("FeatureNominal"),
        reading.triple(nominal, PLACE_PATHS, reading.metres) or (0.0, 0.0, 0.0),
        reading.triple(nominal, DIRECTION_PATHS) or (0.0, 0.0, 0.0),
        reading.triple(nominal, ACROSS_PATHS),
        (sweep[0] * reading.radians, sweep[1] * reading.radians) if len(sweep) == 2 else None,
        sizes,
        tuple((x, y, z) for x, y, z in corners),
        definition.text_at("InternalExternal") == "INTERNAL",
        tolerances.get(name, {}),
        _entity_ids(nominal),
    )


def _entity_ids(nominal: QifElement) -> tuple[str, ...]:
    """The ids of the faces or edges that a feature consists of."""
    group = nominal.at("EntityInternalIds")
    return (
        tuple(id_element.text.strip() for id_element in group.all("Id"))
        if group is not None
        else ()
    )


def _feature_tolerances(root: QifElement, reading: DocumentReading) -> dict[str, dict[str, float]]:
    """For each feature the narrowest tolerance of each kind of characteristic, in metres."""
    definitions = _by_id(root.at("Characteristics", "CharacteristicDefinitions"))
    nominals = root.at("Characteristics", "CharacteristicNominals")
    tolerances: dict[str, dict[str, float]] = {}
    for nominal in nominals.children if nominals else []:
        definition = definitions.get(nominal.text_at("CharacteristicDefinitionId"))
        width = _zone_width(definition, reading) if definition is not None else None
        kind = nominal.tag.removesuffix("CharacteristicNominal")
        features = nominal.at("FeatureNominalIds")
        if width is None or features is None or kind.startswith("Angle"):
            continue
        for feature in features.all("Id"):
            known = tolerances.setdefault(feature.text.strip(), {})
            known[kind] = min(width, known.get(kind, width))
    return tolerances


def _zone_width(definition: QifElement, reading: DocumentReading) -> float | None:
    """The width of a tolerance zone: its value, or the difference of its limits."""
    if (value := definition.at("ToleranceValue")) is not None:
        return reading.length(value)
    upper, lower = definition.at("Tolerance", "MaxValue"), definition.at("Tolerance", "MinValue")
    if upper is None or lower is None:
        return None
    return abs(reading.length(upper) - reading.length(lower))
