"""Finds text that must not reach clingo.

clingo follows inclusions, and text can overflow its stack or its integers, or break its messages.
"""

import re
from dataclasses import dataclass

MAX_NESTING = 50
MAX_OPERATIONS = 100
MAX_PARTS = 10_000  # of one statement, between its commas and semicolons
LARGEST = 2**31 - 1


@dataclass(frozen=True, slots=True)
class Suspicion:
    """Why a text is not given to clingo, and the offset of the character that is the reason."""

    offset: int
    message: str
    hint: str
    code: str = "K202"


def suspicion(text: str, longest: int = 65_536) -> Suspicion | None:
    """The first thing in a text that is not safe to give to clingo; None for nearly every text."""
    if len(text) <= 1000 and _ORDINARY.fullmatch(text) and text.count("(") <= MAX_NESTING:
        return None
    if len(text) > longest:
        return Suspicion(
            0, f"longer than {longest} characters", "give long lists of facts in problems", "K007"
        )
    bare = _BLANKED.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)
    depth = operations = parts = 0
    for found in _SUSPICIOUS.finditer(bare):
        sign = found[0]
        depth += (sign in "([{") - (sign in ")]}")
        operations = 0 if sign in (",", ";", ".", "..") else operations + (sign in "-+*/\\~^?&|")
        parts = 0 if sign == "." else parts + (sign in ",;")
        if why := _why(sign, depth, operations, parts):
            return Suspicion(found.start(), *why)
    return None


_ORDINARY = re.compile(r"(?:[a-zA-Z_(), ]|[0-9](?![0-9]{8}))*")
_BLANKED = re.compile(r'%\*.*?\*%|%[^\n]*|"(?:\\.|[^"\\\n])*"', re.DOTALL)
_SUSPICIOUS = re.compile(r"#\s*(?:include|script)\b|[0-9]{10,}|\.\.|[][(){},;.~^?&|*/\\+-]|[^\x01-\x7f]")


def _why(sign: str, depth: int, operations: int, parts: int) -> tuple[str, ...] | None:
    if sign.endswith("script"):
        return "#script is not allowed: domain files are data", "express it as rules"
    if sign.startswith("#"):
        return "#include is not part of the language", "list the file under `include:` in domain.yaml", "K203"
    if not sign.isascii() or sign == "\0":
        return (
            f"unexpected '{sign}'" if sign != "\0" else "a NUL",
            "only texts and comments may hold it",
            "K201",
        )
    if sign.isdigit() and int(sign[:20]) > LARGEST:
        return "this number is too large", f"the largest is {LARGEST}", "K113"
    if depth > MAX_NESTING:
        return f"nested deeper than {MAX_NESTING} brackets", "no term needs so many", "K007"
    if operations > MAX_OPERATIONS:
        return f"more than {MAX_OPERATIONS} operations in one term", "compute it beforehand", "K007"
    if parts > MAX_PARTS:
        return f"more than {MAX_PARTS} parts in one statement", "write several statements", "K007"
    return None
