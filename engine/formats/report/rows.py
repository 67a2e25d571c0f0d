"""Rows of plain text as a table or, if the terminal is too narrow, as records. No text is cut off, no word that fits on a
line is broken, and no term if there is room."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest

from rich.cells import cell_len, chop_cells
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.style import Style
from rich.text import Text

from cellwright.engine.formats.report.wrapping import terms, wrapped

GAP = 2  # characters between columns
Cut = Callable[[str], Iterable[str]]


def headed(head: str, below: Iterable[str], width: int) -> Text:
    """A head and indented lines below it, all at most `width` characters long."""
    text = Text(wrapped(head, width), "bold")
    for line in below:
        text.append("\n  " + wrapped(line, width - 2).replace("\n", "\n  "), "not bold")
    return text


@dataclass(frozen=True, slots=True)
class TextTable:
    """Cells under headings. If all headings are empty, there is no head. `right` names columns of numbers."""

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: Collection[str] = ()
    lead: str = ""  # style of the first column

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterator[RenderableType | Segment]:
        room = options.max_width - GAP * (len(self.headings) - 1)
        for least in (self._least(terms), self._least(str.split)):
            if sum(least) <= room:
                widths = self._widths(least, room - sum(least))
                yield from self._lines(console, widths)
                return
        for row in self.rows:
            cells = zip(self.headings[1:], row[1:], strict=True)
            below = [line for name, cell in cells if cell for line in _named(name, cell)]
            yield headed(row[0], below, options.max_width)

    def _lines(self, console: Console, widths: Sequence[int]) -> Iterator[Segment]:
        """The lines of the table. Schedules have thousands, so they are written directly: `rich.table` takes most of a second
        for a thousand rows.
        """
        bold, lead, new = console.get_style("bold"), console.get_style(self.lead or "none"), Segment.line()
        if any(self.headings):
            pairs = zip(self.headings, widths, strict=True)
            heads = [Text(name).wrap(console, width, overflow="fold") for name, width in pairs]
            tall = max(map(len, heads))
            parts = [[""] * (tall - len(each)) + [line.plain.rstrip() for line in each] for each in heads]
            for line in zip(*parts, strict=True):
                yield from self._written(line, widths, bold, bold)
                yield new
        for row in self.rows:
            cells = [_fitted(cell, width) for cell, width in zip(row, widths, strict=True)]
            for line in zip_longest(*cells, fillvalue=""):
                yield from self._written(line, widths, lead, None)
                yield new

    def _written(
        self, line: Sequence[str], widths: Sequence[int], lead: Style, style: Style | None
    ) -> Iterator[Segment]:
        """One line of cells, the first in a style of its own."""
        padded = [
            _padded(part, width, name in self.right)
            for part, width, name in zip(line, widths, self.headings, strict=True)
        ]
        yield Segment(padded[0], lead or None)
        if len(padded) > 1:
            yield Segment("".join(" " * GAP + part for part in padded[1:]), style)

    def _columns(self) -> Iterator[tuple[str, ...]]:
        return zip(self.headings, *self.rows, strict=True)

    def _least(self, cut: Cut) -> list[int]:
        """The longest piece of each column, when its cells are cut; headings are cut between words, those of numbers not."""
        return [
            max(
                [_longest(cut(cell)) for cell in cells]
                + [_longest([name] if name in self.right else name.split())]
            )
            for name, *cells in self._columns()
        ]

    def _widths(self, least: Sequence[int], spare: int) -> list[int]:
        """The width of each column: as wide as its text, or a fair share of the space beside its longest pieces."""
        widths = list(least)
        lacks = [
            max((len(line) for cell in column for line in cell.splitlines()), default=0) - least
            for column, least in zip(self._columns(), widths, strict=True)
        ]
        for left, place in zip(
            range(len(lacks), 0, -1), sorted(range(len(lacks)), key=lacks.__getitem__), strict=True
        ):
            given = min(lacks[place], spare // left)
            widths[place] += given
            spare -= given
        return widths


def _longest(pieces: Iterable[str]) -> int:
    return max((len(piece.rstrip()) for piece in pieces), default=0)


def _fitted(cell: str, width: int) -> list[str]:
    """The lines of a cell, at least one."""
    whole = [part for line in cell.splitlines() for part in wrapped(line, width, 0).splitlines()]
    return [part for line in whole for part in _chopped(line, width)] or [""]


def _chopped(line: str, width: int) -> list[str]:
    """A line in pieces of at most so many columns: some characters take two."""
    return chop_cells(line, width) if cell_len(line) > width else [line]


def _padded(text: str, width: int, right: bool) -> str:
    """A text in its column."""
    space = " " * (width - cell_len(text))
    return space + text if right else text + space


def _named(name: str, cell: str) -> list[str]:
    lines = cell.splitlines()
    return [f"{name}: {lines[0]}" if name else lines[0], *lines[1:]]
