"""Tells a PDDL domain, a problem and a plan apart, so that files in a wrong order are told as
that.
"""

import re

from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.files import File

DOMAIN, PROBLEM, PLAN = "domain", "problem", "plan"
ORDER = "the domain comes first, then the problem, and then the plan if there is one"
_DEFINED = re.compile(r"\(\s*define\s*\(\s*(domain|problem)(?=[\s()])", re.IGNORECASE)
# `0.000: (move a b) [5.0]`, or `(move a b)`: an action and no parentheses in it
_STEP = re.compile(r"\d+(\.\d*)?\s*:|\((?!\s*define\b)[^():;]+\)\s*(\[[^\]\n]*\])?\s*(;.*)?(\n|$)")


def require_file(file: File, wanted: str) -> None:
    """Refuse a file of a PDDL task in the place of another.

    What is none of them is left to the readers. Raises `InvalidInput` (K801).
    """
    start = _first_word(file.text)
    kind = _kind_at(file.text, start)
    if kind in ("", wanted):
        return
    said = f"this is a {kind}, but a PDDL {wanted} is wanted here"
    raise InvalidInput([Diagnostic(file.at(start), "K801", said, ORDER)])


def _first_word(text: str) -> int:
    """Where the text begins, after spaces and comments."""
    begin = re.match(r"(?:\s+|;[^\n]*)*", text)
    return begin.end() if begin else 0


def _kind_at(text: str, start: int) -> str:
    if definition := _DEFINED.match(text, start):
        return definition[1].lower()
    if _STEP.match(text, start) or text.startswith("{", start):
        return PLAN
    return ""
