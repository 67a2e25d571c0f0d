"""Long tables as lines of text: rich needs longer for the table of thousands of steps than the planner for the plan."""

import itertools
from collections.abc import Collection, Iterable, Iterator, Sequence

from rich.segment import Segment
from rich.style import Style

GAP = "  "


def lines(head: Sequence[str], rows: Iterable[Sequence[str]], right: Collection[int]) -> Iterator[Segment]:
    """A head and rows in columns as wide as their text. Cells may have several lines; columns in `right` hold numbers."""
    table = [[cell.splitlines() or [""] for cell in row] for row in rows]
    widths = [
        max(len(name), *(len(line) for row in table for line in row[place]))
        for place, name in enumerate(head)
    ]
    yield Segment(_line(head, widths, right), Style(bold=True))
    for row in table:
        for cells in itertools.zip_longest(*row, fillvalue=""):
            yield Segment(_line(cells, widths, right))


def _line(cells: Sequence[str], widths: Sequence[int], right: Collection[int]) -> str:
    placed = (
        cell.rjust(width) if place in right else cell.ljust(width)
        for place, (cell, width) in enumerate(zip(cells, widths, strict=True))
    )
    return GAP.join(placed).rstrip() + "\n"
