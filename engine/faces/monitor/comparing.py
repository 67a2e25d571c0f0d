"""Two runs side by side, with the first difference marked."""

from itertools import zip_longest

from nicegui import ui

from cellwright.engine.faces.monitor.following import first_difference
from cellwright.engine.faces.monitor.tables import fill, made
from cellwright.engine.faces.monitor.viewing import View
from cellwright.engine.formats.report.execution import duration
from cellwright.engine.formats.report.narration import narrated
from cellwright.engine.model.execution import Record
from cellwright.kb.diagnostics import InvalidInput

AROUND = 200  # rows before the first difference and behind it


class Compared(View):
    """This run beside another one of the store, record by record."""

    name = "compare"

    def make(self) -> None:
        """Make what is shown, still empty."""
        others = [each.run for each in self.look.shared.runs() if each.run != self.look.follower.run]
        self._other = ui.select(others, label="the other run", on_change=self.show)
        self._same: tuple[str, int] = ("", 0)  # the other run, and how many records are known to be the same
        self._other.props('dense options-dense data-testid="other"').classes("w-64")
        self._told = ui.label("").props('data-testid="difference" role="status"')
        self._table = made(self.look.choose, "record", self.look.follower.run, "the other run")

    def show(self) -> None:
        """Show the run as it stands."""
        if not self._other.value:
            self._told.set_text("Choose a run to compare with.")
            return
        try:
            other = self.look.shared.follow(str(self._other.value)).records
        except InvalidInput as refused:
            self._told.set_text(refused.diagnostics[0].message)
            return
        mine = self.look.follower.records
        name, same = str(self._other.value), self._same[1] if self._same[0] == self._other.value else 0
        number = first_difference(mine, other, same)
        self._same = name, number - 1 if number else len(mine)
        alike = "the runs are the same; times do not count"
        self._told.set_text(f"✗ the first difference is record {number}" if number else f"✓ {alike}")
        first, last = max(0, (number or 1) - AROUND), (number or len(mine)) + AROUND
        fill(self._table, [_row(each, number) for each in zip_longest(mine[first:last], other[first:last])])


def _row(pair: tuple[Record | None, Record | None], number: int) -> tuple[str, str, str]:
    one, other = pair
    at = one.number if one is not None else other.number if other is not None else 0
    return f"{'✗ ' if at == number else ''}{at}", _said(one), _said(other)


def _said(record: Record | None) -> str:
    if record is None:
        return "it was over"
    content = record.content
    told = " ".join(narrated(record)) or str(content.get("action") or content.get("text") or "")
    return f"{duration(record.at_ms)} {record.kind.value} {told}"
