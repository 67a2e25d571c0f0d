"""Numbers in files, whatever the format: finite, not too large, and written with few digits."""

import math
import re
import sys

MAX_FILE_NUMBER = 1e15  # whole numbers up to here are exact as floating-point numbers, too
MAX_NUMBER_CHARACTERS = 40  # characters of a number
PLAIN_DIGITS = 400  # characters of any floating-point number that is written without an exponent
WHOLE_NUMBER = re.compile(r"[+-]?[0-9]+")
# linear: there is only one way to split the digits
DECIMAL_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


COUNT_NUMBER = re.compile(r"[0-9]{1,15}")


class NumberError(ValueError):
    """A text that is no number for us.

    The message says why, and can follow the text in quotation marks.
    """


def read_whole(text: str, least: int | None = None, most: int = int(MAX_FILE_NUMBER)) -> int:
    """The whole number that a text is, from `least` to `most`. Raises `NumberError`."""
    if not WHOLE_NUMBER.fullmatch(text):
        raise NumberError("is not a whole number")
    value = _in_range(int(_shorten_text(text)), most)
    if least is not None and value < least:
        raise NumberError(f"is less than {least}")
    return int(value)


def read_decimal(
    text: str, most: float = MAX_FILE_NUMBER, longest: int = MAX_NUMBER_CHARACTERS
) -> float:
    """The number that a text of at most `longest` characters is: at most `most` in size.

    Raises `NumberError`.
    """
    if not DECIMAL_NUMBER.fullmatch(text):
        raise NumberError("is not a number")
    return _in_range(float(_shorten_text(text, longest)), most)


def read_finite(text: str) -> float:
    """The number that a text is, of any size that is finite. Raises `NumberError`."""
    return read_decimal(text, sys.float_info.max, PLAIN_DIGITS)


def is_number(value: object, most: float = MAX_FILE_NUMBER) -> bool:
    """Whether a plain value, such as one of a JSON text, is a number from -`most` to `most`;
    NaN and truth values are none.
    """
    return isinstance(value, int | float) and not isinstance(value, bool) and -most <= value <= most


def is_count(text: str) -> bool:
    """Whether a text is a whole number without a sign, of at most 15 digits."""
    return COUNT_NUMBER.fullmatch(text) is not None


def _shorten_text(text: str, longest: int = MAX_NUMBER_CHARACTERS) -> str:
    if len(text) > longest:
        raise NumberError(f"has more than {longest} characters")
    return text


def _in_range(value: float, most: float) -> float:
    if not math.isfinite(value) or abs(value) > most:
        raise NumberError(f"is too large: the largest is {most:g}")
    return value
