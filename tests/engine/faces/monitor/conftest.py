"""A monitor that is served, and pages of it in a browser.

They are skipped where NiceGUI, Playwright or Chromium is missing, unless CELLWRIGHT_BROWSER is
`required`, as in `.ci/run`.
"""

import importlib.util
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.places import TOP

QUIET = (
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--enable-unsafe-swiftshader",
)
CELLWRIGHT = [sys.executable, "-m", "cellwright.engine.faces.cli"]
PATIENCE_MS = 90_000
Serve = Callable[..., str]


def missing() -> list[str]:
    """What pages cannot be tried without."""
    found = [each for each in ("nicegui", "playwright") if importlib.util.find_spec(each) is None]
    return found + ([] if shutil.which("chromium") else ["Chromium"])


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    if lacks := missing():
        said = f"needs {', '.join(lacks)}"
        if os.environ.get("CELLWRIGHT_BROWSER") == "required":
            pytest.fail(said)
        pytest.skip(said)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=shutil.which("chromium"), args=list(QUIET))
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def serve(chromium: Any) -> Iterator[Serve]:  # noqa: ARG001 - without a browser nothing is served
    running: list[subprocess.Popen[str]] = []

    def served(store: Path, folder: Path, *words: str) -> str:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        command = [*CELLWRIGHT, "monitor", *words, "--store", str(store), "--port", str(port)]
        paths = {**os.environ, "PYTHONPATH": str(TOP)}
        running.append(
            subprocess.Popen(command, cwd=folder, env=paths, stdout=subprocess.DEVNULL, text=True)
        )
        _wait_for(port)
        return f"http://127.0.0.1:{port}"

    yield served
    for each in running:
        each.terminate()
        each.wait(30)


def _wait_for(port: int) -> None:
    until = time.monotonic() + 120
    while time.monotonic() < until:
        with socket.socket() as trial:
            if trial.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise TimeoutError("the monitor does not answer")


@pytest.fixture
def open_page(chromium: Any) -> Iterator[Callable[[str], Any]]:
    opened = []

    def opening(address: str) -> Any:
        page = chromium.new_page(viewport={"width": 1280, "height": 720})
        opened.append(page)
        page.set_default_timeout(PATIENCE_MS)
        page.asked, page.failed = [], []
        page.on("request", lambda request: page.asked.append(request.url))
        page.on("pageerror", lambda error: page.failed.append(str(error)))
        page.goto(address)
        return page

    yield opening
    for page in opened:
        assert page.failed == []
        page.close()


def at(page: Any, name: str, **more: Any) -> Any:
    """The part of a page with a name."""
    return page.locator(f'[data-testid="{name}"]', **more)


def begun(page: Any, **fields: str) -> None:
    """Start a run with the form, and wait for its page."""
    for name, value in fields.items():
        at(page, f"start-{name}").fill(value)
    at(page, "start").click()
    at(page, "title", has_text=fields["name"]).wait_for()


def approved(page: Any) -> list[str]:
    """Approve the plan of a run from its preview; what the preview tells."""
    page.locator('[data-testid="approve"]:enabled').click()
    at(page, "preview").get_by_text(re.compile(r"\(")).first.wait_for()
    told: list[str] = page.locator(".q-dialog .q-card").inner_text().split("\n")
    at(page, "sure-approve").click()
    return told


def started(page: Any, **fields: str) -> list[str]:
    """Start a run, and approve its plan; what the preview tells."""
    begun(page, **fields)
    return approved(page)


def run_there(store: Path, *words: str) -> None:
    """Carry out a run to its end."""
    command = [*CELLWRIGHT, "run", *words, "--store", str(store)]
    subprocess.run(command, cwd=TOP, check=True, capture_output=True)
