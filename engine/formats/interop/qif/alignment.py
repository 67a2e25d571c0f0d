"""Which features a part is aligned by, and in which order: its datums, by their precedence in datum reference frames."""

from collections.abc import Iterator

from cellwright.engine.formats.interop.qif.document import Element

STEPS = {"PRIMARY": 1, "SECONDARY": 2, "TERTIARY": 3, "QUATERNARY": 4, "QUINARY": 5, "SENARY": 6}
LATER = 7  # precedence of another name


def alignment_steps(root: Element) -> dict[str, int]:
    """The step (1 first) in which each feature that is a datum is measured, by the ids of features.

    A datum of several frames has its earliest step. In a document without frames, the datums follow their labels.
    """
    features = {name: tuple(found) for name, found in _datums(root)}
    found: dict[str, int] = {}
    for datum, step in list(_in_frames(root)) or _by_label(root):
        for feature in features.get(datum, ()):
            found[feature] = min(step, found.get(feature, step))
    used = {step: number for number, step in enumerate(sorted(set(found.values())), 1)}
    return {feature: used[step] for feature, step in found.items()}


def _children(root: Element, group: str) -> list[Element]:
    found = root.at(group)
    return found.children if found is not None else []


def _datums(root: Element) -> Iterator[tuple[str, list[str]]]:
    """Each datum with the features that make it, itself or through its targets."""
    targets = {
        each.attributes.get("id", ""): each.text_at("FeatureNominalId")
        for each in _children(root, "DatumTargetDefinitions")
    }
    for datum in _children(root, "DatumDefinitions"):
        own = _ids(datum.at("FeatureNominalIds"))
        through = [targets[each] for each in _ids(datum.at("DatumTargetIds")) if targets.get(each)]
        yield datum.attributes.get("id", ""), [*own, *through]


def _ids(group: Element | None) -> list[str]:
    return [each.text.strip() for each in group.all("Id")] if group is not None else []


def _in_frames(root: Element) -> Iterator[tuple[str, int]]:
    """The datums of all frames with their steps."""
    for frame in _children(root, "DatumReferenceFrames"):
        datums = frame.at("Datums")
        for datum in datums.children if datums is not None else ():
            step = STEPS.get(datum.text_at("Precedence", "PrecedenceEnum"), LATER)
            yield from ((each.text.strip(), step) for each in _below(datum, "DatumDefinitionId"))


def _below(element: Element, tag: str) -> Iterator[Element]:
    for child in element.children:
        if child.tag == tag:
            yield child
        else:
            yield from _below(child, tag)


def _by_label(root: Element) -> list[tuple[str, int]]:
    found = sorted(
        (each.text_at("DatumLabel"), each.attributes.get("id", ""))
        for each in _children(root, "DatumDefinitions")
    )
    return [(name, step) for step, (_, name) in enumerate(found, 1)]
