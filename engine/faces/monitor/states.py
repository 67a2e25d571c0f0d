"""The net of contact states of a cell, marked as the run stands."""

import asyncio

from nicegui import background_tasks, ui

from cellwright.engine.faces.monitor.choosing import mentions
from cellwright.engine.faces.monitor.reasons import contact_states
from cellwright.engine.faces.monitor.tables import fill, made
from cellwright.engine.faces.monitor.viewing import View, picture

LIT = 'style="filter: drop-shadow(0 0 4px #d02090)" data-chosen="yes"'


class States(View):
    """Where each object is in the net: full places have somebody in them. What is chosen has a rim there."""

    name = "states"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._told = ui.label("").props('data-testid="marking" role="status"')
        with ui.row().classes("w-full items-start no-wrap"):
            self._table = made(self.look.choose, "object", "place", "together with")
            self._table.props('data-testid="inside"')
            self._picture = ui.html("", sanitize=False).props('data-testid="net"').classes("col")
            self._picture.style("overflow: auto; max-height: calc(100vh - 170px); min-width: 0")
        self._found: tuple[str, list[tuple[str, ...]]] = ("", [])
        self._asked = frozenset[str]()
        self._drawn: object = None

    def show(self) -> None:
        """Show the run as it stands. The marking is found in a process of its own."""
        facts = frozenset(self.look.run.holds)
        if facts != self._asked:
            self._asked = facts
            if not self._found[0]:
                self._told.set_text("looking for the contact states of this cell ...")
            background_tasks.create_lazy(self._find(), name=f"states {id(self)}")
        self._draw()

    async def _find(self) -> None:
        shared, run = self.look.shared, self.look.run
        asked = shared.workers.submit(contact_states, shared.target(run.run)[0], self._asked)
        self._found = await asyncio.wrap_future(asked)
        self._told.set_text(f"marked as the run stands after record {run.number}")
        self._draw()

    def _draw(self) -> None:
        drawn, rows = self._found
        if (shown := (drawn, self.look.step)) == self._drawn:
            return
        self._drawn = shown
        chosen = [self.look.step] if self.look.step else []
        for place in sorted({row[1] for row in rows if chosen and mentions(chosen, row[:1])}):
            drawn = drawn.replace(f'data-place="{place}"', f'data-place="{place}" {LIT}')
        self._picture.set_content(picture(drawn))
        fill(self._table, rows, chosen)
