"""Columns of tables that give a tolerance by its two ends, under the names that measuring programs
use.

The zone goes from the lower to the upper deviation from the nominal value. Its width is the
tolerance; if it lies unevenly, the value in its middle is what the measurement should give.
"""

import re
from collections.abc import Collection, Mapping

UPPER, LOWER = "upper_tol", "lower_tol"
MINUS = "minus_tol"  # a lower deviation that is written without its sign
EVEN = "plus_minus_tol"  # half of the width of an even zone
ENDS = (UPPER, LOWER, MINUS, EVEN)
_WORDS = {"tol", "tolerance", "dev", "deviation", "limit"}
_NAMES = {
    UPPER: {"upper", "up", "plus", "+", "u", "max", "positive", "high"},
    LOWER: {"lower", "low", "l", "min", "negative"},
    MINUS: {"minus", "-"},
    EVEN: {"+/-", "+-", "±"},
}
_SHORT = {"utol": UPPER, "ltol": LOWER, "uppertol": UPPER, "lowertol": LOWER}
_SHORT |= {"tolplus": UPPER, "tolminus": MINUS, "plustol": UPPER, "minustol": MINUS}


def tolerance_column(written: str) -> str:
    """The meaning of a column (`+tol`, `upper tolerance`, `tol_minus`); empty if it is none of
    these.
    """
    parts = re.findall(r"\+/-|\+-|[±+]|-|[a-z]+", written.lower().replace("_", " "))
    words = (
        [each for each in parts if each not in ("-",)]
        if not written.strip().startswith("-")
        else parts
    )
    if written.strip().endswith("-"):
        words = [*words, "-"]
    if "".join(words) in _SHORT and len(words) == 1:
        return _SHORT["".join(words)]
    kinds = [name for name, known in _NAMES.items() if known & set(words)]
    rest = [each for each in words if not any(each in known for known in _NAMES.values())]
    return (
        kinds[0] if len(kinds) == 1 and rest and set(rest) <= _WORDS and set(words) & _WORDS else ""
    )


def looks_like_tolerance(column: str) -> bool:
    """Whether a column seems to give a tolerance: it must not be passed over."""
    return re.search(r"tol|deviation|\blimit|[±]|^\s*[+-]", column.lower()) is not None


def contradiction(columns: Collection[str]) -> str:
    """What is wrong with the columns of tolerances taken together; empty if nothing is."""
    lower = LOWER in columns or MINUS in columns
    if "tolerance" in columns and set(ENDS) & set(columns):
        return "a width of the tolerance zone and its ends"
    if EVEN in columns and (UPPER in columns or lower):
        return "an even tolerance and its ends"
    if (UPPER in columns) != lower:
        return "one end of the tolerance without the other"
    return "two lower ends of the tolerance" if LOWER in columns and MINUS in columns else ""


def zone(values: Mapping[str, float]) -> tuple[float, float] | None:
    """The lower and the upper deviation of a row, in metres; None if it has none."""
    if EVEN in values:
        return -abs(values[EVEN]), abs(values[EVEN])
    lower = values[LOWER] if LOWER in values else -abs(values[MINUS]) if MINUS in values else None
    return (lower, values[UPPER]) if lower is not None and UPPER in values else None
