"""What the index knows of the keys of files agrees with the schemas."""

from collections.abc import Iterator

import pytest

from cellwright.kb.editing.scalar_roles import SHAPE_OF_KIND, ScalarShape
from cellwright.kb.schema import keys_at

Path = tuple[str | int, ...]
UNNAMED = {"repeats",
    "about", "after", "approach", "asks", "asserted", "at", "bodies", "box", "by", "chain", "classes",
    "complete", "completes", "contact", "contact_classes", "controllable", "cost", "cylinder", "depth",
    "distance", "drives", "duration", "during", "ends", "fault", "features", "field", "filters",
    "freedom", "friction", "gravity", "height_field", "home", "initial", "joint", "lies", "mass", "mesh",
    "model", "motion", "needs", "objects", "offers", "otherwise", "outcomes", "own", "packages",
    "parameters", "parents", "patch", "plate", "point_set", "polyhedron", "probes", "processes",
    "quantity", "range", "ranging", "readings", "relevance", "reply", "restrictions", "ring", "risk",
    "rpy", "say", "settings", "shapes", "sight", "slides", "slip", "smoothing", "solid", "speed",
    "sphere", "srdf", "starts", "stop", "stops", "swings", "takes", "timeouts", "tells", "tilts", "tools", "tube",
    "begins", "closed", "every", "open", "price", "turn", "turns", "undesirable", "unit", "units", "urdf",
}  # fmt: skip
"""Keys whose values name nothing that a domain declares, or name it in a form of their own."""


def mappings(kind: str, shape: ScalarShape, path: Path = ()) -> Iterator[tuple[Path, ScalarShape]]:
    """Every place of a kind of file at which the index knows keys."""
    if shape.keys:
        yield path, shape
    for key, inner in shape.keys.items():
        yield from mappings(kind, inner, (*path, key))
    if shape.other is not None:
        yield from mappings(kind, shape.other, (*path, "name"))
    if shape.items is not None:
        yield from mappings(kind, shape.items, (*path, 0))


@pytest.mark.parametrize("kind", SHAPE_OF_KIND)
def test_every_key_that_the_index_knows_is_in_the_schema(kind: str) -> None:
    for path, shape in mappings(kind, SHAPE_OF_KIND[kind]):
        assert set(shape.keys) <= set(keys_at(kind, path)), path


@pytest.mark.parametrize("kind", SHAPE_OF_KIND)
def test_every_key_of_the_schema_is_known_to_the_index_or_names_nothing(kind: str) -> None:
    """A new key in a schema fails here until somebody has said what stands under it."""
    for path, shape in mappings(kind, SHAPE_OF_KIND[kind]):
        assert set(keys_at(kind, path)) - set(shape.keys) <= UNNAMED, path
