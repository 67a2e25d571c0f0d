"""Pictures of every view of the monitor for both cells, as `docs/monitor.md` shows them.

    python benchmarks/screenshots.py [FOLDER]

Two runs are carried out, served, and shown in Chromium; the pictures go to `docs/monitor`. Needs
the extra `monitor`, Playwright and Chromium.
"""

import argparse
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

CELLWRIGHT = [sys.executable, "-m", "cellwright.engine.faces.cli"]
QUIET = (
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--enable-unsafe-swiftshader",
)
RUNS = {
    "themse": ["themse/one", "--fault", "3=not_gripped"],
    "bulkhead": ["bulkhead/twelve_points"],
}
VIEWS = (
    "now",
    "cell",
    "plan",
    "world",
    "states",
    "sequence",
    "diagnosis",
    "results",
    "objects",
    "log",
    "compare",
)
SIZE = {"width": 1280, "height": 720}


def named(page: Any, name: str) -> Any:
    """The part of a page with a name."""
    return page.locator(f'[data-testid="{name}"]')


def views(page: Any, site: str, run: str, folder: Path) -> None:
    """Show each view of a run, in the middle of it."""
    page.goto(f"{site}/run/{run}")
    named(page, "phase").filter(has_text="reached").wait_for()
    named(page, "tab-cell").click()
    named(page, "motion").filter(has_text="the arm rests").wait_for()
    for _ in range(8):
        page.keyboard.press(",")
    for view in VIEWS:
        named(page, f"tab-{view}").click()
        page.wait_for_timeout(8000 if view == "states" else 1500)
        if view == "compare":
            named(page, "other").click()
            page.locator(".q-menu .q-item").first.click()
            page.wait_for_timeout(1000)
        page.screenshot(path=folder / f"{run}_{view}.png")


def entering(page: Any, site: str, folder: Path) -> None:
    """Pick a point on the part."""
    page.goto(f"{site}/measure/job.yaml")
    page.get_by_role("button", name="left").click()
    page.wait_for_timeout(3000)
    box = page.locator('[data-testid="scene"] canvas').bounding_box()
    page.mouse.dblclick(box["x"] + 0.55 * box["width"], box["y"] + 0.45 * box["height"])
    named(page, "verdict").filter(has_text="measured").wait_for()
    named(page, "add").click()
    page.wait_for_timeout(1500)
    page.screenshot(path=folder / "measurements.png")


def main() -> None:
    """Make the pictures."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument(
        "folder", nargs="?", type=Path, default=Path(__file__).parents[1] / "docs" / "monitor"
    )
    folder: Path = asked.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work, socket.socket() as free:
        store = str(Path(work) / "runs.db")
        for name, words in RUNS.items():
            subprocess.run([*CELLWRIGHT, "run", *words, "--store", store, "--name", name], check=True, stdout=subprocess.DEVNULL)  # fmt: skip
        (Path(work) / "job.yaml").write_text("problem: job\ndomain: bulkhead\ngoals: []\n")
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        free.close()
        serving = [*CELLWRIGHT, "monitor", "--store", store, "--port", str(port)]
        with (
            subprocess.Popen(serving, cwd=work, stdout=subprocess.DEVNULL) as server,
            sync_playwright() as player,
        ):
            while socket.socket().connect_ex(("127.0.0.1", port)):
                time.sleep(0.5)
            browser = player.chromium.launch(
                executable_path=shutil.which("chromium"), args=list(QUIET)
            )
            page = browser.new_page(viewport=SIZE)
            page.set_default_timeout(180_000)
            site = f"http://127.0.0.1:{port}"
            page.goto(site)
            page.wait_for_timeout(2000)
            page.screenshot(path=folder / "runs.png")
            for run in RUNS:
                views(page, site, run, folder)
            entering(page, site, folder)
            browser.close()
            server.terminate()


if __name__ == "__main__":
    main()
