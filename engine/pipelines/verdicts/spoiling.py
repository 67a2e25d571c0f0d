"""Values that do not count any more, because it was found out later that their tool was wrong, or that the part had moved.

The fault base says which measurements a cause spoils, and since when (`since`). A run notes them when it finds the cause.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from cellwright.engine.model.verdicts import Spoilt
from cellwright.kb.model.results import Measured
from cellwright.kb.terms import Atom, Function


def spoils(gone: Iterable[Atom], measured: str) -> list[list[str]]:
    """The measurements among facts that do not hold any more, each as what was measured and by which tool, as a record has them."""
    found = (each for each in gone if each.name == measured and len(each.arguments) > 1)
    return [[str(_inside(each)), str(each.arguments[0])] for each in found]


def _inside(atom: Atom) -> object:
    place = atom.arguments[-1]
    return place.arguments[0] if isinstance(place, Function) and place.arguments else place


def spoilt_in(records: Iterable[tuple[Mapping[str, Any], int]]) -> list[Spoilt]:
    """What records of a run, each with its time, say about values that do not count any more."""
    return [
        Spoilt(of, tool, at_ms, content["why"])
        for content, at_ms in records
        for of, tool in content.get("spoils", ())
    ]


def standing(measured: Iterable[Measured], spoilt: Collection[Spoilt]) -> list[Measured]:
    """The values that still count."""
    return [each for each in measured if why_spoilt(each, spoilt) is None]


def why_spoilt(measured: Measured, spoilt: Collection[Spoilt]) -> str | None:
    """Why a value does not count any more; None if it does."""
    said = (each for each in spoilt if (each.of, each.tool) == (measured.of, measured.tool))
    return next((each.why for each in said if measured.at_ms <= each.until_ms), None)


def set_aside(
    measured: Sequence[Measured], spoilt: Collection[Spoilt]
) -> dict[tuple[str, str], list[tuple[Measured, str]]]:
    """The values that do not count any more with the reasons, by what was measured and which quantity."""
    found: dict[tuple[str, str], list[tuple[Measured, str]]] = {}
    for each in measured:
        if (why := why_spoilt(each, spoilt)) is not None:
            found.setdefault((each.of, each.quantity), []).append((each, why))
    return found
