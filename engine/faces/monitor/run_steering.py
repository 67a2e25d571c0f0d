"""Steering a run from a page: orders, questions to a person, and the form that starts a run."""

import asyncio
import json
from collections.abc import Callable
from functools import partial
from typing import Any

from nicegui import ui

from cellwright.engine.faces.monitor.run_follower import WatchedRun
from cellwright.engine.faces.monitor.shared_state import SharedState
from cellwright.engine.formats.report.runs.run_report import duration_text, narrate_problem
from cellwright.engine.pipelines.planning.target_files import problem_of
from cellwright.kb.diagnostics import InvalidInput

END_PHASES = ("reached", "partly", "aborted")
MOVING_PHASES = ("running", "interrupting", "quiescing", "handling")
AT_A_PAUSE = ("paused",)
ORDER_BUTTONS = {  # what the button says, what it does, and in which phases it may be pressed
    "interrupt": (
        "Pause",
        "pauses at the end of the current goal, with empty hands",
        MOVING_PHASES,
    ),
    "continue": ("Go on", "goes on after a pause", ("paused", "interrupting")),
    "stop": ("Stop", "stops at once; nothing moves any more", (*MOVING_PHASES, "ready", "paused")),
    "retry": ("Retry", "at a pause: plans on from the world as it is", AT_A_PAUSE),
}
ORDER_ENTRIES = {  # what the entry of the menu says, what is asked for, and in which phases
    "skip": ("Skip a step", "the step that a person has done by hand, by its number", AT_A_PAUSE),
    "back": ("Go back", "the step to go back to, by its number", AT_A_PAUSE),
    "correct": (
        "Correct",
        "facts, separated by ;, with a - before those that do not hold",
        AT_A_PAUSE,
    ),
    "add": ("Add", "a further command, in the words of the domain", (*MOVING_PHASES, "paused")),
    "answer": (
        "Answer",
        "an outcome of the question, or the step that was done",
        (*MOVING_PHASES, "paused"),
    ),
    "abort": ("Abort", "the word abort, to end the run for good", AT_A_PAUSE),
}


class RunSteering:
    """The buttons for one run, and the banner with what it asks."""

    def __init__(self, shared: SharedState, run: str) -> None:
        self.shared, self.run = shared, run
        self._buttons: dict[str, ui.button | ui.menu_item] = {}
        self._phases: dict[str, tuple[str, ...]] = {}
        self._asked: object = None
        for order, (said, does, phases) in ORDER_BUTTONS.items():
            colour = "red" if order == "stop" else "primary"
            button = ui.button(said, color=colour, on_click=lambda _, order=order: self.give(order))
            self._keep(
                order, button.props(f'dense no-caps data-testid="{order}"').tooltip(does), phases
            )
        approve = ui.button("Approve", on_click=self._approve).props(
            'dense no-caps data-testid="approve"'
        )
        self._keep("approve", approve, ("ready",))
        with (
            ui.button("More", color="primary").props('dense no-caps data-testid="more"'),
            ui.menu(),
        ):
            for order, (said, _, phases) in ORDER_ENTRIES.items():
                item = ui.menu_item(said, on_click=lambda _, order=order: self._ask(order))
                self._keep(order, item.props(f'data-testid="{order}"'), phases)
        self._resume = ui.button("Resume", on_click=lambda: self.give("resume"))
        self._resume.props('dense no-caps data-testid="resume"').tooltip(
            "goes on after a stop or a crash"
        )

    def _keep(self, order: str, button: ui.button | ui.menu_item, phases: tuple[str, ...]) -> None:
        button.set_enabled(False)  # until it is known how the run stands
        self._buttons[order], self._phases[order] = button, phases

    def banner(self) -> None:
        """The place for questions, which a page shows above its views."""
        self._banner = (
            ui.column().classes("w-full q-px-sm gap-1").props('data-testid="asks" role="alert"')
        )

    async def give(self, order: str, text: str = "") -> None:
        """Give an order as the page does."""
        words = ", ".join(map(json.dumps, (self.run, order, text)))
        await ui.run_javascript(f"return order({words})", timeout=90.0)

    def show(self, latest: WatchedRun, goes_on: bool) -> None:
        """Offer what can be ordered now, and what is asked."""
        for order, button in self._buttons.items():
            button.set_enabled(
                goes_on and bool(latest.plan) and latest.phase in self._phases[order]
            )
        self._resume.set_visibility(not goes_on and latest.phase not in END_PHASES)
        questions = latest.questions if goes_on else {}
        if (asked := tuple(questions)) == self._asked:
            return
        self._asked = asked
        self._banner.clear()
        with self._banner:
            for number, question in questions.items():
                self._question(number, question)

    def _question(self, number: int, asked: dict[str, Any]) -> None:
        """What a person is asked, with a button for each answer; a step is confirmed when it is
        done.
        """
        with (
            ui.card().classes("w-full q-pa-sm bg-amber-2 text-black"),
            ui.row().classes("items-center"),
        ):
            ui.label(f"? {asked['says'] or asked['action']}").props(
                f'data-testid="question-{number}"'
            )
            choices = asked.get("choices") or ()
            for offered in choices:
                ui.button(
                    offered, on_click=lambda _, each=offered: self.give("answer", each)
                ).props(f'dense no-caps data-testid="choice-{offered}"')
            if not choices:
                ui.button(
                    "It is done", on_click=lambda: self.give("answer", str(asked["action"]))
                ).props('dense no-caps data-testid="confirm"')

    def _ask(self, order: str) -> None:
        said, wanted, _ = ORDER_ENTRIES[order]
        with ui.dialog() as dialog, ui.card():
            ui.label(f"{said}: {wanted}")
            field = ui.input(said).props('autofocus dense data-testid="text"').classes("w-96")
            told = ui.column().classes("gap-0").props('data-testid="understood"')

            async def give() -> None:
                text = str(field.value or "").strip()
                if order == "add" and not await self._goals(text, told):
                    return
                if order != "abort" or text == "abort":
                    dialog.close()
                    await self.give(order, "" if order == "abort" else text)

            with ui.row():
                if order == "add":
                    look = ui.button(
                        "What is understood?", on_click=lambda: self._goals(str(field.value), told)
                    )
                    look.props('dense no-caps outline data-testid="understand"')
                ui.button(said, on_click=give).props('dense no-caps data-testid="give"')
                ui.button("Close", on_click=dialog.close).props("dense no-caps flat")
        dialog.open()

    async def _goals(self, text: str, told: ui.column) -> bool:
        """Show what a command in words is understood as; whether it is understood."""
        about = self.shared.follow(self.run).about
        return await show_understood(str(about.get("target", "")), text, told)

    def _approve(self) -> None:
        """Show the plan before it may begin."""
        run = self.shared.follow(self.run).latest
        with ui.dialog() as dialog, ui.card().classes("w-full"):
            steps = run.plan.get("steps", ())
            ui.label(f"{len(steps)} steps, forecast to take {duration_text(run.end_ms)}").classes(
                "text-h6"
            )
            for goal in run.goals:
                ui.label(f"goal: {goal}")
            with ui.scroll_area().style("height: 45vh").props('data-testid="preview"'):
                for plan_step in sorted(steps, key=lambda each: each.get("start_ms", 0)):
                    ui.label(
                        f"{duration_text(plan_step.get('start_ms', 0))}  {plan_step['stream']}  "
                        f"{plan_step['step']}"
                    )
            with ui.row():
                for said, order in (("Carry it out", "approve"), ("Abort", "abort")):
                    button = ui.button(
                        said, on_click=_closing_action(dialog, partial(self.give, order))
                    )
                    button.props(f'dense no-caps data-testid="sure-{order}"')
                ui.button("Close", on_click=dialog.close).props("dense no-caps flat")
        dialog.open()


