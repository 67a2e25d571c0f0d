"""Tables of plain text that fit the width of the terminal, and the breaking of long lines."""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest

from rich.cells import cell_len, chop_cells
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.style import Style
from rich.text import Text

WORD_PATTERN = re.compile(r"(?:for )?[^ ]* ?")
TERM_PIECE = re.compile(r"[^ (]*[ (]?")


def join_ranges(numbers: Iterable[int]) -> str:
    """Ascending numbers in few words: `1..4, 7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1][1:] = [number]
        else:
            runs.append([number])
    return ", ".join("..".join(map(str, run)) for run in runs)


def wrap_text(text: str, width: int, indent: int = 2) -> str:
    """The text in lines of at most `width` characters (at least 4); all lines except the first are
    indented.

    Only line breaks and spaces change.
    """
    return "\n".join(_wrapped_lines(text, max(width, indent + 2), " " * indent))


def _wrapped_lines(text: str, width: int, indent: str) -> Iterator[str]:
    line = ""
    for piece in _text_pieces(text, width - len(indent)):
        if line.strip() and len((line + piece).rstrip()) > width:
            yield line.rstrip()
            line = indent
        line += piece
        while len(line.rstrip()) > width:  # one piece longer than a line
            yield line[:width]
            line = indent + line[width:]
    yield line.rstrip()


def _text_pieces(text: str, width: int) -> Iterator[str]:
    """Terms and words; a term longer than a line is broken after its commas, what is still
    longer at its brackets.
    """
    for term in split_terms(text):
        for word in [term] if len(term.rstrip()) <= width else WORD_PATTERN.findall(term):
            yield from TERM_PIECE.findall(word) if len(word.rstrip()) > width else [word]


def split_terms(text: str) -> Iterator[str]:
    """The text, cut at the spaces that are within no brackets."""
    term, depth = "", 0
    for word in WORD_PATTERN.findall(text):
        term += word
        depth = max(0, depth + word.count("(") - word.count(")"))
        if depth == 0:
            yield term
            term = ""
    yield term


TABLE_GAP = 2  # characters between columns
Cut = Callable[[str], Iterable[str]]


def indented_text(head: str, below: Iterable[str], width: int) -> Text:
    """A head and indented lines below it, all at most `width` characters long."""
    text = Text(wrap_text(head, width), "bold")
    for line in below:
        text.append("\n  " + wrap_text(line, width - 2).replace("\n", "\n  "), "not bold")
    return text


@dataclass(frozen=True, slots=True)
class TextTable:
    """Cells under headings.

    If all headings are empty, there is no head. `right` names columns of numbers.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: Collection[str] = ()
    lead: str = ""  # style of the first column

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterator[RenderableType | Segment]:
        room = options.max_width - TABLE_GAP * (len(self.headings) - 1)
        for least in (self._least(split_terms), self._least(str.split)):
            if sum(least) <= room:
                widths = self._widths(least, room - sum(least))
                yield from self._lines(console, widths)
                return
        for row in self.rows:
            cells = zip(self.headings[1:], row[1:], strict=True)
            below = [line for name, cell in cells if cell for line in _named_cell(name, cell)]
            yield indented_text(row[0], below, options.max_width)

    def _lines(self, console: Console, widths: Sequence[int]) -> Iterator[Segment]:
        """The lines of the table. Schedules have thousands, so they are written directly:
        `rich.table` takes most of a second for a thousand rows.
        """
        bold, lead, new = (
            console.get_style("bold"),
            console.get_style(self.lead or "none"),
            Segment.line(),
        )
        if any(self.headings):
            pairs = zip(self.headings, widths, strict=True)
            heads = [Text(name).wrap(console, width, overflow="fold") for name, width in pairs]
            tall = max(map(len, heads))
            parts = [
                [""] * (tall - len(head)) + [line.plain.rstrip() for line in head] for head in heads
            ]
            for line in zip(*parts, strict=True):
                yield from self._written(line, widths, bold, bold)
                yield new
        for row in self.rows:
            cells = [_fit_cell(cell, width) for cell, width in zip(row, widths, strict=True)]
            for line in zip_longest(*cells, fillvalue=""):
                yield from self._written(line, widths, lead, None)
                yield new

    def _written(
        self, line: Sequence[str], widths: Sequence[int], lead: Style, style: Style | None
    ) -> Iterator[Segment]:
        """One line of cells, the first in a style of its own."""
        padded = [
            _pad_text(part, width, name in self.right)
            for part, width, name in zip(line, widths, self.headings, strict=True)
        ]
        yield Segment(padded[0], lead or None)
        if len(padded) > 1:
            yield Segment("".join(" " * TABLE_GAP + part for part in padded[1:]), style)

    def _columns(self) -> Iterator[tuple[str, ...]]:
        return zip(self.headings, *self.rows, strict=True)

    def _least(self, cut: Cut) -> list[int]:
        """The longest piece of each column, when its cells are cut; headings are cut between
        words, those of numbers not.
        """
        return [
            max(
                [_longest_piece(cut(cell)) for cell in cells]
                + [_longest_piece([name] if name in self.right else name.split())]
            )
            for name, *cells in self._columns()
        ]

    def _widths(self, least: Sequence[int], spare: int) -> list[int]:
        """The width of each column: as wide as its text, or a fair share of the space beside
        its longest pieces.
        """
        widths = list(least)
        lacks = [
            max((len(line) for cell in column for line in cell.splitlines()), default=0) - least
            for column, least in zip(self._columns(), widths, strict=True)
        ]
        for columns_left, place in zip(
            range(len(lacks), 0, -1), sorted(range(len(lacks)), key=lacks.__getitem__), strict=True
        ):
            granted = min(lacks[place], spare // columns_left)
            widths[place] += granted
            spare -= granted
        return widths


def _longest_piece(pieces: Iterable[str]) -> int:
    return max((len(piece.rstrip()) for piece in pieces), default=0)


def _fit_cell(cell: str, width: int) -> list[str]:
    """The lines of a cell, at least one."""
    whole = [part for line in cell.splitlines() for part in wrap_text(line, width, 0).splitlines()]
    return [part for line in whole for part in _chop_line(line, width)] or [""]


def _chop_line(line: str, width: int) -> list[str]:
    """A line in pieces of at most so many columns: some characters take two."""
    return chop_cells(line, width) if cell_len(line) > width else [line]


def _pad_text(text: str, width: int, right: bool) -> str:
    """A text in its column."""
    space = " " * (width - cell_len(text))
    return space + text if right else text + space


def _named_cell(name: str, cell: str) -> list[str]:
    lines = cell.splitlines()
    return [f"{name}: {lines[0]}" if name else lines[0], *lines[1:]]
