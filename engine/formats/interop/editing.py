"""Edits of the measurements in a problem file, line by line, so that comments and all other lines do not change.

Measurements stand one a line in a block list under their type under `objects:`, as `import qif` writes them; facts and
goals about them one a line. Other layouts are refused.
"""

import re
from collections.abc import Sequence

from engine.formats.interop.measurements import facts, goal
from engine.model.measurement import MeasurementPoint
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.model.conventions import Conventions

ITEM = re.compile(r"^(\s*)- ")


def added(lines: Sequence[str], point: MeasurementPoint, path: str, words: Conventions) -> list[str]:
    """The lines with one more measurement, its facts and a goal."""
    found = [*lines]
    _insert(found, ("objects:", f"{words.measurement}:"), [point.name], path)
    _insert(found, ("statics:",), facts(point, words), path)
    _insert(found, ("goals:",), [goal(point.name, words)], path)
    return found


def removed(lines: Sequence[str], name: str, path: str, words: Conventions) -> list[str]:
    """The lines without a measurement and without the facts and goals about it."""
    listed = _section(lines, ("objects:", f"{words.measurement}:"), path)
    if not any(lines[index].strip() == f"- {name}" for index in listed):
        raise _refused(path, f"'{name}' does not stand in a line of its own under `{words.measurement}:`")
    word = re.compile(rf"(?<![\w]){re.escape(name)}(?![\w])")
    return [line for line in lines if not (ITEM.match(line) and word.search(_without_texts(line)))]


def replaced(lines: Sequence[str], point: MeasurementPoint, path: str, words: Conventions) -> list[str]:
    """The lines with new facts about an existing measurement; its goal and all its other facts are kept."""
    told = {words.needs, words.position, words.normal, words.tolerance, words.bore}
    own = re.compile(rf"^\s*- (?:{'|'.join(sorted(told))})\({re.escape(point.name)},")
    found = [line for line in lines if not own.match(line)]
    _insert(found, ("statics:",), facts(point, words), path)
    return found


def _without_texts(line: str) -> str:
    return re.sub(r'"[^"]*"', '""', line)


def _refused(path: str, message: str) -> InvalidInput:
    hint = "write one measurement, one fact or one goal per line"
    return InvalidInput([Diagnostic(Source(path), "K418", message, hint)])


def _section(lines: Sequence[str], keys: Sequence[str], path: str) -> range:
    """The lines of the block list below nested keys."""
    at, depth = -1, -1
    for key in keys:
        below = (i for i in range(at + 1, len(lines)) if _depth(lines[i]) > depth)
        at = next((i for i in below if lines[i].strip() == key), -1)
        if at < 0:
            raise _refused(path, f"there is no block list under `{' '.join(keys)}`")
        depth = _depth(lines[at])
    end = at + 1
    while end < len(lines) and (
        ITEM.match(lines[end]) or not lines[end].strip() or lines[end].lstrip()[0] == "#"
    ):
        end += 1
    while end > at + 1 and not ITEM.match(lines[end - 1]):
        end -= 1
    return range(at + 1, end)


def _depth(line: str) -> int:
    return len(line) - len(line.lstrip())


def _insert(lines: list[str], keys: Sequence[str], items: Sequence[str], path: str) -> None:
    """Put items at the end of a block list, with the indentation of the items before them."""
    block = _section(lines, keys, path)
    found = ITEM.match(lines[block.stop - 1]) if len(block) else None
    margin = found[1] if found else " " * (2 * len(keys))
    lines[block.stop : block.stop] = [f"{margin}- {item}" for item in items]
