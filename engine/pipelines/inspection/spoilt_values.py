"""Values that no longer count: their tool was found wrong later, or the part had moved.

The fault base says which measurements a cause spoils, and since when (`since`). A run notes them
when it finds the cause.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from cellwright.engine.model.verdicts import Spoilt
from cellwright.kb.model.measured_results import Measured
from cellwright.kb.terms import Atom, Function


def spoilt_measurements(gone: Iterable[Atom], measured: str) -> list[list[str]]:
    """The measurements among facts that do not hold any more, each as what was measured and by
    which tool, as a record has them.
    """
    facts_gone = (fact for fact in gone if fact.name == measured and len(fact.arguments) > 1)
    return [[str(_inner_name(fact)), str(fact.arguments[0])] for fact in facts_gone]


def _inner_name(atom: Atom) -> object:
    place = atom.arguments[-1]
    return place.arguments[0] if isinstance(place, Function) and place.arguments else place


def spoilt_in(records: Iterable[tuple[Mapping[str, Any], int]]) -> list[Spoilt]:
    """What records of a run, each with its time, say about values that do not count any more."""
    return [
        Spoilt(of, tool, at_ms, content["why"])
        for content, at_ms in records
        for of, tool in content.get("spoils", ())
    ]


def counting_values(measured: Iterable[Measured], spoilt: Collection[Spoilt]) -> list[Measured]:
    """The values that still count."""
    return [value for value in measured if why_spoilt(value, spoilt) is None]


def why_spoilt(measured: Measured, spoilt: Collection[Spoilt]) -> str | None:
    """Why a value does not count any more; None if it does."""
    reasons = (
        spoilt_value
        for spoilt_value in spoilt
        if (spoilt_value.of, spoilt_value.tool) == (measured.of, measured.tool)
    )
    return next(
        (spoilt_value.why for spoilt_value in reasons if measured.at_ms <= spoilt_value.until_ms),
        None,
    )


def set_aside(
    measured: Sequence[Measured], spoilt: Collection[Spoilt]
) -> dict[tuple[str, str], list[tuple[Measured, str]]]:
    """The values that do not count any more with the reasons, by what was measured and which
    quantity.
    """
    values_aside: dict[tuple[str, str], list[tuple[Measured, str]]] = {}
    for value in measured:
        if (why := why_spoilt(value, spoilt)) is not None:
            values_aside.setdefault((value.of, value.quantity), []).append((value, why))
    return values_aside
