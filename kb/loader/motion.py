"""The section `motion` of a domain file: how fast an arm moves from place to place."""

import re
from fractions import Fraction

from cellwright.kb.diagnostics import Source
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.reader import Reader
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.cell import WORLD
from cellwright.kb.model.conventions import CONVENTIONS
from cellwright.kb.model.domain import Predicate
from cellwright.kb.model.motion import DISTANCE, Motion
from cellwright.kb.syntax import SECONDS, unit_seconds

MICROMETRES = {"m": 1_000_000, "cm": 10_000, "mm": 1_000, "in": 25_400}
SPEED = re.compile(rf"([0-9]+(?:\.[0-9]+)?)\s*({'|'.join(MICROMETRES)})\s*/\s*([a-z]+)")
DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*([a-z]*)")
LONGEST = Fraction(86_400)  # seconds
FASTEST = Fraction(10**10)  # micrometres per second
SLOWEST = Fraction(1, 10**3)


def read_motion(reader: Reader, names: Names) -> Motion | None:
    """The motion that a domain declares; None if it declares none, or one that is reported."""
    if "motion" not in reader.root.value:
        return None
    names.travel = reader.text("conventions", "travel") or CONVENTIONS["travel"].role
    where = reader.root.value["motion"][0].where
    _refuse_others(where, names)
    if not reader.text("motion", "speed"):
        reader.findings.add(where, "K005", "`motion:` without a speed", "write `speed: 250 mm/s` below it")
        return None
    speed = _speed(reader.root.descend(("motion", "speed")), reader)
    settling = _settling(reader)
    if speed is None or settling is None:
        return None
    return Motion(speed, settling, reader.text("motion", "frame") or WORLD, where)


def _speed(node: Node, reader: Reader) -> Fraction | None:
    """Micrometres per unit of the domain's time."""
    found = SPEED.fullmatch(str(node.value).strip())
    unit = unit_seconds(found[3]) if found else None
    if found is None or unit is None:
        hint = "write 250 mm/s, 0.2 m/s or 12 m/min"
        reader.findings.add(node.where, "K005", f"'{str(node.value)[:40]}' is not a speed", hint)
        return None
    per_second = Fraction(found[1]) * MICROMETRES[found[2]] / unit
    if not SLOWEST <= per_second <= FASTEST:
        hint = "a speed must be greater than 0, and less than 10 km/s"
        reader.findings.add(node.where, "K113", f"the speed {found[0]} is out of range", hint)
        return None
    return per_second * SECONDS[reader.time_unit]


def _settling(reader: Reader) -> Fraction | None:
    """Units of the domain's time, 0 if nothing is said."""
    said, node = reader.text("motion", "settling").strip(), reader.root.descend(("motion", "settling"))
    if not said:
        return Fraction(0)
    found = DURATION.fullmatch(said)
    unit = unit_seconds(found[2] or reader.time_unit) if found else None
    if found is None or unit is None:
        hint = "write 300 ms, 0.5 s or 0"
        reader.findings.add(node.where, "K005", f"'{said[:40]}' is not a time of 0 or more", hint)
        return None
    settling = Fraction(found[1]) * unit
    if settling > LONGEST:
        reader.findings.add(
            node.where, "K113", f"the settling time {found[0]} is longer than a day", "check the unit"
        )
        return None
    return settling / SECONDS[reader.time_unit]


def _refuse_others(where: Source, names: Names) -> None:
    """Report whatever else has one of the names that durations use for ways between places.

    A table of travel times, with places and a number, is no other thing: its facts come first.
    """
    for name in (names.travel, DISTANCE):
        other = names.predicates.get(name) or names.functions.get(name)
        table = name == names.travel and isinstance(other, Predicate) and _is_table(other)
        if other is not None and not table:
            message = (
                f"with `motion:`, durations call a number '{name}', but line {other.where.line} declares it"
            )
            names.findings.add(where, "K104", message, "give the other one another name")


def _is_table(predicate: Predicate) -> bool:
    return CONVENTIONS["travel"].deviation(predicate.kind.value, predicate.arguments) is None
