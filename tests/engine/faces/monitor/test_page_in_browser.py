"""The page in a browser: views, replay and orders. Skipped where NiceGUI, Playwright or Chromium is missing."""

import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.places import TOP

pytest.importorskip("nicegui", reason="needs the extra `monitor`")
browser_of = pytest.importorskip("playwright.sync_api", reason="needs Playwright")
CHROMIUM = shutil.which("chromium")
QUIET = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]
CELLWRIGHT = [sys.executable, "-m", "engine.faces.cli"]


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    store = tmp_path_factory.mktemp("store") / "runs.db"
    words = ["run", "themse/one", "--store", str(store), "--name", "monday", "--fault", "3=not_gripped"]
    subprocess.run([*CELLWRIGHT, *words], cwd=TOP, check=True, capture_output=True)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    serving = [*CELLWRIGHT, "monitor", "monday", "--store", str(store), "--port", str(port)]
    with subprocess.Popen(serving, cwd=TOP, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        _wait_for(port)
        yield address
        process.terminate()


def _wait_for(port: int) -> None:
    until = time.monotonic() + 60
    while time.monotonic() < until:
        with socket.socket() as trial:
            if trial.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise TimeoutError("the monitor does not answer")


@pytest.fixture
def page(address: str) -> Iterator[Any]:
    with browser_of.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=CHROMIUM, args=list(QUIET))
        opened = browser.new_page(viewport={"width": 1280, "height": 720})
        opened.set_default_timeout(20_000)
        opened.asked = []
        opened.on("request", lambda request: opened.asked.append(request.url))
        opened.goto(address)
        opened.wait_for_selector("svg .step")
        yield opened
        browser.close()


def test_every_view_shows_the_run_and_nothing_comes_from_elsewhere(page: Any, address: str) -> None:
    wanted = {
        "plan": "heat(probe_1",
        "world": "stored",
        "diagnosis": "grip_again",
        "objects": "pick(",
        "log": "EXCEPTION",
    }
    for name, text in wanted.items():
        page.locator(f'[data-testid="tab-{name}"]').click()
        page.locator(".q-tab-panel:visible", has_text=text).first.wait_for()
    site = address.partition("/run/")[0]
    assert [each for each in page.asked if not each.startswith((site, "data:"))] == []


def test_the_page_goes_back_to_the_exception_and_shows_a_chosen_step(page: Any) -> None:
    page.locator('[data-testid="exception"]').click()
    page.locator('[data-testid="phase"]', has_text="quiescing").wait_for()
    page.locator('.step[data-step^="heat"]').first.click()
    page.locator('[data-testid="chosen"]', has_text="waits for: press_switch").wait_for()
    page.locator('[data-testid="live"]').click()
    page.locator('[data-testid="phase"]', has_text="reached").wait_for()


def test_an_order_for_a_run_that_is_over_is_refused_with_the_reason(page: Any) -> None:
    page.locator('[data-testid="interrupt"]').click()
    page.locator(".q-notification", has_text="does not go on").wait_for()
