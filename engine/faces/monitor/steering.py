"""The buttons that give a run orders. Each is a request of the page itself, so that it carries the token and a key."""

import json

from nicegui import ui

PLAIN = {  # what the button says, and what it does
    "interrupt": ("Pause", "pauses at the end of the current goal, with empty hands"),
    "continue": ("Go on", "goes on after a pause"),
    "stop": ("Stop", "stops at once; nothing moves any more"),
    "approve": ("Approve", "lets a plan begin that waits for it"),
    "retry": ("Retry", "at a pause: tries what is left once more"),
    "abort": ("Abort", "ends the run for good"),
}
WORDED = {  # what is asked for
    "skip": ("Skip a step", "step that a person has done by hand, by its number"),
    "back": ("Go back", "step to go back to, by its number"),
    "correct": ("Correct", "facts, separated by ;, with a - before those that do not hold"),
    "add": ("Add", "a further command, in the words of the domain"),
    "answer": ("Answer", "an outcome that the question allows, or a step; empty for the only open one"),
}
SURE = ("abort",)


def steering(run: str) -> None:
    """The buttons for one run."""
    for order, (said, does) in PLAIN.items():
        colour = "red" if order == "stop" else "primary"
        button = ui.button(said, color=colour).props(f'dense no-caps data-testid="{order}"').tooltip(does)
        sure = f"if (!confirm({json.dumps(f'{run}: {does}?')})) return; " if order in SURE else ""
        button.on("click", js_handler=f"() => {{ {sure}order({json.dumps(run)}, {json.dumps(order)}) }}")
    with ui.button("More", color="primary").props('dense no-caps data-testid="more"'), ui.menu():
        for order, (said, asks) in WORDED.items():
            ask = f"const text = prompt({json.dumps(asks)}); if (text) order({json.dumps(run)}, {json.dumps(order)}, text)"
            item = ui.menu_item(said).props(f'data-testid="{order}"')
            item.on("click", js_handler=f"() => {{ {ask} }}")
