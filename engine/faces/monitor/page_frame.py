"""What every page of the monitor has: its head and script, its layout, and the dark switch."""

import json
from typing import Literal

from nicegui import ui

from cellwright.engine.faces.monitor.cell3d import PLACING_SCRIPT
from cellwright.engine.faces.monitor.shared_state import SharedState

PAGE_SCRIPT = """
async function send(path, content) {
  const answer = await fetch(path, {
    method: "POST",
    headers: {
      "content-type": "application/json",
      "x-cellwright-token": TOKEN,
      "idempotency-key": crypto.randomUUID ? crypto.randomUUID() : String(Math.random()) + Date.now(),
    },
    body: JSON.stringify(content),
  });
  const told = await answer.json();
  emitEvent("told", { ...told, refused: !answer.ok });
  return told;
}
function order(run, name, text) {
  return send("/orders", { run: run, order: name, text: text || "" });
}
function choose(event) {
  const step = event.target.closest && event.target.closest(".step");
  if (step) emitEvent("chosen", step.dataset.step || step.textContent);
}
document.addEventListener("click", choose);
document.addEventListener("keydown", (event) => {
  if (event.key === "Enter") choose(event);
});
"""
PAGE_LAYOUT = """
.nicegui-content { padding: 4px 8px; gap: 4px; }
.split { display: flex; width: 100%; gap: 8px; align-items: flex-start; }
.views { flex: 1; min-width: 0; }
.q-tab-panel { overflow-x: auto; }
.chosen { width: 300px; position: sticky; top: 42px; max-height: calc(100vh - 100px);
  overflow-y: auto; padding: 8px;
  border-left: 3px solid #d02090; overflow-wrap: anywhere; flex-wrap: nowrap; background: white;
  z-index: 2; }
.body--dark .chosen { background: #1d1d1d; }
.body--dark .text-primary, .body--dark a:not(.text-white) { color: #8fc1f2 !important; }
@media (max-width: 1000px) {
  .split { flex-direction: column-reverse; align-items: stretch; }
  .views { width: 100%; }
  .chosen { width: 100%; max-height: 26vh; }
}
"""
BAR_STYLE = "padding: 2px 10px"  # of the head and the foot of a page
PAGE_LINKS = {"runs": "/", "measurements": "/measure", "long work": "/work"}


def page_head(shared: SharedState) -> None:
    """What every page needs in its head."""
    ui.add_css(PAGE_LAYOUT)
    ui.add_head_html(
        f"<script>const TOKEN = {json.dumps(shared.token)};{PAGE_SCRIPT}{PLACING_SCRIPT}</script>"
    )
    ui.colors(primary="#1f5a94")
    ui.on("told", lambda event: show_notice(event.args))


def show_notice(told: dict[str, object]) -> None:
    """Show what came of an order."""
    kind: Literal["warning", "positive"] = "warning" if told.get("refused") else "positive"
    ui.notify(str(told.get("said", "")), type=kind, multi_line=True)


def page_heading(title: str, here: str = "") -> None:
    """The bar on top of a page, with the way to the others; `here` is the one that is shown."""
    with ui.header().classes("items-center gap-4").style(BAR_STYLE):
        for name, address in PAGE_LINKS.items():
            if name != here:
                ui.link(name, address).classes("text-white")
        ui.label(title).classes("text-h6").props('data-testid="title"')
        ui.space()
        dark_switch()


def dark_switch() -> None:
    """A button that changes between light and dark; at first a page is as the browser wants it."""
    mode = ui.dark_mode(None)
    shown = "document.body.classList.contains('body--dark')"

    async def change() -> None:
        mode.value = not await ui.run_javascript(f"return {shown}")

    button = ui.button(icon="contrast", on_click=change)
    button.props('dense flat color="white" aria-label="light or dark" data-testid="dark"')
