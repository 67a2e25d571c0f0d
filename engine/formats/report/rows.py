"""Rows of plain text as a table or, if the terminal is too narrow, as records. No text is cut off, and no word that fits
on a line is broken."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from engine.formats.report.wrapping import wrapped

GAP = 2  # characters between columns


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

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        spare = options.max_width - GAP * (len(self.headings) - 1) - sum(self._least())
        if spare >= 0:
            yield self._table(self._widths(spare))
            return
        for row in self.rows:
            cells = zip(self.headings[1:], row[1:], strict=True)
            below = [line for name, cell in cells if cell for line in _named(name, cell)]
            yield headed(row[0], below, options.max_width)

    def _table(self, widths: Sequence[int]) -> Table:
        table = Table(box=None, pad_edge=False, padding=(0, GAP, 0, 0), show_header=any(self.headings))
        for place, (heading, width) in enumerate(zip(self.headings, widths, strict=True)):
            table.add_column(
                Text(heading),
                justify="right" if heading in self.right else "left",
                style=self.lead if place == 0 else "",
                header_style="bold",
                overflow="fold",
                width=width,
            )
        for row in self.rows:
            table.add_row(*map(Text, row))
        return table

    def _columns(self) -> Iterator[tuple[str, ...]]:
        return zip(self.headings, *self.rows, strict=True)

    def _least(self) -> list[int]:
        """The longest word of each column."""
        return [
            max((len(word) for cell in column for word in cell.split()), default=0)
            for column in self._columns()
        ]

    def _widths(self, spare: int) -> list[int]:
        """The width of each column: as wide as its text, or a fair share of the space beside the longest words."""
        widths = self._least()
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


def _named(name: str, cell: str) -> list[str]:
    lines = cell.splitlines()
    return [f"{name}: {lines[0]}" if name else lines[0], *lines[1:]]