def _closing_action(dialog: ui.dialog, then: Callable[[], Any]) -> Callable[[], Any]:
    async def close() -> None:
        dialog.close()
        await then()

    return close


async def show_understood(target: str, text: str, told: ui.column) -> bool:
    """Show the goals of a command in words; whether it is understood."""
    try:
        problem = await asyncio.to_thread(problem_of, target, "", text)
        lines, good = narrate_problem(problem), True
    except InvalidInput as refused:
        lines, good = [str(diagnostic) for diagnostic in refused.diagnostics], False
    told.clear()
    with told:
        for line in lines:
            ui.label(line).classes("" if good else "text-negative").style("white-space: pre-wrap")
    return good


def start_form() -> None:
    """A form that starts a run."""
    with ui.card().classes("w-full q-pa-sm"), ui.row().classes("items-end gap-2"):
        fields = {
            "target": ui.input("target", value="themse/four"),
            "name": ui.input("name of the run"),
            "command": ui.input("command in words").classes("w-80"),
            "factor": ui.input("seconds for a second of the cell", value="0.1"),
            "fault": ui.input("fault, to try: STEP=CAUSE"),
        }
        for name, field in fields.items():
            field.props(f'dense data-testid="start-{name}"')
        approve = ui.checkbox("approve the plan first", value=True).props(
            'dense data-testid="start-approve"'
        )
        told = ui.column().classes("gap-0").props('data-testid="understood"')

        async def look() -> None:
            await show_understood(
                str(fields["target"].value), str(fields["command"].value or ""), told
            )

        async def start() -> None:
            asked = {name: str(field.value or "") for name, field in fields.items()}
            asked |= {
                "order": "start",
                "run": asked.pop("name"),
                "approve": "yes" if approve.value else "",
            }
            answer = await ui.run_javascript(
                f"return send('/orders', {json.dumps(asked)})", timeout=120.0
            )
            if answer and answer.get("open"):
                ui.navigate.to(answer["open"])

        ui.button("What is understood?", on_click=look).props("dense no-caps outline")
        ui.button("Start", on_click=start).props('dense no-caps data-testid="start"')
