"""Parses JSON texts from anywhere: what cannot be read is a `ValueError`, whatever the reason."""

import json
import math
import re
from typing import Any

HALF_SURROGATE = re.compile(
    r"\\u[dD][89a-fA-F]"
)  # perhaps half of a pair of surrogates, which is no character


MAX_DIGITS = 40  # characters of a whole number from another program


def parse_json(text: str | bytes, is_finite: bool = False) -> Any:
    """What a JSON text says.

    Raises `ValueError`, also where it is nested too deeply, a character is not whole, or it is no
    text; with `is_finite` also for NaN, infinities and whole numbers of too many digits.
    """
    hooks = FINITE_HOOKS if is_finite else {}
    try:
        value = json.loads(text, **hooks)
        if HALF_SURROGATE.search(
            text if isinstance(text, str) else text.decode("utf-8", "replace")
        ):
            json.dumps(value, ensure_ascii=False).encode("utf-8")
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except TypeError:
        raise ValueError("not a text") from None
    return value


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is no number")


def _read_finite_float(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise ValueError("a number that is too large")
    return value


def _read_short_integer(digits: str) -> int:
    if len(digits) > MAX_DIGITS:
        raise ValueError(f"a whole number of more than {MAX_DIGITS} characters")
    return int(digits)


FINITE_HOOKS: dict[str, Any] = {
    "parse_constant": _refuse_constant,
    "parse_float": _read_finite_float,
    "parse_int": _read_short_integer,
}
