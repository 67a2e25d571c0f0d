"""Rows of plain text as a table or, if the terminal is too narrow, as records. No text is cut off, no word that fits on a
line is broken, and no term if there is room."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from engine.formats.report.wrapping import terms, wrapped

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

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        room = options.max_width - GAP * (len(self.headings) - 1)
        for least in (self._least(terms), self._least(str.split)):
            if sum(least) <= room:
                yield self._table(self._widths(least, room - sum(least)))
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
            table.add_row(*(Text(_fitted(cell, width)) for cell, width in zip(row, widths, strict=True)))
        return table

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


def _fitted(cell: str, width: int) -> str:
    return "\n".join(wrapped(line, width, 0) for line in cell.splitlines())


def _named(name: str, cell: str) -> list[str]:
    lines = cell.splitlines()
    return [f"{name}: {lines[0]}" if name else lines[0], *lines[1:]]
