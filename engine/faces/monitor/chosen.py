"""The panel that tells of what is chosen, beside every view: what it is, how it stands, and why it is there."""

import asyncio
from typing import Any

from nicegui import background_tasks, ui

from cellwright.engine.faces.monitor.choosing import step_about, told_of
from cellwright.engine.faces.monitor.reasons import reasons
from cellwright.engine.faces.monitor.viewing import Look


class Chosen:
    """A panel, shown while something is chosen: beside the views, or above them where the screen is narrow."""

    def __init__(self, look: Look) -> None:
        self.look = look
        self._told: tuple[object, ...] = ()
        with ui.column().classes("chosen gap-1").props('data-testid="panel"') as self._panel:
            with ui.row().classes("w-full items-center no-wrap"):
                self._name = ui.label("").classes("text-bold col")
                close = ui.button(icon="close", on_click=lambda: self.look.choose(""))
                close.props('dense flat round aria-label="choose nothing" data-testid="unchoose"')
            self._lines = ui.column().classes("gap-1 w-full")
            self._lines.props('data-testid="chosen" role="status"')

    def show(self) -> None:
        """Tell of what is chosen now. Why a step is in the plan takes a moment."""
        look = self.look
        self._panel.set_visibility(bool(look.step))
        lines = [*told_of(look.run, look.step), *self._brought()]
        told = (look.step, *lines, len(look.run.plan.get("steps", ())))
        if told == self._told:
            return
        self._told = told
        self._name.set_text(look.step)
        self._lines.clear()
        with self._lines:
            for line in lines:
                ui.label(line)
        if (step := step_about(look.run, look.step)) is not None:
            background_tasks.create(self._explain(dict(look.run.plan), step, told))

    def _brought(self) -> list[str]:
        """What brought a fact that holds."""
        number = self.look.run.holds.get(self.look.step, 0)
        if not number:
            return []
        content = self.look.follower.records[number - 1].content
        return [f"brought by {content.get('action') or content.get('why') or 'an order'}"]

    async def _explain(self, plan: dict[str, Any], number: int, told: tuple[object, ...]) -> None:
        shared, steps = self.look.shared, {each["id"]: each for each in plan["steps"]}
        asked = (shared.target(self.look.run.run), [steps[each] for each in plan["order"]], number)
        lines = await asyncio.wrap_future(shared.workers.submit(reasons, *asked))
        if told == self._told:
            with self._lines:
                ui.label(f"why {steps[number]['step']} is there:").classes("text-bold")
                for line in lines or ["it brings nothing that a later step needs"]:
                    ui.label(line).props('data-testid="because"')
